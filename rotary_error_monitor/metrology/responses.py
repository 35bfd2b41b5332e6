"""The one place where what an instrument says becomes what the package means by it: blocks, corrected as described."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

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
