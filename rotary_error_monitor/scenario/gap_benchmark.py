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
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.loading import TwinFile, load_problem, load_twin
from rotary_error_monitor.scenario.gap_cases import CasePlan, make_case, write_case
from rotary_error_monitor.scenario.gap_scores import Outcome, score_case

Answer = Any
"""What one process tells another: text, numbers, or a diagnosis as plain data."""

PATIENCE = 3600.0
"""Time, s, after which a process that does not answer is given up."""


@dataclass(frozen=True)
class Benchmark:
    """Result of a run: the hash told beforehand, that of the opened truth, and the outcome of each case."""

    promised: str
    opened: str
    outcomes: tuple[Outcome, ...]


def run_benchmark(
    plans: Sequence[CasePlan], announce: Callable[[str], None], progress: Callable[[], None]
) -> Benchmark:
    """Make, diagnose, open and score.

    Args:
        plans: what to make.
        announce: is given the hash of the sealed truth before the first diagnosis.
        progress: called after each case.

    Raises:
        InputError: a process failed, or the opened truth is not the promised one.
    """
    context = multiprocessing.get_context("spawn")
    maker, maker_end = context.Pipe()
    solver, solver_end = context.Pipe()
    workers = (
        context.Process(target=_keep_cases, args=(maker_end, tuple(plans)), daemon=True),
        context.Process(target=_diagnose_cases, args=(solver_end,), daemon=True),
    )
    with tempfile.TemporaryDirectory(prefix="gap_benchmark_") as folder:
        try:
            for worker in workers:
                worker.start()
            promised = str(_answer(maker))
            announce(promised)
            answers = [_one_case(plan, maker, solver, Path(folder), progress) for plan in plans]
            maker.send(None)
            sealed = str(_answer(maker))
        finally:
            for worker in workers:
                worker.terminate()
                worker.join()
    opened = hashlib.sha256(sealed.encode()).hexdigest()
    if opened != promised:
        raise InputError(f"the opened truth has hash {opened}, but {promised} was promised")
    truths = json.loads(sealed)["truths"]
    outcomes = [score_case(plan, truth, *answer) for plan, truth, answer in zip(plans, truths, answers, strict=True)]
    return Benchmark(promised, opened, tuple(outcomes))


def _one_case(
    plan: CasePlan, maker: Connection, solver: Connection, folder: Path, progress: Callable[[], None]
) -> tuple[dict[str, Any], float]:
    place = folder / plan.name
    maker.send((plan.number, place))
    _answer(maker)
    solver.send((place, plan.left_out))
    diagnosis, seconds = _answer(solver)
    shutil.rmtree(place)
    progress()
    return diagnosis, seconds


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


def _keep_cases(connection: Connection, plans: tuple[CasePlan, ...]) -> None:
    """Process that makes cases: first all truths, for the seal, then each case when it is asked for."""
    try:
        truths = [make_case(plan).truth.as_mapping() for plan in plans]
        hidden = [
            [fault.name for fault in make_case(plan).truth.faults] if plan.kind == "unknown" else [] for plan in plans
        ]
        for truth, names in zip(truths, hidden, strict=True):
            truth["outside"] = names
        sealed = json.dumps({"salt": secrets.token_hex(16), "truths": truths})
        connection.send(hashlib.sha256(sealed.encode()).hexdigest())
        by_number = {plan.number: plan for plan in plans}
        while (request := connection.recv()) is not None:
            number, place = request
            write_case(make_case(by_number[number]), place)
            connection.send(True)
        connection.send(sealed)
    except Exception as error:  # told to the other side, which cannot see this process
        connection.send(error)


def _diagnose_cases(connection: Connection) -> None:
    """Process that diagnoses: sees a bag and a twin, nothing else."""
    while True:
        place, left_out = connection.recv()
        try:
            start = time.perf_counter()
            twin = load_twin(place / "twin.yaml")
            effects: Any = tuple(effect for effect in twin.effects if effect.name not in left_out)
            problem = load_problem(place / "bag", TwinFile(twin.path, twin.description, effects, twin.known))
            diagnosis = diagnose(problem)
            connection.send((diagnosis.as_mapping(), time.perf_counter() - start))
        except Exception as error:  # told to the other side, which cannot see this process
            connection.send(error)
