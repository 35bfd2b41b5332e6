"""The one place where what an instrument says becomes what the package means by it: blocks, corrected as described."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.response import Response
from rotary_error_monitor.signals.blocks import SampleBlock


def correct_block(block: SampleBlock, fields: Sequence[str], response: Response | None) -> SampleBlock:
    """Block with the values and times that the package means; without a response, or by an ideal one, the same object.

    Args:
        block: as it came from the instrument; it is not changed.
        fields: of the stream, which the response is of; whatever else a block holds stays as it is.
        response: of the instrument.

    Raises:
        InputError: the block lacks one of the fields.
    """
    if response is None or response.is_ideal:
        return block
    rows = block.rows
    if not response.changes_no_value:
        values = response.corrected(block.columns(fields))
        rows = np.array(rows, dtype="<f8")
        rows[:, [block.names.index(name) for name in fields]] = values
    # The stamp alone moves: the distances between samples stay the same to the last bit.
    return SampleBlock(block.stamp_ns - response.latency_ns, block.names, rows)


def distortion_variance(roll: float, stds: Sequence[float], along: Array, across: Array) -> Array:
    """(m,) variance of the x component of a tilt by a distortion that is uncertain, rad^2.

    To first order, about an instrument that hardly distorts. That of the y component follows with the roll negative,
    y for x and x for y.

    Args:
        roll: of the instrument, rad.
        stds: standard uncertainty of its gain difference, its cross-coupling and the cubic term of an axis in 1/rad^2.
        along: (m,) tilt about the component's own axis, rad.
        across: (m,) about the other one.
    """
    difference, coupling, cubic = (std**2 for std in stds)
    cosine, sine = math.cos(roll), math.sin(roll)
    own, other = cosine * along - sine * across, sine * along + cosine * across
    linear = 0.25 * difference * (cosine * own - sine * other) ** 2 + coupling * (cosine * other + sine * own) ** 2
    return np.asarray(linear + cubic * (cosine**2 * own**6 + sine**2 * other**6))
