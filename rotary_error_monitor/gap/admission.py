"""What a recording of a stage and its twin must fulfil before they are worth a diagnosis."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rotary_error_monitor.effects.rotor import LVDT, Array
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.twin.recording import StageRecording
from rotary_error_monitor.twin.stage import Signals, StageTwin
from rotary_error_monitor.twin.stage_noise import COMMAND

SHORTEST = 12.0
"""Duration, s, below which the jitter of the rotor cannot be told from effects: of 72 recordings of 6 to 10 s without a
gap 11 showed one, of 112 from 12 to 16 s none."""

FEWEST_TURNS = 1.0
"""Turns of the stage below which an order cannot be told from a drift."""

ABSURD = 0.4
"""Residual over what the twin shows, as a geometric mean over the instruments, from which it describes another stage.
The strongest effects of the gap cases stay below 0.1; twins of other drawn stages give 0.5 and more."""

TOUCHED = 0.05
"""An instrument that agrees this well with the twin says that the stage is the right one."""


def check_extent(recording: StageRecording, raw: Signals, noise: Mapping[str, float]) -> None:
    """Refuse a recording that is too short to hold anything out.

    Args:
        recording: what was measured.
        raw: (n, k) measured minus predicted of each sensor.
        noise: standard deviation of one sample of each kind of sensor: head, autocollimator, lvdt.

    Raises:
        InputError: it lasts or turns too little; the message says what can be said all the same.
    """
    turns = float(np.abs(np.diff(recording.streams[COMMAND].values[:, 0])).sum() / (2 * np.pi))
    if recording.duration >= SHORTEST and turns >= FEWEST_TURNS:
        return
    damage = "".join(f"; {remark}" for remark in recording.remarks)
    raise InputError(
        f"the recording lasts {recording.duration:.1f} s and {turns:.2g} turns of the stage: too little to hold data "
        f"out and to tell effects from noise; record at least {SHORTEST:g} s and {FEWEST_TURNS:g} turn. "
        f"What can be said: {_describe(raw, noise)}{damage}"
    )


def check_stage(recording: StageRecording, raw: Signals, twin: StageTwin) -> None:
    """Refuse a twin that no instrument agrees with.

    Args:
        recording: what was measured.
        raw: (n, k) measured minus predicted of each sensor.
        twin: that predicted.

    Raises:
        InputError: the twin describes another stage.
    """
    ratios: dict[str, list[float]] = {}
    for name, values in raw.items():
        ratios.setdefault(name.partition("_")[0], []).append(_over_signal(recording, twin, name, values))
    by_instrument = {name: float(np.mean(found)) for name, found in ratios.items()}
    if len(by_instrument) < 2 or min(by_instrument.values()) < TOUCHED:
        return
    if np.exp(np.mean(np.log(list(by_instrument.values())))) > ABSURD:
        raise InputError(
            "the twin predicts none of the instruments: measured and predicted differ by "
            f"{_listed({name: f'{ratio:.0%}' for name, ratio in by_instrument.items()})} of what the twin shows. "
            "It describes another stage; give the twin of this one"
        )


def _over_signal(recording: StageRecording, twin: StageTwin, name: str, residual: Array) -> float:
    """Usual size of a sensor's residual over that of what the twin shows there beside the rotation."""
    shown = recording.streams[name].values - residual
    if name in recording.heads:
        shown = shown - twin.state(name).command[:, None]
    size = float(np.median(np.abs(shown - shown.mean(axis=0))))
    return float(np.median(np.abs(residual))) / max(size, np.finfo(np.float64).tiny)


def _describe(raw: Signals, noise: Mapping[str, float]) -> str:
    sizes = {}
    for name, values in raw.items():
        unit = "µm" if name == LVDT else "µrad"
        rms = 1e6 * float(np.sqrt(np.mean(np.square(values))))
        sizes[name] = f"{rms:.3g} {unit} (noise of one sample {1e6 * noise[name.partition('_')[0]]:.2g} {unit})"
    return f"measured and predicted differ by {_listed(sizes)}; of that the rotor's own jitter is a part at the heads"


def _listed(values: Mapping[str, str]) -> str:
    return ", ".join(f"{name} {value}" for name, value in values.items())
