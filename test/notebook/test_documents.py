"""The tutorial runs from its first to its last cell and finds what was put in; the page's code runs as it is shown."""

from __future__ import annotations

import inspect
import re
import subprocess
import sys
from functools import partial
from pathlib import Path

import executed_notebook
import nbformat
import pytest
from leaning_stage import ORDER

import rotary_error_monitor

DOC = Path(__file__).parents[2] / "doc"


@pytest.fixture(scope="module")
def tutorial():
    return nbformat.read(DOC / "tutorial.ipynb", nbformat.NO_CONVERT)


@pytest.fixture
def apart(tmp_path, monkeypatch):
    """A folder in which Jupyter leaves whatever it leaves."""
    for name in ("IPYTHONDIR", "JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR"):
        monkeypatch.setenv(name, str(tmp_path / name.lower()))
    monkeypatch.setenv("JUPYTER_PLATFORM_DIRS", "1")
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    return tmp_path


def texts_of(cell):
    """What a cell printed and showed, as plain text."""
    for output in cell.get("outputs", ()):
        yield output["text"] if output.output_type == "stream" else output["data"]["text/plain"]


def test_the_tutorial_has_no_outputs_and_is_small(tutorial):
    nbformat.validate(tutorial)
    cells = [cell for cell in tutorial.cells if cell.cell_type == "code"]
    assert len(cells) > 10
    assert all(cell.outputs == [] and cell.execution_count is None for cell in cells)
    assert (DOC / "tutorial.ipynb").stat().st_size < 20_000
    assert "simulated" in tutorial.cells[0].source


def test_the_tutorial_runs_and_finds_what_was_put_in(apart):
    command = [sys.executable, executed_notebook.__file__, str(DOC / "tutorial.ipynb"), str(apart / "done.ipynb")]
    ended = subprocess.run(command, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
    tutorial = nbformat.read(apart / "done.ipynb", nbformat.NO_CONVERT)
    outputs = [output for cell in tutorial.cells for output in cell.get("outputs", ())]
    assert sum("image/png" in output.get("data", {}) for output in outputs) >= 5
    assert not [output for output in outputs if output.output_type == "stream" and output.name == "stderr"]
    told = "\n".join(text for cell in tutorial.cells for text in texts_of(cell))
    assert f"spindle_tilt at order_{ORDER}" in told
    (off,) = map(float, re.findall(r"true: 1.500 µrad, ([+-][\d.]+) standard uncertainties off", told))
    assert abs(off) < 4
    shares = [float(share) for share in re.findall(r"([\d.]+)% within two standard uncertainties", told)]
    assert len(shares) == 4 and min(shares) > 90
    pages = [path.name for path in apart.rglob("*.html")]
    assert sorted(pages) == ["diagnosis.html", "quality.html"]


def test_the_code_of_the_page_runs(recording, motion, quality, gap, tmp_path, monkeypatch):
    """What the four functions give has been found already: here they take what the page gives them."""
    (code,) = re.findall(r"```python\n(.*?)```", (DOC / "notebooks.md").read_text(encoding="utf-8"), re.DOTALL)
    monkeypatch.chdir(tmp_path)
    found = {"read_bag": recording, "estimate": motion, "analyse": quality, "diagnose": gap}
    for name, result in found.items():
        signature = inspect.signature(getattr(rotary_error_monitor, name))
        monkeypatch.setattr(rotary_error_monitor, name, partial(bound, signature, result))
    names: dict[str, object] = {}
    exec(compile(code, "notebooks.md", "exec"), names)
    assert [names[name] for name in ("recording", "motion", "quality", "gap")] == list(found.values())
    assert (tmp_path / "page.html").is_file()


def bound(signature, result, *given, **named):
    """The result, where the function could have been called so."""
    signature.bind(*given, **named)
    return result
