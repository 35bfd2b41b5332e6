"""Stages by the content of a `stage` section, read as users' are: from a file; and what was recorded of them."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from rotary_error_monitor.description.stage import StageDescription, load_stage
from rotary_error_monitor.description.topics import stream_of_topic
from rotary_error_monitor.signals.blocks import SampleBlock

DUMPER = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
"""In C, as the package reads: thousands of stages are written."""


def stage_of(content: Mapping[str, Any]) -> StageDescription:
    """The stage that a file with this section describes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "stage.yaml"
        path.write_text(yaml.dump({"stage": content}, Dumper=DUMPER, sort_keys=False), encoding="utf-8")
        return load_stage(path)


def by_stream(blocks: Mapping[str, Sequence[SampleBlock]]) -> dict[str, Sequence[SampleBlock]]:
    """Blocks of topics by their streams."""
    return {stream: each for topic, each in blocks.items() if (stream := stream_of_topic(topic)) is not None}
