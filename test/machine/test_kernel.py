"""The compiled model against the numpy form, on drawn machines; that poses do not depend on one another, to the bit."""

from __future__ import annotations

import ctypes
import os
import runpy
import shutil
import subprocess
import sysconfig
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import setuptools
from kernels import computing_by, drawn_machine, drawn_poses, is_built
from numpy.typing import NDArray

from rotary_error_monitor.description.machine import MachineDescription, load_machine
from rotary_error_monitor.description.machine_parts import Body
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.libraries import VARIABLE, source_digest
from rotary_error_monitor.machine import kernel
from rotary_error_monitor.machine.correction import SolvedCorrections, remaining_offset, solve_axis_corrections
from rotary_error_monitor.machine.error_model import predict_tool_offset
from rotary_error_monitor.machine.kernel import MachineKernel, chosen_kernel, load_kernel
from rotary_error_monitor.machine.kinematics import arrange_machine, stand

Array = NDArray[np.float64]
ROOT = Path(__file__).parents[2]
SOURCES = Path(kernel.__file__).with_name("compiled")
SHIPPED = ("xyzac_trt", "pan2013", "grinder_zhou2023")
needs_library = pytest.mark.skipif(not is_built(), reason="the machine model was not compiled")


def size_of(machine: MachineDescription) -> float:
    """Of the coordinates that offsets are differences of, m."""
    shifts = [np.linalg.norm(body.pose.shift) for body in machine.bodies]
    return float(sum(shifts) + sum(max(map(abs, axis.travel)) for axis in machine.axes if axis.kind == "linear"))


@pytest.fixture(autouse=True, scope="module")
def form() -> None:
    """These tests choose the form themselves."""


def extension() -> setuptools.Extension:
    """The library as setup.py describes it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        patch.setattr(setuptools, "setup", lambda **_: None)
        described: setuptools.Extension = runpy.run_path("setup.py")["kernel"](SOURCES.relative_to(ROOT))
        return described


def shipped_or_drawn(case: int) -> tuple[MachineDescription, np.random.Generator]:
    rng = np.random.default_rng(case)
    return (load_machine(SHIPPED[case]) if case < len(SHIPPED) else drawn_machine(rng)), rng


def assert_same_corrections(one: SolvedCorrections, other: SolvedCorrections, tolerance: float) -> None:
    for name in ("converged", "position_spanned", "direction_spanned"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    np.testing.assert_allclose(one.offset, other.offset, rtol=0.0, atol=tolerance)
    np.testing.assert_allclose(one.corrections, other.corrections, rtol=0.0, atol=tolerance)


@needs_library
@pytest.mark.parametrize("case", range(40))
def test_offsets_are_those_of_numpy_but_for_rounding(case: int) -> None:
    machine, rng = shipped_or_drawn(case)
    model = arrange_machine(machine)
    q, known = drawn_poses(rng, machine, 100)
    added = rng.normal(size=q.shape) * 1e-4
    ideal = stand(model, np.ascontiguousarray(q.T), None).tool_in_workpiece()
    found = []
    for form in ("compiled", "numpy"):
        with computing_by(form):
            found.append(
                np.stack(
                    [
                        predict_tool_offset(model, q, **known),
                        predict_tool_offset(model, q, **known, ideal=ideal),
                        remaining_offset(model, q, added, **known),
                    ]
                )
            )
    compiled, numpy_ = found
    assert np.abs(numpy_).max() > 1e-6
    np.testing.assert_allclose(compiled, numpy_, rtol=0.0, atol=1e-14 * (1.0 + size_of(machine)))


@needs_library
@pytest.mark.parametrize("case", range(40))
def test_corrections_are_those_of_numpy_but_for_rounding(case: int) -> None:
    machine, rng = shipped_or_drawn(case)
    model = arrange_machine(machine)
    q, known = drawn_poses(rng, machine, 100)
    found = []
    for form in ("compiled", "numpy"):
        with computing_by(form):
            found.append(solve_axis_corrections(model, q, **known, least_reach=0.2))
    assert found[0].converged.mean() > 0.9
    assert np.abs(found[0].corrections).max() > 1e-6
    assert_same_corrections(*found, tolerance=2e-14 * (1.0 + size_of(machine)))


@needs_library
@pytest.mark.parametrize("angle", [0.02, 0.3, 3.0])
@pytest.mark.parametrize("seed", range(4))
def test_large_angles_are_those_of_numpy(seed: int, angle: float) -> None:
    """Beyond the reach of the series, where the kernel takes the library's sine and arc tangent."""
    rng = np.random.default_rng(seed)
    machine = drawn_machine(rng, angle=angle)
    q, known = drawn_poses(rng, machine, 50)
    q *= rng.choice([1.0, 1e4, 1e8], q.shape)  # also turns that are too many for the reduction of its own
    # So many turns leave no digits of what grows with them: constants and tables alone are left.
    machine = replace(
        machine,
        errors={name: replace(error, poly=error.poly[:1], harmonic=()) for name, error in machine.errors.items()},
        axes=tuple(replace(axis, expansion=0.0) for axis in machine.axes),
    )
    model = arrange_machine(machine)
    found = []
    for form in ("compiled", "numpy"):
        with computing_by(form):
            found.append(predict_tool_offset(model, q, **known))
    # Of a turn by almost pi the direction is known less well than by other angles: shifts are held alone there.
    far = np.linalg.norm(found[1][:, 3:], axis=1) > 3.0
    scale = np.abs(q).max(axis=1, keepdims=True) + size_of(machine)
    difference = np.abs(found[0] - found[1]) / scale
    assert difference[:, :3].max() <= 1e-14
    assert difference[~far, 3:].max() <= 1e-12


@needs_library
@pytest.mark.parametrize("case", range(8))
def test_a_pose_gives_the_same_bits_however_many_there_are(case: int) -> None:
    machine, rng = shipped_or_drawn(case)
    model = arrange_machine(machine)
    q, known = drawn_poses(rng, machine, 61)
    whole = solve_axis_corrections(model, q, **known)
    left = remaining_offset(model, q, whole.corrections, **known)
    np.testing.assert_array_equal(predict_tool_offset(model, q, **known), whole.offset)
    for count in (1, 2, 5, 7, 8, 9, 16, 60):
        first = int(rng.integers(0, 61 - count + 1))
        part = slice(first, first + count)
        some = {name: value[part] for name, value in known.items()}
        found = solve_axis_corrections(model, q[part], **some)
        assert_same_corrections(found, whole.at(np.arange(first, first + count)), tolerance=0.0)
        np.testing.assert_array_equal(predict_tool_offset(model, q[part], **some), whole.offset[part])
        np.testing.assert_array_equal(remaining_offset(model, q[part], found.corrections, **some), left[part])


@needs_library
def test_the_bits_are_the_same_on_other_processors(tmp_path: Path) -> None:
    """Built for a processor without vectors of its width, and for one that would fuse products and sums."""
    compiler, flags = shutil.which("gcc"), Path("/proc/cpuinfo").read_text(encoding="ascii")
    if compiler is None or not {"fma", "avx2"} <= set(flags.split()):
        pytest.skip("no gcc, or a processor without fused multiply-add")
    described = extension()
    library = Path(kernel.__file__).with_name(f"_kernel{sysconfig.get_config_var('EXT_SUFFIX')}")
    kernels = [MachineKernel(ctypes.CDLL(str(library)))]
    for number, target in enumerate((["-msse2"], ["-mavx2", "-mfma"])):
        library = tmp_path / f"{number}.so"
        # less optimized, which takes half the time and changes no bit
        options = [
            *described.extra_compile_args,
            "-O1",
            *target,
            "-DENTRY=ENTRY_ONCE",
            '-DSOURCE=""',
            "-fPIC",
            "-shared",
        ]
        command = [compiler, *options, *described.sources, "-o", str(library), "-lm"]
        subprocess.run(command, check=True, cwd=ROOT)
        kernels.append(MachineKernel(ctypes.CDLL(str(library))))
    for case in range(8):
        machine, rng = shipped_or_drawn(case)
        model = arrange_machine(machine)
        q, known = drawn_poses(rng, machine, 50)
        rows = kernel.PoseRows(q, *(known.get(name) for name in ("direction", "temperature", "monitored")))
        first, *others = [each.corrections(model, rows, 0.1, 12, 1e-8) for each in kernels]
        for other in others:
            np.testing.assert_array_equal(np.hstack(other), np.hstack(first))


@pytest.mark.parametrize("form", [pytest.param("compiled", marks=needs_library), "numpy"])
def test_what_is_not_finite_is_named(form: str) -> None:
    model = arrange_machine(load_machine("xyzac_trt"))
    q = np.zeros((20, 5))
    q[17, 3] = np.nan
    with computing_by(form):
        for wrong in (predict_tool_offset, solve_axis_corrections):
            with pytest.raises(InputError, match=r"positions at \(17, 3\) is nan"):
                wrong(model, q)
        with pytest.raises(InputError, match=r"positions at \(17, 3\) is nan"):
            remaining_offset(model, np.zeros((20, 5)), q)
        with pytest.raises(InputError, match=r"monitored at \(2, 5\) is -inf"):
            solve_axis_corrections(
                model, np.zeros((3, 5)), monitored=np.array([[0.0] * 6] * 2 + [[0.0] * 5 + [-np.inf]])
            )


@needs_library
def test_a_machine_with_more_axes_than_the_kernel_has_room_for_is_computed_by_numpy() -> None:
    machine = load_machine("pan2013")
    axis = machine.axis("X")
    letters = [f"X{number}" for number in range(kernel.MOST_AXES)]
    carriers = ["base", *letters]
    more = replace(
        machine,
        axes=(*machine.axes, *(replace(axis, letter=letter) for letter in letters)),
        bodies=(
            *(Body(name, parent, axis=name) for name, parent in zip(letters, carriers, strict=False)),
            *(replace(body, parent=letters[-1]) if body.parent == "base" else body for body in machine.bodies),
        ),
    )
    rng = np.random.default_rng(1)
    q, known = drawn_poses(rng, machine, 10)
    kept = {name: value for name, value in known.items() if name != "direction"}
    solved = predict_tool_offset(arrange_machine(more), np.hstack([q, np.zeros((10, len(letters)))]), **kept)
    # What carries both tool and workpiece changes nothing.
    np.testing.assert_allclose(solved, predict_tool_offset(arrange_machine(machine), q, **kept), rtol=0.0, atol=1e-14)
    corrections = solve_axis_corrections(arrange_machine(more), np.zeros((1, 5 + len(letters))))
    assert corrections.converged.all()


@pytest.fixture
def anew(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Looks for the kernel again, and at the end as before."""
    monkeypatch.delitem(os.environ, VARIABLE, raising=False)
    load_kernel.cache_clear()
    yield monkeypatch
    load_kernel.cache_clear()


def test_without_the_library_numpy_computes_and_says_so(anew: pytest.MonkeyPatch, tmp_path: Path) -> None:
    anew.setattr(kernel, "_LIBRARY", tmp_path / "_kernel.so")
    assert chosen_kernel() is None
    assert "_kernel.so was not built" in kernel.describe_kernel()
    machine = load_machine("xyzac_trt")
    assert predict_tool_offset(arrange_machine(machine), np.zeros((1, 5))).shape == (1, 6)
    anew.setenv(VARIABLE, "compiled")
    load_kernel.cache_clear()
    with pytest.raises(
        InputError, match=r"=compiled, but _kernel\.so was not built: install the package where there is"
    ):
        load_kernel()


def test_a_file_that_is_no_library_is_not_used(anew: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "_kernel.so").write_bytes(b"no library")
    anew.setattr(kernel, "_LIBRARY", tmp_path / "_kernel.so")
    assert chosen_kernel() is None


@needs_library
def test_a_library_of_other_sources_is_not_used(anew: pytest.MonkeyPatch, tmp_path: Path) -> None:
    shutil.copytree(SOURCES, tmp_path / "compiled")
    (tmp_path / "compiled" / "lanes.h").write_text("", encoding="ascii")
    anew.setattr(kernel, "_SOURCES", tmp_path / "compiled")
    assert chosen_kernel() is None
    assert "was built of other sources: install the package anew" in kernel.describe_kernel()
    anew.setattr(kernel, "_SOURCES", tmp_path / "none")  # a wheel has the library alone
    load_kernel.cache_clear()
    assert chosen_kernel() is not None
    assert kernel.describe_kernel() == ""


def test_a_kernel_of_another_name_is_refused(anew: pytest.MonkeyPatch) -> None:
    anew.setenv(VARIABLE, "fortran")
    with pytest.raises(InputError, match=r"ROTARY_ERROR_MONITOR_KERNEL=fortran; expected numpy or compiled"):
        load_kernel()


def test_make_setup_builds_it_where_there_is_a_compiler() -> None:
    """Or all tests of it would be left out without a word."""
    if not (ROOT / ".venv" / ".ready").exists() or shutil.which(sysconfig.get_config_var("CC").split()[0]) is None:
        pytest.skip("not installed by make setup, or no compiler")
    assert is_built(), "run: make setup"


def test_setup_and_package_tell_the_sources_alike() -> None:
    assert dict(extension().define_macros)["SOURCE"] == f'"{source_digest(SOURCES)}"'
