"""What all stretches of a recording of a stage have in common."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.gap.problem import Conditions
from rotary_error_monitor.kinds.stage.arc import Arc
from rotary_error_monitor.kinds.stage.conditions import stage_conditions
from rotary_error_monitor.kinds.stage.load_cells import ForceNoise, uncertain_forces, uncertain_load_cells
from rotary_error_monitor.kinds.stage.other_twin import OtherTwin
from rotary_error_monitor.kinds.stage.play import Play
from rotary_error_monitor.kinds.stage.rounding import steps_of
from rotary_error_monitor.kinds.stage.warming import uncertain_warmings
from rotary_error_monitor.twin.recording import StageRecording
from rotary_error_monitor.twin.stage import StageInputs, StageTwin


@dataclass(frozen=True)
class OfWhole:
    """What all stretches of a recording have in common: each on its own would make it of the whole again.

    Attributes:
        inputs: what drove the stage.
        steps: of the readings of each stream.
        conditions: of the recording.
        play: after reversals.
        others: twins with what is not known of the inputs.
        force_noise: of the load cells.
        arc: within which the rotor turned.
    """

    inputs: StageInputs
    steps: Mapping[str, float]
    conditions: Conditions
    play: Play
    others: tuple[OtherTwin, ...]
    force_noise: ForceNoise
    arc: Arc

    @classmethod
    def of(cls, stage: StageDescription, recording: StageRecording, twin: StageTwin) -> OfWhole:
        """That of a recording and its twin."""
        forces = (*uncertain_forces(twin, recording), *uncertain_load_cells(twin, recording))
        others = (*uncertain_warmings(twin, recording), *forces)
        steps, play = steps_of(stage, recording), Play(twin.inputs, recording.duration)
        noise = ForceNoise.of(twin, recording)
        return cls(twin.inputs, steps, stage_conditions(recording), play, others, noise, Arc.of(recording))
