"""Each command that a page of doc/ shows is run: here, in the test named beside it, or it has a reason not to be."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from commissioning.bags import written
from world.newly_built import build

from rotary_error_monitor.cli import main
from rotary_error_monitor.gap.loading import known_kinds
from rotary_error_monitor.testing import Cell

ROOT = Path(__file__).parents[2]
DOC = ROOT / "doc"

PAGES_ELSEWHERE = {
    "calibration": "test/calibration/test_tutorial.py",
    "offset": "test/report/test_offset_document.py",
    "tutorial_mount": "test/test_tutorials.py",
    "tutorial_quadrature": "test/test_tutorials.py",
}
"""Pages of which another test runs every block."""

COMMISSION = "rotary_error_monitor commission BAG --stage nominal.yaml -o stage.yaml"
KIND_OF_ONES_OWN = "pip install ./doc/examples/bath_thermometer"
SENSOR_OF_ONES_OWN = "pip install ./doc/examples/ball_probe"
MONITOR = "ros2 run rotary_error_monitor gap_monitor --ros-args -p effects:=doc/examples/oil_film.py"
WIRE = "rotary_error_monitor wire"
FORMS = "rotary_error_monitor check --stage config/stage.yaml"
HERE = {COMMISSION, KIND_OF_ONES_OWN, SENSOR_OF_ONES_OWN, MONITOR, WIRE, FORMS}

LIVE = "test/commissioning/test_live.py"
OPCUA = "test/nodes/test_opcua_server.py"
WHEEL, COLCON = "test/distribution/test_distribution.py", "test/test_package.py"
ELSEWHERE = {
    "rotary_error_monitor convert drivers_bag --cell-file cell.yaml -o converted": (
        "test/recordings/test_convert.py",
        '"convert", str(recorded / storage), "--cell-file", str(recorded / "cell.yaml")',
    ),
    (
        "rotary_error_monitor analyse BAG --twin STAGE.yaml --height 0 60 "
        "--limits radial_synchronous_um=2 tilt_total_urad=50 -o PAGE.html"
    ): ("test/recordings/test_analyse_command.py", '"analyse", str(bag), "--height", "0", "60"'),
    "rotary_error_monitor compare BAG --twin STAGE.yaml --height 16 -o PAGE.html": (
        "test/recordings/test_compare_command.py",
        '"compare", str(bag), "--twin", str(twin), "--height", "16"',
    ),
    (
        "rotary_error_monitor trend FOLDER --twin STAGE.yaml --height 0 60 "
        "--limits radial_synchronous_um=2 tilt_total_urad=50 -o PAGE.html"
    ): ("test/recordings/test_trend_command.py", 'main(["trend", str(folder), "--height", "0"'),
    "rotary_error_monitor trend FOLDER --scheduler tcp://HOST:8786 -o PAGE.html": (
        "test/recordings/test_trend_command.py",
        '"--scheduler", cluster.scheduler_address',
    ),
    "rotary_error_monitor reproduce lou2019 -o lou2019": (
        "test/reproduction/test_lou2019.py",
        'main(["reproduce", "lou2019", "-o"',
    ),
    "rotary_error_monitor reproduce zhou2023 -o zhou2023": (
        "test/reproduction/test_zhou2023.py",
        'main(["reproduce", "zhou2023", "-o"',
    ),
    "rotary_error_monitor reproduce pan2013 -o pan2013": (
        "test/reproduction/test_pan2013.py",
        'main(["reproduce", "pan2013", "-o"',
    ),
    "rotary_error_monitor diagnose FOLDER --twin TWIN.yaml -o DIR": (
        "test/gap/test_folder_diagnosis.py",
        'main(["diagnose", str(place), "--twin"',
    ),
    "rotary_error_monitor diagnose BAG --twin TWIN.yaml --effects doc/examples/oil_film.py -o DIR": (
        "test/test_effects_document.py",
        "--effects doc/examples/oil_film.py -o DIR",
    ),
    "rotary_error_monitor diagnose bath.csv --twin twin.yaml --write-twin improved.yaml -o DIR": (
        "test/kinds/test_own_kind.py",
        "--write-twin improved.yaml -o DIR",
    ),
    "ros2 run rotary_error_monitor dashboard --ros-args -p machine:=xyzac_trt": (
        "test/nodes/test_dashboard.py",
        'start("dashboard", port=self.port, machine=MACHINE',
    ),
    "rotary_error_monitor run --dashboard": ("test/mock_cell/test_run.py", "dashboard=9001"),
    "cp config/real_cell.yaml cell.yaml": (LIVE, 'COPY = "cp config'),
    "rotary_error_monitor up cell.yaml": (LIVE, "place.type(UP"),
    "rotary_error_monitor commission --live --stage nominal.yaml -o stage.yaml": (LIVE, "place.type(COMMISSION"),
    "ros2 run rotary_error_monitor opcua_server --ros-args -p machine:=xyzac_trt": (OPCUA, 'cell.start("opcua_server"'),
    "rotary_error_monitor security opcua keys --host cell.example.org": (
        "test/security/test_opcua_certificate.py",
        '"security", "opcua", str(folder), "--host", "cell.example.org"',
    ),
    "rotary_error_monitor security user users ann": (
        "test/security/test_users.py",
        '"security", "user", str(file), "ann"',
    ),
    (
        "ros2 run rotary_error_monitor opcua_server --ros-args -p address:=0.0.0.0 -p security_policy:=Basic256Sha256 "
        "-p certificate:=keys/certificate.pem -p private_key:=keys/key.pem -p users:=users"
    ): (OPCUA, 'security_policy="Basic256Sha256"'),
    "make setup": (".ci/run", "make test"),  # which does that first
    "make lint": (".ci/run", "make test"),
    "make test": (".ci/run", "make test"),
    ".venv/bin/rotary_error_monitor --help": (WHEEL, 'PACKAGE, "--help"'),
    "python3 -m venv venv": (WHEEL, "venv.create("),
    "venv/bin/rotary_error_monitor wire": (WHEEL, 'PACKAGE, "wire"'),
    "venv/bin/python -m colcon build": (COLCON, '"-m", "colcon"'),
    "ros2 run rotary_error_monitor rotary_error_monitor wire": (COLCON, 'PACKAGE / PACKAGE), "wire"'),
    "build/release/bin/python -m build": (WHEEL, '"build_sdist"'),
    "ros2 run rotary_error_monitor encoder_head --ros-args -p head:=a -p source:=udp -p udp.port:=5005": (
        "test/sources/test_devices.py",
        "udp.port",
    ),
}
"""Commands by the test that does what they do, with words that stand there."""

_NETWORK = "fetches hundreds of MB; test/distribution installs the same wheel beside libraries that are there"
_INDEX = "fetches the library; the tests of the node have it"
_TOOL = "a tool of others from apt; test/nodes/test_layouts.py holds the file that it is given against a cell"
_APT = "needs ROS from apt and its network"
NOT_RUN = {
    "pip install 'rotary_error_monitor[opcua]'": _INDEX,
    "make docs": "fetches what builds the site; test/website holds its pages",
    ".venv/bin/python -m pytest -q test/metrology": "tests within a test",
    "venv/bin/python -m pip install '.[ros]'": _NETWORK,
    "venv/bin/python -m pip install '.[notebook]' jupyterlab": _NETWORK,
    "sudo apt-get install pipx": "changes the computer",
    "pipx install '.[ros]'": _NETWORK,
    "pip install 'rotary_error_monitor[dashboard]'": _NETWORK,
    "source /opt/ros/jazzy/setup.bash": _APT,
    "rosdep install --from-paths src --ignore-src -y": _APT,
    "python3 -m venv --system-site-packages venv && touch venv/COLCON_IGNORE": _APT,
    "venv/bin/python -m pip install 'rosbags>=0.11.8,<0.12' 'mcap>=1.5,<2'": _NETWORK,
    "source install/setup.bash": "what follows is started by its path, as ros2 run does",
    "venv/bin/python -m pip wheel --wheel-dir wheels '.[ros]'": _NETWORK,
    "venv/bin/python -m pip install --no-index --find-links wheels 'rotary_error_monitor[ros]'": _NETWORK,
    "ros2 run foxglove_bridge foxglove_bridge": _TOOL,
    "ros2 run plotjuggler plotjuggler --layout config/plotjuggler/cell.xml": _TOOL,
    "ros2 run diagnostic_aggregator aggregator_node --ros-args --params-file config/diagnostic_aggregator.yaml": _TOOL,
    "ros2 run rqt_robot_monitor rqt_robot_monitor": _TOOL,
    "python3 -m venv build/release": "as python3 -m venv venv",
    "pip install 'rotary_error_monitor[trend]'": _NETWORK,
    "build/release/bin/python -m pip install build": "fetches build; test/distribution calls the hooks that it calls",
}
"""The one list of commands that no test runs."""


def shown() -> list[tuple[str, str]]:
    """Page and command of each line of an sh block, without comments."""
    found = []
    for path in sorted(DOC.glob("*.md")):
        for block in re.findall(r"```(?:sh|bash|console)\n(.*?)```", path.read_text(encoding="utf-8"), re.DOTALL):
            lines = (line.split(" #")[0].strip() for line in block.splitlines())
            found += [(path.stem, line) for line in lines if line and not line.startswith("#")]
    return found


SHOWN = shown()


def test_each_command_is_run_or_says_why_not():
    lists = (HERE, set(ELSEWHERE), set(NOT_RUN))
    for page, command in SHOWN:
        if page not in PAGES_ELSEWHERE:
            places = sum(command in each for each in lists)
            assert places == 1, f"doc/{page}.md: {command}: run it here, or name it in ELSEWHERE or NOT_RUN"
    known = set().union(*lists)
    assert known - {command for page, command in SHOWN if page not in PAGES_ELSEWHERE} == set(), "no page shows it"


@pytest.mark.parametrize("page", sorted(PAGES_ELSEWHERE))
def test_a_page_that_another_test_runs_is_named_there(page):
    text = (ROOT / PAGES_ELSEWHERE[page]).read_text(encoding="utf-8")
    assert (re.search(rf"\b{page}\b", text) and r"```sh" in text) or "```(sh|text)" in text


@pytest.mark.parametrize("command", sorted(ELSEWHERE))
def test_another_test_does_what_a_command_does(command):
    file, words = ELSEWHERE[command]
    assert words in (ROOT / file).read_text(encoding="utf-8")


@pytest.mark.parametrize("command", sorted({command for _, command in SHOWN if command.startswith("make ")}))
def test_the_makefile_knows_the_target(command):
    assert subprocess.run(["make", "-n", *command.split()[1:]], cwd=ROOT, capture_output=True).returncode == 0


def test_requirements_are_those_of_setup_py():
    setup = (ROOT / "setup.py").read_text(encoding="utf-8")
    asked = [word for command in NOT_RUN if "pip install" in command for word in shlex.split(command) if "<" in word]
    assert asked
    assert all(f'"{requirement}"' in setup for requirement in asked)


def run(command: str, bound: dict[str, Path] | None = None) -> int:
    """Exit code of a command of the package; words such as BAG stand for files."""
    name, *words = shlex.split(command)
    assert name == "rotary_error_monitor"
    return main([str((bound or {}).get(word, word)) for word in words])


@pytest.fixture
def checkout_copy(tmp_path, monkeypatch):
    """Folder in which to work as in a checkout, without leaving anything in this one."""
    shutil.copytree(DOC / "examples", tmp_path / "doc" / "examples")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_contract_is_printed(capsys):
    assert run(WIRE) == 0
    assert capsys.readouterr().out.startswith("| topic |")


def test_a_new_stage_is_commissioned(checkout_copy):
    """How often it is right over many stages: test/commissioning/test_rates.py."""
    bag, _ = written(build(5, count=5, even=False, swap=False, known_tilt=True, duration=24.0), checkout_copy)
    assert run(COMMISSION, {"BAG": bag}) == 0
    assert (checkout_copy / "stage.yaml").is_file()


def test_what_the_sensors_of_the_shipped_stage_take_for_motion(monkeypatch, capsys):
    """The page shows what is printed."""
    monkeypatch.chdir(ROOT)
    assert main(shlex.split(FORMS)[1:]) == 0
    said = capsys.readouterr().out.strip()
    assert f"```text\n{said}\n```" in (DOC / "sensors.md").read_text(encoding="utf-8")


def test_a_kind_of_ones_own_is_installed(checkout_copy, monkeypatch):
    """It is diagnosed in test/kinds/test_own_kind.py."""
    site = checkout_copy / "site"
    how = ["--quiet", "--no-deps", "--no-index", "--no-build-isolation", "--target", str(site)]
    subprocess.run([sys.executable, "-m", *shlex.split(KIND_OF_ONES_OWN), *how], check=True)
    assert "thermometer" not in known_kinds()
    monkeypatch.syspath_prepend(str(site))
    try:
        assert "thermometer" in known_kinds()
    finally:
        for name in [name for name in sys.modules if name.partition(".")[0] == "bath_thermometer"]:
            monkeypatch.delitem(sys.modules, name)


def test_a_kind_of_sensor_of_ones_own_is_installed(checkout_copy):
    """With its topics; it is used in test/nodes/test_stage_files.py."""
    site = checkout_copy / "site"
    how = ["--quiet", "--no-deps", "--no-index", "--no-build-isolation", "--target", str(site)]
    subprocess.run([sys.executable, "-m", *shlex.split(SENSOR_OF_ONES_OWN), *how], check=True)
    for path, there in ((ROOT, False), (f"{ROOT}:{site}", True)):
        begin = "from rotary_error_monitor.start import command; raise SystemExit(command())"
        command = [sys.executable, "-c", begin, *shlex.split(WIRE)[1:]]
        environment = {**os.environ, "PYTHONPATH": str(path)}
        shown = subprocess.run(command, check=True, capture_output=True, text=True, env=environment)
        assert ("| `/stage/ball_probe_{sensor}/samples` |" in shown.stdout) is there
        assert ("entry point 'ball_probe' of ball-probe: ball_probe runs as code" in shown.stderr) is there


def test_a_monitor_runs_with_an_effect_of_ones_own(monkeypatch):
    monkeypatch.chdir(ROOT)
    executable, *arguments = shlex.split(MONITOR)[3:]
    with Cell() as cell:
        process = cell.start(executable, executable, ros_args=[word for word in arguments if word != "--ros-args"])
        cell.wait_for_status(f"{executable}: state", "active", 40.0)
        assert process.stop() == 0
