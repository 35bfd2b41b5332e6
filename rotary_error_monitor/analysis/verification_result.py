"""What a comparison of the monitor with references gives, and its figures one by one under stable names."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from rotary_error_monitor.analysis.reference_judgement import ReferenceJudgement
from rotary_error_monitor.analysis.result import Figure
from rotary_error_monitor.arrays import Array
from rotary_error_monitor.metrology.radial_comparison import RadialComparison
from rotary_error_monitor.metrology.spindle_figures import COVERAGE


@dataclass(frozen=True)
class AxisFigures:
    """What one direction of a reference shows in one direction of turning.

    Attributes:
        axis: name of the reference's direction, such as `x`.
        rms, largest: of the differences, m.
        largest_ns: timestamp (ns) of the largest.
        bound: their 95 % bound, root mean square, m.
        judgement: whether they are as large as stated.
    """

    axis: str
    rms: float
    largest: float
    largest_ns: int
    bound: float
    judgement: ReferenceJudgement


@dataclass(frozen=True)
class TurningComparison:
    """Estimate and reference in one direction at one speed.

    Attributes:
        name: such as `forward 4 rad/s`.
        speed: with its sign, rad/s.
        turned: turns, parts of one too.
        whole: whole turns that the profiles hold.
        zero: (p,) of the reference, taken off, m.
        samples: of all differences, p directions.
        theta: (m,) rotation at these, rad.
        angles: (k,) of the profiles, rad.
        profiles: (k, 2 p) mean over the whole turns: p of the estimate, p of the reference, m.
        bound: (p,) 95 % bound of one difference, root mean square, m.
        axes: figures of each direction.
    """

    name: str
    speed: float
    turned: float
    whole: int
    zero: Array
    samples: RadialComparison
    theta: Array
    angles: Array
    profiles: Array
    bound: Array
    axes: tuple[AxisFigures, ...]


@dataclass(frozen=True)
class ReferenceComparison:
    """The monitor against one reference at one height.

    Attributes:
        reference: name.
        axes: names of its p directions.
        height: at which both are compared, m.
        stated: what the height rests on, in words.
        described: eccentricity of the target by the description, m.
        eccentricity: (2,) as found and taken off, m.
        expanded: (2,) expanded uncertainty of it.
        higher, higher_expanded: by how much the reference seems to stand higher, and its expanded uncertainty, m.
        lean: root mean square of what that height makes of the differences, m.
        lean_most: the largest that is within the uncertainty of one reading, and of what is fitted, m.
        turnings: by direction and speed.
        remarks: what a reader should know.
    """

    reference: str
    axes: tuple[str, ...]
    height: float
    stated: str
    described: tuple[float, float]
    eccentricity: Array
    expanded: Array
    higher: float
    higher_expanded: float
    lean: float
    lean_most: float
    turnings: tuple[TurningComparison, ...]
    remarks: tuple[str, ...]

    @property
    def agrees(self) -> bool:
        """Whether the monitor agrees with this reference in all directions, and as the rotor leans."""
        directions = (axis.judgement.agrees for turning in self.turnings for axis in turning.axes)
        return self.stands_as_stated and all(directions)

    @property
    def stands_as_stated(self) -> bool:
        """Whether the differences do not follow the tilt, as they do where the reference stands at another height."""
        return self.lean <= self.lean_most

    @property
    def place(self) -> str:
        """Stable name, such as `low_at_16mm`."""
        return f"{self.reference}_at_{self.height * 1e3:g}mm".replace("-", "minus_")


@dataclass(frozen=True)
class Verification:
    """The monitor against all references of a recording.

    Attributes:
        comparisons: by reference and height.
        span_ns: first and last timestamp (ns) of the estimates.
        remarks: what a reader should know of the recording.
    """

    comparisons: tuple[ReferenceComparison, ...]
    span_ns: tuple[int, int]
    remarks: tuple[str, ...]

    @property
    def agrees(self) -> bool:
        """Whether the monitor agrees with every reference within the stated uncertainty."""
        return all(each.agrees for each in self.comparisons)

    @property
    def exit_code(self) -> int:
        """Of the command: 0 where they agree, else 10."""
        return 0 if self.agrees else 10


def figures_of(verification: Verification) -> Iterator[Figure]:
    """Every figure."""
    for place, each in _placed(verification.comparisons):
        for turning in each.turnings:
            for axis in turning.axes:
                yield from _of_axis(f"{place}.{axis.axis}", turning, axis)
            for name, zero in zip(each.axes, turning.zero, strict=True):
                yield Figure(f"{place}.zero_{name}", turning.name, float(zero), None, "m")
        for name, value, expanded in zip("xy", each.eccentricity, each.expanded, strict=True):
            yield Figure(f"{place}.artefact_eccentricity_{name}", "", float(value), float(expanded), "m")
        if np.isfinite(each.higher_expanded):
            yield Figure(f"{place}.higher_than_stated", "", each.higher, each.higher_expanded, "m")
            yield Figure(f"{place}.difference_by_that_height_rms", "", each.lean, None, "m")
            yield Figure(f"{place}.difference_by_that_height_most", "", each.lean_most, None, "m")


def _placed(comparisons: Sequence[ReferenceComparison]) -> Iterator[tuple[str, ReferenceComparison]]:
    """Each with its place, and a number from the second of the same place on: a reference may come back."""
    seen = Counter[str]()
    for each in comparisons:
        seen[each.place] += 1
        yield each.place if seen[each.place] == 1 else f"{each.place}_{seen[each.place]}", each


def _of_axis(place: str, turning: TurningComparison, axis: AxisFigures) -> Iterator[Figure]:
    for name, value, unit in (
        ("difference_rms", axis.rms, "m"),
        ("difference_largest", axis.largest, "m"),
        ("difference_mean_rms", axis.judgement.mean, "m"),
        ("difference_mean_most", axis.judgement.most, "m"),
        ("bound_95_percent", axis.bound, "m"),
        ("inside_95_percent_bounds", axis.judgement.inside, "1"),
        ("inside_needed", axis.judgement.needed, "1"),
    ):
        yield Figure(f"{place}.{name}", turning.name, value, None, unit, turns=turning.whole)


def as_mapping(verification: Verification, about: Mapping[str, str]) -> dict[str, Any]:
    """Content of the JSON file."""
    return {
        "about": dict(about),
        "agrees": verification.agrees,
        "coverage_factor": COVERAGE,
        "comparisons": [_comparison(each) for each in verification.comparisons],
        "figures": [asdict(figure) for figure in figures_of(verification)],
        "remarks": list(verification.remarks),
    }


def _comparison(each: ReferenceComparison) -> dict[str, Any]:
    return {
        "reference": each.reference,
        "height": each.height,
        "height_stated": each.stated,
        "agrees": each.agrees,
        "artefact_eccentricity": each.eccentricity.tolist(),
        "artefact_eccentricity_expanded_uncertainty": each.expanded.tolist(),
        "artefact_eccentricity_described": list(each.described),
        "remarks": list(each.remarks),
        "over_angle": [_over_angle(each, turning) for turning in each.turnings],
    }


def _over_angle(each: ReferenceComparison, turning: TurningComparison) -> dict[str, Any]:
    """Mean over the turns by angle, m."""
    count = len(each.axes)
    return {
        "segment": turning.name,
        "agrees": {axis.axis: axis.judgement.agrees for axis in turning.axes},
        "angle": turning.angles.tolist(),
        **{f"estimate_{name}": turning.profiles[:, k].tolist() for k, name in enumerate(each.axes)},
        **{f"reference_{name}": turning.profiles[:, count + k].tolist() for k, name in enumerate(each.axes)},
    }
