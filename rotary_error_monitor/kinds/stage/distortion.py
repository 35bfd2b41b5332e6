"""How far effects show otherwise beside causes that scale, delay or turn what the sensors see."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.effects.rotor import HEAD, StageEffect
from rotary_error_monitor.gap.problem import Candidate
from rotary_error_monitor.twin.stage import StageTwin, turned_by

_LOOKS = 400
"""Instants of a recording at which it is looked at: only its size matters."""

_Acting = list[tuple[Cause, StageEffect]]


def distortions(twin: StageTwin, candidates: Sequence[Candidate], causes: Sequence[Cause]) -> list[float]:
    """For each candidate the part of its signature that is another beside the causes than alone.

    What itself rescales a signal is all another one once the signal has changed. Where a cause rescales a signal that
    the candidate is seen in, it is the part by which that signal changes; where causes delay or turn the rotor, the
    phase by which the candidate's wave is moved.
    """
    if not causes:
        return [0.0] * len(candidates)
    acting = [(cause, cause.effect) for cause in causes if isinstance(cause.effect, StageEffect)]
    time = np.linspace(*twin.span, _LOOKS)
    scaling = [cause for cause, effect in acting if effect.rescales]
    scaled = changes(thin_twin(twin, tuple(twin.times)), (), scaling) if scaling else {}
    turned = {name: _turned(twin, time, acting, name) for name in twin.times}
    found = []
    for candidate in candidates:
        effect = candidate.effect
        assert isinstance(effect, StageEffect)
        place = effect.slices().get("order")
        order = 1.0 if place is None else float(candidate.start[place][0])
        seen = [name for name in twin.times if effect.touches(candidate.location, name)]
        parts = (max(scaled.get(name, 0.0), order * turned[name]) for name in seen)
        found.append(np.inf if effect.rescales else max(parts, default=0.0))
    return found


def thin_twin(twin: StageTwin, streams: Sequence[str]) -> StageTwin:
    """A twin at few instants of some streams, for `changes`."""
    time = np.linspace(*twin.span, _LOOKS)
    return StageTwin(twin.stage, twin.inputs, dict.fromkeys(streams, time), known=twin.known)


def changes(thin: StageTwin, before: Sequence[Cause], after: Sequence[Cause]) -> Mapping[str, float]:
    """Part of each signal, beside the command, that is another with the one set of causes than with the other."""
    command = np.asarray(thin.inputs.command(next(iter(thin.times.values()))), np.float64)[:, None]
    old, new, found = thin.predict(before), thin.predict(after), {}
    for name, values in old.items():
        signal = values - command if name.startswith(f"{HEAD}_") else values
        swing = float(np.linalg.norm(signal - signal.mean(axis=0)))
        change = float(np.linalg.norm(new[name] - values))
        found[name] = change / swing if swing else np.inf if change else 0.0
    return found


def _turned(twin: StageTwin, time: Array, acting: _Acting, stream: str) -> float:
    """Largest angle, rad, by which the rotor is seen elsewhere in a stream."""
    moving = [(c, e) for c, e in acting if e.moves_rotor and e.touches(c.location, stream)]
    if not moving:
        return 0.0
    delay = sum(effect.delay(cause.values, cause.location) for cause, effect in moving)
    state = twin.state_at(time, delay)
    return float(np.max(np.abs(turned_by(moving, state)) + np.abs(state.omega * delay)))
