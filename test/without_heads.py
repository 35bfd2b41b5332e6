"""The stage without read heads that doc/sensors.md shows, as a file."""

from __future__ import annotations

import re
from pathlib import Path

PAGE = Path(__file__).parents[1] / "doc" / "sensors.md"
STREAMS = ("radial_probe_one", "radial_probe_three", "radial_probe_two")


def example(folder: Path) -> Path:
    """The page's example, word by word."""
    section = PAGE.read_text(encoding="utf-8").split("## A stage without read heads")[1]
    block = re.findall(r"^```yaml\n(.*?)^```", section, re.MULTILINE | re.DOTALL)[0]
    path = folder / "three_probes.yaml"
    path.write_text(block, encoding="utf-8")
    return path
