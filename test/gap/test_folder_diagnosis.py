"""`diagnose` of a folder: each bag for itself, and which stages share a cause."""

from __future__ import annotations

import json
import shutil

import pytest

from rotary_error_monitor.blind_check.cases import draw_machine, write_case
from rotary_error_monitor.cases.making import make_machine_case
from rotary_error_monitor.cli import main
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.report.folder_diagnosis import DiagnosedBag, FolderVerdict, folder_sentence

EFFECT = "squareness"


@pytest.fixture(scope="module")
def fleet(tmp_path_factory):
    """One machine with a cause, twice, in two folders, and a bag of something that is none."""
    place = tmp_path_factory.mktemp("fleet")
    write_case(make_machine_case(draw_machine(5), 5, "single", [EFFECT]), place / "case")
    for name in ("north", "south"):
        shutil.copytree(place / "case" / "bag", place / "bags" / name / "bag")
    (place / "bags" / "broken").mkdir()
    (place / "bags" / "broken" / "broken_0.mcap").write_bytes(b"\x89MCAP0\r\n")
    return place


def diagnose(place, out, *options):
    return main(["diagnose", str(place), "--twin", str(place.parent / "case" / "twin.yaml"), "-o", str(out), *options])


def test_each_bag_has_its_verdict_and_shared_causes_are_named(fleet, tmp_path, capsys):
    alone = tmp_path / "alone"
    twin = str(fleet / "case" / "twin.yaml")
    assert diagnose(fleet / "bags" / "north" / "bag", alone, "--no-report", "--twin", twin) == 10
    single = json.loads((alone / "diagnosis.json").read_text(encoding="utf-8"))
    capsys.readouterr()
    assert diagnose(fleet / "bags", tmp_path / "out", "--by-folder", "--jobs", "1") == 10
    content = json.loads((tmp_path / "out" / "diagnosis.json").read_text(encoding="utf-8"))
    assert [(row["bag"], row["stage"]) for row in content["bags"]] == [
        *(("north/bag", "north"), ("south/bag", "south"), ("broken", "twin"))
    ]
    assert content["bags"][2]["diagnosis"] is None and content["bags"][2]["reason"]
    assert content["bags"][0]["diagnosis"] == content["bags"][1]["diagnosis"] == single
    (cause,) = [row for row in content["causes"] if EFFECT in row["cause"]]
    assert cause["shared"] and cause["stages"] == {"north": 1, "south": 1}
    said = capsys.readouterr()
    assert f"2 recordings of 2 stages: 2 explained. Stages share: {cause['cause']}." in said.out
    assert "note: broken: " in said.err
    page = (tmp_path / "out" / "diagnosis.html").read_text(encoding="utf-8")
    assert page.endswith("</html>\n") and "south/bag" in page and "Bags that cannot be diagnosed" in page


def test_of_one_stage_nothing_is_shared():
    content = {"verdict": "explained", "causes": [{"effect": EFFECT, "location": "YZ"}]}
    rows = tuple(DiagnosedBag(name, "A", "/", None, "", content) for name in ("one", "two"))
    said = folder_sentence(FolderVerdict((*rows, DiagnosedBag("three", reason="broken"))))
    assert said == ("2 recordings of 1 stage: 2 explained. No cause is shared by stages. 1 could not be diagnosed.")
    other = DiagnosedBag("four", "A", "/left", None, "", {"verdict": "unknown", "causes": []})
    found = FolderVerdict((*rows, other))
    assert found.worst is Verdict.UNKNOWN and "of 2 stages: 2 explained, 1 unknown" in folder_sentence(found)
    assert found.stages_by_cause == {f"{EFFECT} at YZ": {"A": 2}}


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--write-twin", "new.yaml"], "--write-twin is for one bag"),
        (["--jobs", "0"], "--jobs is 0"),
        (["--effects", "nothing.py"], "nothing.py"),
    ],
)
def test_wrong_input_ends_with_code_2(fleet, tmp_path, capsys, options, said):
    assert diagnose(fleet / "bags", tmp_path / "out", *options) == 2
    assert said in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_a_place_that_cannot_be_written_is_said_before_a_bag_is_read(fleet, tmp_path, capsys):
    (tmp_path / "out" / "diagnosis.html").mkdir(parents=True)
    assert diagnose(fleet / "bags", tmp_path / "out") == 2
    assert "diagnosis.html: cannot be written (it is a folder)" in capsys.readouterr().err


def test_a_folder_that_cannot_be_made_is_said(fleet, tmp_path, capsys):
    (tmp_path / "file").touch()
    twin = str(fleet / "case" / "twin.yaml")
    assert diagnose(fleet / "bags" / "north", tmp_path / "file" / "out", "--jobs", "1", "--twin", twin) == 2
    assert "file/out: cannot be written: Not a directory" in capsys.readouterr().err


def test_a_folder_of_which_no_bag_can_be_diagnosed(fleet, tmp_path, capsys):
    shutil.copytree(fleet / "bags" / "broken", tmp_path / "bags" / "broken")
    shutil.copytree(fleet / "case", tmp_path / "case")
    assert diagnose(tmp_path / "bags", tmp_path / "out", "--jobs", "1") == 2
    assert "none of 1 bags can be diagnosed; broken: " in capsys.readouterr().err
    empty = tmp_path / "empty"
    empty.mkdir()
    assert diagnose(empty, tmp_path / "out", "--twin", str(fleet / "case" / "twin.yaml")) == 2
    assert "no readable bag" in capsys.readouterr().err
