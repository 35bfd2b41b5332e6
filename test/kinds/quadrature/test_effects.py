"""Each effect of sine and cosine signals against signals written down here, and the phase found back from them."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.kinds.quadrature.effects import QuadratureEffect
from rotary_error_monitor.kinds.quadrature.twin import distorted, predict_radius, true_phase

A = 500.0
PHASE = np.linspace(-np.pi, np.pi, 400, endpoint=False) + 0.003
COS, SIN = np.cos(PHASE), np.sin(PHASE)
EFFECTS = {effect.name: effect for effect in load_effects(QuadratureEffect)}
SIGNALS = {
    "signal_offset": ("", {"shift": [4.0, -7.0]}, (A * COS + 4, A * SIN - 7)),
    "unequal_gain": ("", {"relative": 0.02}, (1.01 * A * COS, 0.99 * A * SIN)),
    "quadrature_error": ("", {"angle": 0.03}, (A * COS, A * np.sin(PHASE + 0.03))),
    "signal_compression": ("", {"relative": 0.02}, (A * (COS - 0.02 * COS**3), A * (SIN - 0.02 * SIN**3))),
    "circle_harmonic": (
        "order_4",
        {"order": 4, "cos": -3.0, "sin": 1.0},
        (
            A * COS - 3 * np.cos(3 * PHASE) + np.sin(3 * PHASE),
            A * SIN + 3 * np.sin(3 * PHASE) + np.cos(3 * PHASE),
        ),
    ),
    "signal_clipping": (
        "",
        {"level": [480.0, 470.0, 475.0, 490.0], "part": 1.0},
        (np.clip(A * COS, -470, 480), np.clip(A * SIN, -490, 475)),
    ),
}


def cause_of(name):
    location, parameters, _ = SIGNALS[name]
    return Cause(EFFECTS[name], location, EFFECTS[name].values_from(parameters))


def test_every_effect_has_signals():
    assert set(EFFECTS) == set(SIGNALS)


@pytest.mark.parametrize("name", sorted(SIGNALS))
def test_effect_makes_these_signals(name):
    cosine, sine = SIGNALS[name][2]
    made = distorted(np.exp(1j * PHASE), A, (cause_of(name),))
    np.testing.assert_allclose(made, cosine + 1j * sine, rtol=0, atol=1e-9)
    assert EFFECTS[name].title and EFFECTS[name].source


@pytest.mark.parametrize("name", sorted(SIGNALS))
def test_phase_and_radius_are_found_back(name):
    cosine, sine = SIGNALS[name][2]
    signals, cause = cosine + 1j * sine, cause_of(name)
    away = np.angle(np.exp(1j * (true_phase(signals, A, (cause,)) - PHASE)))
    # Where both signals are cut off the phase is lost; nowhere else.
    known = (np.abs(cosine) < 469) | (np.abs(sine) < 469)
    np.testing.assert_allclose(away[known], 0.0, rtol=0, atol=1e-8)
    np.testing.assert_allclose(predict_radius(signals, A, (cause,)), np.abs(signals), rtol=0, atol=1e-6)
    assert np.abs(np.angle(signals * np.exp(-1j * PHASE))).max() > 1e-3, "the example must show the effect"


@pytest.mark.parametrize("name", sorted(SIGNALS))
def test_effect_without_size_changes_nothing(name):
    effect, location = EFFECTS[name], SIGNALS[name][0]
    idle = Cause(effect, location, effect.start(location))
    np.testing.assert_array_equal(distorted(np.exp(1j * PHASE), A, (idle,)), A * np.exp(1j * PHASE))


def test_effects_act_in_the_order_of_the_hardware_however_they_are_given():
    """Offset before the converter's limit: the limit is that of the shifted signal."""
    causes = (cause_of("signal_clipping"), cause_of("signal_offset"))
    made = distorted(np.exp(1j * PHASE), A, causes)
    np.testing.assert_allclose(made.real, np.clip(A * COS + 4, -470, 480), rtol=0, atol=1e-9)
    np.testing.assert_array_equal(made, distorted(np.exp(1j * PHASE), A, causes[::-1]))


def test_compression_is_a_fourth_harmonic_of_a_quarter_of_its_size():
    phase = np.linspace(0, 2 * np.pi, 360, endpoint=False)
    radius = np.abs(distorted(np.exp(1j * phase), A, (cause_of("signal_compression"),)))
    assert 2 * np.mean(radius * np.cos(4 * phase)) == pytest.approx(-0.02 * A / 4, rel=0.02)
