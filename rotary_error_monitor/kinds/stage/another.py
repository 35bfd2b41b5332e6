"""Whether the twin of a stage describes another stage, told from the orders that it states.

A description states the error motion of one stage order by order. What a nominal description leaves out is no
statement: then the recording shows more than the twin, and a diagnosis says what. Another stage's statements are false:
the recording shows something else than they say, in one order as in the next.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import AUTOCOLLIMATOR
from rotary_error_monitor.effects.effect import Cause, order_location
from rotary_error_monitor.effects.rotor import HEAD, StageEffect
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.gap.options import MOST_CAUSES
from rotary_error_monitor.gap.orders import Angles
from rotary_error_monitor.metrology.periodic_curves import doubted_orders
from rotary_error_monitor.sensors.library import instrument_of, is_listed, sensor_of
from rotary_error_monitor.twin.finite import UnpredictableError
from rotary_error_monitor.twin.recording import StageRecording
from rotary_error_monitor.twin.stage import Signals, StageTwin

HELD = 0.05
"""Part of a statement by which the recording may miss it for it to be true: chance comes that near to one of a dozen
statements of two numbers or more each in some 3 % of the twins of other stages."""

FALSE = 0.4
"""Part of a statement by which the recording must miss it for it to be false: calibrations are good to a tenth."""

BURIED = 0.5
"""A statement of less than this part of what the recording shows says nothing: a part that the twin leaves out may be
on top of it."""

INFLATED = 10.0
"""Variance inflation from which an amplitude says nothing (the usual limit of collinearity, Marquardt 1970): over an
arc a constant, slow changes and other orders pass for an order, and what they have wrong is magnified."""

HIGHEST = 16
"""Highest order that is looked at; those of error motions and graduation that matter are far lower."""


@dataclass(frozen=True)
class Statement:
    """What the twin states of one order in one instrument, and what the recording shows.

    Attributes:
        instrument: `head`, `autocollimator`, or the stream of a listed sensor.
        order: per turn.
        stated: amplitude, root mean square over the instrument's components, rad or m.
        measured: the same of the recording.
        apart: the same of the difference.
    """

    instrument: str
    order: int
    stated: float
    measured: float
    apart: float

    def __str__(self) -> str:
        sizes = (_with_unit(self.instrument, size) for size in (self.stated, self.measured, self.apart))
        stated, measured, apart = sizes
        return f"{self.instrument} order {self.order}: twin {stated}, recording {measured}, {apart} apart"


def check_stage(
    recording: StageRecording, raw: Signals, twin: StageTwin, effects: Iterable[StageEffect], std: dict[str, float]
) -> None:
    """Refuse a twin whose statements are those of another stage.

    Args:
        recording: what was measured.
        raw: (n, k) measured minus predicted of each sensor.
        twin: that predicted.
        effects: known effects: what is larger than any of them can be is refused as well.
        std: standard deviation of one sample of each instrument.

    Raises:
        InputError: the twin describes another stage; the message says in units what differs.
    """
    statements = stage_statements(recording, raw, twin, std)
    overstated = _overstated(statements, _with_statements(statements, raw))
    if overstated:
        raise InputError(
            f"the twin states more error motion than there is, in every instrument: {'; '.join(map(str, overstated))}. "
            "It describes another stage; give the twin of this one, or one that leaves out what is not known of it "
            "(eccentricity, graduation, mirror, spindle)"
        )
    if any(each.apart < HELD * each.stated for each in statements):
        return
    telling = [each for each in statements if each.stated > BURIED * each.measured]
    false = [each for each in telling if each.apart > FALSE * each.stated]
    # As many as effects are looked for may be false of the right stage, which then is what a diagnosis finds.
    if len(false) > MOST_CAUSES and 2 * len(false) > len(telling):
        largest = {each.instrument: each for each in sorted(false, key=lambda each: each.apart)}
        raise InputError(
            f"the twin states {len(statements)} orders of error motion; the recording shows none of them, and "
            f"{len(false)} differ by more than {FALSE:.0%} of what is stated, the largest: "
            f"{'; '.join(map(str, largest.values()))}. It describes another stage; give the twin of this one, or one "
            "that leaves out what is not known of it (eccentricity, graduation, mirror, spindle)"
        )
    _check_reach(raw, twin, effects)


def _with_statements(statements: Sequence[Statement], streams: Iterable[str]) -> set[str]:
    """The instruments that must all be overstated; a listed sensor that no order is stated of says nothing."""
    stated = {each.instrument for each in statements}
    return {instrument_of(name) for name in streams if not is_listed(name) or name in stated}


def _overstated(statements: Sequence[Statement], instruments: set[str]) -> list[Statement]:
    """The largest statement of each instrument if in all of them the orders together are false and more than there is.

    What a twin leaves out makes the recording show more than it states. That small orders are true does not help then.
    """
    found = []
    for instrument in sorted(instruments):
        own = [each for each in statements if each.instrument == instrument]
        stated, measured, apart = (
            float(np.sqrt(sum(getattr(each, part) ** 2 for each in own))) for part in ("stated", "measured", "apart")
        )
        if not own or stated <= measured or apart <= FALSE * stated:
            return []
        found.append(max(own, key=lambda each: each.apart))
    return found if len(found) > 1 else []


def stage_statements(
    recording: StageRecording, raw: Signals, twin: StageTwin, std: dict[str, float]
) -> tuple[Statement, ...]:
    """All orders that the twin states to be larger than one sample's noise, where the recording's angles tell them."""
    orders = min(max(_described_orders(twin.stage), default=1), HIGHEST)
    parts: dict[str, list[tuple[Array, Array]]] = {}
    apart_from_others = np.ones(orders, bool)
    for name, values in raw.items():
        angle = twin.state(name).command
        shown = recording.streams[name].values - values
        shown = shown - angle[:, None] if name in recording.heads else shown
        angles = Angles(angle)
        apart_from_others &= _inflation(angles, orders) < INFLATED
        for stated, apart in zip(shown.T, values.T, strict=True):
            both = _amplitudes(angles, stated, orders), _amplitudes(angles, apart, orders)
            parts.setdefault(instrument_of(name), []).append(both)
    found = []
    for instrument, pairs in parts.items():
        stated = _size([a for a, _ in pairs])
        measured, apart = _size([a + b for a, b in pairs]), _size([b for _, b in pairs])
        found += [
            Statement(instrument, k + 1, float(stated[k]), float(measured[k]), float(apart[k]))
            for k in range(orders)
            if apart_from_others[k] and stated[k] > std[instrument]
        ]
    return tuple(found)


def left_out(twin: StageTwin, residual: Callable[[], Signals], std: dict[str, float]) -> tuple[str, ...]:
    """What a nominal twin does not state although the recording shows it, each in a sentence with its size.

    Args:
        twin: of the stage.
        residual: gives measured minus predicted of each stream, which is not asked for where nothing is left out.
        std: of the noise of one sample of each instrument.
    """
    stage, found = twin.stage, []
    unstated = stage.encoder is not None and not any(stage.encoder.eccentricity)
    if not unstated and any(stage.mirror.tilt):
        return ()
    raw = residual()
    nothing = "the twin states no {}: {} shows {} that it does not predict; {}"
    several = len(stage.azimuths) != 1
    measure = "`calibrate assembly` measures it" if several else "--write-twin writes what is found of it"
    calibrate = f"{measure}, and with --most-causes 8 a diagnosis names several such parts"
    shown = {name: float(np.sqrt(np.mean(np.square(values - values.mean(axis=0))))) for name, values in raw.items()}
    largest = {each: max((s for n, s in shown.items() if instrument_of(n) == each), default=0.0) for each in std}
    if unstated and largest[HEAD] > 2 * std[HEAD]:
        found.append(nothing.format("eccentricity of the ring", "a head", _with_unit(HEAD, largest[HEAD]), calibrate))
    if not any(stage.mirror.tilt) and largest[AUTOCOLLIMATOR] > 2 * std[AUTOCOLLIMATOR]:
        size = _with_unit(AUTOCOLLIMATOR, largest[AUTOCOLLIMATOR])
        found.append(nothing.format("tilt of the mirror", "the autocollimator", size, calibrate))
    return tuple(found)


def _check_reach(raw: Signals, twin: StageTwin, effects: Iterable[StageEffect]) -> None:
    """Refuse what is larger than any known effect can be."""
    base, reach = twin.predict(), dict.fromkeys(raw, 0.0)
    size = {name: float(np.median(np.abs(values))) for name, values in raw.items()}
    for effect in effects:
        for part in effect.locations(twin.stage):
            place = order_location(effect.lowest, part) if effect.orders else part
            missing = [name for name in raw if reach[name] < size[name] and effect.touches(place, name)]
            for name, values in _at_bounds(twin, effect, place, missing).items():
                reach[name] = max(reach[name], float(np.max(np.abs(values - base[name]))))
    beyond = [name for name in raw if size[name] > reach[name]]
    if beyond:
        told = "; ".join(
            f"{name} {_with_unit(name, size[name])} (known effects make {_with_unit(name, reach[name])} at most)"
            for name in beyond
        )
        raise InputError(
            f"measured and predicted differ at the median by more than any known effect can: {told}. Check the "
            "units of the recording (rad, m) and that the twin is of this stage"
        )


def _at_bounds(twin: StageTwin, effect: StageEffect, place: str, streams: Sequence[str]) -> Signals:
    """Prediction with an effect as large as it may be; nothing where it cannot be predicted."""
    if not streams:
        return {}
    try:
        return twin.predict((Cause(effect, place, effect.largest(place)),), streams)
    except UnpredictableError:
        return {}


def _described_orders(stage: StageDescription) -> set[int]:
    planar = (*stage.spindle.radial, *stage.spindle.tilt, *stage.mirror.flatness)
    forms = (row for sensor in stage.sensors.values() for row in sensor.form)
    graduation = () if stage.encoder is None else stage.encoder.graduation
    angular = (*graduation, *stage.spindle.axial, *forms)
    measured = (order for table in stage.tables for order in doubted_orders(table)[0])
    return {1, *(row.order for row in planar), *(row.order for row in angular), *measured}


def _amplitudes(angles: Angles, rows: Array, orders: int) -> Array:
    """(orders, 2) cosine and sine of orders 1, 2, … in rows (n,), all and a constant fitted together."""
    fitted = np.linalg.lstsq(angles.products(orders), angles.moments(rows, orders), rcond=1e-6)[0]
    return np.stack([fitted[1 : orders + 1], fitted[orders + 1 :]], axis=1)


def _inflation(angles: Angles, orders: int) -> Array:
    """(orders,) variance of each order's amplitude over that without other orders and a constant; the larger one."""
    products = angles.products(orders)
    inflation = np.diag(products) * np.diag(np.linalg.pinv(products, rcond=1e-6, hermitian=True))
    return np.maximum(inflation[1 : orders + 1], inflation[orders + 1 :])


def _size(amplitudes: Sequence[Array]) -> Array:
    """(orders,) root mean square over components of the amplitude of each order."""
    return np.asarray(np.sqrt(np.mean([np.sum(np.square(each), axis=1) for each in amplitudes], axis=0)), np.float64)


def _with_unit(name: str, size: float) -> str:
    """A size in the unit that a person reads: µm or mm, µrad, mrad or rad."""
    length = sensor_of(name).unit == "m"
    steps = ((1e-3, 1e6, "µm"), (1.0, 1e3, "mm")) if length else ((1e-3, 1e6, "µrad"), (1.0, 1e3, "mrad"))
    scale, unit = next(((s, u) for limit, s, u in steps if size < limit), (1.0, "m" if length else "rad"))
    return f"{size * scale:.3g} {unit}"
