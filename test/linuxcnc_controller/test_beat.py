"""The beat of a servo thread: found to some microseconds at a fraction of a processor, on any period and phase."""

import numpy as np
import pytest

from rotary_error_monitor.linuxcnc_controller.beat import ServoBeat
from rotary_error_monitor.linuxcnc_controller.clock import Moment

SET_NS = 1_700_000_000_000_000_000


class Thread:
    """A servo thread on a grid of its own, a little late each time, and a processor on which looking takes time."""

    def __init__(self, seed, period_ns=1_000_000, late_ns=20_000, look_ns=1_000, oversleep_ns=10_000):
        self.draw = np.random.default_rng(seed)
        self.period_ns, self.late_ns, self.look_ns, self.oversleep_ns = period_ns, late_ns, look_ns, oversleep_ns
        self.now_ns = self.origin_ns = self.beat_ns = int(self.draw.integers(10**12))
        self.slept_ns = self.number = 0
        self.runs = True
        self._plan()

    def _plan(self):
        self.number += 1
        grid_ns = self.origin_ns + self.number * self.period_ns
        self.next_ns = grid_ns + int(self.draw.uniform(0, self.late_ns))

    def pass_by(self, duration_ns):
        self.now_ns += duration_ns
        while self.runs and self.now_ns >= self.next_ns:
            self.beat_ns = self.next_ns
            self._plan()

    def clock(self):
        self.pass_by(self.look_ns)
        return Moment(SET_NS + self.now_ns, self.now_ns)

    def pulse(self):
        self.pass_by(self.look_ns)
        return self.number

    def sleep(self, seconds):
        slept_ns = round(seconds * 1e9) + int(self.draw.uniform(0, self.oversleep_ns))
        self.slept_ns += slept_ns
        self.pass_by(slept_ns)


@pytest.mark.parametrize("period_ns", [500_000, 1_000_000, 2_000_000])
@pytest.mark.parametrize("seed", range(3))
def test_each_beat_is_stamped_when_it_came(seed, period_ns):
    thread = Thread(seed, period_ns)
    servo, errors = ServoBeat(thread.pulse, thread.sleep), []
    servo.wait(thread.clock)
    begin_ns, thread.slept_ns = thread.now_ns, 0
    for _ in range(300):
        thread.pass_by(int(thread.draw.uniform(3e6, 4e6)))  # what else a look does, and the time to the next
        begin_wait_ns = thread.now_ns
        beat = servo.wait(thread.clock)
        assert beat.pulse == thread.number
        assert beat.moment.stamp_ns - beat.moment.steady_ns == SET_NS
        assert beat.moment.steady_ns > begin_wait_ns
        errors.append(beat.moment.steady_ns - thread.beat_ns)
    step_ns = 10_000 + thread.oversleep_ns + 4 * thread.look_ns
    assert np.abs(errors).max() <= step_ns / 2
    assert abs(np.mean(errors)) < 0.1 * step_ns
    assert servo._period_ns == pytest.approx(period_ns, rel=1e-3)
    awake_ns = thread.now_ns - begin_ns - thread.slept_ns - 300 * 3_500_000
    assert awake_ns / (thread.now_ns - begin_ns) < 0.02, "the rest of the time it sleeps"


def test_a_thread_that_stands_is_not_waited_for_and_is_found_again():
    thread = Thread(4)
    servo = ServoBeat(thread.pulse, thread.sleep)
    thread.runs = False
    begin_ns = thread.now_ns
    assert servo.wait(thread.clock) is None, "nothing is known of it yet"
    assert thread.now_ns - begin_ns < 12_000_000
    thread.runs = True
    assert servo.wait(thread.clock) is not None
    thread.runs = False
    begin_ns, thread.slept_ns = thread.now_ns, 0
    assert servo.wait(thread.clock) is None
    assert thread.slept_ns > 0.8 * (thread.now_ns - begin_ns), "others get the processor"
    thread.runs = True
    beat = servo.wait(thread.clock)
    assert abs(beat.moment.steady_ns - thread.beat_ns) < 100_000


def test_a_beat_that_came_while_the_process_had_to_wait_is_not_told(monkeypatch):
    """Which of the moments between two looks that are far apart it was, nobody knows: the next one is told."""
    thread = Thread(5)
    servo = ServoBeat(thread.pulse, thread.sleep)
    servo.wait(thread.clock)
    waits = iter([600_000])

    def pulse():
        if thread.now_ns > thread.next_ns - 50_000:
            thread.pass_by(next(waits, 0))
        return Thread.pulse(thread)

    servo._pulse = pulse
    beat = servo.wait(thread.clock)
    assert abs(beat.moment.steady_ns - thread.beat_ns) < 15_000


@pytest.mark.parametrize("seed", range(3))
def test_a_beat_that_is_late_by_more_than_a_thread_in_real_time_says_so(seed):
    thread = Thread(seed)
    servo, told = ServoBeat(thread.pulse, thread.sleep), []
    for _ in range(30):
        servo.wait(thread.clock)
    for number in range(300):
        thread.pass_by(3_200_000)
        thread.next_ns += int(thread.draw.uniform(20_000, 400_000)) if number % 3 == 0 else 0
        beat = servo.wait(thread.clock)
        assert abs(beat.moment.steady_ns - thread.beat_ns) < 50_000, "it is stamped when it came all the same"
        told.append((beat.on_time, (thread.beat_ns - thread.origin_ns) % thread.period_ns))
    on_time, late_ns = np.array(told).T
    assert late_ns[on_time == 1].max() < 130_000
    assert late_ns[on_time == 0].min() > 70_000
    assert 5 < (on_time == 0).sum() < 100
