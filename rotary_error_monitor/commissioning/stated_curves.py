"""Measured curves of ring and mirror that a stage file states, as commissioning takes them: by orders of the rotation.

Orders above those that are fitted stay in what a fit leaves, and count as noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.commissioning.heads import HIGHEST
from rotary_error_monitor.commissioning.layouts import Weighed, turned_over
from rotary_error_monitor.commissioning.response_fit import FittedCoefficients
from rotary_error_monitor.commissioning.ring_model import RingFit, RingPrior, fit_ring, orders_of
from rotary_error_monitor.description.harmonics import PlanarHarmonic
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.table_files import FLATNESS, GRADUATION
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.distributions import chi_square_tail
from rotary_error_monitor.metrology.periodic_curves import angular_orders, coefficient_std, planar_orders
from rotary_error_monitor.units import ARCSEC

MISFIT = 1e-6
"""Probability below which a curve is not what the heads see: it costs a file, and chance must not."""

FREE = 1e-3
"""Prior standard deviation of a departure from a curve, rad, where it is looked for: it hides none."""


def ring_level(stage: StageDescription) -> float:
    """Mean of a measured graduation over the ring, rad: all heads show it alike."""
    table = stage.ring.graduation_table
    return 0.0 if table is None else angular_orders(table, 0)[0].cos


def ring_curve(stage: StageDescription, origin: float) -> tuple[Array, float] | None:
    """(k, 2) cosine and sine of orders 1 to k of a graduation that was measured, and the uncertainty of one, rad.

    By a rotation that is `origin` (rad) behind that from which the file counts. None where the file has no curve.
    """
    table = stage.ring.graduation_table
    if table is None:
        return None
    waves = np.zeros((HIGHEST, 2))
    for row in (*angular_orders(table, HIGHEST), *stage.ring.graduation):
        if 1 <= row.order <= HIGHEST:
            turn = row.order * origin
            c, s = np.cos(turn), np.sin(turn)
            waves[row.order - 1] += np.array([[c, -s], [s, c]]) @ (row.cos, row.sin)
    return waves, float(np.hypot(coefficient_std(table), stage.uncertainty.get("encoder.graduation", 0.0)))


def mirror_rows(stage: StageDescription, highest: int) -> tuple[PlanarHarmonic, ...]:
    """Orders 0 to `highest` of a measured flatness, rad; none where the file has no curve."""
    table = stage.mirror.flatness_table
    return () if table is None else planar_orders(table, highest)


def mirror_doubt(stage: StageDescription, usual: float) -> float:
    """Standard uncertainty, rad, of an order of the mirror's flatness: `usual` where neither file nor curve has one."""
    table = stage.mirror.flatness_table
    if table is None:
        return stage.uncertainty.get("mirror.flatness", usual)
    return float(np.hypot(coefficient_std(table), stage.uncertainty.get("mirror.flatness", 0.0)))


def check_counted(stage: StageDescription, is_counted: bool) -> None:
    """Hold that a measured curve has a rotation from which it is counted.

    Raises:
        InputError: neither a command nor a head's `zero` tells it.
    """
    for place, table in ((GRADUATION, stage.ring.graduation_table), (FLATNESS, stage.mirror.flatness_table)):
        if table is not None and not is_counted:
            raise InputError(
                f"{'.'.join(place)}: a measured curve is counted from the rotation's zero, which nothing tells here; "
                "record the command, or state the zero of a head"
            )


def check_ring_curve(
    possible: Sequence[Weighed], response: FittedCoefficients, azimuths: Array, priors: Mapping[int, RingPrior]
) -> None:
    """Hold that the heads see the ring as it was measured, where they stand in one of the possible ways.

    Args:
        possible: layouts.
        response: of the heads, each counted as the first head counts.
        azimuths: (n,) of the heads as they are described, rad.
        priors: by which the layouts were fitted, by the sense of the first head.

    Raises:
        InputError: in each of them an order departs by more than curve and recording are uncertain.
    """
    if all(prior.curve is None for prior in priors.values()):
        return
    found = []
    for each in possible:
        sense, prior = each.layout.sense, priors[each.layout.sense]
        orders = orders_of(response if sense == 1 else turned_over(response))
        free = fit_ring(orders, azimuths[list(each.layout.places)], replace(prior, doubt=FREE))
        found.append(_most_off(free, prior.graduation_std(2)))
    square, order, size = min(found)
    if chi_square_tail(square, 2) < MISFIT:
        raise InputError(
            f"{'.'.join(GRADUATION)}: order {order} of this curve is {size * ARCSEC:.3f} arcsec off what the heads "
            f"see, {np.sqrt(square):.0f} standard uncertainties; expected the curve of this ring, counted from where "
            "the rotation is counted now: put the zero of command or head right, or take the curve out, commission, "
            "and measure it anew with `calibrate assembly --as table`"
        )


def _most_off(fit: RingFit, doubt: float) -> tuple[float, int, float]:
    """Chi-square of the order that departs most, the order, and its amplitude in rad."""
    found = [(0.0, 2, 0.0)]
    for order in range(2, fit.highest + 1):
        values, covariance = fit.graduation(order)
        square = float(values @ np.linalg.solve(covariance + doubt**2 * np.eye(2), values))
        found.append((square, order, float(np.hypot(*values))))
    return max(found)


def check_mirror_curve(stage: StageDescription, chi_square: tuple[float, int]) -> None:
    """Hold that the autocollimator sees the mirror as it was measured, beside a tilt that the file states.

    Args:
        stage: as described.
        chi_square: of what gain and roll leave of the tilt, and its degrees of freedom.

    Raises:
        InputError: it does not.
    """
    if stage.mirror.flatness_table is not None and chi_square_tail(*chi_square) < MISFIT:
        raise InputError(
            f"{'.'.join(FLATNESS)}: this curve and spindle.tilt together are not what the autocollimator shows, "
            f"{np.sqrt(chi_square[0] / chi_square[1]):.1f} times as far off as they are uncertain; expected both "
            "counted from where the rotation is counted now: put the zero of command or head right, or take the curve "
            "out, commission, and measure it anew with `calibrate assembly --as table`"
        )
