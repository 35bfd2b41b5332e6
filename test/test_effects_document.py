"""`doc/effects.md` and its example: what it shows is the file, and the file does what it says."""

from __future__ import annotations

import json
import re
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rotary_error_monitor.blind_check.cases import write_case
from rotary_error_monitor.cases.making import make_stage_case
from rotary_error_monitor.cli import main
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.effects.library import ENTRY_POINTS, effect_named, load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.twin.recording import record_stage
from rotary_error_monitor.twin.stage import twin_of

DOC = Path(__file__).parents[1] / "doc"
EXAMPLE = DOC / "examples" / "oil_film.py"
TEXT = (DOC / "effects.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def case():
    """A stage of the plant whose rotor floats, which the vocabulary does not name."""
    return make_stage_case(41, "unknown", ["oil_film"], (150.0, 300.0))


@pytest.fixture(scope="module")
def folder(case, tmp_path_factory):
    path = tmp_path_factory.mktemp("floating") / "case"
    write_case(case, path)
    return path


def diagnosed(folder, out, *options):
    paths = [str(folder / "bag"), "--twin", str(folder / "twin.yaml"), "-o", str(out), "--no-report"]
    code = main(["diagnose", *paths, *options])
    return code, json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))


def test_the_document_shows_the_file():
    (shown,) = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    assert shown == EXAMPLE.read_text(encoding="utf-8")
    assert len(shown.splitlines()) <= 30
    assert f'entry-points."{ENTRY_POINTS}"' in TEXT


def test_the_document_names_every_hook():
    own = {name for name, item in vars(StageEffect).items() if callable(item)}
    assert set(re.findall(r"^\| `(\w+)\(", TEXT, re.MULTILINE)) == own - {"touches", "locations"}


def test_the_example_moves_the_stage_as_the_exact_plant_does(case):
    effect = effect_named("oil_film", load_effects(StageEffect, [EXAMPLE]))
    (fault,) = case.truth.faults
    recording = record_stage({n: list(b) for n, b in case.blocks.items()}, "abcd")
    twin = twin_of(case.twin, recording, ())
    found = twin.predict((Cause(effect, "", np.asarray(fault.radial)),))["lvdt"] - twin.predict()["lvdt"]
    time = recording.streams["lvdt"].time + (recording.start_ns - case.plant.epoch_ns) * 1e-9
    true = case.plant.signal("lvdt", time) - replace(case.plant, faults=()).signal("lvdt", time)
    np.testing.assert_allclose(found, true, atol=1e-10)
    assert np.abs(true).max() > 5e-8


SHOWN = "rotary_error_monitor diagnose BAG --twin TWIN.yaml --effects doc/examples/oil_film.py -o DIR"


def diagnosed_as_shown(folder, out):
    """By the command as the document has it."""
    assert SHOWN in TEXT.splitlines()
    bound = {"BAG": folder / "bag", "TWIN.yaml": folder / "twin.yaml", "DIR": out}
    code = main([str(bound.get(word, word)) for word in shlex.split(SHOWN)[1:]])
    return code, json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))


def test_without_the_file_it_is_unknown_with_it_explained(case, folder, tmp_path, monkeypatch):
    monkeypatch.chdir(DOC.parent)
    code, content = diagnosed(folder, tmp_path / "without")
    assert code == 12 and content["verdict"] == "unknown"
    code, content = diagnosed_as_shown(folder, tmp_path / "with")
    assert code == 10
    (cause,) = content["causes"]
    assert cause["effect"] == "oil_film" and cause["probability"] > 0.9
    assert content["gap"]["shrink"] > 0.95
    (fault,) = case.truth.faults
    found = cause["parameters"]["lift"]
    assert (np.abs(np.subtract(found["value"], fault.radial)) < 4 * np.asarray(found["std"])).all()


def test_the_list_of_effects_is_what_the_command_prints(capsys):
    """`rotary_error_monitor effects` writes it; each effect says what to do about it."""
    assert main(["effects"]) == 0
    printed = capsys.readouterr().out
    assert (DOC / "effect_list.md").read_text(encoding="utf-8").partition("\n## ")[2] == printed.removeprefix("## ")
    rows = [line.split(" | ") for line in printed.splitlines() if line.startswith("| `")]
    assert len(rows) > 60
    assert all(cell.strip(" |") for row in rows for cell in row)


def test_the_list_of_effects_has_those_of_a_file(capsys):
    assert main(["effects", "stage", "--effects", str(EXAMPLE)]) == 0
    printed = capsys.readouterr().out
    assert "| `oil_film` | lift on the oil film | `lift` (2): 1 µm/(rad/s)^0.5 |" in printed
    assert "axis_backlash" not in printed, "which a stage has none of"
    assert main(["effects", "boat"]) == 2
    assert "'boat'; expected one of" in capsys.readouterr().err
