"""Each effect of a mount against the formula of pointing analysis (Wallace 2002), in hour angle and declination."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.kinds.mount.description import MountDescription, MountGeometry
from rotary_error_monitor.kinds.mount.effects import MountEffect
from rotary_error_monitor.kinds.mount.refraction import Weather, refraction_of
from rotary_error_monitor.kinds.mount.twin import MountRecording, MountTwin

LATITUDE = 0.68
RNG = np.random.default_rng(3)
COUNT = 40
HOUR, DECLINATION = RNG.uniform(-1.4, 1.4, COUNT), RNG.uniform(-0.3, 1.3, COUNT)
OTHER = np.arange(COUNT) % 2 == 1
"""Every other pointing is made on the other side of the pier."""
READINGS = np.column_stack([np.where(OTHER, HOUR + np.pi, HOUR), np.where(OTHER, np.pi - DECLINATION, DECLINATION)])
WAY = RNG.choice([-1.0, 1.0], (COUNT, 2))
TIME = np.linspace(-1800.0, 1800.0, COUNT)
WEATHER = Weather(10.0, 1000.0, 0.5)
RECORDING = MountRecording(READINGS, WAY, np.column_stack([HOUR, DECLINATION]), TIME, LATITUDE, WEATHER)
TWIN = MountTwin(MountDescription("mount", 1e-6), RECORDING)
EFFECTS = {effect.name: effect for effect in load_effects(MountEffect)}

SINE, COSINE = np.sin(LATITUDE), np.cos(LATITUDE)
SIDE = np.where(OTHER, -1.0, 1.0)
"""Which way the declination on the sky goes when the declination axis turns positively."""
NOTHING = np.zeros(COUNT)
UPWARD = SINE * np.sin(DECLINATION) + COSINE * np.cos(DECLINATION) * np.cos(HOUR)
"""Sine of the altitude."""


def angles(direction):
    """Hour angle and declination of directions in the ground's frame, x south, y east, z up."""
    south, east, up = direction
    polar = SINE * up - COSINE * south
    return np.arctan2(-east, SINE * south + COSINE * up), np.arcsin(polar)


def turned(axis):
    """Change of hour angle (on the sky) and declination by a small rotation (3, n) in the ground's frame."""
    a, b = HOUR, DECLINATION
    polar = np.stack([np.cos(b) * np.cos(a), -np.cos(b) * np.sin(a), np.sin(b)])
    ground = np.array([[SINE, 0, -COSINE], [0, 1, 0], [COSINE, 0, SINE]])
    moved = ground @ polar
    h, d = angles(moved + np.cross(axis, moved, axis=0))
    return np.angle(np.exp(1j * (h - a))) * np.cos(b), d - b


DOWN = (COSINE * np.sin(HOUR), COSINE * np.cos(HOUR) * np.sin(DECLINATION) - SINE * np.cos(DECLINATION))
"""Away from the zenith, in proportion to the sine of the zenith distance."""
LEVEL = np.hypot(*DOWN)
REFRACTION = refraction_of(np.arcsin(UPWARD), WEATHER)
FORMULAS = {
    "tube_flexure": ("", {"sag": 1e-5}, (1e-5 * DOWN[0], 1e-5 * DOWN[1])),
    "declination_axis_flexure": ("", {"sag": 1e-5}, (1e-5 * SIDE * UPWARD, NOTHING)),
    "fork_flexure": ("", {"yield": 1e-5}, (NOTHING, 1e-5 * COSINE * np.cos(HOUR))),
    "axis_eccentricity": (
        "H",
        {"cos": 1e-5, "sin": -2e-5},
        ((1e-5 * np.cos(READINGS[:, 0]) - 2e-5 * np.sin(READINGS[:, 0])) * np.cos(DECLINATION), NOTHING),
    ),
    "axis_harmonic": (
        "D",
        {"order": 3, "cos": 1e-5, "sin": 2e-5},
        (NOTHING, SIDE * (1e-5 * np.cos(3 * READINGS[:, 1]) + 2e-5 * np.sin(3 * READINGS[:, 1]))),
    ),
    "axis_gear_ratio": ("H", {"relative": 1e-5}, (1e-5 * READINGS[:, 0] * np.cos(DECLINATION), NOTHING)),
    "axis_backlash": ("D", {"width": 2e-5}, (NOTHING, -SIDE * 1e-5 * WAY[:, 1])),
    "axis_slip": ("H", {"rate": 1e-8}, (1e-8 * TIME * np.cos(DECLINATION), NOTHING)),
    "pier_side_shift": ("D", {"shift": 2e-5}, (NOTHING, np.where(OTHER, -1e-5, -1e-5))),
    "settling_ground": (
        "",
        {"rate": [1e-8, -2e-8]},
        turned(np.stack([1e-8 * TIME, -2e-8 * TIME, NOTHING])),
    ),
    "refraction_scale": (
        "",
        {"relative": 0.05},
        (0.05 * REFRACTION * DOWN[0] / LEVEL, 0.05 * REFRACTION * DOWN[1] / LEVEL),
    ),
}


def test_every_effect_has_a_formula():
    assert set(EFFECTS) == set(FORMULAS)


@pytest.mark.parametrize("name", sorted(FORMULAS))
def test_effect_agrees_with_its_formula(name):
    location, parameters, expected = FORMULAS[name]
    effect = EFFECTS[name]
    cause = Cause(effect, location, effect.values_from(parameters))
    h, d = angles(TWIN.pointing(MountGeometry(), (cause,)))
    shown = np.angle(np.exp(1j * (h - HOUR))) * np.cos(DECLINATION), d - DECLINATION
    np.testing.assert_allclose(shown, expected, rtol=0, atol=3e-9)
    assert np.abs(expected).max() > 5e-6, "the example must show the effect"
    assert location in effect.locations(TWIN.machine)
    assert effect.title and effect.source


@pytest.mark.parametrize("name", sorted(FORMULAS))
def test_effect_without_size_changes_nothing(name):
    effect, location = EFFECTS[name], FORMULAS[name][0]
    idle = Cause(effect, location, effect.start(location))
    np.testing.assert_allclose(
        TWIN.pointing(MountGeometry(), (idle,)), TWIN.pointing(MountGeometry()), rtol=0, atol=1e-15
    )


TANGENT, SECANT_FREE = np.sin(DECLINATION), np.cos(DECLINATION)
GEOMETRY = {
    "hour_index": (MountGeometry(hour_index=1e-5), (SECANT_FREE, NOTHING)),
    "declination_index": (MountGeometry(declination_index=1e-5), (NOTHING, SIDE)),
    "orthogonality": (MountGeometry(orthogonality=1e-5), (-SIDE * TANGENT, NOTHING)),
    "collimation": (MountGeometry(collimation=1e-5), (SIDE, NOTHING)),
    "polar_tilt": (
        MountGeometry(polar_tilt=(1e-5, -2e-5)),
        (
            -(np.cos(HOUR) + 2 * np.sin(HOUR)) * TANGENT,
            -np.sin(HOUR) + 2 * np.cos(HOUR),
        ),
    ),
}


@pytest.mark.parametrize("name", sorted(GEOMETRY))
def test_geometry_agrees_with_the_terms_of_pointing_analysis(name):
    """IH, ID, NP, CH and MA, ME of a first-order pointing model, but for their signs."""
    geometry, terms = GEOMETRY[name]
    h, d = angles(TWIN.pointing(geometry))
    shown = np.angle(np.exp(1j * (h - HOUR))) * np.cos(DECLINATION), d - DECLINATION
    for got, term in zip(shown, terms, strict=True):
        np.testing.assert_allclose(np.abs(got), np.abs(1e-5 * term), rtol=0, atol=2e-9)
