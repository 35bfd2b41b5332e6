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

from faults.documenting import Row, shows
from faults.machine_run import MACHINE, Machine, Run, compare, run

SEEDS = range(11, 11 + int(os.environ.get("FAULT_SEEDS", "1")))
RECOVERY = 1.0
"""Time after the end of a fault within which corrections are again what they would be without it, s."""

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


@joint_fault("axis Y made a jump of 0.0.* m")
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


@joint_fault("axis .* at (nan|inf|-inf) ")
def not_finite(q, v, draw):
    q[draw.choice(list("XYZAC"))] = draw.choice([math.nan, math.inf, -math.inf])


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


def silent(begin: float, end: float):
    def change(t, q, v):
        return None if begin <= t < end else (q, v)

    return change


def drawn(seed: int) -> tuple[np.random.Generator, float, float]:
    draw = np.random.default_rng(1000 + seed)
    begin = draw.uniform(4.0, 5.5)
    return draw, begin, begin + draw.uniform(0.3, 1.5)


def check(seed: int, found: Run, begin: float, end: float, said: str) -> None:
    """Nothing wrong went out, what the expression `said` finds was said within 1 s, and it was over in time."""
    verdict = compare(healthy(seed), found, begin, end)
    assert verdict.wrong == 0.0, verdict
    assert verdict.fastest <= 1.0 + 1e-6, verdict
    assert verdict.recovered <= RECOVERY, verdict
    told = found.told(begin, max(end, begin + 1.0))
    assert any(re.search(said, each) for each in told), told


def test_the_healthy_machine_is_corrected_at_full_rate():
    for seed in SEEDS:
        found = healthy(seed)
        assert len(found.corrections) > 600
        assert not [why for t, why in found.held.items() if t > 3.0]


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
    check(seed, found, begin, end, "temperature is . s old")


def test_every_axis_of_the_machine_has_limits():
    assert all(math.isfinite(axis.fastest) and math.isfinite(axis.quickest) for axis in MACHINE.axes)
