"""Two calibrations of one file at once, and a file that changes or whose owner is another meanwhile."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from rotary_error_monitor.bags import lock
from rotary_error_monitor.bags.lock import FileLock
from rotary_error_monitor.calibration.machine_file import MachineFile
from rotary_error_monitor.calibration.yaml_document import changing
from rotary_error_monitor.cli import main
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.resources import config

DATA = Path(__file__).parents[2] / "doc" / "calibration"
POSITIONING = ["positioning", str(DATA / "x_positioning.csv"), "--axis", "X", "--drop-outliers"]
SQUARENESS = ["squareness", str(DATA / "tracker.csv"), "--distance-um", "0.3", "--distance-ppm", "0"]
SQUARENESS += ["--angle-arcsec", "0.03"]


@pytest.fixture
def machine(tmp_path: Path) -> Path:
    return Path(shutil.copy(config("machines/xyzac_trt.yaml"), tmp_path / "machine.yaml"))


def calibration_of(path: Path) -> dict[str, object]:
    found: dict[str, object] = yaml.safe_load(path.read_text(encoding="utf-8"))["machine"].get("calibration", {})
    return found


# Calibrates when it reads a line, so that several processes do at the same moment.
STEP = """
import sys
from rotary_error_monitor.cli import main
print("ready", flush=True)
sys.stdin.readline()
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.long
def test_both_sections_are_in_the_file(machine: Path) -> None:
    shipped = machine.read_bytes()
    for _ in range(4):
        machine.write_bytes(shipped)
        steps = [
            subprocess.Popen(
                [sys.executable, "-c", STEP, "calibrate", *words, "--machine", str(machine)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
            )
            for words in (POSITIONING, SQUARENESS)
        ]
        for step in steps:
            assert step.stdout is not None and step.stdout.readline() == "ready\n"
        for step in steps:
            assert step.stdin is not None
            step.stdin.write("\n")
            step.stdin.flush()
        texts = [step.communicate(timeout=120)[0] for step in steps]
        assert [step.returncode for step in steps] == [0, 0], texts
        assert {"EXX", "squareness"} <= calibration_of(machine).keys()
        assert [path.name for path in machine.parent.iterdir()] == ["machine.yaml"]


def test_who_holds_the_file_is_told(
    machine: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before = machine.read_bytes()
    wait = FileLock.wait
    monkeypatch.setattr(FileLock, "wait", lambda path: wait(path, 0.1))
    with changing(machine):
        assert main(["calibrate", *POSITIONING, "--machine", str(machine)]) == 2
        assert f"{machine}: process {os.getpid()} is changing it; let it end first" in capsys.readouterr().err
        assert machine.read_bytes() == before
        assert main(["calibrate", *POSITIONING, "--machine", str(machine), "-o", str(machine.with_name("o.yaml"))]) == 0
    assert main(["calibrate", *POSITIONING, "--machine", str(machine)]) == 0


def test_a_file_that_was_replaced_meanwhile_is_locked_as_it_is_now(machine: Path) -> None:
    """Whoever waits for a file gets the one that took its place."""
    first = FileLock.wait(machine)
    other = machine.with_name("other.yaml")
    shutil.copy(machine, other)
    other.replace(machine)
    assert not first.is_of(machine)
    second = FileLock.wait(machine)
    assert second.is_of(machine)
    with pytest.raises(lock.LockedError):
        FileLock.wait(machine, 0.0)
    for each in (first, second):
        each.release()


def test_what_an_editor_changed_meanwhile_stays(machine: Path) -> None:
    file = MachineFile(machine)
    file.set_squareness("X", "Y", 1e-5)
    machine.write_text(machine.read_text(encoding="utf-8") + "# a note of somebody else\n", encoding="utf-8")
    edited = machine.read_bytes()
    with pytest.raises(InputError, match=r"machine.yaml: somebody has changed it since it was read"):
        file.save(machine)
    assert machine.read_bytes() == edited
    assert [path.name for path in machine.parent.iterdir()] == ["machine.yaml"]


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files away")
@pytest.mark.parametrize("mode", [0o640, 0o664])
def test_owner_and_mode_stay(machine: Path, mode: int) -> None:
    os.chown(machine, 12345, 23456)
    machine.chmod(mode)
    assert main(["calibrate", *POSITIONING, "--machine", str(machine)]) == 0
    status = machine.stat()
    assert (status.st_uid, status.st_gid, status.st_mode & 0o7777) == (12345, 23456, mode)


def test_who_may_not_give_a_file_away_writes_it_as_his_own(machine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An owner that cannot be kept is no reason to lose a calibration."""

    def refused(path: Path, user: int, group: int) -> None:
        raise PermissionError(1, "Operation not permitted", str(path))

    machine.chmod(0o660)
    monkeypatch.setattr(os, "chown", refused)
    assert main(["calibrate", *POSITIONING, "--machine", str(machine)]) == 0
    assert machine.stat().st_mode & 0o7777 == 0o660
    assert "EXX" in calibration_of(machine)
