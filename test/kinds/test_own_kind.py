"""`doc/kinds.md` and its example: a kind of somebody else's is found when it is installed, and diagnosed like any."""

from __future__ import annotations

import json
import re
import shlex
import tomllib
from pathlib import Path

import pytest
import yaml
from simulated_bath import LAG, write_bath

from rotary_error_monitor.cli import main
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.gap.kind import ENTRY_POINTS, Kind
from rotary_error_monitor.gap.loading import load_twin
from rotary_error_monitor.gap.table import TableProblem
from rotary_error_monitor.resources import config

DOC = Path(__file__).parents[2] / "doc"
EXAMPLE = DOC / "examples" / "bath_thermometer"


@pytest.fixture
def thermometer(install):
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    install(EXAMPLE, project["entry-points"])


@pytest.fixture
def recording(tmp_path):
    """Of a bath."""
    return write_bath(tmp_path / "bath.csv")


@pytest.fixture
def twin(tmp_path):
    file = tmp_path / "twin.yaml"
    file.write_text("thermometer: {noise: 0.02, zero: 0.1}\n")
    return file


SHOWN = "rotary_error_monitor diagnose bath.csv --twin twin.yaml --write-twin improved.yaml -o DIR"


def test_it_is_diagnosed_and_its_improved_twin_has_no_gap(
    thermometer, recording, twin, tmp_path, capsys, caplog, monkeypatch
):
    """By the command as the document has it."""
    monkeypatch.chdir(tmp_path)
    improved, out = tmp_path / "improved.yaml", tmp_path / "DIR"
    assert SHOWN in (DOC / "kinds.md").read_text(encoding="utf-8").splitlines()
    assert main(shlex.split(SHOWN)[1:]) == 10
    assert "Explained by thermometer lags behind the bath, thermometer_lag (constant" in capsys.readouterr().out
    assert "entry point 'thermometer' of bath_thermometer: bath_thermometer.kind:ThermometerKind runs as code" in (
        caplog.text
    )
    assert {path.name for path in out.iterdir()} == {"diagnosis.json", "diagnosis.html", "diagnosis.png"}
    written = json.loads((out / "diagnosis.json").read_text())
    found = written["causes"][0]["parameters"]["constant"]
    assert found["value"] == pytest.approx(LAG, abs=4 * found["std"]) and found["std"] < 0.02 * LAG
    assert written["where"][0]["channel"] == "/thermometer/reading.temperature"
    assert yaml.safe_load(improved.read_text())["effects"][0]["effect"] == "thermometer_lag"
    again = ["--twin", str(improved), "-o", str(tmp_path / "again"), "--no-report"]
    assert main(["diagnose", str(recording), *again]) == 0


def test_what_it_refuses_is_told(thermometer, recording, twin, tmp_path, capsys):
    out = ["-o", str(tmp_path / "out"), "--no-report"]
    told = f"{twin}:1: thermometer.noise: 'much' is no number; expected: standard deviation of a reading in K"
    twin.write_text("thermometer: {noise: much, zero: 0.1}\n")
    assert main(["diagnose", str(recording), "--twin", str(twin), *out]) == 2
    assert told in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ("temperature + values * time[:3]", "could not be broadcast"),
        ("temperature * float('nan')", "not finite"),
        (
            "temperature + (values * time if values[0] else float('nan'))",
            "with all values 0 it changes the prediction of reading by nan",
        ),
        ("temperature + 0.2 + values * time", "with all values 0 it changes the prediction of reading by 10 "),
    ],
)
def test_a_mistake_in_an_effect_is_told_before_it_takes_part(
    given, told, thermometer, recording, twin, tmp_path, capsys
):
    own = tmp_path / "mine.py"
    own.write_text(
        "from bath_thermometer.effects import ThermometerEffect\n"
        "from rotary_error_monitor.effects.effect import Parameter\n\n\n"
        "class Leak(ThermometerEffect):\n"
        "    name = 'leak'\n"
        "    parameters = (Parameter('rate', 'K/s', 1e-3),)\n\n"
        "    def shown(self, values, time, temperature):\n"
        f"        return {given}\n"
    )
    options = ["--twin", str(twin), "-o", str(tmp_path / "out"), "--no-report", "--effects", str(own)]
    assert main(["diagnose", str(recording), *options]) == 2
    error = capsys.readouterr().err
    assert "effect 'leak' of mine fails: ValueError" in error and told in error


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({"lever": "lever.nothing:Kind"}, r"entry point 'lever' of lever: cannot be loaded: ModuleNotFoundError"),
        ({"lever": "lever"}, r"entry point 'lever' of lever: lever is no kind; name a class derived from Kind"),
        ({"lever": "lever:Lever"}, r"entry point 'lever' of lever: lever:Lever is no kind"),
        ({"stage": "lever:Lever"}, r"entry point 'stage' of .* and entry point 'stage' of .*: two kinds of one name"),
        ({}, r"no section 'machine' or 'mount' or 'quadrature' or 'stage'; it has \['lever', 'stage'\]"),
    ],
)
def test_a_kind_with_a_mistake_is_named(install, tmp_path, entries, message):
    package, twin = tmp_path / "lever", tmp_path / "twin.yaml"
    package.mkdir()
    (package / "__init__.py").write_text("class Lever:\n    pass\n")
    install(package, {ENTRY_POINTS: entries})
    sections = entries or ("lever", "stage")
    twin.write_text("".join(f"{section if entries else section + 's'}: {{}}\n" for section in sections))
    with pytest.raises(InputError, match=message.replace("'lever', 'stage'", "'levers', 'stages'")):
        load_twin(twin)


def test_an_installation_of_before_there_were_kinds_is_told(monkeypatch):
    """A checkout that is newer than what is installed of it has no entry points yet."""
    monkeypatch.setattr("rotary_error_monitor.gap.loading.plugins_of", lambda group: ())
    with pytest.raises(InputError, match=r"stage\.yaml: no kind of thing is known: .*; install this package again"):
        load_twin(config("stage.yaml"))


def test_a_file_that_describes_a_stage_and_its_machine_is_a_twin_of_the_stage(tmp_path):
    config, both = DOC.parent / "config", tmp_path / "both.yaml"
    texts = [(config / name).read_text(encoding="utf-8") for name in ("machines/pan2013.yaml", "stage.yaml")]
    both.write_text("\n".join(texts), encoding="utf-8")
    assert load_twin(both).section == "stage"


def test_the_document_names_every_hook_and_both_entry_points():
    text = (DOC / "kinds.md").read_text(encoding="utf-8")
    hooks = set(re.findall(r"^\| `(\w+)\(", text, re.MULTILINE))
    own = {name for kind in (Kind, TableProblem) for name, item in vars(kind).items() if callable(item)}
    required = Kind.__abstractmethods__ | TableProblem.__abstractmethods__
    assert required < hooks <= own
    (shown,) = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    assert shown in (EXAMPLE / "pyproject.toml").read_text(encoding="utf-8")
