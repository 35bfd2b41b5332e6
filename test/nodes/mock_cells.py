"""Parameters of the nodes of a mock cell in a test."""

from __future__ import annotations

from pathlib import Path

from rotary_error_monitor.sources.mock import MockSettings


def mock_parameters(settings: MockSettings, block_period: float = 0.05, stage: Path | None = None) -> dict[str, object]:
    """What the processes of a cell agree on; by default its stage is the embedded one."""
    shared = {
        "block_period": block_period,
        "mock.seed": settings.seed,
        "mock.epoch": settings.epoch_ns,
        "mock.speeds": list(settings.speeds),
        "mock.forces": settings.forces,
    }
    return shared if stage is None else {"stage": str(stage), **shared}
