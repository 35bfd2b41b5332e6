"""Each part of the diagnosis is really switched off, and comes back; pieces of a run are put together."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

import bench_ablation
from ablation import KINDS, PARTS, TOGETHER, WHOLE, kind_of, without

from rotary_error_monitor.blind_check.cases import draw_machine, write_case
from rotary_error_monitor.cases.making import make_machine_case, make_stage_case
from rotary_error_monitor.gap import departure_selection, judgement, posterior, weighing
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.fitting import fit_causes
from rotary_error_monitor.gap.hypotheses import HypothesisTable
from rotary_error_monitor.gap.loading import load_problem, load_twin
from rotary_error_monitor.gap.normal import width_of
from rotary_error_monitor.gap.selection import select_causes
from rotary_error_monitor.gap.verdict import Verdict


@pytest.fixture(scope="module", params=["stage", "machine"])
def folder(request, tmp_path_factory):
    """A recording on a shop floor with one effect."""
    place = tmp_path_factory.mktemp(request.param) / "case"
    if request.param == "stage":
        write_case(make_stage_case(3, "single", ["unbalance"], (3000.0, 3000.0), rough=True), place)
    else:
        write_case(make_machine_case(draw_machine(4), 4, "single", ["axis_backlash"], rough=True), place)
    return place


def problem_of(folder):
    return load_problem(folder / "bag", load_twin(folder / "twin.yaml"))


@pytest.fixture(scope="module")
def found(folder):
    """Problem and cause of that recording."""
    problem = problem_of(folder)
    return problem, select_causes(problem, most=1).chosen.fit.causes


def kinds_of(problem, causes):
    return [kind_of(kind) for own in problem.departures(causes) for kind in own.kinds]


def test_one_kind_of_departure_is_left_out_at_a_time(found):
    whole = kinds_of(*found)
    assert set(whole) <= set(KINDS) and len(set(whole)) >= 6
    for kind in KINDS:
        with without(f"departures: {kind}"):
            assert kinds_of(*found) == [other for other in whole if other != kind]
    for words, kinds in TOGETHER.items():
        assert set(kinds) <= set(KINDS)
        with without(f"departures: {words}"):
            assert kinds_of(*found) == [other for other in whole if other not in kinds]
            assert departure_selection.with_departures(found[0], fit_causes(*found)) is not None
    with without("departures"):
        assert kinds_of(*found) == []
    with without(WHOLE):
        assert kinds_of(*found) == whole
    assert kinds_of(*found) == whole


def test_every_kind_of_departure_is_a_part(found):
    assert {f"departures: {kind}" for kind in kinds_of(*found)} <= set(PARTS)


def test_without_their_price_departures_cost_nothing(found):
    problem, causes = found
    fit = fit_causes(problem, causes, departures=problem.departures(causes))
    assert np.all(posterior._shares(fit) > 0)
    with without("price of departures"):
        assert np.all(posterior._shares(fit) == 0)


def test_without_something_unknown_the_best_set_is_believed(found):
    low = posterior.Posterior(fit_causes(*found), (), (-30.0,), False, False, 0.0)
    assert not low.likelier and low.probability < 1e-9
    with without("something unknown"):
        assert low.likelier and low.probability == 1.0 and low.total == -30.0
    assert not low.likelier


def test_without_learning_the_noise_stays(found):
    problem, causes = found
    with without("learning of noise"):
        assert problem.learn_noise(causes) is False
    assert type(problem).learn_noise.__name__ == "learn_noise"


@pytest.mark.parametrize(("family", "words"), [("stage", "slow noise"), ("machine", "probe: drifts")])
def test_without_slow_noise_none_is_learnt(tmp_path, family, words):
    if family == "stage":
        write_case(make_stage_case(11, "null", noise="flicker"), tmp_path / "case")
    else:
        write_case(make_machine_case(draw_machine(11), 11, "null", noise="flicker"), tmp_path / "case")

    def remarks():
        return " ".join(diagnose(problem_of(tmp_path / "case")).remarks)

    assert words in remarks()
    with without("slow noise"):
        assert words not in remarks()


def test_without_uncertain_parameters_the_twin_is_exact(found, folder):
    assert width_of(found[0].nuisance(())) > 0
    with without("uncertain parameters"):
        assert width_of(problem_of(folder).nuisance(())) == 0


def test_without_rivals_sets_stay_as_they_grew(found):
    step = select_causes(found[0], most=1).chosen
    with without("rivals"):
        members = (len(step.table.candidates) - 1,)
        start = step.table.evaluate(members)
        assert step.table.exchange(start) is start
        assert list(weighing.rivals_of(step)) == list(judgement.rivals_of(step)) == []
    assert HypothesisTable.exchange.__name__ == "exchange"
    assert step.table.exchange(start).members != members


def test_something_unknown_is_taken_for_an_effect_without_it(tmp_path):
    write_case(make_machine_case(draw_machine(6), 6, "unknown"), tmp_path / "case")
    assert diagnose(problem_of(tmp_path / "case")).verdict is Verdict.UNKNOWN
    with without("something unknown"):
        assert diagnose(problem_of(tmp_path / "case")).verdict is not Verdict.UNKNOWN


def test_pieces_of_a_run_are_put_together(tmp_path, capsys):
    out = tmp_path / "ablation.json"
    arguments = ["--seed", "2", "--cases", "1", "--family", "machine", "--floor", "clean", "--group", "mimic"]
    bench_ablation.main([*arguments, "--part", "departures", "-o", str(out)])
    bench_ablation.main([*arguments, "--part", WHOLE, "-o", str(out)])
    content = json.loads(out.read_text())
    assert list(content["parts"]) == ["departures", WHOLE]
    head, *rows = capsys.readouterr().out.splitlines()[-3:]
    assert head.split() == ["left", "out", *" ".join(bench_ablation.HEAD).split()]
    assert [row.split()[0] for row in rows] == [WHOLE, "departures"]
    with pytest.raises(SystemExit, match="other cases"):
        bench_ablation.main([*arguments, "--seed", "3", "--part", WHOLE, "-o", str(out)])


def row_of(group, right, size=50.0, told=None, named=(), seconds=1.0, verdict="explained"):
    row = {"right": right, "size": size, "told": told, "named": named, "seconds": seconds, "verdict": verdict}
    return {"plan": {"group": group}, **row}


def test_the_table_counts_what_stands_out():
    rows = [
        row_of("variant", True, told=True),
        row_of("variant", True, told=True, verdict="partly_explained"),
        row_of("variant", False, told=False, seconds=4.0),
        row_of("variant", False, size=5.0),
        row_of("loud", True),
        row_of("mimic", False, named=[("head_droop", "")]),
        row_of("mimic", True),
        row_of("unknown", True),
        row_of("single", True),
        row_of("single", True, size=3.0),
    ]
    cells = bench_ablation.format_row("rivals", rows).split()
    assert cells == ["rivals", "2/3", "1/2", "2/3", "1/1", "1/2", "1/1", "1/1", "1.3"]
