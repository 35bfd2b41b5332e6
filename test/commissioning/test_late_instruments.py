"""Instruments that are stamped much later than others: that is put right, and said, for all that follows is late."""

from __future__ import annotations

import pytest
from draws import seeds
from world.newly_built import NewlyBuilt, build
from world.recording import AUTOCOLLIMATOR, COMMAND, Recording, head_topic

from commissioning.judging import Judged, judge
from rotary_error_monitor.signals.blocks import SampleBlock

LATE = 0.03
STREAMS = {"head a": head_topic("a"), "command": COMMAND, "autocollimator": AUTOCOLLIMATOR}


def built(seed: int) -> NewlyBuilt:
    return build(seed, swap=False, duration=24.0, count=4)


def late(recording: Recording, topic: str, delay: float) -> Recording:
    """The recording with one topic stamped later, s."""
    later_ns = round(delay * 1e9)
    blocks = [SampleBlock(each.stamp_ns + later_ns, each.names, each.rows) for each in recording.blocks[topic]]
    return recording.with_topics({topic: (blocks, [when + later_ns for when in recording.arrivals[topic]])})


def said(found: Judged) -> list[str]:
    return [each.text for each in found.result.findings if "later than the earliest instrument" in each.text]


@pytest.mark.parametrize("name", STREAMS)
def test_an_instrument_that_is_very_late_is_named_with_its_delay(name):
    for seed in seeds(3, 1):
        found = judge(built(seed), lambda recording: late(recording, STREAMS[name], LATE))
        (text,) = said(found)
        assert text.startswith(f"{name} is stamped "), text
        told = 1e-3 * float(text.split()[text.split().index("ms") - 1])
        assert told == pytest.approx(LATE, abs=6e-3)  # beside latencies of their own, of up to 5 ms


@pytest.mark.parametrize("delay", [0.0, 0.01])
def test_less_is_no_finding(delay):
    for seed in seeds(3, 1):
        assert not said(judge(built(seed), lambda recording: late(recording, COMMAND, delay)))
