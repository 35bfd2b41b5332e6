"""The command `trend`: what changed between recordings, what is read again and what is not, and what is wrong."""

from __future__ import annotations

import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import duckdb
import mock_bags
import numpy as np
import pytest
import yaml
from mock_bags import EPOCH_NS, write_stage_bag

from rotary_error_monitor.analysis.trend import DAY_NS
from rotary_error_monitor.cli import main
from rotary_error_monitor.recordings.index import APPLICATION, SCHEMA

BAGS, CHANGED = 6, 3
BEFORE, AFTER = 1.0e-5, 1.4e-5
"""Amplitudes of the tilt about x at order 3, rad: all that the rotor does, before and after the change."""


def write_day(folder, day, amplitude=BEFORE, seed=None):
    return mock_bags.write_day(folder, day, amplitude, seed)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Bags of six days, at two depths."""
    folder = tmp_path_factory.mktemp("recorded")
    for day in range(BAGS):
        place = folder / ("" if day % 2 else "more")
        place.mkdir(exist_ok=True)
        write_day(place / f"day_{day}", day, BEFORE if day < CHANGED else AFTER)
    return folder


@pytest.fixture
def folder(recorded, tmp_path):
    """The bags, as a copy that may be changed."""
    return Path(shutil.copytree(recorded, tmp_path / "bags", copy_function=shutil.copy2))


@pytest.fixture(scope="module")
def known(recorded, tmp_path_factory):
    """The bags with the index of a first run, and its results."""
    folder = Path(shutil.copytree(recorded, tmp_path_factory.mktemp("known") / "bags", copy_function=shutil.copy2))
    out = folder.parent / "page.html"
    arguments = ["--height", "0", "--format", "html,json,csv,png", "--jobs", "1", "-o", str(out)]
    assert main(["trend", str(folder), *arguments]) == 0
    return folder, out


@pytest.fixture
def known_folder(known, tmp_path):
    return Path(shutil.copytree(known[0], tmp_path / "bags", copy_function=shutil.copy2))


@pytest.fixture
def reads(monkeypatch):
    """Names of the bags that this process reads, as it does with --jobs 1."""
    from rotary_error_monitor.recordings import trend

    names: list[str] = []
    read = trend.read_figures

    def counting(task):
        names.append(task.name)
        return read(task)

    monkeypatch.setattr(trend, "read_figures", counting)
    return names


def run(folder, *arguments, out=None):
    """Exit code and content of the JSON file."""
    out = out or folder.parent / "out.json"
    code = main(["trend", str(folder), "--height", "0", "--jobs", "1", *arguments, "-o", str(out)])
    return code, json.loads(out.read_text(encoding="utf-8")) if out.exists() else None


def figure_of(content, name):
    (stage,) = content["stages"]
    (figure,) = [figure for figure in stage["figures"] if figure["name"] == name]
    return figure


def test_the_change_is_told_with_its_date_and_size(known):
    content = json.loads(known[1].with_suffix(".json").read_text(encoding="utf-8"))
    (stage,) = content["stages"]
    assert [row["bag"] for row in stage["recordings"]] == [
        ("day_{}" if d % 2 else "more/day_{}").format(d) for d in range(6)
    ]
    assert [row["started_ns"] // DAY_NS for row in stage["recordings"]] == [EPOCH_NS // DAY_NS + d for d in range(6)]
    figure = figure_of(content, "tilt_x.residual_synchronous")
    (step,) = figure["steps"]
    assert (step["after"], step["from"]) == ("more/day_2", "day_3") and not figure["has_slope"]
    change = step["now"] - step["before"]
    assert change == pytest.approx(2 * (AFTER - BEFORE), abs=1.5 * step["expanded_uncertainty"])
    assert figure["now"] == pytest.approx(2 * AFTER, abs=1.5 * figure["now_uncertainty"])
    steady = [figure for figure in stage["figures"] if figure["name"].startswith(("tilt_y", "radial"))]
    assert len(steady) > 10 and not [each["name"] for each in steady if each["steps"] or each["has_slope"]]


def test_csv_holds_each_figure_of_each_recording_and_the_page_loads_nothing(known):
    out = known[1]
    rows = list(csv.DictReader(out.with_suffix(".csv").read_text(encoding="utf-8").splitlines()))
    mean = [float(row["value"]) for row in rows if row["name"] == "tilt_x.residual_synchronous"]
    assert len(mean) == BAGS and np.diff(mean)[CHANGED - 1] > 5 * np.abs(np.delete(np.diff(mean), CHANGED - 1)).max()
    page = out.read_text(encoding="utf-8")
    assert page.startswith("<!doctype html>") and page.endswith("</html>\n")
    assert not re.search(r"(src|href)='(?!data:)", page) and "http" not in re.sub(r"base64,[^']*", "", page)
    assert re.search(
        r"from day_3 on: a step in (1 figure|\d+ figures), most clearly in tilt x: residual synchronous", page
    )
    for word in ("What changed", "tilt x: residual synchronous", "day_3", "Recordings", "± U (k = 2)", "false alarms"):
        assert word in page
    assert out.with_suffix(".png").read_bytes().startswith(b"\x89PNG")


def test_the_second_run_reads_nothing_and_says_the_same_and_limits_are_no_question(known, known_folder, reads, capsys):
    first = json.loads(known[1].with_suffix(".json").read_text(encoding="utf-8"))
    code, second = run(known_folder)
    assert (code, reads, second["read"], second["known"]) == (0, [], 0, BAGS)
    assert second["stages"] == first["stages"]
    for limit, expected in ((2.2e-5, 10), (1e-4, 0)):
        code, judged = run(known_folder, "--limits", f"tilt_residual_synchronous_urad={limit * 1e6}")
        assert (code, reads) == (expected, [])
        (row,) = judged["stages"][0]["limits"]
        assert row["first_beyond"] == ("day_3" if code else None)
        assert row["margin"] == pytest.approx(limit - 2 * AFTER, abs=1.5 * row["margin_uncertainty"])
    assert "Beyond limits by the latest recording: stage (tilt residual synchronous)" in capsys.readouterr().out
    assert run(known_folder, "--limits", "axial_total_um=1")[0] == 11


def test_what_changed_is_read_again_and_what_is_gone_is_said(known_folder, reads, capsys):
    shutil.rmtree(known_folder / "day_5")
    shutil.rmtree(known_folder / "day_1")
    write_day(known_folder / "day_1", 1, seed=77)
    write_day(known_folder / "day_9", 9)
    code, content = run(known_folder)
    assert (code, sorted(reads), content["gone"]) == (0, ["day_1", "day_9"], ["day_5"])
    assert [row["bag"] for row in content["stages"][0]["recordings"]][-1] == "day_9"
    assert "day_5: no longer there" in capsys.readouterr().err
    assert "day_5" not in json.dumps(run(known_folder)[1]) and len(reads) == 2


def test_a_bag_that_cannot_be_analysed_is_listed_and_tried_again_when_it_changes(known_folder, reads, capsys):
    broken = known_folder / "broken"
    broken.mkdir()
    (broken / "broken_0.mcap").write_bytes(b"\x89MCAP0\r\nno more")
    write_stage_bag(known_folder / "standing", 1, ("lvdt", "temperature"))
    assert run(known_folder)[0] == 0
    _, content = run(known_folder)
    assert (content["read"], sorted(reads)) == (0, ["broken", "standing"])
    reasons = {row["bag"]: row["reason"] for row in content["unread"]}
    assert set(reasons) == {"broken", "standing"} and "no message on" in reasons["standing"]
    assert "unexpected" not in "".join(reasons.values())
    assert "note: standing: " in capsys.readouterr().err
    assert run(known_folder)[0] == 0 and len(reads) == 2
    shutil.rmtree(broken)
    write_day(broken, 20)
    assert run(known_folder)[1]["unread"][0]["bag"] == "standing" and reads[2:] == ["broken"]


INTERRUPTED = """
import os, signal, sys
from rotary_error_monitor.cli import main
from rotary_error_monitor.recordings.index import Index
put, done = Index.put, []
def counted(self, *arguments):
    put(self, *arguments)
    done.append(1)
    if len(done) == 2:
        os.kill(os.getpid(), signal.SIGINT)
Index.put = counted
sys.exit(main(sys.argv[1:]))
"""


def test_what_was_done_stays_after_ctrl_c_and_processes_find_what_one_finds(known, folder, reads):
    """Ctrl-C when two processes have given two bags; the others are read by this one."""
    index, out = folder.parent / "elsewhere.duckdb", folder.parent / "out.json"
    arguments = ["trend", str(folder), "--height", "0", "--jobs", "2", "--index", str(index), "-o", str(out)]
    interrupted = subprocess.run([sys.executable, "-c", INTERRUPTED, *arguments], capture_output=True, text=True)
    assert (interrupted.returncode, interrupted.stderr) == (130, "")
    assert sorted(path.name for path in folder.parent.iterdir()) == ["bags", "elsewhere.duckdb"]
    code, content = run(folder, "--index", str(index))
    assert (code, content["read"], content["known"], len(reads)) == (0, BAGS - 2, 2, BAGS - 2)
    first = json.loads(known[1].with_suffix(".json").read_text(encoding="utf-8"))
    assert content["stages"] == first["stages"] and not (folder / "trend.duckdb").exists()


def named(bag, stage):
    """Let a bag say of which stage it is, as a recorder may."""
    path = bag / "metadata.yaml"
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    content["rosbag2_bagfile_information"]["custom_data"] = {"stage": stage}
    path.write_text(yaml.safe_dump(content), encoding="utf-8")


def test_stages_are_told_apart_by_what_bags_say_or_by_folder(known_folder, reads):
    named(known_folder / "day_1", "north")
    named(known_folder / "day_3", "north")
    code, content = run(known_folder)
    assert code == 0 and len(reads) == 2
    assert {(stage["stage"], len(stage["recordings"])) for stage in content["stages"]} == {("north", 2), ("stage", 4)}
    _, by_folder = run(known_folder, "--by-folder")
    assert {(each["stage"], len(each["recordings"])) for each in by_folder["stages"]} == {
        *(("more", 3), ("north", 2), ("stage", 1))
    }
    assert len(reads) == 2


def test_a_copy_of_a_bag_counts_once(known_folder):
    shutil.copytree(known_folder / "day_3", known_folder / "day_3_copy")
    (stage,) = run(known_folder)[1]["stages"]
    assert stage["copies"] == ["day_3_copy"] and len(stage["recordings"]) == BAGS


FOREIGN = {
    "no database": (lambda path: path.write_bytes(b"figures of somebody" * 100), "no index of the trend"),
    "empty": (lambda path: path.touch(), "no index of the trend"),
    "another database": (lambda path: fill(path, "CREATE TABLE mine (a INTEGER)"), "a database of something else"),
    "another about": (
        lambda path: fill(path, "CREATE TABLE about (application VARCHAR, schema INTEGER)"),
        "something else",
    ),
    "newer": (
        lambda path: fill(
            path,
            "CREATE TABLE about (application VARCHAR, schema INTEGER)",
            f"INSERT INTO about VALUES ('{APPLICATION}', {SCHEMA + 1})",
        ),
        f"an index of version {SCHEMA + 1}, and this program knows version {SCHEMA}",
    ),
}


def fill(path, *statements):
    with duckdb.connect(str(path)) as connection:
        for statement in statements:
            connection.execute(statement)


@pytest.mark.parametrize("foreign", FOREIGN)
def test_an_index_of_somebody_else_is_left_as_it_is(foreign, recorded, tmp_path, capsys):
    make, said = FOREIGN[foreign]
    index = tmp_path / "index.duckdb"
    make(index)
    before = index.read_bytes()
    assert run(recorded, "--index", str(index), out=tmp_path / "out.json") == (2, None)
    told = capsys.readouterr().err
    assert said in told and "--index" in told
    assert index.read_bytes() == before and [path.name for path in tmp_path.iterdir()] == ["index.duckdb"]


def test_an_index_that_another_process_has_open_is_said(known_folder, capsys):
    holder = "import duckdb, sys; c = duckdb.connect(sys.argv[1]); print('open', flush=True); sys.stdin.read()"
    with subprocess.Popen(
        [sys.executable, "-c", holder, str(known_folder / "trend.duckdb")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as process:
        assert process.stdout is not None and process.stdout.readline() == b"open\n"
        assert run(known_folder)[0] == 2
        process.communicate()
    assert "another process has the index open" in capsys.readouterr().err


WRONG = {
    "nothing": (["{tmp}/nothing"], "no such folder"),
    "a file": (["{tmp}/file"], "no folder; give a folder with bags below it"),
    "no bag": (["{tmp}/empty"], "no bag below it"),
    "limits": (["{bags}", "--limits", "tilt=1"], "expected NAME_UNIT=NUMBER above 0"),
    "jobs": (["{bags}", "--jobs", "0"], "--jobs is 0; it must be from 1"),
    "rate": (["{bags}", "--false-alarms", "1"], "--false-alarms is 1.0; it must lie between 0 and 1"),
    "both": (["{bags}", "--jobs", "2", "--scheduler", "tcp://127.0.0.1:9"], "give one of the two"),
    "format": (["{bags}", "--format", "pdf"], "--format has 'pdf'"),
    "machine": (["{bags}", "--machine", "grinder_zhou2023"], "the machine has no monitored axis"),
    "index": (["{bags}", "--index", "/proc/trend.duckdb"], "cannot be made"),
    "index is a folder": (["{bags}", "--index", "{tmp}/empty"], "no index of the trend"),
    "index is a bag": (["{bags}", "--index", "{bags}/day_1/day_1_0.mcap"], "no index of the trend"),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_wrong_input_ends_with_code_2(wrong, recorded, tmp_path, capsys):
    words, said = WRONG[wrong]
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").touch()
    arguments = [word.format(tmp=tmp_path, bags=recorded) for word in words]
    assert main(["trend", *arguments, "-o", str(tmp_path / "out.html")]) == 2
    told = capsys.readouterr().err
    assert said in told and "Traceback" not in told
    assert not (tmp_path / "out.html").exists() and not (recorded / "trend.duckdb").exists()


def test_no_bag_that_can_be_analysed_is_wrong_input(tmp_path, capsys):
    write_stage_bag(tmp_path / "bags" / "one", 1, ("lvdt",))
    assert run(tmp_path / "bags") == (2, None)
    assert "none of 1 bags can be analysed; one: " in capsys.readouterr().err


def test_a_result_is_not_written_over_the_index(known_folder, capsys):
    index = known_folder / "trend.json"
    (known_folder / "trend.duckdb").rename(index)
    assert main(["trend", str(known_folder), "--index", str(index), "--jobs", "1", "-o", str(index)]) == 2
    assert "not written, for it is the input" in capsys.readouterr().err


def test_dask_workers_find_the_same_though_one_is_killed(known, folder, monkeypatch):
    """Two workers of a scheduler on this computer; one is killed when the first bag has come."""
    distributed = pytest.importorskip("distributed")
    from rotary_error_monitor.commands import trend as command

    killed = []

    def killing(name):
        def watched(answers, total):
            for answer in answers:
                if not killed:
                    killed.append(cluster.workers[0].process.process.pid)
                    os.kill(killed[0], signal.SIGKILL)
                yield answer

        return watched

    monkeypatch.setattr(command, "bar_of", killing)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as cluster:
        out = folder.parent / "out.json"
        arguments = ["--height", "0", "--scheduler", cluster.scheduler_address, "-o", str(out)]
        assert main(["trend", str(folder), *arguments]) == 0
    content = json.loads(out.read_text(encoding="utf-8"))
    assert killed and (content["read"], content["unread"], content["undone"]) == (BAGS, [], [])
    first = json.loads(known[1].with_suffix(".json").read_text(encoding="utf-8"))
    assert content["stages"] == first["stages"]


def test_the_query_of_the_documentation_gives_the_figures(known, monkeypatch):
    text = (Path(__file__).parents[2] / "doc" / "trend.md").read_text(encoding="utf-8")
    (query,) = re.findall(r"```sql\n(.*?)```", text, re.DOTALL)
    content = json.loads(known[1].with_suffix(".json").read_text(encoding="utf-8"))
    with duckdb.connect(str(known[0] / "trend.duckdb"), read_only=True) as index:
        rows = index.execute(query).fetchall()
        columns = index.execute("SELECT table_name, column_name FROM duckdb_columns() WHERE NOT internal").fetchall()
    told = figure_of(content, "tilt_x.total")["values"]
    assert [(bag, urad) for _, bag, urad, _ in rows] == [(v["bag"], round(v["value"] * 1e6, 3)) for v in told]
    assert [f"{row[0]:%Y-%m-%d %H:%M:%S}" for row in rows] == [
        row["started"] for row in content["stages"][0]["recordings"]
    ]
    described = dict(re.findall(r"^\| `(\w+)`.*?\|.*?\|(.*)\|$", text, re.MULTILINE))
    assert len(columns) > 30
    for table, column in columns:
        assert f"`{column}`" in described[table], f"doc/trend.md does not tell {table}.{column}"
