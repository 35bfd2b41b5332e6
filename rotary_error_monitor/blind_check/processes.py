"""Processes that are asked one question at a time, and answer: those that make cases, and those that diagnose them."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from multiprocessing.connection import Connection, wait
from typing import Any

from rotary_error_monitor.errors import InputError

Answer = Any
"""What one process tells another: text, numbers, or a diagnosis as plain data."""

PATIENCE = 3600.0
"""Time, s, after which a process that does not answer is given up."""

ENDED = "a process of the benchmark ended before its time"


@contextmanager
def processes(target: Callable[..., None], count: int, *arguments: object) -> Iterator[list[Connection]]:
    """So many processes that are given one end of a connection each; the other ends."""
    context = multiprocessing.get_context("spawn")
    pipes = [context.Pipe() for _ in range(count)]
    workers = [context.Process(target=target, args=(end, *arguments), daemon=True) for _, end in pipes]
    try:
        for worker, (_, end) in zip(workers, pipes, strict=True):
            worker.start()
            end.close()  # it has its own: so this side is told when a process ends
        yield [own for own, _ in pipes]
    finally:
        for worker in workers:
            worker.terminate()
        for worker in workers:
            worker.join()


def ask(workers: Sequence[Connection], questions: Sequence[object], answered: Callable[[int], None]) -> list[Answer]:
    """The answers to questions, in their order; each question goes to the process that is free first.

    Args:
        workers: connections to the processes.
        questions: what each is sent; none of them is None.
        answered: is given the place of each question that was answered.

    Raises:
        InputError: a process failed, ended, or does not answer.
    """
    answers: list[Answer] = [None] * len(questions)
    asked: dict[Connection, int] = {}
    free, left = list(workers), iter(range(len(questions)))
    while free or asked:
        for process in free:
            if (place := next(left, None)) is not None:
                _put(process, questions[place])
                asked[process] = place
        free = [each for each in wait(list(asked), PATIENCE) if isinstance(each, Connection)] if asked else []
        if asked and not free:
            raise InputError(f"a process of the benchmark did not answer within {PATIENCE:.0f} s")
        for process in free:
            place = asked.pop(process)
            answers[place] = _answer(process)
            answered(place)
    return answers


def last_words(workers: Sequence[Connection]) -> list[Answer]:
    """What each process says when there is no more to do.

    Raises:
        InputError: a process failed, ended, or does not answer.
    """
    for process in workers:
        _put(process, None)
    return [_answer(process) for process in workers]


def _put(connection: Connection, question: object) -> None:
    try:
        connection.send(question)
    except OSError:
        raise InputError(ENDED) from None


def _answer(connection: Connection) -> Answer:
    if not connection.poll(PATIENCE):
        raise InputError(f"a process of the benchmark did not answer within {PATIENCE:.0f} s")
    try:
        answer = connection.recv()
    except (EOFError, OSError):
        raise InputError(ENDED) from None
    if isinstance(answer, Exception):
        at = "".join(f" at {note}" for note in getattr(answer, "__notes__", ()))
        raise InputError(f"a process of the benchmark failed{at}: {type(answer).__name__}: {answer}")
    return answer
