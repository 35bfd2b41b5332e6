"""Is this calibration good? A number, a sentence, and good or not."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.calibration.identification import (
    HeldOutCheck,
    Identification,
    ProbedPoses,
    choose_further_poses,
    estimate_jacobian,
    parameter_scales,
    rank_with_longer_tool,
)
from rotary_error_monitor.calibration.pose_terms import fit_terms, poses_of_terms
from rotary_error_monitor.calibration.volume import Limits, sample_volume

SAMPLES = 200

DRAWS = 10_000
"""Probable errors that are drawn for a bound of 95 %: it is that of 94.6 to 95.4 %."""


@dataclass(frozen=True)
class CalibrationVerdict:
    """Whether a calibration is good.

    Attributes:
        good: it predicts held-out poses and the tool anywhere in the volume to `required`, and has no doubts.
        uncertainty: standard uncertainty of the predicted tool position in the working volume, root mean square, m.
        bound: 95 % bound of the error of the predicted position, root mean square over the working volume, m.
        largest: the same as `uncertainty` at its worst pose, m.
        required: what `uncertainty` is held against, m.
        sentence: the verdict in words.
        further_poses: axis positions that would add most, in the order of the machine's axes, m or rad.
        rank_with_longer_tool: combinations that the same poses see with a second tool that is 100 mm longer.
        pose_terms: how the uncertainty depends on the pose (`machine/pose_uncertainty.py`), m.
    """

    good: bool
    uncertainty: float
    bound: float
    largest: float
    required: float
    sentence: str
    further_poses: tuple[tuple[float, ...], ...]
    rank_with_longer_tool: int
    pose_terms: Mapping[str, float] = field(default_factory=dict)


def judge_calibration(
    identification: Identification,
    held_out: HeldOutCheck,
    poses: ProbedPoses,
    *,
    required: float,
    limits: Limits | None = None,
    doubts: Sequence[str] = (),
) -> CalibrationVerdict:
    """The verdict on an identified machine, which a held-out check and the poses it came from go with.

    `doubts` are sentences on what else does not fit; with any the calibration is not good.

    What the poses did not see counts with the typical size of an error: it is harmless where it moves the tool tip as
    little in the working volume as it did at the poses, and shows in the number where not. `required` is the largest
    standard uncertainty of the predicted tool position, m; `limits` is the working volume by axis letter, by default
    the whole travel.

    Raises:
        InputError: limits that do not fit the machine.
    """
    machine = identification.machine
    volume = sample_volume(machine, SAMPLES, limits)
    jacobian = _jacobian(identification, volume, poses.noise)
    hidden = identification.hidden * parameter_scales(identification.parameters)
    covariance = identification.covariance + hidden.T @ hidden
    bound = _bound(jacobian, covariance)
    variance = _variance(jacobian, covariance)
    places = poses_of_terms(machine, limits)
    terms = fit_terms(machine, places, _variance(_jacobian(identification, places, poses.noise), covariance))
    uncertainty, largest = math.sqrt(float(variance.mean())), math.sqrt(float(variance.max()))
    good = held_out.ratio <= held_out.limit and uncertainty <= required and not doubts
    sizes = (uncertainty, bound, largest, required)
    sentence = " ".join([_sentence(held_out, *(size * 1e6 for size in sizes), good=good), *doubts])
    further = volume[choose_further_poses(identification, volume, poses)]
    return CalibrationVerdict(
        good,
        uncertainty,
        bound,
        largest,
        required,
        sentence,
        tuple(tuple(float(value) for value in pose) for pose in further),
        rank_with_longer_tool(identification, poses),
        terms,
    )


def _sentence(
    held_out: HeldOutCheck, uncertainty: float, bound: float, largest: float, required: float, *, good: bool
) -> str:
    """The verdict in words, of sizes in µm."""
    sentence = (
        f"The calibration is {'good' if good else 'not good'}: it predicts the tool in the working volume to "
        f"{uncertainty:.2f} µm (95 % bound {bound:.2f} µm, at worst {largest:.2f} µm, required "
        f"{required:.2f} µm), and on {held_out.count} held-out poses it errs by {held_out.ratio:.2f} times what "
        "noise and uncertainty explain"
    )
    if held_out.ratio <= held_out.limit:
        return f"{sentence}."
    return f"{sentence}, more than the {held_out.limit:.2f} of a model that holds all errors."


def _jacobian(identification: Identification, places: Array, noise: float) -> Array:
    """(n, 3, p) derivative of the tool's position by each parameter at places (n, axes), at reference temperature."""
    machine, count = identification.machine, len(places)
    warmth = np.full(count, machine.reference_temperature)
    planned = ProbedPoses(places, np.zeros_like(places), warmth, np.zeros((count, 3)), noise)
    return estimate_jacobian(machine, identification.parameters, planned).reshape(count, 3, -1)


def _variance(jacobian: Array, covariance: Array) -> Array:
    """(n,) of the position, sum over three directions, m²."""
    return np.asarray(np.einsum("nip,pq,niq->n", jacobian, covariance, jacobian, optimize=True), dtype=np.float64)


def _bound(jacobian: NDArray[np.float64], covariance: NDArray[np.float64]) -> float:
    """95 % bound of the root mean square error over poses, m: errors J (n, 3, p) d of normal parameters d.

    Its square is a sum of squared normal values with weights, the eigenvalues of the mean of JᵀJ times the covariance.
    """
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2)
    moved = jacobian @ (vectors * np.sqrt(np.maximum(values, 0.0)))
    weights = np.linalg.eigvalsh(np.einsum("nip,niq->pq", moved, moved) / len(jacobian))
    drawn = np.random.default_rng(0).chisquare(1, size=(DRAWS, weights.size)) @ np.maximum(weights, 0.0)
    return math.sqrt(float(np.quantile(drawn, 0.95)))
