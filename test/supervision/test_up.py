"""`rotary_error_monitor up` with real processes: what is killed comes back, and all ends in order."""

from __future__ import annotations

import asyncio
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from rotary_error_monitor.resources import config
from rotary_error_monitor.supervision.cell_file import CellNode
from rotary_error_monitor.supervision.supervisor import Supervisor
from rotary_error_monitor.testing import Cell

UP = "from rotary_error_monitor.start import command; raise SystemExit(command())"
HEADS = "\n".join(
    f"/**/encoder_head_{head}: {{ros__parameters: {{source: mock, mock: {{epoch: 0}}}}}}" for head in "ab"
)
CELL = f"""{HEADS}
/**/error_estimator: {{ros__parameters: {{check_turns: 0.0}}}}
/**/recorder: {{ros__parameters: {{folder: FOLDER}}}}
/**: {{ros__parameters: {{block_period: 0.05}}}}
"""
STUBBORN = """
import asyncio
from rotary_error_monitor.supervision.cell_file import CellNode
from rotary_error_monitor.supervision.supervisor import RestartTimes, Supervisor
say = lambda text: print("up:", text, flush=True)
raise SystemExit(asyncio.run(Supervisor([CellNode("recorder", "recorder")], [], say, RestartTimes(patience=1.0)).run()))
"""


class Started:
    """A supervisor in a process of its own, and what it said."""

    def __init__(self, process: subprocess.Popen[str], said: Path) -> None:
        self.process, self._said = process, said

    @property
    def said(self) -> str:
        return self._said.read_text()

    def process_of(self, name: str) -> int:
        """Process id of a node, the latest that was told."""
        return int(re.findall(rf"up: {name} started(?: again)?: process (\d+)", self.said)[-1])

    def children(self) -> list[int]:
        return [int(number) for number in re.findall(r"process (\d+)", self.said)]


@contextmanager
def started(cell: Cell, tmp_path: Path, *arguments: str) -> Iterator[Started]:
    said = tmp_path / "said"
    with said.open("w") as output:
        process = subprocess.Popen(
            [sys.executable, "-c", *arguments],
            stdout=output,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=tmp_path,
            env={**os.environ, "ROS_DOMAIN_ID": str(cell.node.context.get_domain_id())},
        )
    supervisor = Started(process, said)
    try:
        yield supervisor
    finally:
        process.kill()
        process.wait()
        deadline = time.monotonic() + 20.0
        while any(map(_is_there, supervisor.children())) and time.monotonic() < deadline:
            time.sleep(0.05)


def _is_there(pid: int) -> bool:
    """Whether a process lives; one that nobody has waited for does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


@pytest.fixture
def cell() -> Iterator[Cell]:
    with Cell() as running:
        yield running


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "cell.yaml"
    path.write_text(CELL.replace("FOLDER", str(tmp_path / "bag")))
    return path


def test_a_cell_whose_output_nobody_reads_any_more_ends(cell: Cell, tmp_path: Path, file: Path) -> None:
    """As behind `| head -1`, with nothing to say that would break the pipe."""
    environment = {**os.environ, "ROS_DOMAIN_ID": str(cell.node.context.get_domain_id())}
    command = [sys.executable, "-c", UP, "up", str(file)]
    with (tmp_path / "errors").open("w") as errors:
        up = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True, env=environment)
    try:
        assert up.stdout is not None
        said = [up.stdout.readline()]
        while "recorder started" not in said[-1]:
            said.append(up.stdout.readline())
        nodes = [int(number) for number in re.findall(r"process (\d+)", "".join(said))]
        up.stdout.close()
        assert up.wait(60) == 128 + signal.SIGPIPE
    finally:
        up.kill()
        up.wait()
    assert len(nodes) == 4 and not any(map(_is_there, nodes))


def test_what_is_killed_comes_back_and_all_ends_in_order(cell: Cell, tmp_path: Path, file: Path) -> None:
    estimates = cell.collect(cell.wire.topic("error_motion_samples"))
    with started(cell, tmp_path, UP, "up", str(file)) as up:
        cell.wait_until(lambda: len(estimates) > 5, "estimates", 60)
        killed = up.process_of("encoder_head_a")
        os.kill(killed, signal.SIGKILL)
        cell.wait_until(
            lambda: "encoder_head_a ended by signal SIGKILL; it is started again in 1 s" in up.said, "its end"
        )
        cell.wait_until(lambda: up.said.count("encoder_head_a started") == 2, "the head to be started again")
        assert up.process_of("encoder_head_a") != killed
        del estimates[:]
        cell.wait_until(lambda: len(estimates) > 5, "estimates of both heads", 60)
        up.process.send_signal(signal.SIGTERM)
        assert up.process.wait(60) == 0, up.said
        assert not any(map(_is_there, up.children()))
    assert (tmp_path / "bag" / "metadata.yaml").exists()
    assert "did not end" not in up.said


def test_a_supervisor_that_is_killed_takes_its_nodes_along(cell: Cell, tmp_path: Path, file: Path) -> None:
    estimates = cell.collect(cell.wire.topic("error_motion_samples"))
    with started(cell, tmp_path, UP, "up", str(file)) as up:
        cell.wait_until(lambda: len(estimates) > 2, "estimates", 60)
        up.process.kill()
        cell.wait_until(lambda: not any(map(_is_there, up.children())), "all nodes to end")


def test_wrong_input_ends_the_cell_with_2(cell: Cell, tmp_path: Path) -> None:
    path = tmp_path / "cell.yaml"
    path.write_text(
        "/**/recorder: {ros__parameters: {folder: bag}}\n/**/encoder_head_a: {ros__parameters: {source: mook}}\n"
    )
    with started(cell, tmp_path, UP, "up", str(path)) as up:
        assert up.process.wait(60) == 2, up.said
        assert "up: encoder_head_a ended with exit code 2, its input is wrong" in up.said
        assert "encoder_head_a" in up.said.split("ended with exit code 2")[0], "what the node itself said stands before"
        assert not any(map(_is_there, up.children()))


def test_a_namespace_moves_the_cell(cell: Cell, tmp_path: Path, file: Path) -> None:
    with started(cell, tmp_path, UP, "up", str(file), "--namespace", "/left") as up:
        cell.wait_for_status("left/error_estimator: estimate", "", 60)
        cell.wait_until(lambda: cell.recorder_hears({"/stage/head_a/samples"}, "left/recorder"), "the recorder", 60)
        up.process.send_signal(signal.SIGINT)
        assert up.process.wait(60) == 0, up.said


def test_the_file_of_a_real_cell_starts_one_that_waits_for_its_drivers(cell: Cell, tmp_path: Path) -> None:
    (tmp_path / "config").symlink_to(config("real_cell.yaml").parent)  # its bag goes beside, not into the package
    with started(cell, tmp_path, UP, "up", "config/real_cell.yaml") as up:
        for name in (
            "encoder_head_a",
            "autocollimator",
            "stage_command",
            "error_estimator",
            "compensation",
            "recorder",
        ):
            cell.wait_for_status(f"{name}: state", "active", 90)
        assert "exit code" not in up.said, up.said
        up.process.send_signal(signal.SIGINT)
        assert up.process.wait(60) == 0, up.said


def test_a_node_that_is_being_started_when_the_cell_ends_ends_too() -> None:
    class Late(Supervisor):
        async def _start(self, node: CellNode) -> asyncio.subprocess.Process:
            process = await asyncio.create_subprocess_exec(sys.executable, "-c", "import time; time.sleep(60)")
            self._ending.set()
            await asyncio.sleep(0.5)  # the cell ends what it knows of meanwhile
            return process

    said: list[str] = []
    supervisor = Late([CellNode("recorder", "recorder")], [], said.append)
    assert asyncio.run(asyncio.wait_for(supervisor.run(), 60.0)) == 0
    (pid,) = (int(number) for text in said for number in re.findall(r"process (\d+)", text))
    assert not _is_there(pid)


def test_a_node_that_does_not_end_is_killed(cell: Cell, tmp_path: Path) -> None:
    with started(cell, tmp_path, STUBBORN) as up:
        cell.wait_for_status("recorder: state", "active", 60)
        os.kill(up.process_of("recorder"), signal.SIGSTOP)
        up.process.send_signal(signal.SIGHUP)
        assert up.process.wait(60) == 1
        assert "recorder did not end within 1 s and is killed" in up.said
        assert not any(map(_is_there, up.children()))
