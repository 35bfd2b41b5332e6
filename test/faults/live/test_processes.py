"""Each process of a running cell is killed, stopped, restarted: what the others publish stays right, and is said."""

from __future__ import annotations

import signal

import pytest

from faults.documenting import Row, shows
from faults.live.cell import DISCOVERY, NAMES, RIGHT_WITHIN, SAID_WITHIN
from faults.live.other_programs import check

TURN = 8.0
"""Longest time in which the mock stage makes a turn, s: it may stand for 3 s between two at 3 rad/s or more."""

KINDS = ("encoder_head", "autocollimator", "mock_controller", "error_estimator", "compensation")
"""Kinds of processes; of the four heads chance takes one."""

WORDS = {
    **{f"encoder_head_{head}": ("error_estimator: estimate", f"without head_{head}") for head in "abcd"},
    "autocollimator": ("error_estimator: estimate", "not observable: eac, ebc"),
    "mock_controller": ("compensation: correction", "held: no joint states for"),
    "error_estimator": ("compensation: correction", "held: no error motion for"),
    "compensation": ("mock_controller: corrections", "no correction comes on"),
}
"""Who says that a process is gone, and what."""


@shows(
    Row(
        group="processes",
        fault="an encoder head, the autocollimator, the estimator, the compensation or the controller is killed",
        seen="by who listens to it, in `/diagnostics` within 1 s",
        done="a head or the autocollimator: the estimate goes on without it; otherwise corrections are held",
        published="what is left, with the uncertainty that it has then; after 2 s without estimates what the "
        "description alone says",
        recovery="within 1 s of when the middleware has found the successor, which it does within 4 s",
    )
)
@pytest.mark.parametrize("kind", KINDS)
def test_a_process_is_killed_and_started_again(live, chance, kind):
    name = chance.choice([each for each in NAMES if each.startswith(kind)])
    speaker, words = WORDS[name]
    with live.lost() as lost:
        begin_ns = live.clock()
        live.kill(name)
        said = live.wait_for_word(speaker, begin_ns, words)
        check("said", said.stamp_ns - begin_ns, SAID_WITHIN, lost())
    live.start(name)
    with live.lost() as lost:
        end_ns = live.active_ns(name)
        well_ns = live.wait_until_all_is_well(end_ns)
        check("right again", well_ns - end_ns, RIGHT_WITHIN + DISCOVERY, lost())
    live.judge(begin_ns)


@shows(
    Row(
        group="processes",
        fault="an encoder head, the autocollimator, the estimator, the compensation or the controller is stopped for "
        "2 s (SIGSTOP) and goes on",
        seen="as when it is killed",
        done="as when it is killed; what has waited meanwhile is used where it is young enough, else dropped by stamp",
        published="what is left; nothing late",
        recovery="within 1 s",
    )
)
@pytest.mark.parametrize("kind", KINDS)
def test_a_process_is_stopped_for_two_seconds(live, chance, kind):
    name = chance.choice([each for each in NAMES if each.startswith(kind)])
    speaker, words = WORDS[name]
    begin_ns = live.clock()
    with live.lost() as lost:
        live.processes[name].pause()
        said = live.wait_for_word(speaker, begin_ns, words)
        check("said", said.stamp_ns - begin_ns, SAID_WITHIN, lost())
    live.wait(lambda: live.clock() - begin_ns > 2_000_000_000, "two seconds to pass")
    with live.lost() as lost:
        end_ns = live.clock()
        live.processes[name].go_on()
        well_ns = live.wait_until_all_is_well(end_ns)
        check("right again", well_ns - end_ns, RIGHT_WITHIN, lost())
    live.judge(begin_ns)


@pytest.mark.few(2)
@shows(
    Row(
        group="processes",
        fault="all processes are stopped for 2 s and go on one after the other, in any order",
        seen="stamps that are old when they arrive",
        done="what is older than `max_age` (1 s) is not estimated, what is older than `age_limit` (0.2 s) not applied",
        published="nothing meanwhile, nothing late",
        recovery="within 1 s of the last one",
    )
)
@pytest.mark.parametrize("time", range(4))
def test_the_whole_cell_is_stopped_for_two_seconds(live, chance, time):
    """Several times: with the middleware's shared memory, one in five left processes that heard nothing any more."""
    begin_ns = live.clock()
    for name in chance.sample(NAMES, len(NAMES)):
        live.processes[name].pause()
    live.wait(lambda: live.clock() - begin_ns > 2_000_000_000, "two seconds to pass")
    with live.lost() as lost:
        for name in chance.sample(NAMES, len(NAMES)):
            live.processes[name].go_on()
        end_ns = live.clock()
        well_ns = live.wait_until_all_is_well(end_ns)
        check("right again", well_ns - end_ns, RIGHT_WITHIN, lost())
    live.judge(begin_ns)


@shows(
    Row(
        group="processes",
        fault="all processes are ended and started again, in any order",
        seen="by each: what has not come yet is named",
        done="corrections wait until the stage's description has been held against a whole turn, and begin from what "
        "the controller has in effect",
        published="error motion from the second head on, corrections after a turn",
        recovery="within 1 s of the first whole turn after the last process was found",
    )
)
def test_all_are_started_again_in_any_order(live, chance):
    begin_ns = live.clock()
    for name in chance.sample(NAMES, len(NAMES)):
        live.kill(name) if chance.random() < 0.5 else live.processes[name].stop(signal.SIGINT)
    order = chance.sample(NAMES, len(NAMES))
    for name in order:
        live.start(name)
    with live.lost() as lost:
        end_ns = max(live.active_ns(name) for name in order)
        well_ns = live.wait_until_all_is_well(end_ns)
        check("right again", well_ns - end_ns, RIGHT_WITHIN + DISCOVERY + TURN, lost())
    live.judge(begin_ns)
