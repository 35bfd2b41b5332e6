"""Diagnosis of sine and cosine signals: made here, and those of a real interferometer with its author's corrections."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
from draws import seeds

from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.kinds.quadrature.description import QuadratureDescription, load_quadrature
from rotary_error_monitor.kinds.quadrature.effects import QuadratureEffect
from rotary_error_monitor.kinds.quadrature.problem import QuadratureProblem, radius_scatter
from rotary_error_monitor.kinds.quadrature.signals import read_quadrature, read_signals
from rotary_error_monitor.kinds.quadrature.twin import QuadratureRecording, true_phase

ROOT = Path(__file__).parents[3]
REAL = ROOT.parent / "shared" / "real" / "nmm_quadrature"
EFFECTS = load_effects(QuadratureEffect)
TWIN = QuadratureDescription("signals", 3.164e-7, 500.0, 50.0, 0.29)
real = pytest.mark.skipif(not REAL.is_dir(), reason="no real signals beside the checkout (../shared/real)")


def problem_of(signals, effects=EFFECTS):
    return QuadratureProblem(TWIN, QuadratureRecording(signals), effects)


def made(seed, distort=lambda cosine, sine: (cosine, sine), count=12000, noise=0.6):
    """Signals in whole counts at random phases of a circle of 505 counts."""
    rng = np.random.default_rng(seed)
    phase = rng.uniform(-np.pi, np.pi, count)
    cosine, sine = distort(505 * np.cos(phase), 505 * np.sin(phase))
    return np.round(cosine + noise * rng.normal(size=count)) + 1j * np.round(sine + noise * rng.normal(size=count))


@pytest.mark.parametrize("seed", seeds(5))
def test_a_circle_of_any_size_has_no_gap(seed):
    diagnosis = diagnose(problem_of(made(seed)))
    assert diagnosis.verdict is Verdict.NO_GAP
    assert diagnosis.figures["amplitude_counts"] == pytest.approx(505, abs=0.1)


def squeezed(cosine, sine):
    return cosine - 0.015 * cosine**3 / 505**2, sine - 0.015 * sine**3 / 505**2


CASES = {
    "signal_offset": (lambda c, s: (c + 3, s - 2), {("signal_offset", ""): {"shift": (3.0, -2.0)}}),
    "unequal_gain": (lambda c, s: (1.01 * c, 0.99 * s), {("unequal_gain", ""): {"relative": 0.02}}),
    "quadrature_error": (
        lambda c, s: (c, s * np.cos(0.01) + c * np.sin(0.01)),
        {("quadrature_error", ""): {"angle": 0.01}},
    ),
    "signal_compression": (squeezed, {("signal_compression", ""): {"relative": 0.015}}),
    "offset and gain": (
        lambda c, s: (1.005 * c + 1, 0.995 * s + 4),
        {("signal_offset", ""): {"shift": (1.0, 4.0)}, ("unequal_gain", ""): {"relative": 0.01}},
    ),
}


@pytest.mark.parametrize("name", sorted(CASES))
def test_the_cause_is_found_and_sized(name):
    distort, expected = CASES[name]
    diagnosis = diagnose(problem_of(made(3, distort)))
    assert diagnosis.verdict is Verdict.EXPLAINED
    assert {found.cause.key for found in diagnosis.causes} == set(expected)
    for found in diagnosis.causes:
        for parameter, value in expected[found.cause.key].items():
            estimate = found.parameters[parameter]
            assert np.all(np.abs(np.subtract(estimate.value, value)) < 4 * np.asarray(estimate.std))
    assert diagnosis.figures["radius_std_after_counts"] == pytest.approx(diagnosis.figures["noise_counts"], rel=0.02)


def test_limits_of_a_converter_are_found_to_a_fraction_of_a_count():
    """Cut after rounding, as a converter does."""
    signals = made(4)
    cut = np.clip(signals.real, -490, 495) + 1j * np.clip(signals.imag, -488, 493)
    diagnosis = diagnose(problem_of(cut), most_causes=1)
    (found,) = diagnosis.causes
    assert found.cause.key == ("signal_clipping", "")
    assert found.parameters["level"].value == pytest.approx((495, 490, 493, 488), abs=1e-3)
    assert found.parameters["part"].value == pytest.approx(1.0, abs=0.01)


def test_an_effect_that_is_not_known_is_not_named():
    known = tuple(effect for effect in EFFECTS if effect.name in ("signal_offset", "quadrature_error"))
    diagnosis = diagnose(problem_of(made(3, lambda c, s: (1.01 * c, 0.99 * s)), known))
    assert diagnosis.verdict is Verdict.UNKNOWN
    assert diagnosis.remainder[0].pattern == "phase: order 2"


def test_scatter_is_noise_whatever_the_circle_looks_like():
    signals = made(2, lambda c, s: (1.05 * c + 20, s), noise=1.0)
    signals[5] *= 1.2
    scatter, kept = radius_scatter(signals)
    assert scatter == pytest.approx(np.hypot(1.0, np.sqrt(1 / 12)), rel=0.02)
    assert not kept[5] and kept.sum() == len(kept) - 1


def test_signals_are_read_in_both_forms(tmp_path):
    signals = made(1, count=600)
    polar = "Phase (deg), Radius, Roundness deviation\n" + "".join(
        f"{np.degrees(np.angle(s)):.6f}, {abs(s):.6f}, 0\n" for s in signals
    )
    (tmp_path / "a.csv.gz").write_bytes(gzip.compress(polar.encode()))
    (tmp_path / "b.csv").write_text("time,sin,cos\n" + "".join(f"0,{s.imag},{s.real}\n" for s in signals))
    np.testing.assert_allclose(read_signals(tmp_path / "a.csv.gz"), signals, rtol=0, atol=1e-4)
    np.testing.assert_allclose(read_signals(tmp_path / "b.csv"), signals, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("x,y\n1,2\n", r"a\.csv:1: columns \['x', 'y'\]; expected phase \(deg\) and radius, or cos and sin"),
        ("", "columns none"),
        ("cos,sin\n" + "1,2\n" * 10, "10 samples; at least 500"),
        ("cos,sin\n" + "1,2\n" * 600 + "1,x\n", "expected numbers in columns cos and sin"),
        ("cos,sin\n" + "1,2\n" * 600 + "1,nan\n", r"a\.csv:602: .*finite"),
        ("cos,sin\n\n\n" + "1,2\n" * 600 + "\n1,nan\n", r"a\.csv:605: .*finite"),
        ("cos,sin\n" + "\n" * 600, "0 samples; at least 500"),
        ("cos,sin\n" + "\r\n" * 600 + "1,2\n" * 10, "10 samples; at least 500"),
        ("cos,sin\n" + "1,2\n" * 600 + "1" * 70_000, "a line of 7000. characters"),
    ],
)
def test_wrong_files_are_told(tmp_path, content, message):
    (tmp_path / "a.csv").write_text(content)
    with pytest.raises(InputError, match=message):
        read_signals(tmp_path / "a.csv")


def test_a_file_that_is_not_there_is_told(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        read_signals(tmp_path / "none.csv")


def test_signals_of_another_size_are_refused():
    with pytest.raises(InputError, match="mean radius is 1515 counts"):
        diagnose(problem_of(3 * made(1)))


@pytest.fixture(scope="module")
def diagnosed():
    found = {}

    def of(axis):
        if axis not in found:
            recording = read_quadrature(REAL / f"test01_XYZ_f_quad_{axis}_raw.csv.gz")
            problem = QuadratureProblem(load_quadrature(ROOT / "config" / "quadrature.yaml"), recording, EFFECTS)
            found[axis] = problem, diagnose(problem, most_causes=6)
        return found[axis]

    return of


@real
@pytest.mark.parametrize(("axis", "noise"), [("X", 0.74), ("Z", 0.77), ("Y", 0.65)])
def test_real_circles_become_round_to_their_noise(diagnosed, axis, noise):
    """Rounder than the author's second correction on every axis, and far rounder where the converters end early."""
    _, diagnosis = diagnosed(axis)
    author = np.std(np.abs(read_signals(REAL / f"test01_XYZ_f_quad_{axis}_MatusDai.csv.gz")))
    assert diagnosis.verdict in (Verdict.EXPLAINED, Verdict.PARTLY_EXPLAINED)
    assert diagnosis.figures["radius_std_after_counts"] < min(noise, author)
    names = {found.cause.effect.name for found in diagnosis.causes}
    assert "signal_offset" in names and "quadrature_error" in names
    assert ("signal_clipping" in names) == (axis == "Y")


@real
def test_the_limits_found_are_those_at_which_the_real_signals_pile_up(diagnosed):
    problem, diagnosis = diagnosed("Y")
    (clipping,) = (found for found in diagnosis.causes if found.cause.effect.name == "signal_clipping")
    whole = np.round(problem.samples.real), np.round(problem.samples.imag)
    ends = (whole[0].max(), -whole[0].min(), whole[1].max(), -whole[1].min())
    assert clipping.parameters["level"].value == pytest.approx(ends, abs=0.1)
    assert all(np.mean(np.abs(signal) >= 510) > 0.2 for signal in whole)


def phase_changed_by(problem, diagnosis, names):
    """(n,) phase of each sample less what it shows, rad, for some of the causes."""
    causes = [found.cause for found in diagnosis.causes if found.cause.effect.name in names]
    assert {cause.effect.name for cause in causes} == set(names)
    amplitude = problem.settled([found.cause for found in diagnosis.causes])
    return true_phase(problem.samples, amplitude, causes) - np.angle(problem.samples)


@real
@pytest.mark.parametrize("axis", ["X", "Z"])
def test_offset_and_gain_agree_with_the_authors_correction(diagnosed, axis):
    """Both correct the same samples and sort them; where the circle begins is a matter of convention.

    The author's corrected phases, row by row, less ours: the best turn is taken off.
    """
    problem, diagnosis = diagnosed(axis)
    change = phase_changed_by(problem, diagnosis, ("signal_offset", "unequal_gain", "quadrature_error"))
    ours = np.sort(np.mod(np.angle(problem.samples) + change, 2 * np.pi))
    author = np.mod(np.angle(read_signals(REAL / f"test01_XYZ_f_quad_{axis}_Heydemann.csv.gz")), 2 * np.pi)
    spreads = [np.std(np.angle(np.exp(1j * (np.roll(ours, shift) - np.sort(author))))) for shift in range(-80, 81)]
    assert np.std(change) > 4e-3, "there is something to correct"
    assert min(spreads) < 3e-4, "rad, which is 0.015 nm"


@real
@pytest.mark.parametrize("axis", ["X", "Z"])
def test_saturation_corrects_the_phase_as_the_author_found_by_experiment(diagnosed, axis):
    """Matus corrects 30.525 nm sin 4φ times the relative squashing of the circle, an empirical constant (NmmReader).

    Saturation of third order follows from physics alone: the same sign, and nearly the size.
    """
    problem, diagnosis = diagnosed(axis)
    change = phase_changed_by(problem, diagnosis, ("signal_compression",))
    ours = 2 * np.mean(change * np.sin(4 * np.angle(problem.samples))) * 316.4 / (2 * np.pi)
    round_signals = read_signals(REAL / f"test01_XYZ_f_quad_{axis}_Heydemann.csv.gz")
    radius, degrees = np.abs(round_signals), np.mod(np.degrees(np.angle(round_signals)), 90)
    between = np.mean(radius[np.abs(degrees - 45) < 2])
    on_axis = np.mean(radius[np.minimum(degrees, 90 - degrees) < 2])
    author = -30.525 * (between - on_axis) / np.mean(radius)
    assert author == pytest.approx(1.2 * ours, rel=0.1)
    assert abs(ours) > 0.2
