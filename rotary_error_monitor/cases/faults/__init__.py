"""Faults of stage and machine by name, in exact geometry: those that the vocabulary names, and others."""

from rotary_error_monitor.cases.faults import axes, instruments, oddities, rotor
from rotary_error_monitor.cases.faults.named import (
    UNNAMED,
    VOCABULARY,
    Named,
    StageFault,
    UnsuitableSeedError,
    make_fault,
)

__all__ = [
    "UNNAMED",
    "VOCABULARY",
    "Named",
    "StageFault",
    "UnsuitableSeedError",
    "axes",
    "instruments",
    "make_fault",
    "oddities",
    "rotor",
]
