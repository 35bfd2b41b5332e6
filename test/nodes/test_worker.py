"""The thread of a node: round instants of a clock that may be late, jump or halt."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from std_msgs.msg import Empty

from rotary_error_monitor.nodes.transport import steady_transport
from rotary_error_monitor.nodes.worker import NotByExecutor, Worker
from rotary_error_monitor.testing.domains import own_domain

MS = 1_000_000
DEADLINE = 60.0


class FakeClock:
    def __init__(self) -> None:
        self.now = 0

    def __call__(self) -> int:
        return self.now


def wait_until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + DEADLINE
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.001)


@pytest.fixture
def clock():
    return FakeClock()


@pytest.fixture
def failures():
    return []


@pytest.fixture
def worker(clock, failures):
    worker = Worker(Context(), clock, failures.append)
    yield worker
    worker.stop()
    assert all(thread.name != "worker" for thread in threading.enumerate())


def test_calls_at_multiples_and_reports_the_latest_when_late(worker, clock):
    called: list[int] = []
    worker.at_each(10 * MS, called.append)
    worker.start()
    for now, expected in ((12, [10]), (19, [10]), (20, [10, 20]), (57, [10, 20, 50])):
        clock.now = now * MS
        wait_until(lambda expected=expected: called == [each * MS for each in expected])


def test_nothing_is_called_before_simulated_time_is_known(worker, clock):
    called: list[int] = []
    seen = threading.Event()
    worker.at_each(10 * MS, called.append)
    worker.at_each(MS, lambda _: seen.set())
    worker.start()
    clock.now = 5 * MS
    assert seen.wait(DEADLINE)
    assert called == []


def test_a_clock_that_is_set_back_goes_on(worker, clock):
    called: list[int] = []
    worker.at_each(10 * MS, called.append)
    worker.start()
    clock.now = 1000 * MS
    wait_until(lambda: called == [1000 * MS])
    clock.now = 25 * MS
    wait_until(lambda: called == [1000 * MS, 20 * MS])


def test_what_a_callback_does_not_handle_is_told(worker, clock, failures):
    def fail(_: int) -> None:
        raise ZeroDivisionError("in a callback")

    worker.at_each(MS, fail)
    worker.start()
    clock.now = 5 * MS
    wait_until(lambda: len(failures) == 1)
    assert isinstance(failures[0], ZeroDivisionError)


def test_nothing_to_do_needs_no_thread(worker):
    worker.start()
    assert all(thread.name != "worker" for thread in threading.enumerate())


def test_the_executor_keeps_off():
    group = NotByExecutor()
    assert not group.can_execute(None)
    assert not group.beginning_execution(None)
    group.ending_execution(None)


@pytest.fixture
def context():
    context = Context()
    with own_domain() as number, steady_transport():
        rclpy.init(context=context, domain_id=number, args=[])
        yield context
        context.try_shutdown()


def test_messages_carry_the_number_that_their_publisher_gives_them(context):
    node = Node("numbers", context=context)
    worker = Worker(context, time.time_ns, lambda error: None)
    try:
        publisher = node.create_publisher(Empty, "/numbered", 10)
        subscription = node.create_subscription(Empty, "/numbered", lambda _: None, 10, callback_group=NotByExecutor())
        numbers: list[int | None] = []
        worker.serve(subscription, lambda _, about: numbers.append(about["publication_sequence_number"]))
        worker.start()
        wait_until(lambda: publisher.get_subscription_count() > 0)
        for count in range(1, 4):
            publisher.publish(Empty())
            wait_until(lambda count=count: len(numbers) >= count)
        assert numbers == [1, 2, 3]
    finally:
        worker.stop()
        node.destroy_node()


def test_what_comes_while_it_reckons_shares_the_next_call(context):
    """After each call it rests as long as that took: all that comes meanwhile costs one call more, however much."""
    node = Node("sharing", context=context)
    worker = Worker(context, time.time_ns, lambda error: None)
    taken: list[float] = []
    calls: list[float] = []
    reckoning = 0.004

    def reckon() -> None:
        calls.append(time.monotonic())
        time.sleep(reckoning)

    try:
        publisher = node.create_publisher(Empty, "/often", 1000)
        subscription = node.create_subscription(Empty, "/often", lambda _: None, 1000, callback_group=NotByExecutor())
        worker.serve(subscription, lambda *_: taken.append(time.monotonic()))
        worker.after_messages(reckon)
        worker.start()
        wait_until(lambda: publisher.get_subscription_count() > 0)
        for _ in range(300):
            publisher.publish(Empty())
            time.sleep(0.002)
        wait_until(lambda: len(taken) == 300 and bool(calls) and calls[-1] > taken[-1])
    finally:
        worker.stop()
        node.destroy_node()
    # one for each wake-up, which is as long as its rest, and one for each eight messages of a backlog
    most = (calls[-1] - taken[0]) / (2 * reckoning) + len(taken) / 8 + 1
    assert len(calls) < most, "one after another would be twice as many wake-ups, or one for each message"


def test_messages_gather_until_the_next_instant(context, monkeypatch):
    """They are handed over right before the instant is called, all of them, in their order, at one wake-up."""
    node = Node("gathering", context=context)
    worker = Worker(context, time.time_ns, lambda error: None)
    worker.gather = None
    heard: list[int | None] = []
    wake_ups: list[int] = []
    take = worker._take

    def noted(ready: list) -> None:
        take(ready)
        wake_ups.append(len(heard))

    monkeypatch.setattr(worker, "_take", noted)
    try:
        publisher = node.create_publisher(Empty, "/often", 1000)
        subscription = node.create_subscription(Empty, "/often", lambda _: None, 1000, callback_group=NotByExecutor())
        worker.serve(subscription, lambda _, about: heard.append(about["publication_sequence_number"]))
        worker.at_each(5 * MS, lambda _: None)
        worker.start()
        wait_until(lambda: publisher.get_subscription_count() > 0)
        begin = time.monotonic()
        for _ in range(300):
            publisher.publish(Empty())
            time.sleep(0.001)
        wait_until(lambda: len(heard) == 300)
        instants = (time.monotonic() - begin) / 0.005
    finally:
        worker.stop()
        node.destroy_node()
    assert heard == list(range(1, 301))
    changes = sum(after > before for before, after in itertools.pairwise([0, *wake_ups]))
    assert changes < 1.5 * instants + 2, "one for each instant, and now and then one right before it"
