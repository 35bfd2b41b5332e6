"""The blind check of diagnosis: one process makes cases and keeps the truth, another diagnoses, then both are compared.

The truth never leaves the first process before every diagnosis is done; its hash is printed at the start, so nobody can
say afterwards that it was something else.
"""

from __future__ import annotations

import hashlib
import json
import secrets
import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from rotary_error_monitor.blind_check.cases import CasePlan, make_case, write_case, write_elsewhere
from rotary_error_monitor.blind_check.processes import ask, last_words, processes
from rotary_error_monitor.blind_check.scores import OpenedCase, score_case
from rotary_error_monitor.blind_check.sizes import departure_beyond_uncertainty, sizes_beyond_uncertainty
from rotary_error_monitor.blind_check.solver import diagnose_cases
from rotary_error_monitor.cases.draws import DURATION
from rotary_error_monitor.errors import InputError


@dataclass(frozen=True)
class Benchmark:
    """Result of a run: the hash of the opened truth, which is the one told beforehand, and the outcome of each case."""

    opened: str
    outcomes: tuple[OpenedCase, ...]


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

        with processes(_keep_cases, jobs, folder) as makers:
            ask(makers, plans, lambda place: progress())
            promised = _joined_hash(last_words(makers))
            announce(promised)
            with processes(diagnose_cases, jobs) as solvers:
                answers = ask(solvers, questions, diagnosed)
            sealed = [str(each) for each in last_words(makers)]
    opened = _joined_hash([_hash(each) for each in sealed])
    if opened != promised:
        raise InputError(f"the opened truth has hash {opened}, but {promised} was promised")
    truths = {name: truth for each in sealed for name, truth in json.loads(each)["truths"].items()}
    outcomes = [score_case(plan, truths[plan.name], *answer) for plan, answer in zip(plans, answers, strict=True)]
    return Benchmark(opened, tuple(outcomes))


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
