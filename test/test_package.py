"""The package as colcon builds it: found through the ament index, every installed executable starts and ends well."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import sysconfig
import time
from pathlib import Path

import pytest
from ament_index_python import get_package_prefix, get_package_share_directory
from checkout import copy_to, node_names, quick_compiler

from rotary_error_monitor.testing.domains import own_domain

PACKAGE = "rotary_error_monitor"


@pytest.fixture(scope="module")
def workspace(tmp_path_factory):
    """A colcon workspace with a copy of what git tracks or would track, built."""
    top = tmp_path_factory.mktemp("workspace")
    copy_to(top / "src" / PACKAGE)
    colcon = [sys.executable, "-m", "colcon"]
    kind = subprocess.run([*colcon, "list"], cwd=top, check=True, capture_output=True, text=True).stdout
    assert "(ros.ament_python)" in kind, f"colcon does not see an ament_python package: {kind}"
    environment = {**os.environ, "CC": str(quick_compiler(tmp_path_factory.mktemp("compiler")))}
    built = subprocess.run([*colcon, "build"], cwd=top, env=environment, capture_output=True, text=True)
    assert built.returncode == 0, built.stdout + built.stderr
    return top


@pytest.fixture
def prefix(workspace, monkeypatch):
    """Prefix of the package as ament finds it, the environment as a sourced workspace sets it."""
    install = workspace / "install" / PACKAGE
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{install}{os.pathsep}{sys.prefix}")
    (site,) = install.glob("lib/python3*/site-packages")
    monkeypatch.setenv("PYTHONPATH", str(site))
    return Path(get_package_prefix(PACKAGE))


def test_ament_finds_the_package_and_its_files(prefix, workspace):
    assert prefix == workspace / "install" / PACKAGE
    share = Path(get_package_share_directory(PACKAGE))
    for name in ("package.xml", "config/stage.yaml", "config/machines/xyzac_trt.yaml", "msg_defs/heads.yaml"):
        assert (share / name).is_file(), name


def test_the_machine_model_is_compiled(prefix):
    if shutil.which(sysconfig.get_config_var("CC").split()[0]) is None:
        pytest.skip("no C compiler")
    (library,) = prefix.glob("lib/python3*/site-packages/rotary_error_monitor/machine/_kernel*")
    assert library.name == f"_kernel{sysconfig.get_config_var('EXT_SUFFIX')}"


def test_executables_begin_with_the_python_that_colcon_was_run_by(prefix):
    """So those of a virtual environment see its packages, whoever starts them."""
    for path in (prefix / "lib" / PACKAGE).iterdir():
        assert path.read_text(encoding="utf-8").splitlines()[0] == f"#!{sys.executable}", path


def test_every_node_is_an_executable(prefix):
    installed = {path.name for path in (prefix / "lib" / PACKAGE).iterdir() if os.access(path, os.X_OK)}
    assert installed == {*node_names(), PACKAGE}


@pytest.mark.few(6)
@pytest.mark.parametrize("name", node_names())
def test_an_installed_executable_starts_and_ends_with_0_on_sigint(prefix, name, tmp_path):
    with own_domain() as domain:
        process = subprocess.Popen(
            [str(prefix / "lib" / PACKAGE / name), "--ros-args", "-p", "autostart:=false"],
            cwd=tmp_path,
            env={**os.environ, "ROS_DOMAIN_ID": str(domain)},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        try:
            assert process.stdout is not None
            seen = ""
            deadline = time.monotonic() + 30
            while "waiting to be configured" not in seen and time.monotonic() < deadline:
                line = process.stdout.readline()
                assert line, f"{name} ended with {process.wait()}:\n{seen}"
                seen += line
            process.send_signal(signal.SIGINT)
            rest, _ = process.communicate(timeout=20)
            assert process.returncode == 0, seen + rest
        finally:
            process.kill()
            process.wait()
            process.stdout.close()


def test_the_installed_command_finds_its_defaults(prefix, tmp_path):
    command = [str(prefix / "lib" / PACKAGE / PACKAGE), "wire"]
    printed = subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, text=True).stdout
    assert "| `/stage/error_motion/samples` | `sensor_msgs/msg/PointCloud2` |" in printed
