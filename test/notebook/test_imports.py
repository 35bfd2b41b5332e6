"""Importing the package costs what it did; what a notebook asks for is loaded then, and says what is missing."""

from __future__ import annotations

import ast
import doctest
import importlib
import subprocess
import sys
from pathlib import Path

import matplotlib
import pytest

import rotary_error_monitor
from rotary_error_monitor.errors import InputError, MissingPackageError
from rotary_error_monitor.notebook import analyses, diagnoses, estimates, recording
from rotary_error_monitor.resources import config

HEAVY = ("numpy", "scipy", "matplotlib", "pandas", "rclpy", "yaml", "mcap", "importlib.metadata", "typing")
NAMES = ("read_bag", "estimate", "analyse", "diagnose")


def loaded_by(statement: str, names: tuple[str, ...]) -> set[str]:
    """Which of some modules are there after a statement, and were not before."""
    code = f"import sys; before = set(sys.modules); {statement}; print(*(set(sys.modules) - before) & set({names!r}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_the_package_alone_loads_nothing():
    assert loaded_by("import rotary_error_monitor, rotary_error_monitor.start", HEAVY[:-1]) == set()
    modules = loaded_by(
        "import rotary_error_monitor", tuple(f"rotary_error_monitor.{room}" for room in ("notebook", "errors"))
    )
    assert modules == set()


def test_what_is_asked_for_loads_neither_ros_nor_tables_nor_windows(short):
    """And drawing comes with the first figure."""
    heavy = ("rclpy", "pandas", "matplotlib", "matplotlib.pyplot")
    asked = f"from rotary_error_monitor import {', '.join(NAMES)}; found = estimate({str(short)!r})"
    asked += f"; assert not set(sys.modules) & set({heavy}); found.figure()"
    assert loaded_by(asked, heavy) == {"matplotlib"}


def test_the_names_are_one_list():
    """Those that a type checker sees, those that are found, and those that `import *` gives."""
    tree = ast.parse(Path(rotary_error_monitor.__file__).read_text(encoding="utf-8"))
    (typed,) = (node for node in tree.body if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")
    seen = {alias.asname: part.module for part in typed.body for alias in part.names}
    assert {*seen, "__version__"} == set(rotary_error_monitor.__all__) <= set(dir(rotary_error_monitor))
    for name, module in seen.items():
        assert getattr(rotary_error_monitor, name) is getattr(importlib.import_module(module), name)
    with pytest.raises(AttributeError, match="module 'rotary_error_monitor' has no attribute 'analyze'"):
        _ = rotary_error_monitor.analyze


def test_without_pandas_only_tables_are_missing(recording, motion, quality, gap, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    for result in (recording, motion, quality, gap, recording["head_a"], motion.at_height(0.0)):
        with pytest.raises(MissingPackageError, match=r"pip install 'rotary_error_monitor\[notebook\]'") as caught:
            result.to_dataframe()
        assert isinstance(caught.value, ImportError) and isinstance(caught.value, InputError)
    assert motion.figure().axes and quality.figures()[0].axes


def test_figures_leave_no_state_behind(recording, motion, quality, gap):
    """Neither the backend nor a setting changes, and the library keeps no figure that nobody closes."""
    from matplotlib import pyplot

    before = dict(matplotlib.rcParams), matplotlib.get_backend(), pyplot.get_fignums()
    figures = [result.figure() for result in (recording, motion, motion.at_height(0.06))]
    figures += [*quality.figures(), *quality.figures("course")[:1], *gap.figures()]
    for figure in figures:
        assert isinstance(figure, matplotlib.figure.Figure) and figure.axes
    assert (dict(matplotlib.rcParams), matplotlib.get_backend(), pyplot.get_fignums()) == before
    assert motion.figure() is not motion.figure()
    with pytest.raises(InputError, match="shown is 'circle'; this analysis has polar, orders, course"):
        quality.figures("circle")


def size_of(png):
    """Dots by its head (ISO/IEC 15948)."""
    assert png.startswith(b"\x89PNG")
    return int.from_bytes(png[16:20], "big"), int.from_bytes(png[20:24], "big")


def test_a_notebook_shows_figures_as_large_as_the_page_does(motion, quality):
    """A picture has 96 dots in an inch of its figure; where it has more, it stays as large."""
    figure, pictures = motion.figure(), quality.figures("polar")
    for shown in (figure, pictures[0]):
        png, told = shown._repr_png_()
        inches = shown.get_size_inches()
        assert (told["width"], told["height"]) == pytest.approx(inches * 96, abs=1)
        assert size_of(png) == pytest.approx(inches * shown.dpi, abs=1)
    wide = 96 * sum(shown.get_size_inches()[0] for shown in pictures)
    assert pictures._repr_png_()[1]["width"] == pytest.approx(wide, abs=len(pictures))
    assert len(repr(pictures).splitlines()) == len(pictures) == len(pictures[:]) > 1


@pytest.mark.parametrize("module", [recording, estimates, analyses, diagnoses], ids=lambda module: module.__name__)
def test_examples_of_docstrings_hold(module, short, bag):
    # a diagnosis takes 12 s at least
    names = {"bag": bag if module is diagnoses else short, "stage": config("stage.yaml")}
    runner, count = doctest.DocTestRunner(), 0
    for test in doctest.DocTestFinder(recurse=True).find(module, globs=names):
        count += len(test.examples)
        assert runner.run(test).failed == 0, test.name
    assert count >= 3
