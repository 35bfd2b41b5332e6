"""An independent world: recordings of rotary stages made from the contract of signals alone, with exact geometry.

`make_recording` makes a healthy recording with the habits of real instruments, `random_stage` a stage to record,
`FAULTS` holds what can go wrong in a recording, `DESCRIPTIONS` what can be wrong in the description of a stage.
"""

from .descriptions import DESCRIPTIONS, Description
from .faults import FAULTS, Fault, Injected
from .options import MOTIONS, Options
from .recording import Recording, samples
from .rotor import Components, Rotor
from .stage import make_recording
from .stages import random_stage

__all__ = [
    "DESCRIPTIONS",
    "FAULTS",
    "MOTIONS",
    "Components",
    "Description",
    "Fault",
    "Injected",
    "Options",
    "Recording",
    "Rotor",
    "make_recording",
    "random_stage",
    "samples",
]
