"""What `calibrate errors --uncertainty` and `offset` state, against machines drawn and moved by other means.

Machines are drawn here number by number, their offsets are pytransform3d's products of exact matrices.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from draws import ALL
from kernels import FORMS, computing_by, is_built
from numpy.typing import NDArray

from rotary_error_monitor.calibration.volume import draws_for, estimate_uncertain_offsets, sample_volume
from rotary_error_monitor.description.machine import MachineDescription, load_machine
from rotary_error_monitor.description.machine_parts import Displacement
from rotary_error_monitor.machine.budget import offset_covariance

Array = NDArray[np.float64]

MACHINES = 500 if ALL else 120
POSES = 60
STATED = {"location.linear": 3e-6, "location.angular": 5e-6, "errors.linear": 8e-7, "errors.angular": 2e-6}
CHI_SQUARE_3 = 7.815
"""Not exceeded by chi-square of three degrees of freedom in 95 of 100 cases."""

LEAST, MOST = (0.93, 0.97) if ALL else (0.87, 0.99)
"""Of 120 at 95 %, 104 or fewer, or 119 or more, come by chance less often than once in a hundred."""


@pytest.fixture(autouse=True, scope="module")
def form() -> Iterator[None]:
    """By the form that users have: other tests hold both against one another, to the last digits."""
    with computing_by(FORMS[not is_built()]):
        yield


def described(name: str, *, ideal: bool = False) -> MachineDescription:
    """A machine whose stated uncertainties are all that is uncertain of it; an ideal one is said to have no errors."""
    machine = load_machine(name)
    axes = tuple(replace(axis, repeatability=None) for axis in machine.axes)
    if ideal:
        axes = tuple(replace(axis, expansion=0.0, reversal=0.0) for axis in axes)
        bodies = tuple(replace(body, location_error=Displacement()) for body in machine.bodies)
        return replace(machine, axes=axes, bodies=bodies, errors={}, uncertainty=STATED, calibrated={})
    errors = {name: replace(each, table=None, harmonic=()) for name, each in machine.errors.items()}
    return replace(machine, axes=axes, errors=errors, uncertainty=STATED, calibrated={})


def drawn(machine: MachineDescription, rng: np.random.Generator) -> MachineDescription:
    """Places of all bodies that axes move, and all coefficients that are not zero, off by normal deviates."""
    bodies = []
    for body in machine.bodies:
        if body.axis is not None:
            shift = np.array(body.location_error.shift) + 3e-6 * rng.normal(size=3)
            turn = np.array(body.location_error.rotation) + 5e-6 * rng.normal(size=3)
            x, y, z = map(float, shift)
            a, b, c = map(float, turn)
            body = replace(body, location_error=Displacement((x, y, z), (a, b, c)))
        bodies.append(body)
    errors = {}
    for name, each in machine.errors.items():
        size = 8e-7 if name[1] in "XYZ" else 2e-6
        errors[name] = replace(each, poly=tuple(c + size * rng.normal() if c else 0.0 for c in each.poly))
    return replace(machine, bodies=tuple(bodies), errors=errors)


@pytest.mark.parametrize("ideal", [False, True])
@pytest.mark.parametrize("name", ["pan2013", "xyzac_trt", "grinder_zhou2023"])
def test_machines_that_the_description_allows(name: str, ideal: bool, independent_offset: Callable[..., Array]) -> None:
    """Within the bound everywhere and at each pose; components and place of the tool as uncertain as stated."""
    machine = described(name, ideal=ideal)
    poses = sample_volume(machine, POSES)
    still = np.zeros_like(poses), np.zeros(POSES)
    found = estimate_uncertain_offsets(machine, poses, draws=draws_for(POSES))
    covariance = offset_covariance(machine, poses)
    assert covariance is not None
    middle = independent_offset(machine, poses, *still)
    np.testing.assert_allclose(found.offset, middle, rtol=0, atol=1e-11)
    place = np.linalg.inv(covariance[:, :3, :3])
    stated = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    held: dict[str, list[float]] = {"everywhere": [], "pose": [], "component": [], "offset": [], "place": []}
    for seed in range(MACHINES):
        offset = independent_offset(drawn(machine, np.random.default_rng([MACHINES, seed])), poses, *still)
        length, off = np.linalg.norm(offset[:, :3], axis=1), offset - middle
        held["everywhere"].append(float(length.max() < found.largest_bound))
        held["pose"].append(float(np.mean(length < found.position_bound)))
        uncertain = stated.min(axis=0) > 1e-9
        held["component"].append(float(np.mean((np.abs(off) < 1.96 * found.deviation)[:, uncertain])))
        held["offset"].append(float(np.mean((np.abs(off) < 1.96 * stated)[:, uncertain])))
        square = np.einsum("ni,nij,nj->n", off[:, :3], place, off[:, :3])
        held["place"].append(float(np.mean(square < CHI_SQUARE_3)))
    rates = {key: round(float(np.mean(each)), 3) for key, each in held.items()}
    print(name, "ideal" if ideal else "with errors", rates)
    assert all(LEAST <= rate <= MOST for rate in rates.values()), rates


def test_the_bound_everywhere_is_no_less_than_that_of_any_pose() -> None:
    machine = described("pan2013", ideal=True)
    found = estimate_uncertain_offsets(machine, sample_volume(machine, 200))
    assert found.largest_bound > 1.01 * found.position_bound.max()
    assert [draws_for(count) for count in (1, 25_000, 100_000, 10_000_000)] == [2000, 2000, 500, 100]
