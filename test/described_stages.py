"""Stages by the content of a `stage` section, read as users' are: from a file."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from rotary_error_monitor.description.stage import StageDescription, load_stage


def stage_of(content: Mapping[str, Any]) -> StageDescription:
    """The stage that a file with this section describes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "stage.yaml"
        path.write_text(yaml.safe_dump({"stage": content}, sort_keys=False), encoding="utf-8")
        return load_stage(path)
