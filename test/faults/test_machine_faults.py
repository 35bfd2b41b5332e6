"""Faults in joint states and temperature, at random times: a correction is right as it says, or none is given."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from draws import ALL

from faults.documenting import Row, shows
from faults.machine_run import MACHINE, START, Machine, Run, compare, left_over, run
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.verdict import DOUBTS

SEEDS = range(11, 11 + int(os.environ.get("FAULT_SEEDS", "2" if ALL else "1")))
RECOVERY = 1.0
"""Time after the end of a fault within which corrections are again what they would be without it, s."""

TOLD = 0.75
"""Time within which a fault is told here, s: a node looks for what is new every 0.05 s, says it no sooner than 0.2 s
after the last news, and all is to be in `/diagnostics` within 1 s."""

Change = Callable[[dict[str, float], dict[str, float], np.random.Generator], None]
JOINT_FAULTS: dict[str, tuple[Change, str]] = {}
"""What becomes of positions and velocities by axis, and an expression for what is to be said of it."""


def joint_fault(said: str) -> Callable[[Change], Change]:
    def note(change: Change) -> Change:
        JOINT_FAULTS[change.__name__] = (change, said)
        return change

    return note


@joint_fault("axis X at .* m is beyond its travel of")
def beyond_its_travel(q, v, draw):
    q["X"] += draw.choice([-1, 1]) * draw.uniform(0.6, 5.0)


@joint_fault(r"axis Y made a jump of -?0\.0.* m")
def a_jump_within_its_travel(q, v, draw):
    q["Y"] += draw.choice([-1, 1]) * draw.uniform(0.03, 0.1)


@joint_fault("axis A (at .* is beyond its travel|made a jump)")
def a_rotary_axis_off_by_radians(q, v, draw):
    q["A"] += draw.uniform(1.0, 10.0)


@joint_fault("axis [AC] (at .* is beyond its travel|made a jump)")
def degrees_for_radians(q, v, draw):
    for letter in "AC":
        q[letter], v[letter] = math.degrees(q[letter]), math.degrees(v[letter])


@joint_fault("axis [XYZ] (at .* is beyond its travel|made a jump)")
def millimetres_for_metres(q, v, draw):
    for letter in "XYZ":
        q[letter], v[letter] = 1e3 * q[letter], 1e3 * v[letter]


@joint_fault("axis . at nan ")
def not_a_number(q, v, draw):
    q[draw.choice(list("XYZAC"))] = math.nan


@joint_fault("axis . at -?inf ")
def infinite(q, v, draw):
    q[draw.choice(list("XYZAC"))] = draw.choice([math.inf, -math.inf])


@joint_fault(r"axis .* at (1e\+30|-1e\+300) ")
def huge(q, v, draw):
    q[draw.choice(list("XYZAC"))] = draw.choice([1e30, -1e300])


@joint_fault("lacks axis Z")
def an_axis_is_missing(q, v, draw):
    del q["Z"], v["Z"]


@joint_fault("axis [XY] made a jump")
def two_axes_exchanged(q, v, draw):
    q["X"], q["Y"], v["X"], v["Y"] = q["Y"] + 0.02, q["X"] - 0.02, v["Y"], v["X"]


@cache
def healthy(seed: int) -> Run:
    return run(Machine(seed))


def frozen(machine: Machine, begin: float, end: float):
    """Positions that stand, under fresh stamps and with the speeds of the motion."""

    def change(t, q, v):
        return (machine.joint_state(begin)[0], v) if begin <= t < end else (q, v)

    return change


def abrupt(machine: Machine, begin: float) -> tuple[str, float]:
    """The axis of XYZA that comes to a time (s) fastest, by what its brakes take away between two states of 10 ms."""
    moving = {
        axis.letter: abs(float(machine.axis(axis.letter, begin)[1])) / (axis.quickest * 0.01)
        for axis in MACHINE.axes
        if axis.letter != "C"
    }
    letter = max(moving, key=lambda each: moving[each])
    return letter, moving[letter]


def silent(begin: float, end: float):
    def change(t, q, v):
        return None if begin <= t < end else (q, v)

    return change


def drawn(seed: int) -> tuple[np.random.Generator, float, float]:
    draw = np.random.default_rng(1000 + seed)
    begin = draw.uniform(4.0, 5.5)
    return draw, begin, begin + draw.uniform(0.3, 1.5)


def check(seed: int, found: Run, begin: float, end: float, said: str, shown: float | None = None) -> None:
    """Nothing wrong went out, what the expression `said` finds was said in time, and it was over in time.

    Where a fault does not show at its begin, it is said in time from when it is `shown`, s.
    """
    verdict = compare(healthy(seed), found, begin, end)
    assert verdict.wrong == 0.0, verdict
    assert verdict.fastest <= 1.0 + 1e-6, verdict
    assert verdict.recovered <= RECOVERY, verdict
    shown = begin if shown is None else shown
    told = found.told(shown, shown + TOLD)
    assert any(re.search(said, each) for each in told), told


def test_the_healthy_machine_is_corrected_at_full_rate():
    for seed in SEEDS:
        found = healthy(seed)
        assert len(found.corrections) > 600
        assert not [why for t, why in found.held.items() if t > 3.0]


def test_a_correction_is_judged_by_where_it_puts_the_tool():
    """One of the tilting axis alone tilts the tool; against those of linear axes alone it was none."""
    sound = healthy(11)
    for axis in range(len(MACHINE.axes) - 1):
        off = 1e-4 * (np.arange(len(MACHINE.axes)) == axis)
        moved = {stamp: replace(each, values=each.values + off) for stamp, each in sound.corrections.items()}
        assert compare(sound, replace(sound, corrections=moved), 2.0, 3.0).wrong == 1.0
    assert compare(sound, sound, 2.0, 3.0).wrong == 0.0


_RECOVERED = "within 1 s after the first sound joint state"
_HELD = "held; nothing moves"


@shows(
    *(
        Row(
            "joints",
            f"Joint states: {name}",
            "`compensation: correction`: held, the axis, its value and what it can be",
            "not believed; after a jump none is until the axes can have come back or paused for 0.5 s, after"
            " one that their speed allows for 1 s",
            _HELD,
            _RECOVERED,
        )
        for name in ("beyond the travel", "a jump", "degrees for radians", "mm for m", "not finite or huge")
    ),
    Row(
        "joints",
        "Joint states: an axis is missing, or one stands twice",
        "the message is refused, with the name of the axis",
        "not believed",
        _HELD,
        _RECOVERED,
    ),
)
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", JOINT_FAULTS)
def test_what_no_joint_state_can_be_moves_nothing(name, seed):
    draw, begin, end = drawn(seed)
    fixed = draw.integers(1 << 31)
    fault, said = JOINT_FAULTS[name]

    def change(t, q, v):
        if begin <= t < end:
            fault(q, v, np.random.default_rng(fixed))
        return q, v

    check(seed, run(Machine(seed), change), begin, end, said)


@shows(
    Row(
        "joints",
        "Joint states are frozen under fresh stamps",
        "`compensation: correction`: the axis is frozen, it says that it moved so far and stands",
        "not believed once an axis should have gone 1 mm or 1 mrad",
        "until then corrections for a place that is off by no more than that; then held",
        _RECOVERED,
    ),
    Row(
        "joints",
        "Joint states are frozen under fresh stamps, with velocities left out or 0",
        "`compensation: correction`: the axis is frozen, it stood at once from so many m/s",
        "an axis that comes to stand faster than its stated `acceleration` can stop it, with a stamp off by 5 ms,"
        " is not believed until it moves or the controller pauses for 0.5 s; of states 10 ms apart at 5 m/s² that is"
        " one that went at more than 0.06 m/s. A slower one may as well have stopped: positions alone do not tell. The"
        " monitored axis is held against its encoder heads as well, so a driver that freezes while it turns is seen"
        " within 0.05 rad. Where positions go on elsewhere after 20 ms to 2 s, at about what the mean of the speeds"
        " before and after makes of that time, the axis was frozen and not set elsewhere",
        "for 25 ms, or two states, corrections for where it stood; then held. Of a slower axis corrections for where it"
        " stood, without a word, as long as it is frozen: let the driver give velocities, or stop stamping",
        _RECOVERED
        + "; of one that stood before and behind as well, or for longer, with a pause of the joint states of "
        "0.5 s or a reset",
    ),
    Row(
        "joints",
        "Positions of an axis jump to and fro, every second or third joint state",
        "`compensation: correction`: the axis made a jump of so much within so long",
        "after four jumps within 0.5 s a place that the axis can have come back to has to last for 0.5 s",
        "held from the second jump on, but for four states at most",
        _RECOVERED,
    ),
    Row(
        "joints",
        "The rotation of the error motion is in another unit, or another axis's",
        "`compensation: correction`: the axis stands at … by its encoder but at … by the joint states",
        "once encoder and joint states are further apart than `position_tolerance`, they have to agree for 0.3 s: "
        "modulo a turn they come near one another again and again",
        "held",
        _RECOVERED,
    ),
    Row(
        "joints",
        "The controller says that corrections are in effect that cannot be: in mm or degrees",
        "`compensation: correction`: what it says of which axis, and the error limit",
        "beyond the error limit of an axis it is no begin; `~/reset` accepts it, and it goes back at the rate limit",
        "held at the start; while corrections go out, a warning",
        "with what can be in effect, or a reset",
    ),
    Row(
        "joints",
        "Joint states fall silent",
        "`compensation: correction`: no joint states for so many s",
        "the last one counts for 0.5 s, carried on with its speed",
        "held",
        _RECOVERED,
    ),
)
@pytest.mark.parametrize("seed", SEEDS)
def test_joint_states_that_stand_or_end(seed):
    _, begin, end = drawn(seed)
    machine = Machine(seed)
    check(seed, run(machine, frozen(machine, begin, end)), begin, end, "axis . is frozen: it says that it moved")
    silence = "joint states .* s old" if end - begin > 0.6 else ""
    check(seed, run(machine, silent(begin, end)), begin, end, silence)


@shows(
    Row(
        "joints",
        "Positions and velocities of joint states contradict one another: another sign, unit or axis after a pause",
        "`compensation: correction`: the axis goes against its velocity, so far in so long, and what that says; with"
        " corrections, a warning that velocities of an axis are not used",
        "ways of 0.04 s to 0.3 s are held against velocities within 30 ms of them; after a pause axes in motion are not"
        " believed before 0.4 s of it. Of the monitored axis the encoder bears the position out, and where a velocity"
        " steps while positions go on, these are believed; one that was always 0 is one that the driver does not fill"
        " in",
        "held from 0.1 s of motion on; a fast reversal, or an axis below 1 % of its speed, takes 0.5 s or is not seen,"
        " nor are two exchanged axes that go alike. Of an axis that stands nothing is seen until it moves",
        "once the axis has gone as its velocities say for 0.1 s, or with a reset",
    )
)
@pytest.mark.parametrize("seed", SEEDS)
def test_positions_of_another_sign_after_a_pause(seed):
    draw, begin, end = drawn(seed)
    letter, pause = draw.choice(list("XYZA")), 0.6

    def change(t, q, v):
        if begin <= t < begin + pause:
            return None
        return (q | {letter: -q[letter]}, v) if begin + pause <= t < end + pause else (q, v)

    found = run(Machine(seed), change)
    verdict = compare(healthy(seed), found, begin, end + pause)
    assert verdict.wrong == 0.0, verdict
    assert verdict.fastest <= 1.0 + 1e-6, verdict
    told = found.told(begin + pause, begin + pause + TOLD)
    assert any(re.search("against its velocity|not held against|beyond its travel", each) for each in told), told
    assert verdict.recovered <= 1.5 or end + pause + 1.5 > 8.0, verdict


@pytest.mark.parametrize("velocities", ["left out", "zero"])
@pytest.mark.parametrize("together", [True, False])
@pytest.mark.parametrize("seed", SEEDS)
def test_joint_states_that_stand_and_say_nothing_of_speeds(seed, together, velocities):
    machine, (_, begin, end) = Machine(seed), drawn(seed)
    times = begin + 0.01 * np.arange(100)
    begin, end = max((abrupt(machine, t)[1], t, t + end - begin) for t in times.tolist())[1:]
    letter, speed = abrupt(machine, begin)
    if speed < 1.3:
        pytest.skip("no axis of this machine is faster than what it may have braked from")
    still = "XYZA" if together else letter
    standing = machine.joint_state(math.ceil(begin * 100.0) / 100.0)[0]

    def change(t, q, v):
        stands = still if begin <= t < end else ""
        return (
            {k: standing[k] if k in stands else q[k] for k in q},
            {k: 0.0 if k in stands else v[k] for k in v} if velocities == "zero" else {},
        )

    check(seed, run(machine, change), begin, end, "axis . is frozen: it stood at once from")


@shows(
    Row(
        "joints",
        "The first joint states are wrong: all zeros of a driver that is not connected yet, or off by centimetres",
        "`compensation: correction`: no joint states, of a single wrong one; or held, they are not believed",
        "what lasted for less than 0.5 s before a jump gives way to what lasts for 0.5 s after it; what lasted longer"
        " is believed against it",
        "held for 0.5 s from the first right one; before it nothing of a single wrong one, and corrections for where"
        " they say of more",
        "0.5 s after the first sound joint state; of zeros that lasted for longer with a pause of 0.5 s, or a reset",
    )
)
@pytest.mark.parametrize("wrong", ["all zeros", "off by centimetres"])
@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize("seed", SEEDS)
def test_joint_states_that_begin_wrong(seed, count, wrong):
    end = 0.01 * count - 0.005  # before it nothing is known of where the axes go, and that is said

    def change(t, q, v):
        if t > end:
            return q, v
        return (dict.fromkeys(q, 0.0), dict.fromkeys(v, 0.0)) if wrong == "all zeros" else (q | {"X": 0.08 - q["X"]}, v)

    check(seed, run(Machine(seed), change), 0.0, end, "joint states are not believed|no joint states")


@pytest.mark.few(2)
@shows(
    Row(
        "joints",
        "A single joint state is stamped ahead of its time",
        "`compensation: correction`: a jump, where an axis is fast enough for it; those that come before its stamp are"
        " refused as late",
        "the state that fits neither what was before nor what comes after is the wrong one, where those fit each other",
        "until its stamp has passed, corrections for where the axes were; then held for one joint state",
        "with the second joint state after its stamp, where axes go a steady way; of states 0.2 s apart it may need a"
        " pause of 0.5 s, or a reset",
    )
)
@pytest.mark.parametrize("ahead", [0.03, 0.06, 0.09])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_joint_state_that_is_stamped_ahead(seed, ahead):
    _, begin, _ = drawn(seed)
    found = run(Machine(seed), ahead=lambda t: ahead if begin <= t < begin + 0.01 else 0.0)
    verdict = compare(healthy(seed), found, begin, begin + 0.01 + ahead)
    assert verdict.wrong == 0.0, verdict
    assert verdict.recovered <= 0.2, verdict
    assert max(found.corrections) > max(healthy(seed).corrections) - 100 * 1_000_000


def old_again(share: float, begin: float, end: float, draw: np.random.Generator) -> Callable[[float], float]:
    """How far ahead of its time, s, a state is stamped: a share of those up to `end` have the stamp of the begin."""

    def ahead(t: float) -> float:
        return begin - t if begin <= t < end and draw.uniform() < share else 0.0

    return ahead


@shows(
    Row(
        "joints",
        "Joint states repeat an old stamp, all of them for 0.3 s to 1.5 s, or a drawn part of them",
        "`compensation`: refused, not after the one before, counted; of more than 0.5 s `compensation: correction`: no "
        "joint states for so many s",
        "a state with a stamp that was there is not used; the last one counts for 0.5 s, carried on with its speed",
        "corrections by the states between; without any held after 0.5 s",
        "within 1 s after the first sound joint state",
    )
)
@pytest.mark.parametrize("share", [1.0, None], ids=["all", "some"])
@pytest.mark.parametrize("seed", SEEDS)
def test_joint_states_that_repeat_an_old_stamp(seed, share):
    draw, begin, end = drawn(seed)
    part = draw.uniform(0.05, 0.9) if share is None else share
    begin = round(begin, 2)  # of a state that was there
    found = run(Machine(seed), ahead=old_again(part, begin, end, draw))
    check(seed, found, begin, end, "not after the one before")


@shows(
    Row(
        "joints",
        "Temperature out of range, not finite, or changing faster than a machine does",
        "`compensation: correction`: the value and what it can be",
        "not believed; the last one stands in with a growing uncertainty",
        "corrections with the uncertainty that the temperature adds; held beyond `uncertainty_limit`",
        "with the next plausible temperature",
    ),
    Row(
        "joints",
        "Temperature falls silent",
        "`compensation: correction`: no temperature for so many s",
        "the last one stands in with a growing uncertainty",
        "corrections with the uncertainty that the temperature adds; held beyond `uncertainty_limit`",
        "with the next temperature",
    ),
)
@pytest.mark.parametrize(
    ("value", "said"),
    [
        (-300.0, "temperature not believed: -300 °C is beyond its range"),
        (100.0, "temperature not believed: 100 °C is beyond its range"),
        (1e6, r"temperature not believed: 1e\+06 °C is beyond its range"),
        (math.nan, "temperature not believed: nan is not finite"),
    ],
)
@pytest.mark.parametrize("seed", SEEDS)
def test_temperatures(value, said, seed):
    _, begin, end = drawn(seed)
    found = run(Machine(seed), temperature=lambda t, warmth: value if begin <= t < end else warmth)
    check(seed, found, begin, end, said)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_silent_thermometer(seed):
    begin, end = 2.1, 6.1
    soon = replace(MACHINE, limits=replace(MACHINE.limits, temperature_age=2.0))
    found = run(Machine(seed), temperature=lambda t, warmth: None if begin <= t < end else warmth, description=soon)
    check(seed, found, begin, end, "temperature is . s old", begin + soon.limits.temperature_age)


@shows(
    Row(
        "joints",
        "No temperature has come yet",
        "`compensation: correction`: held, no temperature yet",
        "corrections wait for it for 2.5 s (`temperature_patience`); from then on that of reference stands in, as "
        "uncertain as the range of temperatures, which is told as well",
        "held; then corrections with that uncertainty, held where it is larger than `uncertainty_limit`",
        "with the first temperature; its uncertainty falls once others have agreed with it for 0.5 s",
    )
)
@pytest.mark.parametrize("seed", SEEDS)
def test_corrections_wait_for_the_first_temperature(seed):
    machine, waiting, stands_in = Machine(seed), "no temperature yet; after 2.5 s", "no temperature: that of reference"
    for begin, until in ((1.2, 1.5), (math.inf, 2.5)):  # temperatures come every half second
        found = run(machine, temperature=lambda t, warmth, begin=begin: warmth if t >= begin else None)
        held = {why for t, why in found.held.items() if 0.1 < t < until}
        assert len(held) == 1 and held.pop().startswith(waiting)
        assert until - 0.1 < (min(found.corrections) - START) * 1e-9 < until + 0.2
        assert any(why.startswith(stands_in) for _, why in found.said) == math.isinf(begin)
    sure = healthy(seed).uncertain  # how much more depends on where the axes are
    more = [found.uncertain[stamp] / sure[stamp] for stamp in found.uncertain.keys() & sure.keys()]
    assert min(more) >= 1.0 and np.mean(more) > 1.5


def without_tilt(begin: float, end: float, *, doubted: bool) -> Callable[[float, ErrorMotion], ErrorMotion]:
    """What an estimator publishes that hears no autocollimator, or does not believe it."""
    doubt = doubted << DOUBTS.index("autocollimator")
    tilt = np.isin(np.arange(6), (3, 4))

    def change(t: float, motion: ErrorMotion) -> ErrorMotion:
        if not begin <= t < end:
            return motion
        return replace(
            motion,
            observable=motion.observable & ~tilt,
            components=np.where(tilt, 0.0, motion.components),
            covariance=np.where(tilt[:, None] | tilt, 0.0, motion.covariance),
            doubts=np.full(len(motion.times_ns), doubt),
        )

    return change


@shows(
    Row(
        "autocollimator",
        "The autocollimator is lost, or not believed, while corrections flow",
        "`compensation: correction`, a warning: tilt from the description, no autocollimator is heard, or is not used",
        "the machine's description stands in for the tilt, as uncertain as it was off while the tilt was measured",
        "corrections with that uncertainty, in the covariance and in `standard_uncertainty_um`; held where it is larger"
        " than `uncertainty_limit`",
        "with the first estimate that has tilt",
    )
)
@pytest.mark.parametrize("doubted", [False, True], ids=["lost", "doubted"])
@pytest.mark.parametrize("seed", SEEDS)
def test_what_a_lost_autocollimator_costs_is_said(seed, doubted):
    _, begin, end = drawn(seed)
    found, sound = run(Machine(seed), motion=without_tilt(begin, end, doubted=doubted)), healthy(seed)
    words = "the autocollimator is not used" if doubted else "no autocollimator is heard"
    assert f"tilt from the description: {words}" in found.told(begin, begin + TOLD)
    reported = sorted(sound.uncertain.keys() & found.uncertain.keys())
    during = np.array([stamp for stamp in reported if begin + 0.1 < (stamp - START) * 1e-9 < end])
    off = left_over(Machine(seed), found, during)
    spreads = [[each.corrections[stamp].report.covariance for stamp in during] for each in (found, sound)]
    deviations = np.sqrt(np.diagonal(spreads, axis1=2, axis2=3))
    (place, place_before), (tilt, tilt_before) = (
        np.linalg.norm(deviations[:, :, i], axis=2) for i in ([0, 1, 2], [3, 4])
    )
    assert (off <= 6.0 * place).all()
    assert (place > place_before).all() and (tilt > 1.3 * tilt_before).all()
    after = [stamp for stamp in reported if (stamp - START) * 1e-9 > end + 0.1]
    assert [found.uncertain[stamp] for stamp in after] == pytest.approx([sound.uncertain[stamp] for stamp in after])


def test_every_axis_of_the_machine_has_limits():
    assert all(math.isfinite(axis.fastest) and math.isfinite(axis.quickest) for axis in MACHINE.axes)
