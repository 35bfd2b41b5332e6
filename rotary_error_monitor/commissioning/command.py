"""The command beside the heads: its zero and its delay against the rotation that they show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.commissioning.heads import ROUNDS, HeadAngles, HeadResponse, earlier, loose, straight_part
from rotary_error_monitor.commissioning.response_fit import basis, fit_response
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import COMMAND
from rotary_error_monitor.metrology.shaft_recording import record_shaft
from rotary_error_monitor.units import TURN


@dataclass(frozen=True)
class CommandFit:
    """The command, counted as the first head counts, less the mean of the heads.

    Attributes:
        constant: at rotation 0, rad, with its standard uncertainty.
        delay: by which it is late against the rotation, s: of its stamps, less the lag of the drive.
        scale: by which it goes faster than the heads, or its clock drifts.
    """

    constant: float
    constant_std: float
    delay: float
    delay_std: float
    scale: float
    scale_std: float


def fit_command(stage: StageDescription, angles: HeadAngles, heads: HeadResponse) -> CommandFit:
    """Zero and delay of the command.

    Raises:
        InputError: command and heads hardly overlap.
    """
    delay = 0.0
    for _ in range(ROUNDS):
        late = dict(zip(heads.names, heads.delays, strict=True)) | {COMMAND: delay}
        shaft = record_shaft(loose(stage), earlier(angles, late), None)
        theta = shaft.readings[:, :-1].mean(axis=1)
        speed = np.gradient(theta, shaft.times)
        turns = max(1.0, float(np.abs(np.diff(theta)).sum()) / TURN)
        wander = stage.timing(COMMAND) * float(np.sqrt((speed**2).mean() / turns))
        values = shaft.readings[:, -1:] - theta[:, None]
        highest = (heads.response.coefficients.shape[1] - 3) // 2
        response = fit_response(basis(theta, speed, highest), values, np.eye(1), wander)
        found = straight_part(response, theta)
        delay += float(found.delay[0])
    return CommandFit(
        float(found.constant[0]),
        float(np.sqrt(found.constant_covariance[0, 0])),
        delay,
        float(np.hypot(np.sqrt(found.delay_covariance[0, 0]), stage.timing(COMMAND))),
        float(found.scale[0]),
        float(np.sqrt(found.scale_covariance[0, 0])),
    )
