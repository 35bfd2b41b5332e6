"""A cell on two hosts, with a network between them that delays, loses and breaks off."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from faults.documenting import Row, shows

from network.cell import MACHINE, SAYINGS
from network.hosts import why_not
from network.judging import Judge
from network.scenario import CUT, SAID, Witness, cut_off_and_rejoined
from rotary_error_monitor.description.wire import load_wire

SPLITS = {
    "estimator and compensation on the far side": ("encoder_head", "autocollimator", "mock_controller"),
    "controller on the far side": ("mock_controller",),
}

pytestmark = [pytest.mark.cell, pytest.mark.skipif(bool(why_not()), reason=why_not() or "-")]

SAMPLES_LOST = Row(
    group="network",
    fault="two computers whose network delays by 15 to 25 ms, lets frames overtake one another and loses one in fifty",
    seen="with `config/fastdds.xml` nodes ask for a message within 10 ms of its loss, and again until it is there; "
    "what is older than the controller's `max_age` is refused there and counted",
    done="the estimator waits for what is late, up to its `patience` of 0.1 s",
    published="complete estimates, as without losses; corrections are some 80 ms old when they reach the controller, "
    "and up to 0.25 s after a loss, which its `max_age` is to allow",
    recovery="nothing to recover from",
)
CUT_OFF = Row(
    group="network",
    fault="the network between two computers breaks off for 3 s",
    seen="by both sides: the controller's node, and the compensation; in the log within 1 s",
    done="corrections are held on both sides",
    published="no corrections; an estimate of what is on the estimator's own side",
    recovery="within 2 s of the end of the cut; what became too old meanwhile is dropped and counted. Where the speed "
    "is another then and no change of speed has shown the drive's delay yet, positioning is uncertain until one does: "
    "`error_estimator: estimate` says by how much",
)


@pytest.mark.few(1)
@shows(SAMPLES_LOST, CUT_OFF)
@pytest.mark.parametrize("far", SPLITS.values(), ids=SPLITS)
def test_a_cell_on_two_hosts_holds_while_they_are_cut_off_and_recovers(far, tmp_path):
    seen = cut_off_and_rejoined(far, tmp_path / "bag")
    assert 0.01 < seen.loss < 0.03
    assert not seen.corrected
    assert seen.status.startswith("held: no ")
    assert seen.whole_again_ns < seen.recovered_ns
    hold_is_said(seen)
    judge = Judge(tmp_path / "bag", load_wire(tuple("abcd")), MACHINE, seen.settings)
    nothing_wrong_is_published(judge, (seen.flowing_ns, seen.cut_ns), seen.recovered_ns)
    what_is_in_effect_is_held(judge, seen.quiet_ns, seen.joined_ns)


def hold_is_said(seen: Witness) -> None:
    """By both sides within a second of the cut, and by both within two of its end that corrections flow again."""
    quiet_ns, recovered_ns = seen.quiet_ns, seen.recovered_ns
    for node, (flows, held) in SAYINGS.items():
        said = seen.said[node]
        assert any(text.startswith(held) and seen.cut_ns < time_ns < quiet_ns for time_ns, text in said), said
        assert not any(text.startswith(flows) and quiet_ns < time_ns < seen.joined_ns for time_ns, text in said), said
        assert any(text.startswith(flows) and seen.joined_ns < time_ns < recovered_ns for time_ns, text in said), said


def nothing_wrong_is_published(judge: Judge, flowing: Sequence[int], recovered_ns: int) -> None:
    """Held against the true stage and machine: estimates at any time, corrections while they flow."""
    estimates, sent = judge.estimates(), judge.corrections("axis_corrections")
    assert len(estimates.wrong) > 1000
    assert estimates.wrong.mean() <= 0.002
    for begin_ns, end_ns in (flowing, (recovered_ns, int(sent.stamp_ns[-1]))):
        part = sent.between(begin_ns, end_ns)
        assert len(part.stamp_ns) > 20
        assert np.median(part.after) < 0.05 * np.median(part.before), "m, with the correction and without"


def what_is_in_effect_is_held(judge: Judge, quiet_ns: int, joined_ns: int) -> None:
    """What the controller has in effect during the cut does not move, and nothing new is sent to it."""
    applied = judge.corrections("applied_corrections").between(quiet_ns, joined_ns)
    expected = min(CUT - SAID, (joined_ns - quiet_ns) * 1e-9) * 20
    assert len(applied.stamp_ns) > 0.8 * expected - 1, "of 20 a second; they come once the network is back"
    assert np.ptp(applied.values, axis=0).max() == 0.0
    sent = judge.corrections("axis_corrections")
    assert not ((sent.arrived_ns > quiet_ns) & (sent.arrived_ns < joined_ns)).any()
