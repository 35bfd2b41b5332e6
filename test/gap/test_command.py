"""The commands `diagnose` and `gap-benchmark` from files to exit codes."""

from __future__ import annotations

import json
import shutil
import sys

import numpy as np
import pytest
import yaml

from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.blind_check.cases import draw_machine, plan_cases, write_case
from rotary_error_monitor.cases.making import make_machine_case, make_stage_case
from rotary_error_monitor.cli import main
from rotary_error_monitor.signals.blocks import SampleBlock


@pytest.fixture(scope="module")
def stage_case(tmp_path_factory):
    folder = tmp_path_factory.mktemp("stage") / "case"
    write_case(make_stage_case(5, "single", ["mirror_wobble"], (150.0, 300.0), duration=20.0), folder)
    return folder


@pytest.fixture(scope="module")
def machine_case(tmp_path_factory):
    folder = tmp_path_factory.mktemp("machine") / "case"
    write_case(make_machine_case(draw_machine(5), 5, "single", ["squareness"]), folder)
    return folder


def run(folder, out, *options):
    return main(["diagnose", str(folder / "bag"), "--twin", str(folder / "twin.yaml"), "-o", str(out), *options])


@pytest.mark.parametrize("case", ["stage_case", "machine_case"])
def test_an_explained_gap_is_written_and_its_twin_has_none(case, request, tmp_path, capsys):
    folder = request.getfixturevalue(case)
    improved = tmp_path / "improved.yaml"
    assert run(folder, tmp_path / "out", "--write-twin", str(improved)) == 10
    assert "Explained by" in capsys.readouterr().out
    assert {file.name for file in (tmp_path / "out").iterdir()} == {"diagnosis.json", "diagnosis.html", "diagnosis.png"}
    shutil.copytree(folder / "bag", tmp_path / "again" / "bag")
    shutil.copy(improved, tmp_path / "again" / "twin.yaml")
    assert run(tmp_path / "again", tmp_path / "out2", "--no-report") == 0
    assert json.loads((tmp_path / "out2" / "diagnosis.json").read_text())["verdict"] == "no_gap"


def test_where_somebody_watches_a_bar_says_what_is_done(machine_case, tmp_path, capsys, monkeypatch):
    assert run(machine_case, tmp_path / "out", "--no-report") == 10
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    assert run(machine_case, tmp_path / "out", "--no-report") == 10
    drawn = capsys.readouterr().err
    assert "diagnose:" in drawn
    assert [words for words in ("reading", "residual", "1 effect", "verdict", "writing") if words not in drawn] == []


def test_an_effect_without_a_parameter_of_its_own_is_kept_in_the_twin(tmp_path):
    folder = tmp_path / "case"
    write_case(make_stage_case(3, "single", ["head_latency"], (150.0, 300.0), duration=20.0), folder)
    improved = tmp_path / "improved.yaml"
    assert run(folder, tmp_path / "out", "--no-report", "--write-twin", str(improved)) == 10
    rows = yaml.safe_load(improved.read_text())["effects"]
    assert rows[0]["effect"] == "head_latency" and rows[0]["location"].startswith("head_")
    shutil.copy(improved, folder / "twin.yaml")
    assert run(folder, tmp_path / "out2", "--no-report") == 0


@pytest.mark.long
def test_a_departure_that_no_twin_can_hold_stands_beside_it_in_words(tmp_path):
    told = 0
    for seed in range(1, 6):
        folder, improved = tmp_path / f"case{seed}", tmp_path / f"improved{seed}.yaml"
        write_case(make_machine_case(draw_machine(seed), seed, "variant", ["squareness"], (900.0, 1500.0)), folder)
        run(folder, tmp_path / "out", "--no-report", "--write-twin", str(improved))
        causes = json.loads((tmp_path / "out" / "diagnosis.json").read_text())["causes"]
        lines = improved.read_text().splitlines() if causes else []
        assert [line for line in lines if line.startswith("#")] == [
            f"# not in this twin: {found['effect']} at {found['location']} {row['pattern']} ({row['share']:.1%} of it)"
            for found in causes
            for row in found["departures"]
        ]
        told += sum(len(found["departures"]) for found in causes)
        assert not causes or "machine" in yaml.safe_load(improved.read_text())
    assert told >= 3


def test_a_users_effect_takes_part(stage_case, tmp_path):
    own = tmp_path / "mine.py"
    own.write_text(
        "from rotary_error_monitor.effects.effect import Parameter\n"
        "from rotary_error_monitor.effects.rotor import StageEffect\n\n\n"
        "class Offset(StageEffect):\n"
        "    name = 'tilt_offset'\n"
        "    parameters = (Parameter('offset', 'rad', 1e-6),)\n"
        "    acts_on = ('autocollimator',)\n\n"
        "    def measured(self, values, location, state, ideal):\n"
        "        return ideal + values[0]\n"
    )
    assert run(stage_case, tmp_path / "out", "--no-report", "--effects", str(own)) == 10
    ranking = json.loads((tmp_path / "out" / "diagnosis.json").read_text())["ranking"]
    assert ranking[0]["effect"] == "mirror_wobble"


def blocks_of(folder):
    from rotary_error_monitor.bags.reader import BagReader

    return BagReader(folder / "bag").read_blocks()


def changed(folder, target, change):
    topics = blocks_of(folder)
    change(topics)
    target.mkdir()
    write_messages(target / "bag", topics)
    shutil.copy(folder / "twin.yaml", target / "twin.yaml")
    return target


def drop_head(topics):
    del topics["/stage/head_b/samples"]


def make_nan(topics):
    block = topics["/stage/head_a/samples"][3]
    rows = block.rows.copy()
    rows[5, 1] = np.nan
    topics["/stage/head_a/samples"][3] = SampleBlock(block.stamp_ns, block.names, rows)


def move_clock(topics):
    topics["/stage/autocollimator/samples"] = [
        SampleBlock(b.stamp_ns + 3_600_000_000_000, b.names, b.rows) for b in topics["/stage/autocollimator/samples"]
    ]


def cut_short(topics):
    for name, blocks in topics.items():
        topics[name] = blocks[:1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (drop_head, "/stage/head_b/samples"),
        (make_nan, "finite"),
        (move_clock, "do not overlap"),
        (cut_short, "200 are needed"),
    ],
)
def test_bad_recordings_are_told(stage_case, tmp_path, capsys, change, message):
    assert run(changed(stage_case, tmp_path / "bad", change), tmp_path / "out") == 2
    assert message in capsys.readouterr().err


def test_a_torn_bag_gives_what_is_readable(stage_case, tmp_path, capsys):
    shutil.copytree(stage_case, tmp_path / "torn")
    bag = next((tmp_path / "torn" / "bag").glob("*.mcap"))
    content = bag.read_bytes()
    bag.write_bytes(content[: int(0.7 * len(content))])
    assert run(tmp_path / "torn", tmp_path / "out", "--no-report") == 10
    assert "was not closed; readable are" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("stage: {encoder: {}}", "twin.yaml:1"),
        ("motor: {}", "no section 'machine' or 'mount' or 'quadrature' or 'stage'"),
        ("[1, 2]", "expected a mapping"),
        ("stage: [", "no valid YAML"),
    ],
)
def test_bad_twins_are_told(stage_case, tmp_path, capsys, content, message):
    shutil.copytree(stage_case / "bag", tmp_path / "case" / "bag")
    (tmp_path / "case" / "twin.yaml").write_text(content)
    assert run(tmp_path / "case", tmp_path / "out") == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    "option", [["--false-alarms", "0"], ["--most-causes", "0"], ["--most-rate", "99"], ["--twin", "nowhere.yaml"]]
)
def test_bad_options_are_told(stage_case, tmp_path, capsys, option):
    assert run(stage_case, tmp_path / "out", *option) == 2
    assert capsys.readouterr().err


def test_the_plan_goes_round_all_effects():
    plans = plan_cases(3, 100, ("stage", "machine"), (False,))
    assert [plan.number for plan in plans] == list(range(len(plans)))
    singles = {plan.effects[0] for plan in plans if plan.group == "single"}
    assert {"disc_scale", "tool_length"} <= singles and len(singles) > 35
    left_out = [plan for plan in plans if plan.group == "left out"]
    assert all(plan.left_out[:1] == plan.effects for plan in left_out)
    assert all("rotary_harmonic" in plan.left_out for plan in left_out if plan.effects == ("head_droop",))
    assert {plan.family for plan in plans if plan.group == "new speed"} == {"stage"}
    assert plan_cases(3, 100, ("stage", "machine"), (False,)) == plans


def test_the_benchmark_opens_what_it_sealed(tmp_path, capsys):
    out = tmp_path / "outcomes.json"
    arguments = ["--cases", "1", "--family", "machine", "--floor", "clean", "--seed", "2", "-o", str(out)]
    groups = ("single", "pair", "unknown", "null", "weak", "left out")
    chosen = [argument for group in groups for argument in ("--group", group)]
    assert main(["gap-benchmark", *arguments, *chosen]) == 0
    printed = capsys.readouterr().out
    sealed = printed.splitlines()[0].split()[-1]
    assert f"opened truth: sha256 {sealed}" in printed
    content = json.loads(out.read_text())
    assert content["sha256"] == sealed
    assert sum(row["right"] for row in content["outcomes"]) == len(content["outcomes"]) == 6
    assert main(["gap-benchmark", *arguments, *chosen, "--jobs", "2"]) == 0
    printed = capsys.readouterr().out
    again = json.loads(out.read_text())
    assert f"opened truth: sha256 {printed.splitlines()[0].split()[-1]}" in printed
    assert [row | {"seconds": 0.0} for row in again["outcomes"]] == [
        row | {"seconds": 0.0} for row in content["outcomes"]
    ]
    assert main(["gap-benchmark", "--cases", "0"]) == 2
    assert main(["gap-benchmark", "--jobs", "0"]) == 2
