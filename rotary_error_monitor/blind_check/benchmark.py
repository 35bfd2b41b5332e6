"""The blind check of diagnosis: one process makes cases and keeps the truth, another diagnoses, then both are compared.

The truth never leaves the first process before every diagnosis is done; its hash is printed at the start, so nobody can
say afterwards that it was something else.
"""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import secrets
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from rotary_error_monitor.blind_check.cases import CasePlan, make_case, write_case, write_elsewhere
from rotary_error_monitor.blind_check.scores import Outcome, score_case
from rotary_error_monitor.blind_check.sizes import departure_beyond_uncertainty, sizes_beyond_uncertainty
from rotary_error_monitor.blind_check.solver import diagnose_cases
from rotary_error_monitor.cases.draws import DURATION
from rotary_error_monitor.errors import InputError

Answer = Any
"""What one process tells another: text, numbers, or a diagnosis as plain data."""

PATIENCE = 3600.0
"""Time, s, after which a process that does not answer is given up."""


@dataclass(frozen=True)
class Benchmark:
    """Result of a run: the hash of the opened truth, which is the one told beforehand, and the outcome of each case."""

    opened: str
    outcomes: tuple[Outcome, ...]


def run_benchmark(
    plans: Sequence[CasePlan], announce: Callable[[str], None], progress: Callable[[], None], jobs: int = 1
) -> Benchmark:
    """Make, diagnose, open and score.

    Args:
        plans: what to make.
        announce: is given the hash of the sealed truth before the first diagnosis.
        progress: called when a case is made, and again when it is diagnosed.
        jobs: cases that are made, and then diagnosed, at the same time.

    Raises:
        InputError: a process failed, or the opened truth is not the promised one.
    """
    with tempfile.TemporaryDirectory(prefix="gap_benchmark_") as name:
        folder, questions = Path(name), [(Path(name) / plan.name, plan.left_out) for plan in plans]

        def diagnosed(place: int) -> None:
            shutil.rmtree(questions[place][0])
            progress()

        with _processes(_keep_cases, jobs, folder) as makers:
            _ask(makers, plans, lambda place: progress())
            promised = _joined_hash(_of_each(makers))
            announce(promised)
            with _processes(diagnose_cases, jobs) as solvers:
                answers = _ask(solvers, questions, diagnosed)
            sealed = [str(each) for each in _of_each(makers)]
    opened = _joined_hash([_hash(each) for each in sealed])
    if opened != promised:
        raise InputError(f"the opened truth has hash {opened}, but {promised} was promised")
    truths = {name: truth for each in sealed for name, truth in json.loads(each)["truths"].items()}
    outcomes = [score_case(plan, truths[plan.name], *answer) for plan, answer in zip(plans, answers, strict=True)]
    return Benchmark(opened, tuple(outcomes))


@contextmanager
def _processes(target: Callable[..., None], count: int, *arguments: object) -> Iterator[list[Connection]]:
    """So many processes that are given one end of a connection each; the other ends."""
    context = multiprocessing.get_context("spawn")
    pipes = [context.Pipe() for _ in range(count)]
    workers = [context.Process(target=target, args=(end, *arguments), daemon=True) for _, end in pipes]
    try:
        for worker in workers:
            worker.start()
        yield [own for own, _ in pipes]
    finally:
        for worker in workers:
            worker.terminate()
        for worker in workers:
            worker.join()


def _ask(processes: Sequence[Connection], questions: Sequence[object], answered: Callable[[int], None]) -> list[Answer]:
    """The answers to questions, in their order; each question goes to the process that is free first."""
    answers: list[Answer] = [None] * len(questions)
    asked: dict[Connection, int] = {}
    free, left = list(processes), iter(range(len(questions)))
    while free or asked:
        for process in free:
            if (place := next(left, None)) is not None:
                process.send(questions[place])
                asked[process] = place
        free = [each for each in wait(list(asked), PATIENCE) if isinstance(each, Connection)] if asked else []
        if asked and not free:
            raise InputError(f"a process of the benchmark did not answer within {PATIENCE:.0f} s")
        for process in free:
            place = asked.pop(process)
            answers[place] = _answer(process)
            answered(place)
    return answers


def _of_each(processes: Sequence[Connection]) -> list[Answer]:
    """What each process says when there is no more to do."""
    for process in processes:
        process.send(None)
    return [_answer(process) for process in processes]


def _answer(connection: Connection) -> Answer:
    if not connection.poll(PATIENCE):
        raise InputError(f"a process of the benchmark did not answer within {PATIENCE:.0f} s")
    try:
        answer = connection.recv()
    except EOFError:
        raise InputError("a process of the benchmark ended before its time") from None
    if isinstance(answer, Exception):
        raise InputError(f"a process of the benchmark failed: {type(answer).__name__}: {answer}")
    return answer


def _keep_cases(connection: Connection, folder: Path) -> None:
    """Process that makes cases: writes bags and twins, and keeps the truth to itself until it is asked for."""
    try:
        truths = {}
        while (plan := connection.recv()) is not None:
            truths[plan.name] = write_plan(plan, folder / plan.name)
            connection.send(True)
        sealed = json.dumps({"salt": secrets.token_hex(16), "truths": truths})
        connection.send(_hash(sealed))
        connection.recv()
        connection.send(sealed)
    except Exception as error:  # told to the other side, which cannot see this process
        connection.send(error)


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _joined_hash(hashes: Sequence[str]) -> str:
    """One hash of what several processes keep: their own, where there is one."""
    return hashes[0] if len(hashes) == 1 else _hash("\n".join(hashes))


def write_plan(plan: CasePlan, place: Path) -> dict[str, Any]:
    """Write the case of a plan into a folder, which is made; gives its truth, plain data."""
    case = make_case(plan)
    write_case(case, place)
    if plan.group == "new speed":
        write_elsewhere(case, place, plan.seed)
    truth = case.truth.as_mapping()
    truth["outside"] = [fault.name for fault in case.truth.faults] if plan.kind in ("unknown", "mimic") else []
    truth["sizes"] = sizes_beyond_uncertainty(case, DURATION)
    truth["departure_size"] = departure_beyond_uncertainty(case, DURATION)
    return truth
