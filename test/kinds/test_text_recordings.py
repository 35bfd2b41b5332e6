"""Mounts and signals on the command line: from a text file to verdict, exit code and improved twin."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from simulated_pointings import pointing_file, simulate_pointings

from rotary_error_monitor.cli import main

CONFIG = Path(__file__).parents[2] / "config"
MOUNTS = sorted((CONFIG / "mounts").glob("*.yaml"))


@pytest.fixture
def pointings(tmp_path):
    file = tmp_path / "pointings.dat"
    sag = simulate_pointings(9, turn=lambda pose: 1e-3 * np.cross(pose.tube, -pose.up))
    file.write_text(pointing_file(sag), encoding="utf-8")
    return file


@pytest.fixture
def signals(tmp_path):
    rng = np.random.default_rng(1)
    phase = rng.uniform(0, 2 * np.pi, 8000)
    cosine = np.round(500 * np.cos(phase) + 2.5 + 0.5 * rng.normal(size=8000))
    sine = np.round(500 * np.sin(phase) - 1.5 + 0.5 * rng.normal(size=8000))
    file = tmp_path / "signals.csv"
    np.savetxt(file, np.column_stack([cosine, sine]), fmt="%d", delimiter=",", header="cos,sin", comments="")
    return file


@pytest.mark.parametrize(
    ("fixture", "twin", "effect"),
    [("pointings", MOUNTS[0], "tube_flexure"), ("signals", CONFIG / "quadrature.yaml", "signal_offset")],
    ids=["mount", "signals"],
)
def test_an_explained_gap_is_written_and_its_twin_has_none(fixture, twin, effect, request, tmp_path, capsys):
    file, improved = request.getfixturevalue(fixture), tmp_path / "improved.yaml"
    arguments = ["diagnose", str(file), "--twin", str(twin), "-o", str(tmp_path / "out")]
    assert main([*arguments, "--write-twin", str(improved)]) == 10
    assert f", {effect} (" in capsys.readouterr().out
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"diagnosis.json", "diagnosis.html", "diagnosis.png"}
    written = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert written["figures"] and written["where"][0]["share"] > 0.3
    assert yaml.safe_load(improved.read_text())["effects"][0]["effect"] == effect
    assert main(["diagnose", str(file), "--twin", str(improved), "-o", str(tmp_path / "again"), "--no-report"]) == 0


def test_an_effect_of_a_users_own_takes_part(pointings, tmp_path):
    own = tmp_path / "mine.py"
    own.write_text(
        "import numpy as np\n"
        "from rotary_error_monitor.effects.effect import Parameter\n"
        "from rotary_error_monitor.kinds.mount.effects import MountEffect\n\n\n"
        "class Wind(MountEffect):\n"
        "    name = 'wind'\n"
        "    parameters = (Parameter('push', 'rad', 1e-4),)\n\n"
        "    def locations(self, machine):\n"
        "        return machine.letters\n\n"
        "    def turn(self, values, location, state):\n"
        "        return values[0] * state.tube[[1, 2, 0]] ** 2\n"
    )
    arguments = ["--twin", str(MOUNTS[0]), "-o", str(tmp_path / "out"), "--no-report", "--effects", str(own)]
    assert main(["diagnose", str(pointings), *arguments]) == 10
    ranking = json.loads((tmp_path / "out" / "diagnosis.json").read_text())["ranking"]
    assert ranking[0]["effect"] == "tube_flexure" and "wind" in {row["effect"] for row in ranking}


MINE = """\
import numpy as np
from rotary_error_monitor.effects.effect import Parameter
from rotary_error_monitor.kinds.mount.effects import MountEffect
from rotary_error_monitor.kinds.quadrature.effects import QuadratureEffect


class Mine(%s):
    name = "mine"
    parameters = (Parameter("size", "rad", 1e-4),)

    def %s
        return %s
"""
TURN = ("MountEffect", "turn(self, values, location, state):")
AMEND = ("MountEffect", "amend(self, machine, values, location):")
DISPLACE = ("QuadratureEffect", "displacement(self, values, location, state):")


@pytest.mark.parametrize(
    ("hook", "given", "message"),
    [
        (TURN, "values[0] * state.tube[:2]", "fails: ValueError: turn gets shape (2, "),
        (TURN, "state.tube / 0.0", "fails: ValueError: turn gets values that are not finite"),
        (TURN, "state.wind", "fails: AttributeError: 'PointingState' object has no attribute 'wind'"),
        (AMEND, "None", "fails: TypeError: amend gives NoneType"),
        (DISPLACE, "values[0]", "fails: ValueError: displacement gets shape ()"),
        (DISPLACE, "state.signals * np.nan", "fails: ValueError: displacement gets values that are not finite"),
    ],
)
def test_a_users_effect_with_a_mistake_is_named(hook, given, message, request, tmp_path, capsys):
    own, mount = tmp_path / "mine.py", hook[0] == "MountEffect"
    own.write_text(MINE % (*hook, given), encoding="utf-8")
    file = request.getfixturevalue("pointings" if mount else "signals")
    twin = MOUNTS[0] if mount else CONFIG / "quadrature.yaml"
    with np.errstate(divide="ignore", invalid="ignore"):
        code = main(["diagnose", str(file), "--twin", str(twin), "-o", str(tmp_path / "out"), "--effects", str(own)])
    told = capsys.readouterr().err
    assert code == 2 and "effect 'mine' of mine " in told and message in told
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("mount: {name: m}", "'noise' is a required property"),
        ("mount: {name: m, noise: -1.0}", r"twin.yaml:1: mount.noise"),
        ("mount:\n  name: m\n  noise: 1.0e-05\n  latitude: 51.5\n", "twin.yaml:4: mount.latitude"),
        ("quadrature: {name: q, period: 1.0}", "is a required property"),
        (
            "mount: {name: m, noise: 1.0e-05}\neffects: [{effect: wobble, parameters: {}}]",
            "no effect is called 'wobble'",
        ),
    ],
)
def test_wrong_twins_are_told_with_their_line(pointings, tmp_path, capsys, content, message):
    twin = tmp_path / "twin.yaml"
    twin.write_text(content)
    assert main(["diagnose", str(pointings), "--twin", str(twin), "-o", str(tmp_path / "out")]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("twin", [*MOUNTS, CONFIG / "quadrature.yaml"], ids=lambda path: path.stem)
def test_a_recording_of_another_kind_is_told(twin, tmp_path, capsys):
    file = tmp_path / "nothing.txt"
    file.write_text("x\ny\n")
    assert main(["diagnose", str(file), "--twin", str(twin), "-o", str(tmp_path / "out")]) == 2
    assert str(file) in capsys.readouterr().err
