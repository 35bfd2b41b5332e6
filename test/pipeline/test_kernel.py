"""The compiled form of what is done at each tick against numpy's, to the last bit, on drawn inputs."""

from __future__ import annotations

from dataclasses import astuple, fields, replace
from typing import Any

import numpy as np
import pytest
from kernels import computing_by, is_built

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.stage import StageDescription, load_stage
from rotary_error_monitor.description.stage_limits import StageLimits
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.evidence import COLUMNS, INDEX, Reach
from rotary_error_monitor.pipeline.input_checks import InputChecks, Tolerances
from rotary_error_monitor.pipeline.joints import AxisPositions, JointTrack
from rotary_error_monitor.pipeline.live_components import Carrier
from rotary_error_monitor.pipeline.publication import AssemblyVariance, Believed, Publication
from rotary_error_monitor.pipeline.ticks import TickMaker
from rotary_error_monitor.pipeline.verdict import DOUBTS, InputVerdict
from rotary_error_monitor.signals.resampling import Resampled

pytestmark = pytest.mark.skipif(not is_built(), reason="the library was not compiled")

COUNTS = [1, 2, 5, 40]
EPOCH = 1_764_000_000_000_000_000


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


def drawn_verdict(rng: np.random.Generator) -> InputVerdict:
    reaches = [Reach(*(1e-6 * rng.normal(size=2)), rng.choice([1e-7, 3e-6, np.inf])) for _ in range(3)]
    return InputVerdict(
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


@pytest.mark.parametrize("seed", range(40))
def test_axes_have_the_bits_of_numpy_wherever_joint_states_are(seed: int) -> None:
    rng = np.random.default_rng(seed)
    machine = load_machine(str(rng.choice(["xyzac_trt", "pan2013"])))
    count, period = int(rng.choice([0, 1, 2, 30])), int(rng.choice([1_000_000, 10_000_000, 150_000_000]))
    stamps = EPOCH + period * np.arange(count) + rng.integers(0, period // 4, count)
    speeds = rng.choice([0.0, 0.01], len(machine.letters))
    ticks = EPOCH + np.sort(rng.integers(-2 * period, (count + 3) * period, int(rng.choice(COUNTS))))
    found = []
    for form in ("compiled", "numpy"):
        with computing_by(form):
            track = JointTrack(machine, 30_000_000, 100_000_000)
            for i, stamp in enumerate(stamps.tolist()):
                jump = 0.5 if i == 20 else 0.0  # which is not believed, and so doubted
                angles = {
                    name: v * 1e-9 * (stamp - EPOCH) + jump for name, v in zip(machine.letters, speeds, strict=True)
                }
                left_out = {machine.monitored} if i == 10 else set()
                track.push(stamp, {name: at for name, at in angles.items() if name not in left_out}, {})
            found.append(track.at(ticks))
    for each in fields(AxisPositions):
        assert_same_bits(getattr(found[0], each.name), getattr(found[1], each.name))


def drawn_axes(rng: np.random.Generator, ticks: np.ndarray, axes: int) -> AxisPositions:
    m = len(ticks)
    return AxisPositions(
        *(rng.normal(size=(m, axes)) for _ in range(3)),
        rng.uniform(0.0, 0.1, m),
        rng.random(m) < 0.9,
        ticks - rng.integers(0, 40_000_000, m),
        1e-3 * rng.normal(size=(m, axes)) + 2 * np.pi * rng.integers(-1, 2, (m, axes)),
        rng.random(m) < 0.9,
        rng.random(m) < 0.1,
    )


@pytest.mark.parametrize("seed", range(40))
def test_inputs_are_judged_alike(seed: int) -> None:
    rng = np.random.default_rng(seed)
    machine = load_machine("xyzac_trt")
    batches, end = [], EPOCH
    for size in rng.choice([1, 2, 5, 40], 4):
        ticks = end + np.cumsum(rng.choice([1_000_000, 3_000_000, 80_000_000], size, p=[0.9, 0.05, 0.05]))
        motion = drawn_motion(rng, int(size))
        motion.theta[:] = 1e-3 * rng.normal(size=size)
        motion.covariance[rng.random(size) < 0.9] = 1e-14 * np.eye(6)  # those that cannot be are used by neither
        doubts = rng.choice([0, 1 << DOUBTS.index("unverified"), 1 << DOUBTS.index("ring")], size)
        batches.append((drawn_axes(rng, ticks, len(machine.letters)), replace(motion, times_ns=ticks, doubts=doubts)))
        end = int(ticks[-1])
    found = []
    for form in ("compiled", "numpy"):
        with computing_by(form):
            checks = InputChecks(machine, Tolerances(50_000_000, 1e-3, 1e-3, 2e-3), StageLimits())
            found.append([(checks.judge(*batch), checks.joints_are_sound()) for batch in batches])
    for (one, sound), (other, is_sound) in zip(*found, strict=True):
        for name in ("usable", "commanded", "command"):
            assert_same_bits(getattr(one, name), getattr(other, name))
        assert (one.hold, one.remarks, sound) == (other.hold, other.remarks, is_sound)


@pytest.mark.parametrize("seed", range(20))
def test_components_are_carried_alike(seed: int) -> None:
    rng = np.random.default_rng(seed)
    carrier = Carrier(float(rng.choice([0.0, 0.3])), float(rng.choice([0.0, np.pi / 2, 0.7])))
    motion, found = drawn_motion(rng, int(rng.choice(COUNTS))), []
    for form in ("compiled", "numpy"):
        with computing_by(form):
            found.append(carrier.components(motion))
    assert_same_bits(*found)
