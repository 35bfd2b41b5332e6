"""Many tasks at once: by processes that may be ended at any time, and by Dask."""

from __future__ import annotations

import itertools
import multiprocessing
import os
import sys

import pytest
import worker_tasks

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.recordings.workers import Lost, run_all


@pytest.mark.parametrize("jobs", [1, 2])
def test_every_task_has_its_result(jobs):
    assert dict(run_all(worker_tasks.square, range(7), jobs)) == {n: n * n for n in range(7)}
    assert multiprocessing.active_children() == []


def test_processes_are_kept_and_are_no_more_than_tasks():
    answers = dict(run_all(worker_tasks.number_and_process, range(6), 2))
    assert {number for number, _ in answers.values()} == set(range(6))
    assert 1 <= len({process for _, process in answers.values()} - {os.getpid()}) <= 2
    assert list(run_all(worker_tasks.square, (), 2)) == []


def test_a_process_that_is_ended_loses_nothing_but_a_task_that_ends_every_one(tmp_path):
    once, steady = str(tmp_path / "once"), str(tmp_path / "steady")
    (tmp_path / "steady").touch()
    assert dict(run_all(worker_tasks.end_once, [once, steady], 2)) == {once: "once", steady: "steady"}
    ((_, lost),) = run_all(worker_tasks.end_always, [once], 2)
    assert isinstance(lost, Lost) and "ended 2 times (killed" in lost.why


def test_what_a_task_raises_is_raised_here():
    with pytest.raises(ValueError, match="task 0 is wrong"):
        list(run_all(worker_tasks.fail, [0], 2))
    assert multiprocessing.active_children() == []


def test_closing_ends_what_is_at_work(tmp_path):
    answers = run_all(worker_tasks.end_once, _done(tmp_path, 40), 2)
    next(answers)
    assert multiprocessing.active_children()
    answers.close()
    assert multiprocessing.active_children() == []


def _done(folder, count):
    for number in range(count):
        (folder / str(number)).touch()
    return [str(folder / str(number)) for number in range(count)]


def test_without_dask_the_package_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"pip install 'rotary_error_monitor\[trend\]'"):
        next(run_all(worker_tasks.square, [1], 1, "tcp://127.0.0.1:9"))


def test_an_address_without_a_scheduler_is_named(monkeypatch):
    monkeypatch.setattr("rotary_error_monitor.recordings.workers.PATIENCE", 1.0)
    for address in ("tcp://127.0.0.1:9", "nowhere"):
        with pytest.raises(InputError, match=f"--scheduler {address}: no Dask scheduler answers there"):
            next(run_all(worker_tasks.square, itertools.repeat(1, 2), 1, address))
