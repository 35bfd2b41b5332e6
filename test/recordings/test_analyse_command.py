"""The command `analyse`: pages and tables whole and self-contained, exit codes, and what is wrong said."""

from __future__ import annotations

import csv
import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
import yaml
from mock_bags import STREAMS, write_stage_bag

from rotary_error_monitor.cli import main
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.description.topics import samples_topic
from rotary_error_monitor.files import write_whole
from rotary_error_monitor.recordings.replay import replay_bag
from rotary_error_monitor.resources import config


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return write_stage_bag(tmp_path_factory.mktemp("recorded") / "bag", 16)


@pytest.fixture(scope="module")
def results(bag, tmp_path_factory):
    """All formats of one analysis, with limits that it is within of and beyond."""
    out = tmp_path_factory.mktemp("results") / "page.html"
    arguments = ["analyse", str(bag), "--height", "0", "60", "--format", "html,json,csv,png", "-o", str(out)]
    assert main([*arguments, "--limits", "radial_total_um=100", "tilt_total_nrad=5"]) == 10
    return out


def test_json_and_csv_hold_the_same_figures_with_unit_and_uncertainty(results, bag):
    content = json.loads(results.with_suffix(".json").read_text(encoding="utf-8"))
    rows = list(csv.DictReader(results.with_suffix(".csv").read_text(encoding="utf-8").splitlines()))
    assert len(rows) == len(content["figures"]) > 60
    for row, figure in zip(rows, content["figures"], strict=True):
        assert (row["name"], row["segment"], row["unit"]) == (figure["name"], figure["segment"], figure["unit"])
        assert float(row["value"]) == figure["value"]
    names = {(figure["name"], figure["segment"]) for figure in content["figures"]}
    for name in ("radial_rotating_at_60mm.total", "radial_x_at_0mm.synchronous_about_MZC", "tilt_y.fundamental"):
        assert {segment.split()[0] for found, segment in names if found == name} == {"forward", "backward"}
    of_segments = [figure for figure in content["figures"] if figure["segment"]]
    assert all(figure["expanded_uncertainty"] > 0 and figure["turns"] > 1 for figure in of_segments)
    assert all(figure["bandwidth"] > 10 and figure["cut_off"] > 10 for figure in of_segments)
    assert content["verdict"] == "beyond"
    assert [row["outcome"] for row in content["limits"]] == ["within", "beyond"]
    assert {stream["topic"] for stream in content["streams"]} == {samples_topic(stream) for stream in STREAMS}


def test_the_figures_are_those_of_the_replays_error_motion(results, bag):
    """Range of a component by hand, of whatever was at that speed: the total value, but for noise."""
    content = json.loads(results.with_suffix(".json").read_text(encoding="utf-8"))
    replay = replay_bag(bag, load_stage())
    fast = [row for row in content["figures"] if row["name"] == "tilt_x.total"]
    for row in fast:
        sense = 1 if row["segment"].startswith("forward") else -1
        speed = np.gradient(replay.theta, (replay.stamp_ns - replay.stamp_ns[0]) * 1e-9)
        there = np.abs(speed - 4 * sense) < 0.02
        measured = np.ptp(replay.error_motion[there, 3])
        noise = np.sqrt(np.median(replay.covariance[there, 3, 3]))
        assert row["value"] == pytest.approx(measured, abs=12 * noise)


def test_the_page_is_whole_and_loads_nothing(results):
    page = results.read_text(encoding="utf-8")
    assert page.startswith("<!doctype html>") and page.endswith("</html>\n")
    assert page.index("beyond its limits: tilt total") < page.index("<img")
    assert not re.search(r"(src|href)='(?!data:)", page) and "http" not in re.sub(r"base64,[^']*", "", page)
    # both ways: two heights of polar plots, radial and tilt spectra; the course of motion, tilt and temperature
    assert page.count("data:image/png;base64,") >= 2 * (2 + 2) + 3
    assert all(name in page for name in ("<h2>Polar plots", "<h2>Orders", "<h2>Course over time", "name='viewport'"))
    for word in ("± U (k = 2)", "synchronous", "asynchronous", "Bandwidth", "turns", "Health of the streams", "MIC"):
        assert word in page
    assert results.with_suffix(".png").read_bytes().startswith(b"\x89PNG")
    assert sorted(path.name for path in results.parent.iterdir()) == [
        f"page.{e}" for e in ("csv", "html", "json", "png")
    ]


@pytest.mark.parametrize(
    ("limits", "code", "said"),
    [
        ([], 0, "No limits were given, so there is no verdict. Largest total error motion: radial"),
        (["--limits", "radial_total_um=100"], 0, "The stage is good: it keeps its limit, uncertainty included"),
        (["--limits", "radial_total_nm=10"], 10, "The stage is beyond its limits: radial total"),
        (
            ["--limits", "axial_total_um=1"],
            11,
            "cannot be told: axial total is not told by this recording (limit 1 µm)",
        ),
    ],
)
def test_the_verdict_and_its_exit_code(bag, tmp_path, capsys, limits, code, said):
    assert main(["analyse", str(bag), *limits, "-o", str(tmp_path / "out.json")]) == code
    assert said in capsys.readouterr().out


def test_limits_of_the_twins_file_count_and_the_command_line_counts_more(bag, tmp_path):
    twin = tmp_path / "stage.yaml"
    content = yaml.safe_load(config("stage.yaml").read_text(encoding="utf-8"))
    twin.write_text(yaml.safe_dump({**content, "error_motion_limits": {"radial_total": 1e-8}}), encoding="utf-8")
    arguments = ["analyse", str(bag), "--twin", str(twin), "-o", str(tmp_path / "out.csv")]
    assert main(arguments) == 10
    assert main([*arguments, "--limits", "radial_total_um=100"]) == 0


def test_what_changed_is_more_than_the_uncertainty_of_both(bag, tmp_path, capsys):
    """Against itself nothing; against a stage whose rotor leans twice as far at order 3, the tilt, and hardly else."""
    out = tmp_path / "out.json"

    def changes(other):
        assert main(["analyse", str(bag), "--against", str(other), "--height", "0", "-o", str(out)]) == 0
        assert "figures that both recordings tell" in capsys.readouterr().out
        return json.loads(out.read_text(encoding="utf-8"))["changes"]

    assert not any(change["told"] for change in changes(bag))
    stage = load_stage()
    rows = [replace(row, x=(3 * row.x[0], 3 * row.x[1])) if row.order == 3 else row for row in stage.spindle.tilt]
    other = write_stage_bag(
        tmp_path / "bag", 16, stage=replace(stage, spindle=replace(stage.spindle, tilt=tuple(rows)))
    )
    found = changes(other)
    told = {change["name"] for change in found if change["told"]}
    assert {"tilt_x.synchronous", "tilt_x.residual_synchronous", "tilt_x.total"} <= told
    same = [change for change in found if change["name"].startswith(("radial", "tilt_y"))]
    assert sum(change["told"] for change in same) <= 0.15 * len(same)


def test_less_than_a_turn_is_said(tmp_path, capsys):
    short = write_stage_bag(tmp_path / "bag", 1.25)
    assert main(["analyse", str(short), "-o", str(tmp_path / "out.html")]) == 0
    told = capsys.readouterr()
    assert "No whole turn: no error motion value is told." in told.out
    assert "no whole one, so no error motion value is told" in told.err
    assert "no whole one" in (tmp_path / "out.html").read_text(encoding="utf-8")


WRONG = {
    "nothing there": (lambda folder: folder / "nothing", "no such bag"),
    "a folder without a bag": (lambda folder: folder, "metadata.yaml|no bag|holds no"),
    "something else": (
        lambda folder: write_stage_bag(folder / "bag", 2, ("lvdt", "temperature")),
        "no message on /stage/head_a",
    ),
    "an empty bag": (
        lambda folder: write_stage_bag(folder / "bag", 0, ()),
        "no message on /stage/head_a|empty|no topic",
    ),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_a_wrong_bag_is_named_and_an_old_page_stays(wrong, tmp_path, capsys):
    make, said = WRONG[wrong]
    recording = tmp_path / "recording"
    recording.mkdir()
    out = tmp_path / "page.html"
    out.write_text("old")
    assert main(["analyse", str(make(recording)), "-o", str(out)]) == 2
    told = capsys.readouterr().err
    assert re.search(said, told) and "Traceback" not in told
    assert out.read_text() == "old"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["-o", "page.txt"], "page.txt: ends in none of html, json, csv, png"),
        (["-o", "page.html", "--format", "html,pdf"], "--format has 'pdf'; give some of html,json,csv,png"),
        (["-o", "page.html", "--waves", "1"], "--waves is 1; it must be at least 3"),
        (["-o", "page.html", "--height", "nan"], "--height is nan; it must be a height above the ring in mm"),
        (["-o", "page.html", "--limits", "radial=1"], "expected NAME_UNIT=NUMBER above 0"),
        (["-o", "no/page.html"], "no folder no"),
        (["-o", "page.html", "--machine", "grinder_zhou2023"], "the machine has no monitored axis"),
    ],
)
def test_wrong_arguments_end_with_code_2(bag, arguments, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["analyse", str(bag), *arguments]) == 2
    assert said in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_what_is_read_is_not_written_over(bag, tmp_path, capsys):
    twin = tmp_path / "stage.json"
    shutil.copy(config("stage.yaml"), twin)
    assert main(["analyse", str(bag), "--twin", str(twin), "-o", str(twin)]) == 2
    assert "not written, for it is the input" in capsys.readouterr().err


def test_a_file_is_written_whole_or_stays(tmp_path, monkeypatch):
    path = tmp_path / "page.html"
    write_whole(path, b"old")

    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("rotary_error_monitor.files.os.fsync", full)
    with pytest.raises(ValueError, match=r"page.html: cannot be written \(No space left on device\)"):
        write_whole(path, b"new")
    assert path.read_bytes() == b"old"
    assert [each.name for each in tmp_path.iterdir()] == ["page.html"]
