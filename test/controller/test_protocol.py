"""Records go over the wire and come back the same to the last bit."""

import pytest

from rotary_error_monitor.controller.protocol import (
    ClearRequest,
    CorrectionRequest,
    End,
    Hello,
    Observation,
    State,
    decode,
    encode,
)
from rotary_error_monitor.errors import InputError

THIRD = 1 / 3


@pytest.mark.parametrize(
    "record",
    [
        Hello(("X", "C")),
        State(1795232049265785191, (THIRD, -0.0), (1e-300, 0.0), True, (THIRD, 0.0), 1e-9, False, "off", "", 2, 0.1),
        Observation(7, (THIRD,), (1e-17,)),
        End("gone"),
        CorrectionRequest(9, {"X": THIRD}),
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
