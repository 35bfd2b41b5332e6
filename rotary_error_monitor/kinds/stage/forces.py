"""Which force acts on the shaft: that of the load cell of its own topic, or of those that the stage lists."""

from __future__ import annotations

from dataclasses import replace

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import FORCE
from rotary_error_monitor.description.topics import samples_topic
from rotary_error_monitor.metrology.forces import joined_force, load_cell
from rotary_error_monitor.twin.recording import SignalStream, StageRecording

_OWN = samples_topic(FORCE)


def with_shaft_force(stage: StageDescription, recording: StageRecording) -> tuple[StageDescription, StageRecording]:
    """Stage and recording with the force on the shaft as the stream `force`, and listed forces that it is of.

    Those that the stage names count before the load cell of the topic of its own, that before the only one that is
    listed. What is not used is left out of the stage's inputs, and remarks say so.
    """
    if not stage.forces:
        return stage, recording
    names = [name for name in stage.shaft_forces if name in recording.streams]
    own = FORCE in recording.streams
    if own and not stage.force:
        names = []
    streams, remarks = dict(recording.streams), [*recording.remarks, *_remarks(stage, names, own)]
    if names:
        read = [recording.streams[name] for name in names]
        cells = [load_cell(stage.inputs[name]) for name in names]
        streams[FORCE] = SignalStream(
            *joined_force(cells, [each.time for each in read], [each.values for each in read])
        )
    forces = set(stage.forces.values())
    inputs = {name: sensor for name, sensor in stage.inputs.items() if name in names or name not in forces}
    return replace(stage, inputs=inputs), StageRecording(recording.start_ns, streams, tuple(remarks))


def _remarks(stage: StageDescription, names: list[str], own: bool) -> list[str]:
    """Which force is taken for that on the shaft, where there are several to choose from, or one is missing."""
    listed = ", ".join(stage.forces.values())
    if own and not names:
        why = "none that environment.force names is of use" if stage.force else "environment.force names none"
        return [f"force on the shaft: that of {_OWN}, not of {listed}, for {why}"]
    if not names:
        return [f"force on the shaft: none is known, for none of {', '.join(stage.shaft_forces)} is of use"]
    if own or len(names) < len(stage.forces) or len(names) < len(stage.shaft_forces):
        others = [*([_OWN] if own else []), *(name for name in stage.forces.values() if name not in names)]
        missing = [name for name in stage.shaft_forces if name not in names]
        beside = f", not of {', '.join(dict.fromkeys([*others, *missing]))}"
        return [f"force on the shaft: that of {', '.join(names)}{beside}"]
    return []
