"""The diagnosis with one of its parts switched off, in a process that is kept from all that makes cases.

Parts are switched off from here, by patches; the product has no switch for any of them.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from multiprocessing.connection import Connection
from unittest.mock import PropertyMock, patch

import numpy as np

from rotary_error_monitor.blind_check.solver import diagnose_case, seal_process
from rotary_error_monitor.gap import judgement, posterior, weighing
from rotary_error_monitor.gap.departures import Departures
from rotary_error_monitor.gap.hypotheses import HypothesisTable
from rotary_error_monitor.kinds.machine import problem as machine
from rotary_error_monitor.kinds.stage import noise_learning, nuisances, of_whole
from rotary_error_monitor.kinds.stage import problem as stage

WHOLE = "nothing"
"""Name of the method with all its parts."""

KINDS = (
    "temperature",
    "lagging temperature",
    "lag",
    "zero",
    "time",
    "direction",
    "speed",
    "load",
    "low speed",
    "after reversals",
    "at rest",
    "little by little",
    "place",
    "orders",
    "another zero",
    "other periods",
    "harmonic",
    "size",
    "settling",
    "course",
)
"""Kinds of departure; those of each axis and of each order, which are several to the method, are one here."""

TOGETHER = {
    "all conditions": ("temperature", "time", "direction", "speed", "load", "low speed"),
    "all forms": ("orders", "harmonic", "size"),
}
"""Kinds that stand in for one another, so that one of them alone is hardly missed."""

PROBLEMS = (stage.StageProblem, machine.MachineProblem)


def _no_departures(stack: ExitStack) -> None:
    for owner in PROBLEMS:
        stack.enter_context(patch.object(owner, "departures", lambda self, causes: ()))


def _no_kinds(kinds: Collection[str], stack: ExitStack) -> None:
    for owner in PROBLEMS:
        stack.enter_context(patch.object(owner, "departures", _others(owner.departures, kinds)))


def _others(departures: Callable, kinds: Collection[str]) -> Callable:
    def others(self, causes):
        return tuple(_at(own, [kind_of(name) not in kinds for name in own.kinds]) for own in departures(self, causes))

    return others


def kind_of(name: str) -> str:
    """That of `KINDS` to which a departure of an axis or an order belongs."""
    return "orders" if name.startswith("order_") else re.sub(r"( of| on)? [A-Z0-9]$", "", name)


def _at(own: Departures, kept: list[bool]) -> Departures:
    """Some of the columns, of which the method chooses in its turn."""
    return own.chosen(np.flatnonzero(kept).tolist())


def _no_price(stack: ExitStack) -> None:
    stack.enter_context(patch.object(posterior, "_shares", lambda fit: np.zeros(len(fit.causes))))


def _no_unknown(stack: ExitStack) -> None:
    """The best set is believed; sets are compared with one another as before."""
    stack.enter_context(patch.object(posterior.Posterior, "probability", PropertyMock(return_value=1.0)))


def _no_learning(stack: ExitStack) -> None:
    """Noise, spectrum of the jitter and outliers are what they are without any cause."""
    for owner in PROBLEMS:
        stack.enter_context(patch.object(owner, "learn_noise", lambda self, causes: False))


def _no_slow_noise(stack: ExitStack) -> None:
    for module in (noise_learning, machine):
        stack.enter_context(patch.object(module, "learn_slow_noise", lambda *arguments: None))


def _no_uncertainty(stack: ExitStack) -> None:
    stack.enter_context(patch.object(nuisances, "uncertain_parameters", lambda description: ()))
    for name in ("uncertain_warmings", "uncertain_forces"):
        stack.enter_context(patch.object(of_whole, name, lambda twin, recording: ()))
    stack.enter_context(patch.object(of_whole, "steps_of", lambda description, recording: {}))
    stack.enter_context(patch.object(machine, "uncertain_shifts", lambda description: ()))


def _no_rivals(stack: ExitStack) -> None:
    """Sets stay as they grew: nothing is exchanged on the table, or when departures are weighed."""
    stack.enter_context(patch.object(HypothesisTable, "exchange", lambda self, start: start))
    for module in (judgement, weighing):
        stack.enter_context(patch.object(module, "rivals_of", lambda step: iter(())))


PARTS: dict[str, Callable[[ExitStack], None]] = {
    WHOLE: lambda stack: None,
    "departures": _no_departures,
    **{f"departures: {kind}": partial(_no_kinds, (kind,)) for kind in KINDS},
    **{f"departures: {words}": partial(_no_kinds, kinds) for words, kinds in TOGETHER.items()},
    "price of departures": _no_price,
    "something unknown": _no_unknown,
    "learning of noise": _no_learning,
    "slow noise": _no_slow_noise,
    "uncertain parameters": _no_uncertainty,
    "rivals": _no_rivals,
}
"""What switches each part off until the stack is left."""


@contextmanager
def without(part: str) -> Iterator[None]:
    """The method without that part."""
    with ExitStack() as stack:
        PARTS[part](stack)
        yield


def diagnose_without(connection: Connection, part: str) -> None:
    """Answer requests (folder, effects left out of the library) until the connection ends.

    The answer is the diagnosis and the time of the processor that it took, s: what else the computer does is no part of
    it.
    """
    seal_process()
    with without(part):
        while True:
            place, left_out = connection.recv()
            begin = time.process_time()
            try:
                diagnosis, _ = diagnose_case(place, left_out)
            except Exception as error:  # told to the other side, which cannot see this process
                connection.send(error)
            else:
                connection.send((diagnosis, time.process_time() - begin))
