"""The same function for many recordings at once: by processes of this computer, or by Dask on others."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from types import ModuleType
from typing import Any, Generic, TypeVar

from rotary_error_monitor.errors import InputError, excerpt

Task = TypeVar("Task")
Result = TypeVar("Result")

ATTEMPTS = 2
"""Times that a task is begun whose worker ended: the first time the system may have ended whatever it found."""

AHEAD = 2
"""Tasks that a scheduler holds for each worker: one at work, and one that has come; more would only wait there."""

PATIENCE = 10.0
"""Time, s, in which a scheduler that is there answers."""


@dataclass(frozen=True)
class Lost:
    """A task without a result, and why: not for what the task is, so that it may be done another time."""

    why: str


Answers = Generator[tuple[Task, Result | Lost], None, None]


def run_all(
    function: Callable[[Task], Result], tasks: Iterable[Task], jobs: int | None = None, scheduler: str | None = None
) -> Answers[Task, Result]:
    """Results as they come, each with its task, in any order; no more of them are held than there are workers.

    Closing the iterator, as Ctrl-C does, ends the workers at once.

    Args:
        function: of a module, so that other processes find it; what it raises ends everything.
        tasks: that can be sent to another process.
        jobs: processes, 1 at least; with 1 this one does it; None for as many as there are processors. A scheduler has
            its own number of them.
        scheduler: address of a Dask scheduler, such as `tcp://host:8786`; None for processes of this computer.

    Raises:
        InputError: Dask is not installed, or no scheduler or worker is at the address.
    """
    if scheduler is not None:
        return _by_dask(function, deque(tasks), scheduler)
    jobs = jobs or len(os.sched_getaffinity(0))
    if jobs == 1:
        return ((task, function(task)) for task in tasks)
    return _Processes(function, deque(tasks), jobs).results()


class _Processes(Generic[Task, Result]):
    """Processes that each have one task at a time: if one ends without a result, it is known of which."""

    def __init__(self, function: Callable[[Task], Result], tasks: deque[Task], jobs: int) -> None:
        self._function = function
        self._waiting = deque((task, 1) for task in tasks)
        self._jobs = min(jobs, len(tasks))
        self._busy: dict[Connection, tuple[BaseProcess, Task, int]] = {}
        self._idle: list[tuple[Connection, BaseProcess]] = []

    def results(self) -> Answers[Task, Result]:
        """As `run_all`."""
        try:
            while self._waiting or self._busy:
                while self._waiting and len(self._busy) < self._jobs:
                    self._begin(*self._waiting.popleft())
                for ready in wait(list(self._busy)):
                    assert isinstance(ready, Connection)
                    yield from self._finished(ready)
        finally:
            self._end()

    def _begin(self, task: Task, attempt: int) -> None:
        connection, process = self._idle.pop() if self._idle else self._started()
        self._busy[connection] = process, task, attempt
        with contextlib.suppress(OSError):  # it has ended: told where its answer would be read
            connection.send(task)

    def _started(self) -> tuple[Connection, BaseProcess]:
        context = multiprocessing.get_context("spawn")  # threads of libraries do not survive a fork
        ours, theirs = context.Pipe()
        process = context.Process(target=_work, args=(self._function, theirs), daemon=True)
        process.start()
        theirs.close()
        return ours, process

    def _finished(self, connection: Connection) -> Answers[Task, Result]:
        process, task, attempt = self._busy.pop(connection)
        try:
            answer = connection.recv()
        except (EOFError, OSError):
            connection.close()
            process.join()
            if attempt < ATTEMPTS:
                self._waiting.append((task, attempt + 1))
            else:
                yield task, Lost(f"its process was ended {attempt} times ({_end_of(process)})")
            return
        self._idle.append((connection, process))
        if isinstance(answer, BaseException):
            raise answer
        yield task, answer

    def _end(self) -> None:
        processes = [(c, process) for c, (process, *_) in self._busy.items()] + self._idle
        for _, process in processes:
            process.terminate()
        for connection, process in processes:
            process.join()
            connection.close()


def _end_of(process: BaseProcess) -> str:
    code = process.exitcode or 0
    if code == -signal.SIGKILL:
        return "killed, as the system does where memory runs out"
    return f"by signal {-code}" if code < 0 else f"exit code {code}"


def _work(function: Callable[[Any], object], connection: Connection) -> None:
    """Process that does one task after another until nobody is at the other end."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the one who gives the tasks, who ends this process
    with contextlib.suppress(EOFError, OSError):
        while True:
            task = connection.recv()
            try:
                answer: object = function(task)
            except Exception as error:  # raised where the results are read
                answer = error
            connection.send(answer)


def _by_dask(function: Callable[[Task], Result], tasks: deque[Task], address: str) -> Answers[Task, Result]:
    distributed = _distributed()
    try:
        client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(
            f"--scheduler {excerpt(address)}: no Dask scheduler answers there "
            f"({excerpt(error) or type(error).__name__}); start one with `dask scheduler` and give its address"
        ) from error
    with client:
        workers = len(client.scheduler_info(n_workers=-1)["workers"])
        if not workers:
            raise InputError(f"--scheduler {excerpt(address)}: it has no worker; start some with `dask worker`")
        under_way: dict[Any, Task] = {}
        ended = distributed.as_completed((), loop=client.loop)
        try:
            while tasks or under_way:
                while tasks and len(under_way) < AHEAD * workers:
                    task = tasks.popleft()
                    future = client.submit(function, task, pure=False)
                    under_way[future] = task
                    ended.add(future)
                future = next(ended)
                yield under_way.pop(future), _answer_of(future, distributed)
        finally:
            client.cancel(list(under_way), force=True)


def _answer_of(future: Any, distributed: ModuleType) -> Any:  # noqa: ANN401  # what a task gives
    if future.status == "cancelled":
        return Lost("the scheduler gave it up")
    error = future.exception()
    if error is None:
        return future.result()
    if isinstance(error, distributed.scheduler.KilledWorker):
        return Lost("the workers that had it ended, one after another")
    raise error


def _distributed() -> ModuleType:
    """The library; it is loaded where a scheduler is asked for."""
    try:
        import distributed
        import distributed.scheduler
    except ImportError:
        raise InputError(
            "--scheduler needs the package distributed: pip install 'rotary_error_monitor[trend]'"
        ) from None
    return distributed
