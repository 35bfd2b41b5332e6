"""An independent world: recordings of rotary stages made from the contract of signals alone, with exact geometry.

`make_recording` makes a healthy recording with the habits of real instruments, `random_stage` a stage to record,
`FAULTS` holds what can go wrong in a recording, `PROBE_FAULTS` what beside that in one of a stage with displacement
probes (`with_probes`, `with_probes_alone`), `TILT_FAULTS` in one with a second autocollimator (`with_tilt_sensor`),
`DESCRIPTIONS` what can be wrong in the description of a stage.
"""

from .descriptions import DESCRIPTIONS, Description
from .faults import FAULTS, Fault, Injected
from .faults_probes import PROBE_FAULTS, TILT_FAULTS
from .options import MOTIONS, Options
from .probes import with_probes, with_probes_alone, with_tilt_sensor
from .recording import Recording, samples
from .rotor import Components, Rotor
from .stage import make_recording
from .stages import random_stage

__all__ = [
    "DESCRIPTIONS",
    "FAULTS",
    "MOTIONS",
    "PROBE_FAULTS",
    "TILT_FAULTS",
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
    "with_probes",
    "with_probes_alone",
    "with_tilt_sensor",
]
