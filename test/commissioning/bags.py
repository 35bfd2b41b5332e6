"""Bags and nominal files of newly built stages."""

from __future__ import annotations

from pathlib import Path

import yaml
from described_stages import stage_of
from world.newly_built import NewlyBuilt
from world.recording import Recording

from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.cli import main
from rotary_error_monitor.description.wire import wire_of


def written(built: NewlyBuilt, folder: Path, recording: Recording | None = None) -> tuple[Path, Path]:
    """Bag and nominal file."""
    bag, nominal = folder / "bag", folder / "nominal.yaml"
    nominal.write_text(yaml.safe_dump({"stage": built.nominal}, sort_keys=False), encoding="utf-8")
    blocks = (recording or built.recording).blocks
    write_messages(bag, {topic: each for topic, each in blocks.items() if each}, wire_of(stage_of(built.nominal)))
    return bag, nominal


def run(bag: Path, nominal: Path, output: Path, *words: str) -> int:
    """Exit code of `commission`."""
    return main(["commission", str(bag), "--stage", str(nominal), "-o", str(output), "--date", "2026-11-27", *words])
