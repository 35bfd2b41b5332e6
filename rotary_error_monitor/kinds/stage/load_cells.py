"""What a load cell of the shaft as it is sold may be wrong by, as nuisances: its zero, its sensitivity, its filter.

A force that is wrong by them moves what the twin predicts as a drift or another compliance of the stage would.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rotary_error_monitor.description.sensor_section import SHAFT_FORCE
from rotary_error_monitor.description.stage import OWN_LOAD_CELL
from rotary_error_monitor.description.streams import FORCE
from rotary_error_monitor.kinds.stage.other_twin import Diluted, Late, OtherTwin, Pushed
from rotary_error_monitor.twin.recording import StageRecording
from rotary_error_monitor.twin.stage import StageTwin

AS_SOLD = 0.01 / float(np.sqrt(3.0))
"""Standard uncertainty of zero and sensitivity of a load cell of which nobody states one, parts of its rated output.

Data sheets of strain-gauge load cells allow 1 % of each either way, anything within being as likely.
"""


def uncertain_load_cells(twin: StageTwin, recording: StageRecording) -> tuple[OtherTwin, ...]:
    """Twins with one standard uncertainty more of what a load cell is set to; none where no force acts.

    Its rated output is the most that it read, at least. What it reads is filtered below half the rate of its samples,
    which delays it by up to one of them.
    """
    if FORCE not in recording.streams or not np.any(twin.inputs.force(recording.streams[FORCE].time)):
        return ()
    return tuple(OtherTwin(twin, each) for each in _changes(twin, recording))


def _changes(twin: StageTwin, recording: StageRecording) -> Iterator[Pushed | Diluted | Late]:
    read, stated = recording.streams[FORCE], twin.stage.uncertainty
    if not any(sensor.measures == SHAFT_FORCE for sensor in twin.stage.inputs.values()):  # those state their own zero
        zero = stated.get(OWN_LOAD_CELL, AS_SOLD * float(np.abs(read.values).max()))
        # readings within the noise are no force, whatever the zero is
        yield from (Pushed(zero * axis, where_it_acts=True) for axis in np.eye(2))
    yield Diluted(stated.get(f"{OWN_LOAD_CELL}_gain", AS_SOLD))
    yield Late(twin.inputs.force, stated.get(f"{OWN_LOAD_CELL}_timing", read.period))
