"""What `python -m build` makes is whole: the archive builds the wheel, and the wheel works where nothing else is."""

from __future__ import annotations

import configparser
import os
import signal
import subprocess
import sys
import tarfile
import venv
import xml.etree.ElementTree as ET
import zipfile
from pathlib import Path
from shutil import which
from sysconfig import get_config_var, get_paths

import checkout
import pytest
from catkin_pkg.changelog import get_changelog_from_path
from mock_bags import write_mock_bag

from rotary_error_monitor.testing.domains import own_domain

ROOT = Path(__file__).parents[2]
PACKAGE = "rotary_error_monitor"
ROOMS = ("machine", "metrology", "pipeline", "signals")
LIBRARIES = {f"{PACKAGE}/{room}/_kernel{get_config_var('EXT_SUFFIX')}" for room in ROOMS}
HOOKS = "import sys; from setuptools import build_meta; print(getattr(build_meta, sys.argv[1])(sys.argv[2]))"
"""Calls a build hook of PEP 517 as `python -m build --no-isolation` does."""


def built(hook: str, source: Path, folder: Path, **environment: str) -> Path:
    """What a hook of the build backend makes of a source tree, in a process of its own."""
    command = [sys.executable, "-W", "error", "-c", HOOKS, hook, str(folder)]
    done = subprocess.run(command, cwd=source, capture_output=True, text=True, env={**os.environ, **environment})
    assert done.returncode == 0, done.stdout + done.stderr
    return folder / done.stdout.split()[-1]


@pytest.fixture(scope="module")
def sdist(tmp_path_factory):
    """The source archive."""
    source = checkout.copy_to(tmp_path_factory.mktemp("checkout"))
    return built("build_sdist", source, tmp_path_factory.mktemp("sdist"))


@pytest.fixture(scope="module")
def wheel(sdist, tmp_path_factory):
    """The wheel, built of nothing but the source archive."""
    folder = tmp_path_factory.mktemp("unpacked")
    with tarfile.open(sdist) as archive:
        archive.extraction_filter = getattr(tarfile, "data_filter", None)  # as of Python 3.11.4
        archive.extractall(folder)
    (source,) = folder.iterdir()
    compiler = checkout.quick_compiler(tmp_path_factory.mktemp("compiler"))
    return built("build_wheel", source, tmp_path_factory.mktemp("wheel"), CC=str(compiler))


@pytest.fixture(scope="module")
def prefix(wheel, tmp_path_factory):
    """A virtual environment outside the checkout in which the wheel is installed; libraries are those of the tests."""
    folder = tmp_path_factory.mktemp("environment") / "venv"
    venv.create(folder, with_pip=False)
    python = str(folder / "bin" / "python")
    pip = [sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "--no-index", "--no-deps"]
    subprocess.run([*pip, str(wheel)], check=True)
    (site,) = folder.glob("lib/python3*/site-packages")
    # behind the environment's own, so that the wheel counts and not what is installed for the tests
    (site / "libraries.pth").write_text(f"import site; site.addsitedir({get_paths()['purelib']!r})\n")
    return folder


def run(prefix: Path, folder: Path, *words: str) -> str:
    """What an installed executable prints that ends with 0; nothing of the checkout is on its path."""
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "AMENT_PREFIX_PATH")}
    command = [str(prefix / "bin" / words[0]), *words[1:]]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def version() -> str:
    found = ET.parse(ROOT / "package.xml").findtext("version")
    assert found is not None
    return found


@pytest.mark.filterwarnings("ignore:nodes.Node.traverse:DeprecationWarning")  # by catkin_pkg, with a newer docutils
def test_the_changelog_begins_with_this_version():
    """As catkin and bloom read it: the newest first; before a release the next one may stand above as Forthcoming."""
    changes = get_changelog_from_path(str(ROOT / "CHANGELOG.rst"), package_name=PACKAGE)
    released = [(number, date) for number, date, _ in changes.foreach_version() if number.lower() != "forthcoming"]
    assert released[0][0] == version()
    assert released == sorted(released, key=lambda each: each[1], reverse=True)


def test_the_archive_holds_every_file_of_the_checkout(sdist):
    with tarfile.open(sdist) as archive:
        held = {member.name.partition("/")[2] for member in archive if member.isfile()}
    assert sdist.name == f"{PACKAGE}-{version()}.tar.gz"
    assert set(checkout.names()) - held == set()
    made = {name for name in held - set(checkout.names()) if not name.startswith(f"{PACKAGE}.egg-info/")}
    assert made == {"PKG-INFO"}


def test_the_wheel_holds_the_package_and_its_data(wheel):
    with zipfile.ZipFile(wheel) as archive:
        held = set(archive.namelist())
        entries = configparser.ConfigParser()
        entries.read_string(archive.read(f"{PACKAGE}-{version()}.dist-info/entry_points.txt").decode())
    assert {name for name in held if name.startswith(f"{PACKAGE}/")} == {
        *(name for name in checkout.names() if name.startswith(f"{PACKAGE}/") and not name.endswith((".c", ".h"))),
        *(LIBRARIES if which(get_config_var("CC").split()[0]) else []),
    }
    data = f"{PACKAGE}-{version()}.data/data/share/"
    share = {name.removeprefix(data) for name in held if name.startswith(data)}
    shared = {name for name in checkout.names() if name.startswith(("config/", "msg_defs/")) or name == "package.xml"}
    marker = f"ament_index/resource_index/packages/{PACKAGE}"
    assert share == {marker, *(f"{PACKAGE}/{name}" for name in shared)}
    assert set(entries["console_scripts"]) == {*checkout.node_names(), PACKAGE}


def test_without_a_compiler_the_wheel_lacks_the_libraries_alone(wheel, tmp_path):
    source = checkout.copy_to(tmp_path / "source")
    other = built("build_wheel", source, tmp_path, CC="/bin/false")
    with zipfile.ZipFile(wheel) as archive, zipfile.ZipFile(other) as lacking:
        differing = set(archive.namelist()) - set(lacking.namelist())
        assert differing <= LIBRARIES
        assert f"{PACKAGE}/machine/kernel.py" in lacking.namelist()


def test_every_executable_is_there(prefix):
    assert {PACKAGE, *checkout.node_names()} <= {
        path.name for path in (prefix / "bin").iterdir() if os.access(path, os.X_OK)
    }


def test_the_installed_package_is_the_one_that_runs(prefix, tmp_path):
    asked = (
        f"import {PACKAGE}; from rotary_error_monitor.resources import share; "
        f"from ament_index_python import get_package_share_directory as found; "
        f"print({PACKAGE}.__file__, share(), found('{PACKAGE}'), sep='\\n')"
    )
    environment = {"AMENT_PREFIX_PATH": str(prefix), "PATH": os.defpath}
    done = subprocess.run(
        [str(prefix / "bin" / "python"), "-c", asked], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    code, share, found = map(Path, done.stdout.splitlines())
    assert code.is_relative_to(prefix) and (code.parent / "py.typed").is_file()
    assert share == found == prefix / "share" / PACKAGE


def test_commands_work(prefix, tmp_path):
    assert run(prefix, tmp_path, PACKAGE, "--version").strip() == version()
    assert "commands:" in run(prefix, tmp_path, PACKAGE, "--help")
    assert "| `/stage/error_motion/samples` |" in run(prefix, tmp_path, PACKAGE, "wire")
    effects = run(prefix, tmp_path, PACKAGE, "effects")
    assert all(f"## Effects of a {kind}\n" in effects for kind in ("stage", "machine", "mount", "quadrature"))


def test_a_bag_is_replayed(prefix, tmp_path):
    bag = write_mock_bag(tmp_path / "bag", samples=8_000)  # more than a turn, before which offsets are held
    assert run(prefix, tmp_path, PACKAGE, "replay", str(bag), "--machine", "xyzac_trt", "-o", "out.npz")
    assert (tmp_path / "out.npz").is_file()


def test_a_node_runs_and_ends(prefix, tmp_path):
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "AMENT_PREFIX_PATH")}
    with own_domain() as domain:
        command = [str(prefix / "bin" / "error_estimator"), "--ros-args", "-p", "autostart:=false"]
        process = subprocess.Popen(
            command, cwd=tmp_path, env={**environment, "ROS_DOMAIN_ID": str(domain)},
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        with process:
            assert process.stdout is not None
            seen = process.stdout.readline()
            process.send_signal(signal.SIGINT)
            rest, _ = process.communicate(timeout=30)
    assert "waiting to be configured" in seen, seen + rest
    assert process.returncode == 0, seen + rest
