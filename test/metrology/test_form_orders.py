"""Which orders of a form pass for motion: closed forms, and a circle that is sampled and solved angle by angle."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotary_error_monitor.metrology.encoder_heads import HeadLayout
from rotary_error_monitor.metrology.form_orders import OrderView, view_order

ANGLES = st.floats(-np.pi, np.pi)
ORDERS = st.integers(1, 15)


def radial(azimuths: np.ndarray) -> np.ndarray:
    rows = np.zeros((len(azimuths), 6))
    rows[:, 0], rows[:, 1] = np.cos(azimuths), np.sin(azimuths)
    return rows


def axial(azimuths: np.ndarray, radius: float) -> np.ndarray:
    rows = np.zeros((len(azimuths), 6))
    rows[:, 2], rows[:, 3], rows[:, 4] = 1.0, radius * np.sin(azimuths), -radius * np.cos(azimuths)
    return rows


def heads(azimuths: np.ndarray, radius: float) -> np.ndarray:
    rows = np.zeros((len(azimuths), 6))
    rows[:, 0], rows[:, 1], rows[:, 5] = -np.sin(azimuths) / radius, np.cos(azimuths) / radius, 1.0
    return rows


def views(rows: np.ndarray, azimuths: np.ndarray, orders: range, deviation: float = 1e-8) -> list[OrderView]:
    even = np.full(len(rows), deviation)
    return [view_order(k, rows, even, np.exp(1j * k * azimuths)[:, None]) for k in orders]


def passing(found: list[OrderView]) -> dict[int, tuple[str, ...]]:
    """Components by the orders that pass as a whole; none may pass in part."""
    assert all(view.is_hidden or view.is_seen for view in found)
    return {view.order: view.components for view in found if view.is_hidden}


@given(start=ANGLES)
def test_three_probes_at_120_degrees(start: float) -> None:
    at = start + 2 * np.pi * np.arange(3) / 3
    found = passing(views(radial(at), at, range(1, 13)))
    assert found == {k: ("exc", "eyc") for k in range(1, 13) if k % 3}


@given(start=ANGLES)
def test_four_heads_and_four_axial_probes_at_90_degrees(start: float) -> None:
    at = start + np.pi / 2 * np.arange(4)
    ring = {k: ("exc", "eyc") if k % 2 else ("ecc",) for k in range(1, 13) if k % 4 != 2}
    assert passing(views(heads(at, 0.1), at, range(1, 13), 3e-7)) == ring
    face = {k: ("eac", "ebc") if k % 2 else ("ezc",) for k in range(1, 13) if k % 4 != 2}
    assert passing(views(axial(at, 0.05), at, range(1, 13))) == face


@given(start=ANGLES, radius=st.floats(0.005, 0.5))
def test_without_redundancy_all_passes(start: float, radius: float) -> None:
    """One probe (Donaldson: its reading is the sum of form and motion), two at right angles, three before a face."""
    every = set(range(1, 13))
    one, two, three = np.array([0.0]), start + np.array([0.0, np.pi / 2]), start + 2 * np.pi * np.arange(3) / 3
    assert passing(views(radial(one), one, range(1, 13))) == dict.fromkeys(every, ("exc",))
    assert set(passing(views(radial(two), two, range(1, 13)))) == every
    assert set(passing(views(axial(three, radius), three, range(1, 13)))) == every


@given(azimuths=st.lists(ANGLES, min_size=2, max_size=6, unique=True), order=ORDERS, seed=st.integers(0, 99))
def test_a_sampled_circle_leaves_as_much(azimuths: list[float], order: int, seed: int) -> None:
    """An artefact out of round is turned; at each angle its place is solved for, each probe by its own noise."""
    at, draw = np.array(azimuths), np.random.default_rng(seed)
    spread = np.linalg.svd(radial(at)[:, :2], compute_uv=False)
    if spread[-1] < 1e-3:  # on one line but for rounding
        return
    noise, (cos, sin) = draw.uniform(1.0, 3.0, len(at)), draw.normal(size=2)
    left = whole = 0.0
    for theta in 2 * np.pi * np.arange(4 * order) / (4 * order):
        psi = order * (at - theta)
        seen = (cos * np.cos(psi) + sin * np.sin(psi)) / noise
        place, *_ = np.linalg.lstsq(np.stack([np.cos(at), np.sin(at)], 1) / noise[:, None], seen, rcond=None)
        left += float(((seen - (place @ [np.cos(at), np.sin(at)]) / noise) ** 2).sum())
        whole += float((seen**2).sum())
    view = view_order(order, radial(at), 1e-8 * noise, np.exp(1j * order * at)[:, None])
    assert view.passing == pytest.approx(1.0 - left / whole, abs=1e-5)


@given(azimuths=st.lists(ANGLES, min_size=3, max_size=6, unique=True), order=ORDERS)
def test_heads_are_seen_as_by_their_layout(azimuths: list[float], order: int) -> None:
    at = np.array(azimuths)
    layout = HeadLayout(tuple(azimuths))
    if np.linalg.svd(layout.sensitivity, compute_uv=False)[-1] < 0.01:  # there a layout takes less for motion
        return
    (view,) = views(heads(at, 0.1), at, range(order, order + 1), 3e-7)
    (known,) = layout.graduation_view([order])
    assert view.passing == pytest.approx(1.0 - known.seen**2, abs=1e-5)
    assert view.is_hidden == (order in layout.hidden_orders(order))


def test_two_mirrors_share_what_one_of_them_shows() -> None:
    """Two instruments alike: half of the square of a form that one mirror has passes for tilt, all of a common one."""
    rows = np.tile(np.eye(6)[3:5], (2, 1))
    apart = np.vstack([np.eye(2), np.zeros((2, 2))]).astype(complex)
    assert view_order(2, rows, np.ones(4), apart).passing == pytest.approx(0.5)
    both = view_order(2, rows, np.ones(4), np.vstack([np.eye(2), np.eye(2)]).astype(complex))
    assert both == OrderView(2, 1.0, ("eac", "ebc"))
