"""The command `compare`: the monitor held against references, by the independent world and by the mock stage."""

from __future__ import annotations

import csv
import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from described_stages import stage_of
from mock_bags import write_stage_bag
from referenced_stage import leaning_stages, raised, record
from without_heads import STREAMS, example
from world import Options, make_recording, random_stage, with_probes

from rotary_error_monitor.analysis.verification_result import figures_of
from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.cli import main
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.recordings.verification import verify_bag
from rotary_error_monitor.resources import config


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return write_stage_bag(tmp_path_factory.mktemp("recorded") / "bag", 16)


@pytest.fixture(scope="module")
def results(bag, tmp_path_factory):
    """All formats of one comparison; the monitor agrees."""
    folder = tmp_path_factory.mktemp("results")
    twin, out = folder / "stage.yaml", folder / "page.html"
    shutil.copy(config("stage.yaml"), twin)
    arguments = ["compare", str(bag), "--twin", str(twin), "--height", "16", "--format", "html,json,csv,png"]
    assert main([*arguments, "-o", str(out)]) == 0
    return out


def test_json_and_csv_hold_the_same_figures_of_both_directions(results):
    content = json.loads(results.with_suffix(".json").read_text(encoding="utf-8"))
    rows = list(csv.DictReader(results.with_suffix(".csv").read_text(encoding="utf-8").splitlines()))
    assert [(row["name"], row["segment"]) for row in rows] == [(f["name"], f["segment"]) for f in content["figures"]]
    assert all(float(row["value"]) == figure["value"] for row, figure in zip(rows, content["figures"], strict=True))
    for name in ("rms", "largest", "mean_rms"):
        ways = {f["segment"].split()[0] for f in content["figures"] if f["name"] == f"lvdt_at_16mm.x.difference_{name}"}
        assert ways == {"forward", "backward"}
    (comparison,) = content["comparisons"]
    assert content["agrees"] is comparison["agrees"] is True
    true = load_stage().lvdt.artefact_eccentricity
    off = np.array(comparison["artefact_eccentricity"]) - true
    assert (np.abs(off) <= comparison["artefact_eccentricity_expanded_uncertainty"]).all()
    for turning in comparison["over_angle"]:
        assert turning["estimate_x"] == pytest.approx(turning["reference_x"], abs=2e-7)
        assert np.ptp(turning["estimate_x"]) > 5e-6


def test_the_page_is_whole_and_loads_nothing(results):
    page = results.read_text(encoding="utf-8")
    assert page.startswith("<!doctype html>") and page.endswith("</html>\n")
    assert page.index("agrees with the reference within its stated uncertainty") < page.index("<img")
    assert not re.search(r"(src|href)='(?!data:)", page) and "http" not in re.sub(r"base64,[^']*", "", page)
    assert page.count("data:image/png;base64,") == 8  # over angle and time, motion and difference, along x and y
    assert results.with_suffix(".png").read_bytes().startswith(b"\x89PNG")


def test_a_right_description_agrees_and_an_lvdt_10_mm_higher_does_not(tmp_path):
    """Stages that lean; the artefact's eccentricity, which no description tells, is found within its uncertainty."""
    inside = []
    for seed, section in leaning_stages(2):
        bag = record(tmp_path, seed, section, 14.0)
        right, wrong = (verify_bag(bag, raised(section, by)) for by in (0.0, 0.01))
        assert right.agrees and right.exit_code == 0, seed
        assert not wrong.agrees and wrong.exit_code == 10, seed
        (found,), (off,) = right.comparisons, wrong.comparisons
        error = found.eccentricity - np.array(section["lvdt"]["artefact_eccentricity"])
        inside += (np.abs(error) <= found.expanded).tolist()
        assert off.higher == pytest.approx(-0.01, abs=1.5 * off.higher_expanded) and off.higher_expanded < 3e-3
    assert np.mean(inside) >= 0.75  # of four; over more stages in test_compare_rates.py


def test_a_probe_that_is_a_reference_is_no_input(tmp_path):
    """Its samples change what it says of the monitor, and nothing of the estimate."""
    section = with_probes(random_stage(8), 8)
    section.pop("lvdt", None)
    options = Options(motion="steady", peak_speed=4.0, odd_rates=False)
    recording = make_recording(8, duration=6.0, stage=section, options=options)
    topic = "/stage/radial_probe_high/samples"
    stage, found = stage_of(section), []
    for name, size in (("right", 0.0), ("wrong", 4e-6)):
        blocks = []
        for block in recording.blocks[topic]:
            rows = block.rows.copy()
            rows[:, 1] += size * np.cos(2 * recording.truth(block.times_ns).theta)
            blocks.append(replace(block, rows=rows))
        write_messages(tmp_path / name, {**recording.blocks, topic: blocks})
        found.append(verify_bag(tmp_path / name, stage, names=("high",)))
    (right,), (wrong,) = (each.comparisons for each in found)
    assert right.agrees and not wrong.agrees
    assert right.height == section["sensors"]["high"]["height"] and right.axes == wrong.axes
    once = next(row for row in section["sensors"]["high"]["form"] if row["order"] == 1)
    assert (np.abs(right.eccentricity - [once["cos"], once["sin"]]) <= right.expanded).all()
    for one, other in zip(right.turnings, wrong.turnings, strict=True):
        assert (one.samples.estimate == other.samples.estimate).all()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--height", "60"], r"--height is 60 \(mm\): no reference was recorded there, but at 16 mm above the ring$"),
        (["--height", "0.016"], r"--height is 0.016 \(mm\): no reference .* at 16 mm above the ring; 16 \(mm\) may be"),
        (["--height", "16000"], "--height is 16000.0; it must be a height above the ring in mm, at most 10 m"),
        (["--height", "nan"], "--height is nan; it must be a height above the ring in mm"),
        (["--reference", "low"], "the stage has no reference 'low'; it has lvdt"),
        (["-o", "page.txt"], "page.txt: ends in none of html, json, csv, png"),
        (["-o", "no/page.html"], "no folder no"),
        (["--format", "json"], "--format is json; it needs -o OUT, by which its files are named"),
    ],
)
def test_wrong_arguments_end_with_code_2(bag, arguments, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    out = [] if {"-o", "--format"} & set(arguments) else ["-o", "page.html"]
    assert main(["compare", str(bag), *arguments, *out]) == 2
    told = capsys.readouterr().err
    assert re.search(said, told, re.MULTILINE) and "Traceback" not in told
    assert list(tmp_path.iterdir()) == []


def test_a_bag_that_tells_nothing_is_named_and_an_old_page_stays(tmp_path, capsys):
    heads = (*(f"head_{letter}" for letter in "abcd"), "autocollimator", "command")
    out = tmp_path / "page.html"
    out.write_text("old")
    for streams, seconds, said in (
        (heads, 2, "no samples of the reference lvdt; the stage has lvdt: record one beside heads"),
        ((*heads, "lvdt"), 1.25, r"lvdt at 16 mm: \S+ turns in common .* record a whole turn at least"),
    ):
        bag = write_stage_bag(tmp_path / f"bag_{len(streams)}", seconds, streams)
        assert main(["compare", str(bag), "-o", str(out)]) == 2
        told = capsys.readouterr().err
        assert re.search(said, told) and str(bag) in told
    empty = tmp_path / "empty.mcap"
    empty.write_bytes(b"")
    assert main(["compare", str(empty), "-o", str(out)]) == 2
    assert "the recording was not closed; readable are 0 messages on 0 topics, 0 of 0 bytes" in capsys.readouterr().err
    assert out.read_text() == "old"


def test_what_is_read_is_not_written_over(bag, tmp_path, capsys):
    twin = tmp_path / "stage.json"
    shutil.copy(config("stage.yaml"), twin)
    assert main(["compare", str(bag), "--twin", str(twin), "-o", str(twin)]) == 2
    assert "not written, for it is the input" in capsys.readouterr().err


def test_an_lvdt_that_comes_back_is_compared_each_time(bag):
    """Two stands at one height have figures of their own names."""
    found = verify_bag(bag, load_stage())
    names = [figure.name for figure in figures_of(replace(found, comparisons=found.comparisons * 2))]
    assert {name.partition(".")[0] for name in names} == {"lvdt_at_16mm", "lvdt_at_16mm_2"}


def test_a_stage_without_any_reference_says_what_is_lacking(bag):
    with pytest.raises(InputError, match="the stage has neither LVDT nor radial probe"):
        verify_bag(bag, replace(load_stage(), lvdt=None))


def test_an_estimate_that_was_not_believed_is_told(bag):
    """A tilt beyond what the stage can do, and so hardly an estimate at the height of the LVDT."""
    stiff = load_stage()
    stiff = replace(stiff, spindle=replace(stiff.spindle, tilt=()), stated_limits={**stiff.stated_limits, "tilt": 1e-6})
    with pytest.raises(InputError, match=r"not observable.*; autocollimator: not believed at some time: .* at most"):
        verify_bag(bag, stiff)


def test_a_stage_all_of_whose_sensors_are_references_is_told_to_name_fewer(tmp_path):
    """Three probes and no heads: without the probes nothing is left that estimates."""
    stage = load_stage(example(tmp_path))
    bag = write_stage_bag(tmp_path / "bag", 4, (*STREAMS, "command"), stage)
    with pytest.raises(InputError, match=r"one at 0 mm: radial error motion is not observable.* or name fewer of"):
        verify_bag(bag, stage)
    assert verify_bag(bag, stage, names=["one"]).comparisons
