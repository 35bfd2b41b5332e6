"""The process of the blind check that diagnoses: it is given bags and twins, and kept from all that makes cases."""

from __future__ import annotations

import re
import sys
import time
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.gap.diagnosis import DiagnosisResult, diagnose
from rotary_error_monitor.gap.loading import AnyTwinFile, load_problem, load_twin
from rotary_error_monitor.gap.normal import stack, width_of
from rotary_error_monitor.gap.problem import Problem

REFUSED = "refused"
"""In place of a verdict: the recording or its twin was not accepted, which of a case is always wrong."""

_MAKERS = re.compile(r"rotary_error_monitor\.(plant|blind_check\.(cases|sizes|benchmark|scores))(\.|$)")
_OTHER_PROCESS = re.compile(r"/proc/(\d+|self|thread-self)/(mem|cmdline|environ|fd|map_files)")


def seal_process() -> None:
    """From now on this process can neither load what makes cases nor look into another process.

    Raises:
        PermissionError: what makes cases is loaded already.
    """
    loaded = [name for name in sys.modules if _MAKERS.match(name)]
    if loaded:
        raise PermissionError(f"a process that diagnoses blindly has loaded {loaded[0]}")
    sys.addaudithook(_refuse)


def _refuse(event: str, arguments: tuple[Any, ...]) -> None:
    if event == "import" and _MAKERS.match(str(arguments[0])):
        raise PermissionError(f"a process that diagnoses blindly may not load {arguments[0]}")
    if event == "open" and _OTHER_PROCESS.match(str(arguments[0])):
        raise PermissionError(f"a process that diagnoses blindly may not read {arguments[0]}")


def diagnose_cases(connection: Connection) -> None:
    """Answer requests (folder, effects left out of the library) until the connection ends."""
    seal_process()
    while True:
        place, left_out = connection.recv()
        try:
            connection.send(diagnose_case(place, left_out))
        except Exception as error:  # told to the other side, which cannot see this process
            error.add_note(place.name)
            connection.send(error)


def diagnose_case(place: Path, left_out: tuple[str, ...] = ()) -> tuple[dict[str, Any], float]:
    """Diagnosis of a case as plain data, and the time that it took, s.

    Where the folder holds a second recording of the same stage (`elsewhere`), the gap there with the causes as found on
    the first one is added under that name. A case that is refused has the reason as its `refusal`.
    """
    start = time.perf_counter()
    twin = load_twin(place / "twin.yaml")
    effects = tuple(effect for effect in twin.effects if effect.name not in left_out)
    known = replace(twin, effects=effects)
    try:
        diagnosis = diagnose(load_problem(place / "bag", known))
    except InputError as error:
        return _refused(str(error)), time.perf_counter() - start
    seconds = time.perf_counter() - start
    content = diagnosis.as_mapping()
    if (place / "elsewhere").exists():
        content["elsewhere"] = _gap_elsewhere(place / "elsewhere", known, diagnosis)
    return content, seconds


def _refused(reason: str) -> dict[str, Any]:
    """What stands in place of the diagnosis of a case that is refused."""
    return {
        "verdict": REFUSED,
        "refusal": reason,
        "causes": [],
        "indistinguishable": [],
        "where": [],
        "gap": {"shrink": 0.0},
    }


def _gap_elsewhere(bag: Path, twin: AnyTwinFile, diagnosis: DiagnosisResult) -> dict[str, float]:
    problem = load_problem(bag, twin)
    causes = tuple(found.cause for found in diagnosis.causes)
    return {"before": _rms(problem, ()), "after": _rms(problem, causes)}


def _rms(problem: Problem, causes: tuple[Cause, ...]) -> float:
    """Root mean square of white rows; causes are not sized anew, uncertain parameters within their uncertainty."""
    nuisance = problem.nuisance(causes)
    whole = stack(problem, problem.residual(causes), [nuisance]).total()
    return float((whole.without(width_of(nuisance)).power / whole.count) ** 0.5)
