from __future__ import annotations

import numpy as np
import pytest
from pytransform3d.rotations import matrix_from_compact_axis_angle

from rotary_error_monitor.machine.transforms import (
    chain,
    compose,
    cross,
    inverse,
    rotate,
    rotation_by,
    rotation_vector,
    transform,
)


@pytest.mark.parametrize("size", [0.0, 1e-300, 1e-12, 1e-6, 1e-3, 0.5, 2.0, 3.1])
def test_rotation_by_vector_and_back(size: float) -> None:
    rng = np.random.default_rng(1)
    vectors = rng.normal(size=(3, 50))
    vectors *= size / np.sqrt((vectors**2).sum(axis=0))
    rotation = rotation_by(vectors)
    truth = np.stack([matrix_from_compact_axis_angle(v) for v in vectors.T], axis=-1)
    np.testing.assert_allclose(rotation, truth, atol=1e-15)
    np.testing.assert_allclose(rotation_vector(rotation), vectors, atol=2e-14)


def test_products_agree_with_matrices() -> None:
    rng = np.random.default_rng(2)
    a, b = (transform(rotation_by(rng.normal(size=(3, 20))), rng.normal(size=(3, 20))) for _ in range(2))
    v = rng.normal(size=(3, 20))
    for i in range(20):
        first, second = (np.vstack([m[..., i], [0, 0, 0, 1]]) for m in (a, b))
        np.testing.assert_allclose(chain(a, b)[..., i], (first @ second)[:3], atol=1e-14)
        np.testing.assert_allclose(compose(a[:, :3], b[:, :3])[..., i], (first @ second)[:3, :3], atol=1e-14)
        np.testing.assert_allclose(rotate(a, v)[:, i], first[:3, :3] @ v[:, i], atol=1e-14)
        np.testing.assert_allclose(inverse(a)[..., i], np.linalg.inv(first[:3, :3]), atol=1e-14)
        np.testing.assert_allclose(cross(v, a[:, 3])[:, i], np.cross(v[:, i], a[:, 3, i]), atol=1e-14)
