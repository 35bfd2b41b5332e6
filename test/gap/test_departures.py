"""How effects depart from their textbook form: columns that follow from any signature, told in words."""

from __future__ import annotations

import dataclasses
import itertools
import re

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import multivariate_normal

from rotary_error_monitor.effects.effect import Cause, Parameter, Role, order_location
from rotary_error_monitor.effects.library import effect_named, load_effects
from rotary_error_monitor.effects.rotor import StageEffect, effects_of
from rotary_error_monitor.gap.departure_selection import likeliest_kinds, log_evidence
from rotary_error_monitor.gap.departures import (
    COURSES,
    SHARE,
    Departures,
    Modulation,
    Normaliser,
    amplitude_sizes,
    columns_at,
    modulated,
    percent,
    settling,
    slow_courses,
    spread_out,
    wanders,
)
from rotary_error_monitor.gap.fitted_departures import FittedDepartures, describe
from rotary_error_monitor.gap.fitting import fit_causes
from rotary_error_monitor.gap.posterior import marginal_likelihood
from rotary_error_monitor.gap.problem import LateRows

COUNT = 4000


class Lean(StageEffect):
    """An effect of a user's own: two shifts of one unit, and a turn."""

    name = "lean"
    parameters = (
        Parameter("order", "1", 1.0, role=Role.FIXED, bound=10, least=1),
        Parameter("shift", "m", 1e-6, 2, bound=1e-3),
        Parameter("turn", "rad", 1e-6, bound=1e-3),
    )


def test_sizes_are_shared_by_amplitudes_of_one_unit():
    cause = Cause(Lean(), "", np.array([2.0, 3e-6, 4e-6, -5e-7]))
    np.testing.assert_allclose(amplitude_sizes(cause), [np.sqrt(12.5) * 1e-6, np.sqrt(12.5) * 1e-6, 5e-7])


@pytest.mark.parametrize("each", [False, True])
def test_a_column_is_a_tenth_of_the_cause(each, rng):
    signature = rng.normal(size=(COUNT, 2, 3))
    amplitudes = np.array([2.0, -2.0, 2.0])
    wave = np.sqrt(2) * np.cos(2 * np.pi * 7 * np.arange(COUNT) / COUNT)
    modulations = [Modulation("place", wave, str, each)]
    columns = modulated(signature, amplitudes, np.full(3, 2.0), modulations)
    kinds, _, _ = spread_out(modulations, amplitudes, np.full(3, 2.0))
    assert columns.shape == (COUNT, 2, 3 if each else 1) and len(kinds) == columns.shape[2]
    squares = np.sum(np.square(columns)) / np.sum(np.square(signature @ amplitudes))
    assert np.sqrt(squares) == pytest.approx(SHARE, rel=0.05)


def test_what_the_amplitudes_do_together_is_told_as_one_change():
    """All amplitudes 20 % larger where the modulation is one: the cause is 20 % larger there."""
    amplitudes, sizes = np.array([3.0, -4.0]), np.full(2, np.sqrt(12.5))
    modulations = [Modulation("warm", np.ones(10), lambda change: f"{change:.3f}", True)]
    columns = modulated(np.eye(2)[:, None, :], amplitudes, sizes, [Modulation("warm", np.ones(2), str, True)])[:, 0]
    departures = Departures(0, *spread_out(modulations, amplitudes, sizes), {})
    values = 0.2 * amplitudes / (SHARE * sizes)
    (told,) = describe(FittedDepartures(departures, values, columns.T @ columns / np.sum(np.square(amplitudes))))
    assert told.pattern == "0.200" and told.share == pytest.approx(0.2)


def test_stretches_are_scaled_alike():
    norm = Normaliser({"warm": np.array([1.0, 3.0]), "steady": np.ones(2)})
    np.testing.assert_allclose(norm("warm", np.array([2.0, 4.0])), [0.0, 2.0])
    assert norm.unit("warm") == 1.0 and norm.unit("steady") == 0.0


def test_columns_of_a_long_recording_are_chosen_when_they_are_made(rng):
    rows = {"x": rng.normal(size=(5, 4))}
    late = columns_at(LateRows(4, lambda stretch: rows), np.array([2, 0]))
    assert late.width == 2
    np.testing.assert_array_equal(late.of(0).rows["x"], rows["x"][:, [2, 0]])


@pytest.mark.parametrize(
    ("name", "jumps"),
    [("reversal_backlash", True), ("radial_hysteresis", True), ("encoder_latency", False), ("unbalance", False)],
)
def test_what_jumps_at_reversals_may_be_soft_there(name, jumps, stage_problem):
    problem, _ = stage_problem(7, "null")
    effect = effect_named(name, load_effects(StageEffect))
    values = effect.start("")
    linear = effect.indices(Role.LINEAR)
    values[linear] = effect.scales()[linear]
    assert problem._modulations.jumps(Cause(effect, "", values)) == jumps


@pytest.mark.parametrize(
    ("name", "apart"),
    [("graduation_error", (1, 2, 3)), ("mirror_flatness", ()), ("spindle_tilt", ()), ("drive_cyclic_error", ())],
)
def test_what_differs_around_the_turn_is_neighbouring_orders_where_these_describe_it(name, apart, stage_problem):
    """Heads at other places of a ring see its mark later: what differs with the rotation is none of its orders."""
    problem, _ = stage_problem(7, "null")
    effect, place = effect_named(name, problem.effects), order_location(5, "")
    values = effect.start(place)
    linear = effect.indices(Role.LINEAR)
    values[linear] = effect.scales()[linear] * np.linspace(1.0, 2.0, len(linear))
    (departures,) = problem.departures((Cause(effect, place, values),))
    assert {kind for kind in departures.kinds if kind.startswith("place")} == {f"place {order}" for order in apart}
    assert {"order_4", "order_6"} <= set(departures.kinds)


def test_kinds_that_cancel_one_another_are_as_large_as_they_are():
    """What a sum of two leaves is the smaller, the more alike they are; each of them is no smaller for that."""
    departures = Departures(0, ("speed", "speed", "time"), (str,) * 3, np.zeros(3), {})
    alike = 0.01 * np.array([[1.0, 0.0, 0.99], [0.0, 1.0, 0.0], [0.99, 0.0, 1.0]])
    fitted = FittedDepartures(departures, np.array([3.0, 0.5, -3.0]), alike)
    assert fitted.shares() == {"speed": pytest.approx(0.1 * np.hypot(3.0, 0.5)), "time": pytest.approx(0.3)}
    assert fitted.share() == pytest.approx(0.1 * np.sqrt(2 * 9.0 * 0.01 + 0.25))
    assert fitted.size() == pytest.approx(0.1 * np.sqrt(9.0 + 0.25 + 9.0))
    together = dataclasses.replace(fitted, values=np.array([3.0, 0.5, 3.0]))
    assert together.size() == together.share() > fitted.size()


def test_what_may_be_there_as_a_whole_counts_by_its_prior_however_much_it_shows():
    """All of a play that stays at rest is as fair as a tenth of what goes with the speed; half the play as much less.

    A cause that the textbook's columns took for a fifth of what it is has departures of five times their size.
    """
    products = np.diag([9.0, 0.01])
    departures = Departures(0, ("at rest", "speed"), (str,) * 2, np.zeros(2), {}, whole=frozenset({"at rest"}))
    for part, speed in ((1.0, 0.0), (0.5, 0.0), (1.0, 2.0)):
        for grown in (1.0, 5.0):
            fitted = FittedDepartures(departures, np.array([part * grown, speed]), products, grown)
            assert fitted.size() == pytest.approx(SHARE * np.hypot(part, speed))
            assert fitted.share() == pytest.approx(np.hypot(3.0 * part * grown, SHARE * speed))
    # Told as a part of the play that is there, and not of the little that its textbook form shows.
    (told, _) = describe(FittedDepartures(departures, np.array([1.0, 0.0]), products, beside=4.0))
    assert told.share == pytest.approx(3.0 / 4.0)
    textbook = dataclasses.replace(departures, whole=frozenset())
    assert FittedDepartures(textbook, np.array([1.0, 0.0]), products).size() == pytest.approx(3.0)


def test_every_effect_of_a_stage_may_depart_on_its_own_channels_only(stage_problem):
    problem, _ = stage_problem(7, "null")
    for effect in effects_of(problem.stage, load_effects(StageEffect)):
        place = "order_5" if effect.orders else effect.locations(problem.stage)[0]
        values = effect.start(place)
        linear = effect.indices(Role.LINEAR)
        values[linear] = effect.scales()[linear]
        cause = Cause(effect, place, values)
        own = problem.signature(cause, linear, (cause,))
        (departures,) = problem.departures((cause,))
        assert set(departures.columns) <= set(own), effect.name
        widths = {rows.shape[1] for rows in departures.columns.values()}
        assert widths == {len(departures.kinds)} and all(np.isfinite(r).all() for r in departures.columns.values())
        assert len(departures.words) == len(departures.changes) == len(departures.kinds)
        assert all(isinstance(words(0.1), str) for words in departures.words)


@pytest.mark.parametrize("seed", range(4))
def test_the_marginal_likelihood_is_that_of_the_normal_distribution(seed, linear):
    """Of a cause whose prior is as wide as it is seen, and a departure of one standard deviation of its prior."""
    draw = np.random.default_rng(seed)
    shape, other = np.linalg.qr(draw.normal(size=(800, 2)))[0].T * np.array([[30.0], [20.0]])
    linear.offer({"shape": {"x": shape[:, None]}})
    linear.data = {"x": (0.7 * shape - 0.5 * other + draw.normal(size=800))[:, None]}
    departures = Departures(0, ("time",), (wanders,), np.array([0.1]), {"x": other[:, None]})
    cause = Cause(linear.effects["shape"], "", np.array([1.0]))
    found = marginal_likelihood(fit_causes(linear, [cause], departures=[departures]))
    y, null = linear.data["x"][:, 0], marginal_likelihood(fit_causes(linear, []))
    power = float(shape @ y) ** 2 / float(shape @ shape)
    width = (power - 1) / float(shape @ shape)
    covariance = np.eye(800) + width * np.outer(shape, shape) + np.outer(other, other)
    exact = multivariate_normal(np.zeros(800), covariance).logpdf(y) - multivariate_normal(np.zeros(800)).logpdf(y)
    assert found - null == pytest.approx(exact, abs=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_a_kind_that_stood_for_two_others_leaves_when_they_have_joined(seed):
    """It has the most evidence alone, since it looks like their sum; beside them it is worth nothing."""
    rng = np.random.default_rng(seed)
    first, second = rng.normal(size=(2, 2000))
    alike = (first + second)[:, None] / np.sqrt(2) + 1.5 * rng.normal(size=(2000, 8))
    columns = np.column_stack([alike, first, second])
    data = 0.5 * (first + second) + rng.normal(size=2000)
    found, _ = likeliest_kinds(columns.T @ columns, columns.T @ data, ["alike"] * 8 + ["first", "second"])
    assert found == {"first", "second"}


def test_of_kinds_that_look_nearly_the_same_the_likeliest_are_found():
    """Of all sets of up to three kinds; one that joined first stood for others, at worst beside one that cancels it."""
    passed, draws, missed = np.linspace(0, 1, 400), 60, 0
    warm = {lag: passed - lag * -np.expm1(-passed / lag) for lag in (0.06, 0.25, 1.0)}
    slow = {"time": [passed], "temperature": [-np.expm1(-passed / 0.35)], "lagging": list(warm.values())}
    waves = {"settling": [settling(passed).values], "course": [m.values for m in slow_courses(passed)]}
    kinds = {name: np.column_stack([w - np.mean(w) for w in rows]) for name, rows in {**slow, **waves}.items()}
    columns = np.hstack([rows / np.std(rows) if name in slow else rows for name, rows in kinds.items()])
    labels = np.repeat(list(kinds), [rows.shape[1] for rows in kinds.values()])
    sets = [some for size in (1, 2, 3) for some in itertools.combinations(kinds, size)]
    for seed in range(draws):
        rng = np.random.default_rng(seed)
        size, memory = 10 ** rng.uniform(0.0, 1.3), 400 * rng.uniform(0.1, 0.4)
        wanders = lfilter([np.sqrt(-np.expm1(-2 / memory))], [1.0, -np.exp(-1 / memory)], rng.normal(size=500))[100:]
        data = 0.18 * size * wanders + rng.normal(size=400)
        gram, moment = 0.09 * size**2 * columns.T @ columns, 0.3 * size * columns.T @ (data - np.mean(data))
        _, found = likeliest_kinds(gram, moment, labels.tolist())
        evidence = [log_evidence(gram, moment, np.flatnonzero(np.isin(labels, some))) for some in sets]
        prices = [np.log(len(kinds)) * len(some) for some in sets]
        missed += max(np.subtract(evidence, prices)) > found + 1e-6
    assert missed < 0.1 * draws


def test_courses_describe_what_wanders_within_a_tenth_of_the_recording():
    """Of an Ornstein-Uhlenbeck process with that memory 5 % of the power are faster; with 12 courses 17 % were left."""
    memory, count = 0.1, 2000
    rng = np.random.default_rng(0)
    passed = np.linspace(0, 1, count)
    noise = np.sqrt(1 - np.exp(-2 / (memory * count))) * rng.normal(size=(count, 200))
    wandering = lfilter([1.0], [1.0, -np.exp(-1 / (memory * count))], noise, axis=0)
    columns = np.column_stack([np.ones(count), np.cos(np.pi * passed), *(m.values for m in slow_courses(passed))])
    left = wandering - columns @ np.linalg.lstsq(columns, wandering, rcond=None)[0]
    assert np.mean(left**2) / np.mean(wandering**2) < 0.08


def test_effects_of_a_stage_may_wander_as_fast(stage_problem):
    problem, _ = stage_problem(3, "null", duration=10.0)
    effect = effect_named("lvdt_gain", problem.effects)
    (departures,) = problem.departures([Cause(effect, "x", np.array([0.01]))])
    assert departures.kinds.count("course") == COURSES - 1


def test_what_settles_differs_at_first_as_it_says():
    """Without a mean, of size one over a whole recording; by as much at first, and for as long, as its words tell."""
    passed = (np.arange(200_000) + 0.5) / 200_000
    modulation = settling(passed, duration=40.0)
    values = modulation.values
    assert abs(values.mean()) < 1e-6 and values.std() == pytest.approx(1.0, abs=1e-6)
    for change in np.random.default_rng(4).normal(size=20) * SHARE:
        pattern = r"(larger|smaller) at first by ([\d.]+) %, settling within ([\d.]+) s"
        side, part, time = re.fullmatch(pattern, modulation.words(change)).groups()
        assert (side == "larger") == (change > 0)
        assert float(part) == pytest.approx(100 * abs(change) * values[0], rel=0.06), "in two digits or whole ones"
        at = np.searchsorted(passed, float(time) / 40.0)
        assert (values[at] - values[-1]) / (values[0] - values[-1]) == pytest.approx(np.exp(-1), abs=1e-3)
    assert "settling within a sixteenth of the recording" in settling(passed).words(0.1)


def test_a_change_is_told_in_plain_numbers():
    told = {0.0123: "1.2 %", 0.5: "50 %", 0.9949: "99 %", 0.996: "100 %", -1.234: "123 %", 31.6: "3160 %"}
    assert {change: percent(change) for change in told} == told
