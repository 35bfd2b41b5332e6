"""The plant against the contract's first-order formulas, written out here, and against closed forms."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from rotary_error_monitor.description.harmonics import AngularHarmonic, PlanarHarmonic
from rotary_error_monitor.description.spindle_section import Spindle
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.stage_section import Encoder, Mirror
from rotary_error_monitor.description.two_axis_section import Autocollimator, RadialReference, Turbulence
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.plant.clocks import Clock, stage_clocks
from rotary_error_monitor.plant.environment import intermittent_forces
from rotary_error_monitor.plant.motion import random_motion
from rotary_error_monitor.plant.stage import StagePlant

Array = NDArray[np.float64]
EPOCH = 1_763_700_000_000_000_000
QUARTER = np.pi / 2
STAGE = StageDescription(
    encoder=Encoder(
        disc_radius=0.1,
        lines_per_revolution=31488,
        counts_per_line=100,
        noise=3e-7,
        azimuths={"a": 0.0, "b": 2 * QUARTER, "c": QUARTER, "d": 3 * QUARTER},
        eccentricity=(-2.7e-5, 8.5e-6),
        graduation=(AngularHarmonic(2, -7e-7, 3.4e-6), AngularHarmonic(3, 2.3e-6, -5.3e-7)),
    ),
    autocollimator=Autocollimator(range=4.848e-4, resolution=4.848e-7, noise=4.848e-7),
    mirror=Mirror((7.2e-5, 2.4e-5), (PlanarHarmonic(2, (-6e-6, -2.2e-6), (1.5e-6, -4e-6)),)),
    spindle=Spindle(
        radial=(
            PlanarHarmonic(1, (-2.3e-7, 3e-7), (-3.3e-6, -4.5e-6)),
            PlanarHarmonic(5, (6e-8, 1e-6), (-8e-7, -4e-8)),
        ),
        tilt=(
            PlanarHarmonic(1, (-1.3e-5, 9.2e-6), (1.7e-5, -2.4e-5)),
            PlanarHarmonic(3, (-5e-6, 9e-6), (1.4e-5, -8e-6)),
        ),
        radial_compliance=2e-8,
        tilt_compliance=5e-8,
        radial_thermal=(-8.7e-8, 4.2e-7),
    ),
    lvdt=RadialReference(0.06, 5e-8, (2.6e-6, -7.2e-6)),
)
TIME = np.linspace(0, 40, 4001)


@pytest.fixture(scope="module")
def plant() -> StagePlant:
    return StagePlant(STAGE, 7, EPOCH, random_motion(7), intermittent_forces(7))


def harmonics(rows: Sequence[PlanarHarmonic], theta: Array) -> Array:
    total = np.zeros((2, len(theta)))
    for row in rows:
        for axis, (cosine, sine) in enumerate((row.x, row.y)):
            total[axis] += cosine * np.cos(row.order * theta) + sine * np.sin(row.order * theta)
    return total


def turned(theta: Array, vector: tuple[float, float]) -> Array:
    return np.array(
        [np.cos(theta) * vector[0] - np.sin(theta) * vector[1], np.sin(theta) * vector[0] + np.cos(theta) * vector[1]]
    )


def first_order(plant: StagePlant, time: Array) -> dict[str, Array]:
    """The signals by the formulas of the wire contract, from true rotation, force and temperature."""
    stage, scene = plant.stage, plant.scene(time)
    assert stage.lvdt is not None
    theta, force = scene.theta, np.array([scene.force.real, scene.force.imag])
    spindle, encoder = stage.spindle, stage.encoder
    d = harmonics(spindle.radial, theta) + spindle.radial_compliance * force
    d = d + np.outer(spindle.radial_thermal, scene.warming)
    g = harmonics(spindle.tilt, theta) + spindle.tilt_compliance * np.array([-force[1], force[0]])
    c = d + turned(theta, encoder.eccentricity)
    signals = {}
    for name, phi in encoder.azimuths.items():
        psi = phi - theta
        graduation = sum(r.cos * np.cos(r.order * psi) + r.sin * np.sin(r.order * psi) for r in encoder.graduation)
        signals[f"head_{name}"] = theta + (-c[0] * np.sin(phi) + c[1] * np.cos(phi)) / encoder.disc_radius + graduation
    signals["autocollimator"] = turned(theta, stage.mirror.tilt) + g + harmonics(stage.mirror.flatness, theta)
    height, artefact = stage.lvdt.height, stage.lvdt.artefact_eccentricity
    signals["lvdt"] = d + height * np.array([g[1], -g[0]]) + turned(theta, artefact)
    return signals


def test_signals_are_the_contracts_to_first_order(plant: StagePlant) -> None:
    expected = first_order(plant, TIME)
    count = STAGE.encoder.resolution
    for name in "abcd":
        error = plant.signal(f"head_{name}", TIME)[:, 0] - expected[f"head_{name}"]
        assert 0 < np.abs(error).max() < 0.1 * count  # a second-order term is there, and it is small
    assert np.abs(plant.signal("autocollimator", TIME).T - expected["autocollimator"]).max() < 1e-9
    assert np.abs(plant.signal("lvdt", TIME).T - expected["lvdt"]).max() < 1e-9


def test_without_graduation_error_the_formula_errs_by_the_third_order_only(plant: StagePlant) -> None:
    def deviation(scale: float) -> float:
        encoder = replace(STAGE.encoder, eccentricity=(scale * 4e-5, -scale * 3e-5), graduation=())
        still = replace(plant, description=replace(STAGE, encoder=encoder, spindle=Spindle()), jitter=0.0)
        return float(np.abs(still.signal("head_a", TIME)[:, 0] - first_order(still, TIME)["head_a"]).max())

    # the sight line passes through the axis: sin(shift) = displacement / radius
    assert deviation(20) / deviation(10) == pytest.approx(8, rel=0.01)


def test_reading_of_an_eccentric_ring_is_the_closed_form() -> None:
    # law of sines in the triangle of axis, ring centre and cut
    encoder = replace(STAGE.encoder, eccentricity=(3e-3, 0.0), graduation=())
    plant = StagePlant(replace(STAGE, encoder=encoder, spindle=Spindle()), 1)
    theta = plant.scene(TIME).theta
    for name, phi in encoder.azimuths.items():
        expected = theta + np.arcsin(3e-3 * np.sin(theta - phi) / 0.1)
        np.testing.assert_allclose(plant.signal(f"head_{name}", TIME)[:, 0], expected, rtol=0, atol=1e-12)


def test_reading_of_a_tilted_ring_is_the_closed_form() -> None:
    # seen in its own plane, a ring that leans about x shortens the y component of the sight line
    lean = 0.02
    encoder = replace(STAGE.encoder, eccentricity=(0.0, 0.0), graduation=())
    spindle = Spindle(tilt=(PlanarHarmonic(0, (lean, 0.0), (0.0, 0.0)),))
    plant = StagePlant(replace(STAGE, encoder=encoder, spindle=spindle), 1)
    theta = plant.scene(TIME).theta
    for phi_name in "abcd":  # along and across the tilt axis the foreshortening turns nothing
        np.testing.assert_allclose(plant.signal(f"head_{phi_name}", TIME)[:, 0], theta, rtol=0, atol=1e-12)
    slanted = replace(encoder, azimuths={"a": np.pi / 4})
    plant = replace(plant, description=replace(plant.description, encoder=slanted))
    expected = theta + np.pi / 4 - np.arctan(np.cos(lean))
    np.testing.assert_allclose(plant.signal("head_a", TIME)[:, 0], expected, rtol=0, atol=1e-12)


def test_autocollimator_sees_a_large_tilt_exactly() -> None:
    spindle = Spindle(tilt=(PlanarHarmonic(0, (0.0, 0.0), (0.1, 0.0)),))
    plant = StagePlant(replace(STAGE, mirror=Mirror(), spindle=spindle), 1)
    seen = plant.signal("autocollimator", TIME)
    np.testing.assert_allclose(seen, np.tile([0.0, 0.1], (len(TIME), 1)), rtol=0, atol=1e-15)


def test_lvdt_sees_the_exact_rotation_of_the_artefact() -> None:
    spindle = Spindle(tilt=(PlanarHarmonic(0, (0.1, 0.0), (0.0, 0.0)),))
    plant = StagePlant(replace(STAGE, spindle=spindle, lvdt=RadialReference(0.06, 0.0)), 1)
    expected = np.tile([0.0, -0.06 * np.sin(0.1)], (len(TIME), 1))
    np.testing.assert_allclose(plant.signal("lvdt", TIME), expected, rtol=0, atol=1e-15)


@pytest.mark.parametrize("stream", StagePlant(STAGE, 0).streams)
def test_samples_do_not_depend_on_how_they_are_asked_for(plant: StagePlant, stream: str) -> None:
    plant = replace(plant, description=replace(STAGE, autocollimator=turbulent()))
    whole = plant.samples(stream, -3, 500)
    pieces = [plant.samples(stream, first, count) for first, count in [(-3, 1), (-2, 7), (5, 200), (205, 292)]]
    np.testing.assert_array_equal(np.concatenate([piece.rows[:, 1:] for piece in pieces]), whole.rows[:, 1:])
    np.testing.assert_array_equal(np.concatenate([piece.times_ns for piece in pieces]), whole.times_ns)


def turbulent() -> Autocollimator:
    return replace(STAGE.autocollimator, turbulence=Turbulence(3.9e-7, 0.3))


def test_noise_is_as_described(plant: StagePlant) -> None:
    assert STAGE.lvdt is not None
    for stream, std, step in [
        ("head_a", STAGE.encoder.noise, STAGE.encoder.resolution),
        ("autocollimator", STAGE.autocollimator.noise, STAGE.autocollimator.resolution),
        ("lvdt", STAGE.lvdt.noise, 0.0),
        ("force", 0.2, 0.0),
        ("temperature", 0.01, 0.0),
    ]:
        block = plant.samples(stream, 0, 9000)
        seen = plant.signal(stream, (block.times_ns - EPOCH) * 1e-9)
        difference = block.rows[:, 1:] - seen
        assert difference.std() == pytest.approx(np.hypot(std, step / np.sqrt(12)), rel=0.03)
        assert np.abs(difference.mean()) < 4 * difference.std() / np.sqrt(difference.size)
    command = plant.samples("command", 0, 9000)
    np.testing.assert_array_equal(command.rows[:, 1:], plant.signal("command", (command.times_ns - EPOCH) * 1e-9))


def test_readings_are_whole_counts_and_stay_in_range(plant: StagePlant) -> None:
    angle = plant.samples("head_b", 0, 2000).column("angle") / STAGE.encoder.resolution
    np.testing.assert_allclose(angle, np.rint(angle), rtol=0, atol=1e-6)
    narrow = replace(STAGE, autocollimator=replace(STAGE.autocollimator, range=2e-5))
    tilt = replace(plant, description=narrow).samples("autocollimator", 0, 2000).columns(["tilt_x", "tilt_y"])
    assert np.abs(tilt).max() <= 2e-5 + 0.5 * STAGE.autocollimator.resolution
    assert (np.abs(tilt) > 1.9e-5).mean() > 0.1


def test_turbulence_has_its_standard_deviation_and_correlation_time() -> None:
    air = Turbulence(3.9e-7, 0.3)
    quiet = replace(STAGE.autocollimator, noise=0.0, resolution=1e-12, turbulence=air)
    plant = StagePlant(replace(STAGE, autocollimator=quiet), 5)
    block = plant.samples("autocollimator", 0, 400 * 1200)
    slow = (block.rows[:, 1:] - plant.signal("autocollimator", (block.times_ns) * 1e-9))[:, 0]
    assert slow.std() == pytest.approx(air.std, rel=0.05)
    lag = 120  # one correlation time
    assert np.mean(slow[lag:] * slow[:-lag]) / slow.var() == pytest.approx(np.exp(-1), abs=0.06)


def test_jitter_is_a_smooth_true_motion(plant: StagePlant) -> None:
    time = np.arange(0, 400, 0.002)
    scene = plant.scene(time)
    jitter = scene.theta - scene.command
    assert jitter.std() == pytest.approx(2e-6, rel=0.05)
    spectrum = np.abs(np.fft.rfft(jitter * np.hanning(len(jitter)))) ** 2
    frequency = np.fft.rfftfreq(len(jitter), 0.002)
    assert spectrum[frequency > 20.1].sum() < 1e-9 * spectrum.sum()
    np.testing.assert_array_equal(scene.error_motion[:, 5], jitter)


def test_other_seeds_give_other_jitter_and_noise(plant: StagePlant) -> None:
    other = replace(plant, seed=8)
    assert not np.allclose(other.scene(TIME).theta, plant.scene(TIME).theta, rtol=0, atol=1e-8)
    pairs = [(p.samples("lvdt", 0, 5000), p) for p in (plant, other)]
    noise = [b.rows[:, 1] - p.signal("lvdt", (b.times_ns - EPOCH) * 1e-9)[:, 0] for b, p in pairs]
    assert abs(np.corrcoef(*noise)[0, 1]) < 0.06


def test_streams_have_clocks_of_their_own() -> None:
    clocks = stage_clocks("abcd", 50_000.0)
    starts = [clock.times_ns(0, 1)[0] for clock in clocks.values()]
    assert len(set(starts) - {0}) >= 6
    clock = Clock(250.0, 0.0028, 1e-5)
    times = clock.times_ns(-10, 100_000)
    assert times[10] == 2_800_000
    assert times[-1] - times[0] == pytest.approx(99_999 * 4e6 * (1 + 1e-5), abs=1)
    for index in (-10, 0, 1, 99_000):
        time = int(clock.times_ns(index, 1)[0])
        assert [clock.index_at(time + step) for step in (-1, 0, 1)] == [index, index, index + 1]


def test_index_at_and_samples_use_absolute_time(plant: StagePlant) -> None:
    index = plant.index_at("autocollimator", EPOCH + 10_000_000_000)
    block = plant.samples("autocollimator", index, 2)
    assert block.stamp_ns >= EPOCH + 10_000_000_000 > block.stamp_ns - 2_500_000
    later = replace(plant, epoch_ns=EPOCH + 1)
    np.testing.assert_array_equal(later.samples("autocollimator", index, 2).rows, block.rows)


def test_a_day_later_the_reading_is_still_exact_to_a_fraction_of_a_count(plant: StagePlant) -> None:
    day = plant.index_at("head_a", EPOCH + 86_400 * 10**9)
    times = plant.clocks["head_a"].times_ns(day, 500) * 1e-9
    expected = first_order(plant, times)["head_a"]
    assert np.abs(plant.signal("head_a", times)[:, 0] - expected).max() < 0.1 * STAGE.encoder.resolution


def test_unknown_stream_is_refused_with_what_there_is() -> None:
    plant = StagePlant(replace(STAGE, lvdt=None), 1)
    asks: list[Callable[[], object]] = [
        lambda: plant.samples("lvdt", 0, 1),
        lambda: plant.signal("lvdt", TIME),
        lambda: plant.index_at("x", 0),
    ]
    for ask in asks:
        with pytest.raises(InputError, match="this stage has head_a, head_b, head_c, head_d, autocollimator, command"):
            ask()


@pytest.mark.parametrize("bad", [(0.0, 0.0, 0.0), (np.nan, 0.0, 0.0), (250.0, np.inf, 0.0), (250.0, 0.0, 0.5)])
def test_impossible_clocks_are_refused(bad: tuple[float, float, float]) -> None:
    with pytest.raises(InputError, match="rate must be positive"):
        Clock(*bad)
