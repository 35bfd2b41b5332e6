"""Gross readings of what drives a stage: of the command, of load cells, of thermometers."""

from __future__ import annotations

import numpy as np
from scipy.integrate import cumulative_trapezoid

from rotary_error_monitor.arrays import Mask
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import COMMAND
from rotary_error_monitor.effects.rotor import HEAD
from rotary_error_monitor.noise.channels import noise_std
from rotary_error_monitor.signals.gross_readings import gross_readings
from rotary_error_monitor.signals.reading_noise import noise_beside_line
from rotary_error_monitor.twin.recording import SignalStream, StageRecording

SEEN = 1e-6
"""Error of a command, rad, that shows where no head does: of 10 µm at order 100 it is a nanometre."""


def without_gross_inputs(stage: StageDescription, recording: StageRecording) -> StageRecording:
    """The recording without gross readings of its inputs, which what lies beside them bridges, and remarks on them.

    A sensor's are told beside what the twin predicts; a twin that follows a wrong input predicts what never was.
    """
    streams, remarks = dict(recording.streams), list(recording.remarks)
    for name in (name for name in recording.streams if name not in recording.sensors):
        stream = streams[name]
        gross = _of_command(stream, noise_std(stage)[HEAD] or SEEN) if name == COMMAND else _of_columns(stream)
        if gross.any():
            remarks.append(f"{name}: spikes left out: {np.count_nonzero(gross)}")
            streams[name] = SignalStream(stream.time[~gross], stream.values[~gross])
    if len(remarks) == len(recording.remarks):
        return recording
    return StageRecording(recording.start_ns, streams, tuple(remarks))


def _of_command(command: SignalStream, least: float) -> Mask:
    """(n,) of speed, and of the angle against what the speeds add up to, however fast the stage turns.

    A command has no noise: what is less than `least`, rad, is none the less nothing that anybody sees.
    """
    wrong = _of_columns(SignalStream(command.time, command.values[:, 1:]), least / command.period)
    sound = np.flatnonzero(~wrong)
    if len(sound) < 2:
        return np.zeros(len(wrong), bool)
    speed = np.interp(command.time, command.time[sound], command.values[sound, 1])
    travelled = cumulative_trapezoid(speed, command.time, initial=0)
    return wrong | _of_columns(SignalStream(command.time, (command.values[:, 0] - travelled)[:, None]), least)


def _of_columns(stream: SignalStream, least: float = 0.0) -> Mask:
    """(n,) whether any component of a reading is gross."""
    noise = np.maximum(noise_beside_line(stream.values), least)
    columns = [gross_readings(stream.values[:, [i]], float(std), stream.period) for i, std in enumerate(noise)]
    return np.asarray(np.any(np.hstack(columns), axis=1), bool)
