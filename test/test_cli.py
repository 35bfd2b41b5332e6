"""The command line: every command describes itself, wrong input ends with code 2."""

from __future__ import annotations

import subprocess
import sys

import pytest

from rotary_error_monitor import __version__
from rotary_error_monitor.cli import COMMANDS, main


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_describes_itself(command, capsys):
    with pytest.raises(SystemExit) as end:
        main([command, "--help"])
    assert end.value.code == 0
    assert command in capsys.readouterr().out


def test_help_lists_every_command(capsys):
    with pytest.raises(SystemExit) as end:
        main(["--help"])
    assert end.value.code == 0
    printed = capsys.readouterr().out
    assert all(command in printed for command in COMMANDS)


def test_the_version_is_told(capsys):
    with pytest.raises(SystemExit):
        main(["--version"])
    assert capsys.readouterr().out.strip() == __version__


@pytest.mark.parametrize("arguments", [[], ["dance"], ["replay"]])
def test_wrong_words_end_with_code_2(arguments, capsys):
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert end.value.code == 2
    assert "usage: rotary_error_monitor" in capsys.readouterr().err


def test_commands_that_need_no_ros_load_none():
    check = "import sys; from rotary_error_monitor.cli import main; main(['wire']); sys.exit('rclpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", check], capture_output=True).returncode == 0
