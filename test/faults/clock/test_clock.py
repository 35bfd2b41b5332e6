"""Simulated time halts and steps both ways, in a running cell whose truth is a function of that time."""

from __future__ import annotations

import os
import random
import time
from collections.abc import Iterator

import pytest
from rclpy.clock import Clock as RclpyClock
from rclpy.clock_type import ClockType
from rosgraph_msgs.msg import Clock

from faults.documenting import Row, shows
from faults.live.cell import LONGEST_AT_ONE_SPEED, RIGHT_WITHIN, LiveCell
from faults.live.other_programs import check
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.testing import Cell

HOUR = 3600 * 10**9
SAID_WITHIN = 2.0
"""Real time within which a standstill is said, s: it takes two reports of a second to see it."""

TEMPERATURE = 1.0
"""Time, s, until the next temperature comes where the clock was set back: without one the compensation waits."""

TURN = 8.0


class SimulatedTime:
    """Publishes `/clock`, at the pace of real time while it runs."""

    def __init__(self, cell: Cell, begin_ns: int) -> None:
        self.now_ns = begin_ns
        self.runs = True
        self._last = time.monotonic_ns()
        self._publisher = cell.node.create_publisher(Clock, "/clock", 10)
        steady = RclpyClock(clock_type=ClockType.STEADY_TIME)
        cell.node.create_timer(0.01, self._tick, clock=steady)

    def step(self, by_ns: int) -> int:
        """Set the clock; what it shows then."""
        self.now_ns += by_ns
        return self.now_ns

    def _tick(self) -> None:
        now = time.monotonic_ns()
        passed, self._last = now - self._last, now
        if self.runs:
            self.now_ns += passed
            self._publisher.publish(Clock(clock=messages.stamp_from_ns(self.now_ns)))


@pytest.fixture(scope="module")
def seed() -> int:
    return int(os.environ.get("FAULTS_SEED") or random.SystemRandom().randrange(2**31))


@pytest.fixture(scope="module")
def chance(seed: int) -> random.Random:
    return random.Random(seed)


@pytest.fixture(scope="module")
def simulated(seed: int) -> Iterator[tuple[LiveCell, SimulatedTime]]:
    with Cell(parameters={"use_sim_time": True}) as cell:
        clock = SimulatedTime(cell, 1_800_000_000 * 10**9)
        live = LiveCell(cell, seed, clock=lambda: clock.now_ns, before=24 * HOUR)
        live.start_all()
        yield live, clock


@pytest.fixture
def live(simulated: tuple[LiveCell, SimulatedTime], seed: int) -> tuple[LiveCell, SimulatedTime]:
    print(f"to repeat it: FAULTS_SEED={seed}")
    live, clock = simulated
    clock.runs = True
    live.let_run(0.2)
    live.forget()
    live.wait_until_all_is_well(clock.now_ns)
    live.forget()
    return simulated


@shows(
    Row(
        group="processes",
        fault="simulated time stops: `/clock` halts",
        seen="by every node, within 2 s of real time; by the controller at once, for no correction comes",
        done="corrections are held: with the time all that is made in time stands",
        published="nothing",
        recovery="within 1 s of when it goes on",
    )
)
def test_simulated_time_stops(live, chance):
    live, clock = live
    live.let_run(chance.uniform(0.0, 1.0))
    begin_ns, begin = clock.now_ns, time.monotonic()
    clock.runs = False
    with live.lost() as lost:
        for name in ("error_estimator", "compensation", "mock_controller", "encoder_head_c"):
            live.wait_for_word(f"{name}: state", begin_ns - 10**9, "time stands still")
        assert time.monotonic() - begin < lost().allowed(SAID_WITHIN)
    live.wait_for_word("mock_controller: corrections", begin_ns - 10**9, "no correction comes")
    held_ns = live.newest_ns()
    live.let_run(chance.uniform(0.2, 1.0))
    assert live.newest_ns() == held_ns
    clock.runs = True
    with live.lost() as lost:
        well_ns = live.wait_until_all_is_well(begin_ns + 1)
        check("right again", well_ns - begin_ns, RIGHT_WITHIN, lost())
    live.wait_for_word("error_estimator: state", begin_ns + 1, "active", least=0)
    live.judge(begin_ns)


@shows(
    Row(
        group="processes",
        fault="the clock steps, by 0.05 s to a day, forward or back",
        seen="by the stamps; a clock that was set back is said",
        done="what was stamped later is forgotten; a gap is not bridged",
        published="nothing of the time between; what is right from the new time on",
        recovery="back: within 1 s of the next temperature; forward: within 1 s; where the stage turns at another "
        "speed since, once a change of speed has shown the drive's delay",
    )
)
@pytest.mark.parametrize("sign", [1, -1, 1, -1, 1, -1])
def test_the_clock_steps(live, chance, sign):
    live, clock = live
    size = 10 ** chance.uniform(-1.3, 4.3)
    print(f"a step of {sign * size:.3f} s")
    live.forget()
    since_ns = clock.step(round(sign * size * 1e9))
    with live.lost() as lost:
        well_ns = live.wait_until_all_is_well(since_ns)
        patience = RIGHT_WITHIN + (TEMPERATURE if sign < 0 else 0.0)
        told_ns = live.last_said_ns("error_estimator: estimate", since_ns, "until a change of speed shows")
        check("right again", well_ns - min(told_ns, well_ns), patience, lost())
        check("right again since the step", well_ns - since_ns, LONGEST_AT_ONE_SPEED + patience, lost())
    live.let_run(1.0)
    live.judge(since_ns)
