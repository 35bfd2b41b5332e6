"""How large an effect must be to be named, beside what an ideal test that knows the effect would need.

Sizes are counted in standard deviations of the Fisher bound: with the signature X of the effect at its place, as white
rows, and columns N of the twin's uncertain parameters, one standard uncertainty each, an effect a s, in the fixed
direction a, is known to the standard deviation of s

    std = (a' F a)^(-1/2),    F = X'X - X'N (1 + N'N)^-1 N'X

at best (Cramér and Rao). The likelihood-ratio test that knows effect, place and shape, and looks for nothing else, has
a statistic that is chi-square with as many degrees of freedom as the effect has amplitudes, noncentral by the square of
the size in those standard deviations. It is the bound that no method passes, whatever it searches.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import brentq, isotonic_regression
from scipy.stats import chi2, ncx2

from rotary_error_monitor.cases.draws import DURATION
from rotary_error_monitor.cases.faults import StageFault
from rotary_error_monitor.cases.making import make_stage_case
from rotary_error_monitor.cases.response import times_of
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.effects.effect import Cause, Role
from rotary_error_monitor.effects.library import effect_named, load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.gap.diagnosis import DiagnosisResult, diagnose
from rotary_error_monitor.gap.normal import stack, width_of
from rotary_error_monitor.gap.options import FALSE_ALARMS
from rotary_error_monitor.kinds.stage.problem import StageProblem
from rotary_error_monitor.plant.stage import StagePlant
from rotary_error_monitor.twin.recording import StageRecording, record_stage

SIZES = (2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0, 13.0, 17.0, 23.0, 30.0)
"""Standard deviations of the Fisher bound at which effects are tried: dense where a method that searches all effects
and places at the usual false-alarm rate begins to see one."""

MIDDLE = SIZES.index(6.0)
"""Where the search for the sizes of interest begins."""

EFFECTS = load_effects(StageEffect)


@dataclass(frozen=True)
class Setting:
    """A clean stage with one effect at one place, in one direction, of any size.

    Attributes:
        twin: its description.
        plant: the stage with the effect.
        fault: the effect, as large as the case drew it.
    """

    twin: StageDescription
    plant: StagePlant
    fault: StageFault

    @classmethod
    def of(cls, effect: str, seed: int, rough: bool = False) -> Setting:
        """Stage, place and direction as the seed draws them."""
        case = make_stage_case(seed, "single", [effect], rough=rough)
        (fault,) = case.truth.faults
        return cls(case.twin, case.plant, fault)

    @property
    def key(self) -> tuple[str, str]:
        """Name and place of the effect."""
        return self.fault.name, self.fault.location

    @cached_property
    def cause(self) -> Cause:
        """The effect as the vocabulary has it."""
        effect = effect_named(self.fault.name, EFFECTS)
        return Cause(effect, self.fault.location, effect.values_from(self.fault.parameters))

    @property
    def linear(self) -> list[int]:
        """Indices of the amplitudes."""
        return self.cause.effect.indices(Role.LINEAR)

    def problem(self, size: float, seed: int) -> StageProblem:
        """A recording with noise and jitter from the seed, the effect `size` times as large as the case drew it."""
        faults = (self.fault.scaled(size),) if size else ()
        return StageProblem(self.twin, recorded(replace(self.plant, seed=seed, faults=faults)), EFFECTS)

    @cached_property
    def std(self) -> float:
        """Fisher bound: standard deviation of the size, as a part of the effect as the case drew it."""
        return 1 / float(np.sqrt(information_of(self.problem(0.0, 0), self.cause)))

    @cached_property
    def std_in_units(self) -> tuple[tuple[float, str], ...]:
        """The same as a length of each amplitude vector of one unit."""
        units: dict[str, float] = {}
        effect = self.cause.effect
        for parameter in effect.parameters:
            if parameter.role is Role.LINEAR:
                own = self.cause.values[effect.slices()[parameter.name]]
                units[parameter.unit] = float(np.hypot(units.get(parameter.unit, 0.0), np.linalg.norm(own)))
        return tuple((self.std * size, unit) for unit, size in units.items())


def recorded(plant: StagePlant) -> StageRecording:
    """A recording of the usual length."""
    blocks = {stream: [plant.samples(stream, 0, len(times_of(plant, stream, DURATION)))] for stream in plant.streams}
    return record_stage(blocks, sorted(plant.stage.encoder.azimuths))


def information_of(problem: StageProblem, cause: Cause) -> float:
    """Fisher information of the size of a cause in its direction, uncertain parameters integrated out."""
    effect, linear = cause.effect, cause.effect.indices(Role.LINEAR)
    values = cause.values.copy()
    values[linear] = 0.0
    columns = problem.signature(Cause(effect, cause.location, values), linear)
    nuisance = problem.nuisance(())
    whole = stack(problem, problem.residual(()), [nuisance, columns]).total().without(width_of(nuisance))
    direction = cause.values[linear]
    return float(direction @ whole.gram @ direction)


@dataclass(frozen=True)
class Trial:
    """One diagnosis: `size` of the effect in standard deviations of its Fisher bound, and what was said.

    Attributes:
        size: of the effect in standard deviations of its Fisher bound.
        seed: of noise and jitter.
        seen: a gap was.
        named: the effect was, at its place, or what is named is said to be indistinguishable from it.
    """

    size: float
    seed: int
    seen: bool
    named: bool


def try_size(setting: Setting, size: float, seed: int, false_alarms: float = FALSE_ALARMS) -> Trial:
    """Diagnose one recording."""
    found = diagnose(setting.problem(size * setting.std, seed), false_alarms)
    return Trial(size, seed, found.verdict.value != "no_gap", names(found, setting.key))


def names(diagnosis: DiagnosisResult, key: tuple[str, str]) -> bool:
    """Whether an effect at a place is among the causes, or in the group of one."""
    causes = {found.cause.key for found in diagnosis.causes}
    groups = [set(group.effects) for group in diagnosis.indistinguishable]
    return key in causes or any(key in group and causes & group for group in groups)


def search_sizes(try_all: Callable[[float], Sequence[Trial]]) -> list[Trial]:
    """Trials at sizes from the middle on, up to two at which all are named, down to one at which none is."""
    found = list(try_all(SIZES[MIDDLE]))
    lower, in_a_row = found, int(all(trial.named for trial in found))
    for size in reversed(SIZES[:MIDDLE]):
        if not any(trial.named for trial in lower):
            break
        lower = list(try_all(size))
        found = [*found, *lower]
    for size in SIZES[MIDDLE + 1 :]:
        if in_a_row == 2:
            break
        upper = list(try_all(size))
        found = [*found, *upper]
        in_a_row = in_a_row + 1 if all(trial.named for trial in upper) else 0
    return found


def size_reaching(level: float, sizes: Sequence[float], hits: Sequence[bool]) -> float:
    """Size from which a share of the trials is hit; infinite where none tried is large enough.

    Between the sizes tried it is interpolated in the shares, made to grow with the size (isotonic regression).
    """
    tried = np.unique(sizes)
    own = [[hit for size, hit in zip(sizes, hits, strict=True) if size == each] for each in tried]
    shares = isotonic_regression([np.mean(part) for part in own], weights=[len(part) for part in own]).x
    above = np.flatnonzero(shares >= level - 1e-12)
    if len(above) == 0:
        return float("inf")
    first = int(above[0])
    if first == 0:
        return float(tried[0])
    return float(np.interp(level, shares[first - 1 : first + 1], tried[first - 1 : first + 1]))


def ideal_power(size: float, amplitudes: int, false_alarms: float = FALSE_ALARMS) -> float:
    """Power of the test that knows effect, place and shape, against a size in standard deviations of the bound."""
    return float(ncx2.sf(chi2.isf(false_alarms, amplitudes), amplitudes, size**2))


def ideal_size(level: float, amplitudes: int, false_alarms: float = FALSE_ALARMS) -> float:
    """Size at which that test has a power."""
    return float(brentq(lambda size: ideal_power(size, amplitudes, false_alarms) - level, 1e-6, SIZES[-1]))
