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
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
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
    plans: Sequence[CasePlan], announce: Callable[[str], None], progress: Callable[[], None]
) -> Benchmark:
    """Make, diagnose, open and score.

    Args:
        plans: what to make.
        announce: is given the hash of the sealed truth before the first diagnosis.
        progress: called when a case is made, and again when it is diagnosed.

    Raises:
        InputError: a process failed, or the opened truth is not the promised one.
    """
    context = multiprocessing.get_context("spawn")
    maker, maker_end = context.Pipe()
    solver, solver_end = context.Pipe()
    with tempfile.TemporaryDirectory(prefix="gap_benchmark_") as folder:
        workers = (
            context.Process(target=_keep_cases, args=(maker_end, tuple(plans), Path(folder)), daemon=True),
            context.Process(target=diagnose_cases, args=(solver_end,), daemon=True),
        )
        try:
            for worker in workers:
                worker.start()
            for _ in plans:
                _answer(maker)
                progress()
            promised = str(_answer(maker))
            announce(promised)
            answers = [_one_case(plan, solver, Path(folder), progress) for plan in plans]
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
    return Benchmark(opened, tuple(outcomes))


def _one_case(
    plan: CasePlan, solver: Connection, folder: Path, progress: Callable[[], None]
) -> tuple[dict[str, Any], float]:
    place = folder / plan.name
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


def _keep_cases(connection: Connection, plans: tuple[CasePlan, ...], folder: Path) -> None:
    """Process that makes cases: writes bags and twins, and keeps the truth to itself until it is asked for."""
    try:
        truths = []
        for plan in plans:
            truths.append(write_plan(plan, folder / plan.name))
            connection.send(True)
        sealed = json.dumps({"salt": secrets.token_hex(16), "truths": truths})
        connection.send(hashlib.sha256(sealed.encode()).hexdigest())
        connection.recv()
        connection.send(sealed)
    except Exception as error:  # told to the other side, which cannot see this process
        connection.send(error)


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
