"""Records go over the wire and come back the same to the last bit."""

import math
import select

import pytest

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.linuxcnc_controller.protocol import (
    Absent,
    ClearRequest,
    CorrectionRequest,
    End,
    HaltRequest,
    Hello,
    LinkSettings,
    Observation,
    State,
    decode,
    encode,
)

THIRD = 1 / 3


@pytest.mark.parametrize(
    "record",
    [
        Hello(("X", "C")),
        Absent("no LinuxCNC runs here"),
        State(
            1795232049265785191,
            (THIRD, -0.0),
            (1e-300, 0.0),
            True,
            (-THIRD, 1e-9),
            (0.0, -1e-300),
            True,
            (THIRD, 0.0),
            (0.0, 2e-9),
            (1e-6, 0.0),
            True,
            1e-9,
            False,
            "off",
            2,
        ),
        Observation(7, (THIRD,), (1e-17,)),
        End("gone"),
        CorrectionRequest((THIRD, -0.0)),
        HaltRequest(),
        ClearRequest(),
    ],
)
def test_a_record_survives_the_wire(record):
    assert decode(encode(record).rstrip()) == record


@pytest.mark.parametrize(
    "line", [b"Running with fallback_uid", b"{}", b'{"kind": "Nothing"}', b'{"kind": "End"}', b"3"]
)
def test_what_is_no_record_is_refused(line):
    with pytest.raises(InputError, match="no record"):
        decode(line)


def test_a_state_of_nine_axes_is_written_to_a_pipe_whole():
    """What is longer than `PIPE_BUF` may be cut when the pipe is full."""
    nine = (-math.pi * 1e-100,) * 9
    state = State(
        2**62, nine, nine, False, nine, nine, False, nine, nine, nine, False, nine[0], False, "x" * 500, 2**31
    )
    assert len(encode(state)) < select.PIPE_BUF


def test_limits_are_those_of_the_kind_of_axis():
    limits = LinkSettings(largest_rotary=3e-3, speed_linear=1e-3, acceleration_rotary=0.2).course_limits((False, True))
    assert limits.largest == (5e-4, 3e-3)
    assert limits.speed == (1e-3, 2e-2)
    assert limits.acceleration == (0.05, 0.2)
