"""The index by itself: whole bags or none, whoever ends it; questions that differ are told apart."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from dataclasses import replace

import pytest

from rotary_error_monitor.analysis.result import Figure
from rotary_error_monitor.bags.naming import Given, Naming
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.recordings.analysis import Question
from rotary_error_monitor.recordings.bag_figures import question_key
from rotary_error_monitor.recordings.index import Index, IndexEntry

KILLED = """
import os, signal, sys
from pathlib import Path
from rotary_error_monitor.analysis.result import Figure
from rotary_error_monitor.recordings.index import IndexEntry, Index
folder = Path(sys.argv[1])
figures = tuple(Figure(f"f{k}", "s", 1.0 * k, 0.1, "m") for k in range(50))
index = Index(folder / "i.duckdb", folder)
index.put("first", "q", "1", [IndexEntry("/", "", 5, figures)])
index.put("second", "q", "1", [IndexEntry("/", "", 6, figures)])
insert, tables = index._insert, []
def half(table, rows):
    insert(table, rows)
    tables.append(table)
    if len(tables) == int(sys.argv[2]):
        os.kill(os.getpid(), signal.SIGKILL)
index._insert = half
index.put("second", "q", "2", [IndexEntry("/", "", 7, figures), IndexEntry("/left", "", 8, figures)])
"""


@pytest.mark.parametrize("statement", [4])
def test_a_kill_in_the_middle_of_a_bag_leaves_what_was_known(tmp_path, statement):
    command = [sys.executable, "-c", KILLED, str(tmp_path), str(statement)]
    assert subprocess.run(command).returncode == -signal.SIGKILL
    with Index(tmp_path / "i.duckdb", tmp_path) as index:
        assert index.fingerprints("q") == {"first": "1", "second": "1"}
        found = list(index.entries("q"))
        assert [(bag, entry.started_ns, len(entry.figures)) for bag, entry in found] == [
            *(("first", 5, 50), ("second", 6, 50))
        ]
        index.put("second", "q", "2", [IndexEntry("/", "", 7)])
        assert index.fingerprints("q") == {"first": "1", "second": "2"}


def test_what_is_put_comes_back_as_it_was_and_questions_and_folders_are_told_apart(tmp_path):
    figures = (
        Figure("a.b", "forward 4 rad/s", 1e-6, None, "m"),
        Figure("c", "", -2.5e-7, 1e-9, "rad/K", 3e-7, 4, 100, 6.5),
    )
    whole = IndexEntry(
        "/left", "A7", 1_763_700_000_123_456_789, figures, (("forward 4 rad/s", 4.0),), "", ("a note", "ü")
    )
    failed = IndexEntry("", reason="no message")
    (tmp_path / "bags").mkdir()
    with Index(tmp_path / "i.duckdb", tmp_path / "bags") as index:
        index.put("one", "q", "1", [whole])
        index.put("two", "q", "1", [failed])
        assert list(index.entries("q")) == [("one", whole), ("two", failed)]
        assert list(index.entries("other")) == [] and index.fingerprints("other") == {}
        index.put("one", "other", "1", [failed])
        index.forget(["two"])
        assert index.bags() == {"one"} and list(index.entries("q")) == [("one", whole)]
    with Index(tmp_path / "i.duckdb", tmp_path) as index:
        assert index.bags() == set()


def test_an_index_within_its_folder_goes_where_the_folder_goes(tmp_path):
    (tmp_path / "bags").mkdir()
    with Index(tmp_path / "bags" / "i.duckdb", tmp_path / "bags") as index:
        index.put("one", "q", "1", [IndexEntry("/")])
    (tmp_path / "bags").rename(tmp_path / "moved")
    with Index(tmp_path / "moved" / "i.duckdb", tmp_path / "moved") as index:
        assert index.bags() == {"one"}


def test_another_version_reads_again(tmp_path, monkeypatch):
    with Index(tmp_path / "i.duckdb", tmp_path) as index:
        index.put("one", "q", "1", [IndexEntry("/")])
        monkeypatch.setattr("rotary_error_monitor.recordings.index.__version__", "99.0")
        assert index.fingerprints("q") == {}


def test_a_question_is_all_that_figures_depend_on_and_no_limit():
    stage, machine = load_stage(), load_machine("xyzac_trt")
    asked = Question()
    given = Naming(None, {"/stage/lvdt/samples": Given("/probe", "map.yaml:1")})
    other = replace(stage, lvdt=replace(stage.lvdt, height=0.02))
    keys = [
        question_key(stage, None, asked),
        question_key(other, None, asked),
        question_key(stage, machine, asked),
        *(
            question_key(stage, None, replace(asked, **{name: value}))
            for name, value in (
                ("heights", (0.06,)),
                ("most_waves", 50),
                ("naming", Naming("/left")),
                ("naming", given),
            )
        ),
    ]
    assert len(set(keys)) == len(keys)
    limited = replace(asked, limits=replace(asked.limits, radial_total=1e-6))
    assert question_key(load_stage(), None, limited) == keys[0]


def test_without_duckdb_the_package_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "duckdb", None)
    with pytest.raises(InputError, match=r"pip install 'rotary_error_monitor\[trend\]'"):
        Index(tmp_path / "i.duckdb", tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(os.geteuid() != 0, reason="a folder that this user may not write is made by root for another")
def test_a_folder_that_may_not_be_written_asks_for_an_index_elsewhere():
    """As a user who may read and not write: root may write everywhere."""
    code = (
        "import os, sys\n"
        "from pathlib import Path\n"
        "from rotary_error_monitor.errors import InputError\n"
        "from rotary_error_monitor.recordings.index import Index\n"
        "import duckdb\n"
        "os.setuid(65534)\n"
        "try:\n"
        "    Index(Path('/usr/trend.duckdb'), Path('/usr'))\n"
        "except InputError as error:\n"
        "    print(error)\n"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "/usr/trend.duckdb: cannot be made" in told.stdout and "--index" in told.stdout, told.stderr
