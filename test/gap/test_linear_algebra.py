"""Normal equations, evidence, fits and held-out gaps against direct formulas on plain numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.stats import chi2, multivariate_normal

from rotary_error_monitor.gap.fitting import fit_causes
from rotary_error_monitor.gap.hypotheses import HypothesisTable
from rotary_error_monitor.gap.normal import combine, grams_by_channel, own_rest, stack, subtract
from rotary_error_monitor.gap.problem import SparseRows
from rotary_error_monitor.gap.selection import select_causes
from rotary_error_monitor.gap.shrink import measure_gap


def table(problem):
    candidates = problem.candidates({}, ())
    return candidates, [problem.signature(c.cause(np.zeros(1)), [0]) for c in candidates]


def test_blocks_sum_to_the_whole(linear):
    candidates, columns = table(linear)
    blocks = stack(linear, linear.data, columns)
    whole = np.concatenate(
        [np.concatenate([c.effect.column.get(k, np.zeros((800, 1))) for k in "xy"]) for c in candidates], 1
    )
    data = np.concatenate([linear.data[k] for k in "xy"])
    total = blocks.total()
    np.testing.assert_allclose(total.gram, whole.T @ whole, rtol=1e-12)
    np.testing.assert_allclose(total.moment, (whole.T @ data)[:, 0], rtol=1e-12)
    assert total.power == pytest.approx(float(np.sum(data**2)))
    assert total.count == 1600
    amplitudes = np.array([0.3, -0.2, 0.1])
    assert blocks.squares([0, 1, 2], amplitudes).sum() == pytest.approx(
        float(np.sum((data[:, 0] - whole @ amplitudes) ** 2))
    )


def by_label(blocks, conditions):
    return [blocks.total(conditions.labels == label) for label in range(len(conditions.names))]


def test_neighbouring_blocks_of_one_label_are_joined(linear, monkeypatch):
    labels = np.array([0, 0, 1, 1, 2, 0, 3, 3])
    own = replace(linear.conditions, labels=labels)
    monkeypatch.setattr(type(linear), "conditions", own)
    joined = own.joined()
    np.testing.assert_array_equal(joined.labels, [0, 1, 2, 0, 3])
    assert (joined.edges[0], joined.edges[-1]) == (own.edges[0], own.edges[-1])
    _, columns = table(linear)
    few = stack(linear, linear.data, columns, conditions=joined)
    assert few.gram.shape[0] == 5
    for part, same in zip(by_label(stack(linear, linear.data, columns), own), by_label(few, joined), strict=True):
        np.testing.assert_allclose(part.gram, same.gram, rtol=1e-12)
        np.testing.assert_allclose(part.moment, same.moment, rtol=1e-12)
        assert (part.power, part.count) == (pytest.approx(same.power), same.count)


def test_columns_that_act_on_few_channels(linear, rng):
    """Rows of the columns that act, and rows with zeros in the others' places, are the same."""
    full = {"x": rng.normal(size=(800, 3)), "y": rng.normal(size=(800, 3))}
    full["x"][:, 1], full["y"][:, [0, 2]] = 0.0, 0.0
    acting = {"x": np.array([0, 2]), "y": np.array([1])}
    sparse = SparseRows(3, {channel: full[channel][:, own] for channel, own in acting.items()}, acting)
    _, columns = table(linear)
    expected, found = (stack(linear, linear.data, [rows, *columns]) for rows in (full, sparse))
    np.testing.assert_allclose(found.gram, expected.gram, atol=1e-9)
    np.testing.assert_allclose(found.moment, expected.moment, atol=1e-9)
    known = stack(linear, linear.data, [sparse, *columns], stack(linear, linear.data, [sparse]).gram)
    np.testing.assert_allclose(known.gram, expected.gram, atol=1e-9)
    amplitudes = np.array([0.3, -2.0, 0.7])
    for channel, rows in combine(linear, [sparse], [amplitudes]).items():
        np.testing.assert_allclose(rows[:, 0], full[channel] @ amplitudes, atol=1e-12)
    for mine, theirs in zip(own_rest(linear, linear.data, sparse), own_rest(linear, linear.data, full), strict=True):
        for channel in "xy":
            np.testing.assert_allclose(mine[channel], theirs[channel], atol=1e-9)


def test_many_sets_are_weighed_as_each_alone(linear):
    candidates, columns = table(linear)
    hypotheses = HypothesisTable(linear, linear.data, {}, candidates, columns)
    sets = [(0,), (1, 2), (), (2,), (2, 0), (0, 1, 2)]
    together = hypotheses.evaluate_all(sets)
    assert [hypothesis.members for hypothesis in together] == sets
    gram, moment = hypotheses.normal.gram, hypotheses.normal.moment
    for hypothesis, members in zip(together, sets, strict=True):
        own = list(members)
        best = np.linalg.solve(gram[np.ix_(own, own)], moment[own])
        np.testing.assert_allclose(hypothesis.amplitudes, best, rtol=1e-9)
        assert hypothesis.reduction == pytest.approx(float(best @ moment[own]))
        assert hypothesis.log_evidence == pytest.approx(hypotheses.evaluate(members).log_evidence)


def test_nuisances_are_integrated_out(linear, rng):
    nuisance = {"x": rng.normal(size=(800, 3))}
    _, columns = table(linear)
    left = stack(linear, linear.data, [nuisance, *columns]).total().without(3)
    z = nuisance["x"]
    covariance_inverse = np.linalg.inv(np.eye(800) + z @ z.T)
    x = columns[0]["x"]
    assert left.gram[0, 0] == pytest.approx((x.T @ covariance_inverse @ x).item())
    assert left.moment[0] == pytest.approx((x.T @ covariance_inverse @ linear.data["x"]).item())


def test_what_uncertain_parameters_can_take_of_a_signature(linear, rng):
    """Of one that is `size` of them all but 1 / (1 + size² |x|²), of one that is across them nothing."""
    candidates, columns = table(linear)
    x = columns[0]["x"]
    across = rng.normal(size=(800, 1))
    across -= x @ np.linalg.lstsq(x, across)[0]
    power = (x.T @ x).item()
    for size in (1e-3, 0.1, 10.0):
        weighed = HypothesisTable(linear, linear.data, {"x": size * x}, candidates[:2], [columns[0], {"x": across}])
        assert 1 - weighed.taken(0) == pytest.approx(1 / (1 + size**2 * power), rel=1e-6)
        assert weighed.taken(1) == pytest.approx(0.0, abs=1e-9)


def test_evidence_is_the_marginal_likelihood_with_the_likeliest_width_of_the_prior(linear):
    candidates, columns = table(linear)
    hypotheses = HypothesisTable(linear, linear.data, {}, candidates, columns)
    hypothesis = hypotheses.evaluate([0])
    x, y = columns[0]["x"][:, 0], linear.data["x"][:, 0]

    def exact(width):
        return multivariate_normal(np.zeros(800), np.eye(800) + width**2 * np.outer(x, x)).logpdf(y)

    best = minimize_scalar(lambda log_width: -exact(np.exp(log_width)), bounds=(-5.0, 5.0), method="bounded")
    assert hypothesis.log_evidence == pytest.approx(-best.fun - exact(0.0) - np.log(3), abs=1e-3)
    assert hypothesis.log_p_value == pytest.approx(chi2.logsf(hypothesis.reduction, 1))


def test_the_better_of_two_likenesses_wins(linear):
    candidates, columns = table(linear)
    hypotheses = HypothesisTable(linear, linear.data, {}, candidates, columns)
    singles = sorted(hypotheses.singles(), key=lambda w: -w.log_evidence)
    assert hypotheses.candidates[singles[0].members[0]].effect.name == "first"
    wrong = hypotheses.evaluate([hypotheses.position(("third", "")), hypotheses.position(("second", ""))])
    assert hypotheses.position(("first", "")) in hypotheses.exchange(wrong).members
    assert hypotheses.free([0]) == [1, 2]


def test_a_fit_gives_size_and_spread(linear):
    candidates, _ = table(linear)
    fit = fit_causes(linear, [candidates[0].cause(np.array([0.0]))])
    x = linear.effects["first"].column["x"]
    direct = (x.T @ linear.data["x"]).item() / (x.T @ x).item()
    assert fit.causes[0].values[0] == pytest.approx(direct, rel=1e-9)
    assert fit.covariances[0][0, 0] == pytest.approx(1 / (x.T @ x).item(), rel=1e-6)


def test_an_uncertain_parameter_takes_its_part(linear):
    linear.nuisances = {"x": 0.2 * linear.effects["first"].column["x"]}
    fit = fit_causes(linear, [])
    assert fit.nuisance_values[0] == pytest.approx(2.5, abs=0.3)
    np.testing.assert_allclose(fit.rest["x"], linear.data["x"] - fit.nuisance_values[0] * linear.nuisances["x"])


def test_the_gap_shrinks_to_the_noise(linear):
    candidates, _ = table(linear)
    fit = fit_causes(linear, [candidates[0].cause(np.array([0.0]))])
    gap = measure_gap(fit, linear.conditions)
    squares = sum(float(np.sum(rows**2)) for rows in linear.data.values())
    assert gap.before == pytest.approx(np.sqrt(squares / 1600), rel=1e-3)
    assert gap.after == pytest.approx(1.0, abs=0.04)
    assert gap.shrink > 0.95
    assert gap.interval[0] <= gap.shrink <= gap.interval[1]


def test_selection_stops_at_the_noise(linear):
    selection = select_causes(linear)
    assert [cause.effect.name for cause in selection.chosen.fit.causes] == ["first"]
    assert selection.chosen.settled and not selection.null.settled


def test_selection_finds_pairs(linear, rng):
    linear.data["x"] += 0.4 * linear.effects["second"].column["x"]
    linear.data["y"] += 0.4 * linear.effects["second"].column["y"]
    steps = []
    selection = select_causes(linear, progress=steps.append)
    assert {cause.effect.name for cause in selection.chosen.fit.causes} == {"first", "second"}
    assert steps[0] == "residual" and len(steps) == 3


def test_nothing_is_found_in_noise(linear, rng):
    alarms = 0
    for _ in range(60):
        linear.data = {channel: rng.normal(size=(800, 1)) for channel in "xy"}
        alarms += not select_causes(linear, 0.01).null.settled
    # One in a hundred at most; three in sixty would happen once in 300 runs of this test.
    assert alarms <= 2


def test_rows_combine_and_subtract(linear):
    linear.data = {"x": np.zeros((1, 1)), "y": np.zeros((1, 1))}
    rows = combine(
        linear,
        [{"x": np.array([[1.0, 2.0]])}, {"x": np.array([[1.0]]), "y": np.array([[3.0]])}],
        [np.array([1.0, 1.0]), np.array([2.0])],
    )
    assert rows["x"].item() == 5.0 and rows["y"].item() == 6.0
    left = subtract({"x": np.array([[7.0]]), "z": np.array([[1.0]])}, rows)
    assert left["x"].item() == 2.0 and left["z"].item() == 1.0


def test_leading_columns_need_no_second_look(linear, rng):
    nuisance = {"x": rng.normal(size=(800, 3)), "y": rng.normal(size=(800, 3))}
    _, columns = table(linear)
    whole = stack(linear, linear.data, [nuisance, *columns])
    spared = stack(linear, linear.data, [nuisance, *columns], stack(linear, linear.data, [nuisance]).gram)
    np.testing.assert_allclose(spared.gram, whole.gram, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(spared.moment, whole.moment, rtol=1e-12)


def test_products_by_channel_are_those_of_the_columns_that_act_there(linear, rng):
    first = SparseRows(3, {"x": rng.normal(size=(800, 2))}, {"x": np.array([0, 2])})
    second = {"x": rng.normal(size=(800, 1)), "y": rng.normal(size=(800, 1))}
    grams = grams_by_channel(linear, [first, second], ["x", "y"])
    dense = np.zeros((800, 4))
    dense[:, [0, 2, 3]] = np.hstack([first.rows["x"], second["x"]])
    np.testing.assert_allclose(grams["x"], dense.T @ dense, rtol=1e-12)
    assert grams["y"][3, 3] == pytest.approx(float(np.sum(second["y"] ** 2)))
    assert np.count_nonzero(grams["y"]) == 1
    whole = stack(linear, linear.data, [first, second]).total().gram
    np.testing.assert_allclose(grams["x"] + grams["y"], whole, rtol=1e-10, atol=1e-9)


def test_effects_of_very_unequal_usual_sizes_are_weighed_together(linear):
    """What an effect of usual size shows may differ by 10^6 between effects: neither hides the other."""
    candidates, columns = table(linear)
    faint = {channel: 1e-6 * rows for channel, rows in columns[1].items()}
    data = {"x": linear.data["x"] + 3.0 * columns[1]["x"], "y": linear.data["y"] + 3.0 * columns[1]["y"]}
    hypotheses = HypothesisTable(linear, data, {}, candidates[:2], [{"x": 1e3 * columns[0]["x"]}, faint])
    both = hypotheses.evaluate([0, 1])
    alone = hypotheses.evaluate([0])
    assert both.dof == 2
    assert both.reduction - alone.reduction > 1000
    assert both.amplitudes[1] == pytest.approx(3e6, rel=0.02)
    assert both.amplitudes[0] == pytest.approx(0.5e-3, rel=0.2)


def test_excess_is_that_of_each_channel_alone(linear, rng):
    """A parameter moved ten standard uncertainties in one channel alone does not show in the other, which shares it."""
    shape = {"x": 2.0 * rng.normal(size=(800, 1)), "y": 2.0 * rng.normal(size=(800, 1))}
    data = {"x": linear.data["y"] + 10.0 * shape["x"], "y": rng.normal(size=(800, 1))}
    rest, excess = own_rest(linear, data, shape)
    assert excess["x"] == pytest.approx(100.0, rel=0.1)
    assert excess["y"] == 0.0
    assert np.std(rest["x"]) == pytest.approx(1.0, abs=0.1)
    shared = stack(linear, data, [shape]).total()
    moved = shared.moment / (shared.gram[0, 0] + 1)
    assert np.std(data["y"] - moved * shape["y"]) > 5, "one value for both channels carries the gap into the other"
