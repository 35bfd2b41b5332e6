"""The compiled form of what is done at each tick against numpy's, to the last bit, on drawn inputs."""

from __future__ import annotations

from dataclasses import astuple, replace
from typing import Any

import numpy as np
import pytest
from kernels import computing_by, is_built

from rotary_error_monitor.description.stage import StageDescription, load_stage
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.evidence import COLUMNS, INDEX, Reach
from rotary_error_monitor.pipeline.publication import AssemblyVariance, Believed, Publication
from rotary_error_monitor.pipeline.ticks import TickMaker
from rotary_error_monitor.pipeline.verdict import DOUBTS, Verdict
from rotary_error_monitor.signals.resampling import Resampled

pytestmark = pytest.mark.skipif(not is_built(), reason="the library was not compiled")

COUNTS = [1, 2, 5, 40]


def bits_of(stage: StageDescription) -> dict[str, int]:
    names = (*(f"head_{letter}" for letter in stage.azimuths), "autocollimator", "command", *stage.sensors)
    return {name: 1 << i for i, name in enumerate(names)}


def assert_same_bits(one: Any, other: Any) -> None:
    assert one.shape == other.shape and one.dtype == other.dtype
    np.testing.assert_array_equal(one, other)  # NaN for NaN
    if one.dtype == np.float64:
        known = ~np.isnan(one)
        np.testing.assert_array_equal(np.signbit(one[known]), np.signbit(other[known]))


def drawn_samples(rng: np.random.Generator, count: int, angle: np.ndarray, width: int) -> Resampled:
    values = angle[:, None] + 1e-5 * rng.normal(size=(count, width))
    values += 2 * np.pi * rng.integers(-1, 2) * (width == 1)
    small = np.abs(1e-6 * rng.normal(size=(2, count, width)))
    return Resampled(values, rng.uniform(0.02, 1.0, count), small[0], small[1], np.ones(count, np.bool_))


@pytest.mark.parametrize("seed", range(40))
def test_ticks_have_the_bits_of_numpy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    stage, count = load_stage(None), int(rng.choice(COUNTS))
    bits = bits_of(stage)
    theta = rng.uniform(-1e3, 1e3) + np.linspace(0.0, 1e-2, count)
    sampled = {name: drawn_samples(rng, count, theta, 1) for name in bits}
    sampled["autocollimator"] = drawn_samples(rng, count, np.zeros(count), 2)
    if rng.random() < 0.3:
        sampled["command"].values[rng.integers(count)] = np.nan
    rates = {name: float(rng.choice([100.0, 5e4])) for name in bits}
    heads = [name for name in bits if name.startswith("head_")]
    used = sum(bits[name] for name in rng.permutation(heads)[: rng.integers(0, len(heads) + 1)])
    there = used | sum(bit for bit in bits.values() if rng.random() < 0.7)
    of_each = np.full(count, there), np.full(count, used)
    if rng.random() < 0.5:  # not the same streams throughout
        of_each[1][rng.random(count) < 0.5] = there
    found = []
    for form in ("compiled", "numpy"):
        with computing_by(form):
            maker = TickMaker(stage, {f"head_{name}": at for name, at in stage.azimuths.items()}, bits, 1e-3)
            found.append(maker.make_each(sampled, *of_each, rates))
    one, other = found
    for name in ("evidence", "parity", "disagreement", "redundancy", "readings"):
        assert_same_bits(getattr(one, name), getattr(other, name))
    for mine, its in zip(astuple(one.motion), astuple(other.motion), strict=True):
        assert_same_bits(mine, its)


def drawn_verdict(rng: np.random.Generator) -> Verdict:
    reaches = [Reach(*(1e-6 * rng.normal(size=2)), rng.choice([1e-7, 3e-6, np.inf])) for _ in range(3)]
    return Verdict(
        excluded=int(rng.integers(0, 64)),
        doubts=int(rng.integers(0, 1 << len(DOUBTS))) if rng.random() < 0.5 else 0,
        head_scale=float(rng.uniform(1.0, 3.0)),
        tilt_scale=float(rng.uniform(1.0, 3.0)),
        lag=float(rng.choice([0.0, 1e-6, np.nan], p=[0.45, 0.45, 0.1])),
        unresolved=float(rng.choice([0.0, 1e-7])),
        unresolved_tilt=float(rng.choice([0.0, 1e-7])),
        most=float(rng.choice([0.5, 5.0, np.inf])),
        settled=int(rng.choice([-1, 0, 5])),
        tilt=reaches[0],
        ecc=reaches[1]._replace(y=0.0),
        radial=reaches[2],
    )


def drawn_motion(rng: np.random.Generator, count: int) -> ErrorMotion:
    motion = ErrorMotion.unknown(count)
    motion.theta[:] = rng.normal(size=count)
    motion.observable[:] = rng.random((count, 6)) < 0.8
    motion.components[:] = 1e-6 * rng.normal(size=(count, 6))
    motion.covariance[:] = 1e-14 * rng.normal(size=(count, 6, 6))
    if rng.random() < 0.3:
        motion.components[rng.integers(count), rng.integers(6)] = np.nan
    if rng.random() < 0.3:
        motion.covariance[rng.integers(count), rng.integers(6), rng.integers(6)] = np.inf
    return motion


def drawn_evidence(rng: np.random.Generator, count: int) -> np.ndarray:
    seen = 1e-6 * rng.normal(size=(count, len(COLUMNS)))
    seen[:, INDEX["radial_variance"]] = rng.uniform(0.0, 1e-12, count)
    far = rng.random(count) < 0.2
    seen[far, INDEX["surplus_x"]] = 10.0 ** rng.uniform(-5, -2, far.sum())  # m, some beyond what a stage can do
    for name in ("tilt", "command"):
        seen[:, INDEX[name]] = rng.random(count) < 0.7
    seen[rng.random(seen.shape) < rng.choice([0.0, 0.02])] = np.nan
    return seen


@pytest.mark.parametrize("seed", range(60))
def test_what_goes_out_has_the_bits_of_numpy(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(seed)
    stage, count = load_stage(None), int(rng.choice(COUNTS))
    if rng.random() < 0.5:
        distorted = replace(AssemblyVariance.of(stage), roll_angle=0.1, distortion=(1e-3, 0.0, 1e2))
        monkeypatch.setattr(AssemblyVariance, "of", lambda _: distorted)
    motion, seen = drawn_motion(rng, count), drawn_evidence(rng, count)
    first = int(rng.integers(0, count + 1))
    verdicts = [(slice(0, first), drawn_verdict(rng)), (slice(first, count), drawn_verdict(rng))]
    streams, disagreement = rng.integers(0, 64, count), rng.uniform(0.0, 3.0, count)
    redundancy, ticks = rng.integers(0, 3, count), np.arange(count)
    found = []
    for form in ("compiled", "numpy"):
        with computing_by(form):
            mine = ErrorMotion(*(each.copy() for each in astuple(motion)))
            believed = Believed(verdicts)
            publication = Publication(stage, bits_of(stage))
            found.append(publication.finish(ticks, mine, seen, streams, disagreement, redundancy, believed))
    (one, goes), (other, went) = found
    assert_same_bits(goes, went)
    for mine, its in zip(astuple(one), astuple(other), strict=True):
        assert_same_bits(mine, its)
