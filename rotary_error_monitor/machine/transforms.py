"""Rotations, transforms and vectors of many poses at once, element by element.

Rotations are (3, 3, ..., n), transforms (3, 4, ..., n) and vectors (3, ..., n), poses last: every operation is the same
sum of products for each pose, so one pose alone gives bit for bit what it gives among others. BLAS (`@`, `einsum`) and
reductions (`sum`, `dot`) choose their order of summation by shape and do not.
"""

from __future__ import annotations

import numpy as np

from rotary_error_monitor.arrays import Array


def rotation_by(vector: Array) -> Array:
    """(3, 3, ..., n) rotation by the rotation vectors (3, ..., n) in rad: about their direction, by their length.

    With `u = sin(a/2) v/a`, a unit quaternion's vector part, R = 1 + 2 cos(a/2) [u]× + 2 [u]×²; it holds down to a = 0.
    Pan et al. 2013 multiply three rotations instead (Equations 5, 7; the third factor of Equation 5 is printed with
    alpha for gamma) and keep the first order of small ones (Equations 6, 8).
    """
    angle = length(vector)
    u = vector * (0.5 * np.sinc(angle / (2 * np.pi)))
    twice = 2.0 * u
    sine = np.cos(0.5 * angle) * twice
    rotation: Array = twice[:, None] * u[None]
    square = [rotation[i, i].copy() for i in range(3)]
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        rotation[i, i] = 1.0 - (square[j] + square[k])
        rotation[i, j] -= sine[k]
        rotation[j, i] += sine[k]
    return rotation


def rotation_vector(rotation: Array) -> Array:
    """(3, ..., n) rotation vector in rad of (3, 3, ..., n) rotations by less than pi."""
    vector = 0.5 * np.stack(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    sine = length(vector)
    cosine = 0.5 * (rotation[0, 0] + rotation[1, 1] + rotation[2, 2] - 1.0)
    # angle / sin(angle) is 1 to the last bit for the angles below 1e-8, where the quotient would be 0 / 0.
    scale: Array = np.where(sine > 1e-8, np.arctan2(sine, cosine) / np.where(sine > 1e-8, sine, 1.0), 1.0)
    return vector * scale


def compose(first: Array, second: Array) -> Array:
    """(3, 3, ..., n) product of rotations, or (3, 4, ..., n) of a rotation and a transform; `second` acts first."""
    product: Array = first[:, 0, None] * second[0]
    product = product + first[:, 1, None] * second[1]
    product += first[:, 2, None] * second[2]
    return product


def chain(first: Array, second: Array) -> Array:
    """(3, 4, ..., n) product of transforms; `second` acts first."""
    product = compose(first, second)
    product[:, 3] += first[:, 3]
    return product


def transform(rotation: Array, shift: Array) -> Array:
    """(3, 4, ..., n) transform `p -> rotation p + shift`: rotation in columns 0-2, shift in column 3."""
    return np.concatenate([rotation, shift[:, None]], axis=1)


def rotate(rotation: Array, vector: Array) -> Array:
    """(3, ..., n) vectors turned by rotations, or by the rotations of transforms."""
    rotated: Array = rotation[:, 0] * vector[0]
    rotated = rotated + rotation[:, 1] * vector[1]
    rotated += rotation[:, 2] * vector[2]
    return rotated


def inverse(rotation: Array) -> Array:
    """(3, 3, ..., n) inverse of rotations, or of the rotations of transforms."""
    return np.swapaxes(rotation[:, :3], 0, 1)


def cross(a: Array, b: Array) -> Array:
    """(3, ..., n) cross products."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def dot(a: Array, b: Array) -> Array:
    """(..., n) scalar products."""
    product: Array = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


def length(vector: Array) -> Array:
    """(..., n) lengths."""
    root: Array = np.sqrt(dot(vector, vector))
    return root
