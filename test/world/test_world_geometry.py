"""The exact geometry against another way to compute it: rotation matrices and a search for the cut, large errors."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from .geometry import BALL, autocollimator_reading, head_reading, lvdt_reading, rotate
from .rotor import Components


def pose(theta: float, seed: int) -> Components:
    """A rotor far out of place."""
    d = np.random.default_rng(seed).uniform(-1.0, 1.0, 5) * [0.01, 0.01, 0.01, 0.2, 0.2]
    return Components(*np.array([[theta], *d[:, None], [0.0]]))


def orientation(at: Components) -> Rotation:
    """The rotor's orientation: its tilt after its rotation."""
    return Rotation.from_rotvec([at.eac[0], at.ebc[0], 0.0]) * Rotation.from_rotvec([0.0, 0.0, at.theta[0]])


@pytest.mark.parametrize("seed", range(12))
def test_a_head_reads_the_line_where_its_sight_cuts_the_ring(seed):
    rng = np.random.default_rng(seed + 100)
    theta, azimuth = rng.uniform(-40.0, 40.0), rng.uniform(-6.0, 6.0)
    at, eccentricity, radius = pose(theta, seed), rng.uniform(-0.01, 0.01, 2), 0.1
    graduation = [{"order": 3, "cos": 0.01, "sin": -0.02}]
    encoder = {"disc_radius": radius, "eccentricity": eccentricity, "graduation": graduation}
    turn = orientation(at)
    place = np.array([at.exc[0], at.eyc[0], at.ezc[0]])

    def on_rotor(s: float) -> np.ndarray:
        """A point of the line of sight as the rotor sees it, from the ring's centre."""
        point = s * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        return turn.inv().apply(point - place)[:2] - eccentricity

    cut = on_rotor(brentq(lambda s: np.hypot(*on_rotor(s)) - radius, 0.02, 0.5, xtol=1e-15))
    psi = np.arctan2(cut[1], cut[0])
    expected = azimuth - psi + 0.01 * np.cos(3 * psi) - 0.02 * np.sin(3 * psi)
    reading = head_reading(at, azimuth, encoder)[0]
    assert abs(np.angle(np.exp(1j * (reading - expected)))) < 1e-11
    assert abs(reading - theta) < 1.0


@pytest.mark.parametrize("seed", range(6))
def test_the_autocollimator_sees_the_reflected_ray(seed):
    rng = np.random.default_rng(seed)
    at, tilt, wave = pose(rng.uniform(-9.0, 9.0), seed), rng.uniform(-0.05, 0.05, 2), rng.uniform(-0.02, 0.02, 4)
    mirror = {"tilt": tilt, "flatness": [{"order": 2, "x": wave[:2], "y": wave[2:]}]}
    c, s = np.cos(2 * at.theta[0]), np.sin(2 * at.theta[0])
    bent = Rotation.from_rotvec([wave[0] * c + wave[1] * s, wave[2] * c + wave[3] * s, 0.0])
    tilted = Rotation.from_rotvec([at.eac[0], at.ebc[0], 0.0])
    turned = Rotation.from_rotvec([0.0, 0.0, at.theta[0]])
    normal = (tilted * bent * turned * Rotation.from_rotvec([*tilt, 0.0])).apply([0.0, 0.0, 1.0])
    ray = np.array([0.0, 0.0, -1.0]) - 2.0 * np.dot([0.0, 0.0, -1.0], normal) * normal
    expected = 0.5 * np.array([-ray[1], ray[0]]) / ray[2]
    assert np.allclose(autocollimator_reading(at, mirror)[0], expected, atol=1e-13)


@pytest.mark.parametrize("seed", range(6))
def test_the_lvdt_touches_the_ball(seed):
    rng = np.random.default_rng(seed)
    at, shift, height = pose(rng.uniform(-9.0, 9.0), seed), rng.uniform(-1e-3, 1e-3, 2), 0.01
    at = Components(at.theta, 0.1 * at.exc, 0.1 * at.eyc, 0.1 * at.ezc, at.eac, at.ebc, at.ecc)
    centre = orientation(at).apply([*shift, height]) + [at.exc[0], at.eyc[0], at.ezc[0]]
    reading = lvdt_reading(at, {"height": height, "artefact_eccentricity": shift})[0]
    for contact in ([BALL + reading[0], 0.0, height], [0.0, BALL + reading[1], height]):
        assert abs(np.linalg.norm(np.array(contact) - centre) - BALL) < 1e-14


def test_rotate_is_a_rotation():
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-2.0, 2.0, (2, 50))
    vectors = rng.standard_normal((50, 3))
    expected = Rotation.from_rotvec(np.stack([x, y, np.zeros(50)], axis=1)).apply(vectors)
    assert np.allclose(rotate(x, y, vectors), expected, atol=1e-12)
    assert np.array_equal(rotate(np.zeros(50), np.zeros(50), vectors), vectors)
