"""The embedded stage with sensors in its list, as a file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from rotary_error_monitor.resources import config


def stage_that_lists(folder: Path, sensors: Mapping[str, Mapping[str, Any]]) -> Path:
    """File of the embedded stage with these sensors."""
    content = yaml.safe_load(config("stage.yaml").read_text(encoding="utf-8"))
    content["stage"]["sensors"] = dict(sensors)
    path = folder / "stage.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return path
