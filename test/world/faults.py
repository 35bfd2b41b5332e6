"""All faults by name. Each is called with a recording and a generator, and gives the recording with the fault in it."""

from __future__ import annotations

from .fault import Fault, Injected, registry
from .faults_blocks import BLOCK_FAULTS
from .faults_heads import HEAD_FAULTS
from .faults_others import AUTOCOLLIMATOR_FAULTS, CLOCK_FAULTS, COMMAND_FAULTS

__all__ = ["FAULTS", "Fault", "Injected"]

FAULTS: dict[str, Fault] = registry(
    [*HEAD_FAULTS, *BLOCK_FAULTS, *AUTOCOLLIMATOR_FAULTS, *COMMAND_FAULTS, *CLOCK_FAULTS]
)
