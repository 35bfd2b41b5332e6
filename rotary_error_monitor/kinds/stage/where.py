"""Where the gap of a stage lies: shares of the channels, and in words what each share depends on."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.streams import COMMAND
from rotary_error_monitor.description.topics import samples_topic
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.effects.rotor import HEAD, RotorState
from rotary_error_monitor.gap.dependence import explained_by, explained_by_constant, name_dependences
from rotary_error_monitor.gap.normal import own_rest
from rotary_error_monitor.gap.problem import Share
from rotary_error_monitor.kinds.stage.rows import StageRows
from rotary_error_monitor.sensors.library import instrument_of, sensor_of
from rotary_error_monitor.twin.recording import fields_of

ALIKE = 0.9
"""Heads whose gaps differ less than this see the rotation itself: the gap is named against the command."""

ORDERS = 120
TELLING = 0.1
"""Part of a channel's excess that a dependence must explain to be named."""


def stage_where(problem: StageRows, causes: Sequence[Cause], explained: bool) -> list[Share]:
    """Shares of all channels, largest first; empty if nothing exceeds the noise.

    Of explained gaps the causes' own effect on each channel counts; of others what exceeds the noise in white rows.
    """
    if explained:
        signals = _effect(problem, causes)
        powers = {channel: float(np.mean(np.square(values))) for channel, (values, _, _) in signals.items()}
        energy = {c: powers[c] / noise**2 * len(values) for c, (values, noise, _) in signals.items()}
    else:
        signals, energy = _excess(problem, causes)
        powers = {c: energy[c] / len(values) * noise**2 for c, (values, noise, _) in signals.items()}
    total = sum(energy.values())
    if total <= 0:
        return []
    units = {
        _channel(stream, axis): ("µrad" if stream == COMMAND else sensor_of(stream).small_unit, 1e6)
        for stream in (*problem.twin.times, COMMAND)
        for axis in range(len(fields_of(stream)))
    }
    return [
        Share(
            channel,
            energy[channel] / total,
            float(np.sqrt(powers[channel])),
            signals[channel][1],
            _words(*signals[channel], powers[channel]) if energy[channel] > 0 else "noise",
            units[channel],
        )
        for channel in sorted(energy, key=lambda channel: -energy[channel])
    ]


def _words(values: Array, noise: float, state: Callable[[], RotorState], power: float) -> str:
    """Pattern of values of which at least `power` is excess; what uncertain parameters took up counts as well."""
    return describe(values, state(), max(power, float(np.mean(np.square(values))) - noise**2))


_Signals = Mapping[str, tuple[Array, float, Callable[[], RotorState]]]
"""Values of each channel, its noise, and what gives the rotor at its samples when it is wanted."""


def _channel(stream: str, axis: int) -> str:
    return f"{samples_topic(stream)}.{fields_of(stream)[axis]}"


def _effect(problem: StageRows, causes: Sequence[Cause]) -> _Signals:
    """Effect of the causes on each channel; what all heads share alike stands once, in the command's channel."""
    predict = problem.twin.predict  # one stream at a time: of a long recording all would fill the memory
    moved = {name: predict(causes, [name])[name] - predict((), [name])[name] for name in problem.twin.times}
    found: dict[str, tuple[Array, float, Callable[[], RotorState]]] = {}
    heads = [name for name in moved if name.startswith(f"{HEAD}_")]
    powers = [float(np.mean(np.square(moved[name]))) for name in heads]
    alike = bool(heads) and min(powers) > (ALIKE * np.sqrt(max(powers))) ** 2 and max(powers) > 0
    if alike:
        length = min(len(moved[name]) for name in heads)
        shared = np.mean([moved[name][:length, 0] for name in heads], axis=0)
        alike = float(np.mean(np.square(shared))) > 0.5 * max(powers)
        if alike:
            found[_channel(COMMAND, 0)] = (shared, problem.noise.std[HEAD], partial(_state, problem, heads[0], length))
            for name in heads:
                moved[name] = moved[name][:length] - shared[:, None]
    for name, values in moved.items():
        state = partial(_state, problem, name, len(values))
        for axis in range(values.shape[1]):
            noise = problem.noise.std[instrument_of(name)]
            found[_channel(name, axis)] = (values[:, axis], noise, state)
    return found


def _excess(problem: StageRows, causes: Sequence[Cause]) -> tuple[_Signals, dict[str, float]]:
    """White rows beside the causes in the unit of their channel, with the rotor at the rows; and their excess power.

    Where the uncertain parameters had to move far they took the gap with them: then the rows before that are shown.
    """
    data = problem.residual(causes)
    rest, excess = own_rest(problem, data, problem.nuisance(causes))
    found, energy = {}, {}
    for track in problem.tracks(rest):
        if np.sum(track.rows**2) - len(track.rows) < 0.5 * excess[track.channel]:
            (track,) = problem.tracks({track.channel: data[track.channel]})
        stream, _, axis = track.channel.partition(".")
        noise = problem.noise.std[HEAD if stream == COMMAND else instrument_of(stream)]
        channel = _channel(stream, 0 if axis in ("", "x") else 1)
        found[channel] = (track.rows * noise, noise, partial(problem.twin.state_at, track.time))
        energy[channel] = max(0.0, excess[track.channel])
    _give_back(energy, [_channel(name, 0) for name in problem.recording.heads])
    return found, energy


def _give_back(energy: dict[str, float], heads: Sequence[str]) -> None:
    """Give the heads what each of them has of its own in the mean of all, which stands against the command.

    Of n heads that differ by chance, n - 1 parts lie in what each has beyond the mean, and one part in the mean itself.
    """
    shared, own = _channel(COMMAND, 0), [head for head in heads if head in energy]
    differing = sum(energy[head] for head in own)
    if shared not in energy or len(own) < 2 or differing <= 0:
        return
    part = min(energy[shared], differing / (len(own) - 1))
    energy[shared] -= part
    for head in own:
        energy[head] *= 1 + part / differing


def _state(problem: StageRows, stream: str, length: int) -> RotorState:
    """The rotor at the first samples of a stream."""
    state = problem.twin.state(stream)
    if len(state.time) == length:
        return state
    return RotorState(
        state.time[:length],
        state.command[:length],
        state.omega[:length],
        state.theta[:length],
        state.force[:length],
        state.warming[:length],
        state.command_at,
        state.lines,
        warmings={place: warming[:length] for place, warming in state.warmings.items()},
    )


def describe(values: Array, state: RotorState, power: float) -> str:
    """What a signal depends on, in words: each dependence with the part of the excess that it explains alone.

    Args:
        values: (n,) gap of one channel.
        state: the rotor at those samples.
        power: mean square of the excess in `values`.
    """
    if power <= 0:
        return "noise"
    excess = power * len(values)
    parts = [(explained_by(table, values) / excess, name) for name, table in _dependences(state).items()]
    parts.append((explained_by_constant(values) / excess, "constant"))
    parts += filter(None, (_orders(values, state, excess), _place(values, state, excess)))
    return name_dependences(parts, TELLING)


def _dependences(state: RotorState) -> dict[str, Array]:
    """Tables of what a signal may go with, by the words for it."""
    late = (state.time - state.time.mean()) / max(float(np.ptp(state.time)), 1e-9)
    found = {"time": np.stack([late, late**2, late**3], axis=1)}
    top = float(np.max(np.abs(state.omega), initial=0.0))
    if top > 0:
        speed = state.omega / top
        moving = np.abs(speed) > 1e-6
        found["direction"] = (np.sign(speed) * moving)[:, None]
        found["speed"] = np.stack([np.abs(speed), speed**2], axis=1)
    if np.ptp(state.force) > 0:
        found["force"] = state.force / max(float(np.max(np.abs(state.force))), 1e-9)
    if np.ptp(state.warming) > 0:
        found["temperature"] = state.warming[:, None] / float(np.max(np.abs(state.warming)))
    for place, warming in state.warmings.items():
        if np.ptp(warming) > 0:
            found[f"temperature of {place}"] = warming[:, None] / float(np.max(np.abs(warming)))
    return found


def _orders(values: Array, state: RotorState, excess: float) -> tuple[float, str] | None:
    step, turning = np.exp(-1j * state.command), np.ones(len(values), complex)
    powers = []
    for _ in range(ORDERS):
        turning = turning * step
        powers.append(2 * abs(np.dot(turning, values)) ** 2 / len(values))
    best = sorted(range(ORDERS), key=lambda k: -powers[k])[:3]
    named = [k for k in best if powers[k] > max(0.5 * TELLING * excess, 0.1 * powers[best[0]])]
    total = sum(powers[k] for k in named) / excess
    if not named or total < TELLING:
        return None
    words = ", ".join(str(k + 1) for k in named)
    return min(total, 1.0), f"angle, order{'s' if len(named) > 1 else ''} {words}"


def _place(values: Array, state: RotorState, excess: float) -> tuple[float, str] | None:
    """One narrow place on the circle that holds most of the excess, as no wave does."""
    cells = 72
    cell = (np.mod(state.command, 2 * np.pi) * cells / (2 * np.pi)).astype(np.intp) % cells
    energy = np.bincount(cell, np.square(values), minlength=cells)
    count = np.bincount(cell, minlength=cells)
    base = float(np.median(energy / np.maximum(count, 1)))
    above = np.maximum(energy - base * count, 0.0)
    best = int(np.argmax(above))
    near = float(above[[best - 1, best, (best + 1) % cells]].sum())
    if near < 0.5 * max(excess, float(above.sum())):
        return None
    return near / excess, f"angle, a place at {(best + 0.5) * 360 / cells:.0f}°"
