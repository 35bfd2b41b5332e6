"""The command line: every command describes itself, wrong input ends with code 2."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest
from checkout import node_names

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


def test_an_analysis_loads_neither_splines_nor_general_solvers():
    """Both load for a third of a second, and only measured curves and centres that are no single ones need them."""
    code = (
        "import sys, rotary_error_monitor.recordings.analysis, rotary_error_monitor.report.analysis_figure\n"
        "print([name for name in ('scipy.interpolate', 'scipy.optimize', 'scipy.stats') if name in sys.modules])"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ended.stdout.strip() == "[]"


def test_nodes_load_nothing_of_scipy():
    """It loads for as long as all else that a node needs; only what diagnoses, and frames, want it from the start."""
    names = sorted(set(node_names()) - {"gap_monitor", "visualization"})
    code = (
        "import sys, importlib\n"
        f"for name in {names}:\n"
        "    importlib.import_module(f'rotary_error_monitor.nodes.{name}')\n"
        "print([name for name in sys.modules if name.split('.')[0] in ('scipy', 'matplotlib')])"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert len(names) > 5
    assert ended.stdout.strip() == "[]"


def test_nodes_that_record_nothing_load_nothing_that_writes_bags():
    """It loads for as long as rclpy itself."""
    names = sorted(set(node_names()) - {"gap_monitor", "recorder"})
    code = (
        "import sys, importlib\n"
        f"for name in {names}:\n"
        "    importlib.import_module(f'rotary_error_monitor.nodes.{name}')\n"
        "print([name for name in sys.modules if name.split('.')[0] == 'mcap'])"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ended.stdout.strip() == "[]"


def test_a_list_of_all_commands_loads_none():
    code = (
        "import sys\n"
        "from rotary_error_monitor.cli import main\n"
        "try:\n    main(['--help'])\n"
        "except SystemExit:\n"
        "    print([name for name in sys.modules if name == 'numpy' or 'rotary_error_monitor.commands' in name])"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ended.stdout.splitlines()[-1] == "[]"


def test_commands_load_no_general_statistics_before_they_are_needed():
    """All distributions load for a second or two; what most commands want of them stands beneath."""
    names = sorted(name.replace("-", "_") for name in COMMANDS)
    code = (
        "import sys, importlib\n"
        f"for name in {names}:\n"
        "    importlib.import_module(f'rotary_error_monitor.commands.{name}')\n"
        "importlib.import_module('rotary_error_monitor.gap.loading')\n"
        "importlib.import_module('rotary_error_monitor.kinds.stage.stretches')\n"
        "importlib.import_module('rotary_error_monitor.kinds.machine.problem')\n"
        "print('scipy.stats' in sys.modules)"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ended.stdout.strip() == "False"


def test_what_only_reads_and_estimates_loads_nothing_of_scipy():
    """It loads for as long as all else that a replay needs."""
    code = (
        "import sys, importlib\n"
        "for name in ('check', 'convert', 'recover', 'replay', 'run', 'up'):\n"
        "    importlib.import_module(f'rotary_error_monitor.commands.{name}')\n"
        "print([name for name in sys.modules if name.split('.')[0] == 'scipy'])"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ended.stdout.strip() == "[]"


@pytest.mark.parametrize(("given", "used"), [(None, "1"), ("2", "2")])
def test_linear_algebra_has_one_thread_unless_told_otherwise(given, used):
    """It is told before numpy is loaded, which asks once."""
    code = (
        "import os, sys\n"
        "from rotary_error_monitor import cli\n"
        "assert 'numpy' not in sys.modules\n"
        "try:\n    cli.main(['--version'])\n"
        "except SystemExit:\n    print(os.environ['OMP_NUM_THREADS'])"
    )
    environment = {name: value for name, value in os.environ.items() if name != "OMP_NUM_THREADS"}
    environment |= {} if given is None else {"OMP_NUM_THREADS": given}
    ended = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert ended.stdout.split()[-1] == used


def test_output_that_nobody_reads_any_more_is_no_mistake():
    reading, writing = os.pipe()
    os.close(reading)
    command = [sys.executable, "-m", "rotary_error_monitor.cli", "wire"]
    ended = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writing)
    assert (ended.returncode, ended.stderr) == (128 + signal.SIGPIPE, "")


def test_another_pipe_that_breaks_is_told(monkeypatch):
    def run(arguments):
        raise BrokenPipeError("of a process that died")

    monkeypatch.setattr("rotary_error_monitor.commands.wire.run", run)
    with pytest.raises(BrokenPipeError, match="of a process that died"):
        main(["wire"])
