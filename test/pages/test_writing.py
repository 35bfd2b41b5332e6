"""Commands that write pages, given what they cannot use or no room: said in one line, and the old page stays."""

from __future__ import annotations

import os
import re
import resource
import stat
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
import yaml
from mock_bags import write_stage_bag
from world.newly_built import build

from rotary_error_monitor import files
from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.blind_check.cases import draw_machine, write_case
from rotary_error_monitor.cases.making import make_machine_case
from rotary_error_monitor.cli import main
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.description.wire import load_wire
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.files import write_all, write_whole
from rotary_error_monitor.resources import config
from rotary_error_monitor.sources.mock import MockSettings, mock_stage

EPOCH_NS = 1_763_700_000_000_000_000
OLD = "an old page"
SOME = 3000
"""Bytes that fit on a disk which is nearly full."""


def _bag(folder: Path, *streams: str) -> Path:
    plant = mock_stage(load_stage(), MockSettings(5, EPOCH_NS, (4.0,), forces=False, rate=300.0))
    wire = load_wire()
    write_messages(folder, {wire.topic(f"{name}_samples").name: [plant.samples(name, 0, 50)] for name in streams}, wire)
    return folder


def _folder(folder: Path) -> Path:
    folder.mkdir()
    return folder


WRONG: dict[str, tuple[Callable[[Path], Path], str]] = {
    "nothing": (lambda place: place, "no such bag|no such file|cannot be read"),
    "a folder without a bag": (_folder, "metadata.yaml|no bag|holds no|no such"),
    "an empty bag": (_bag, "no message|empty|no topic|holds no"),
    "a bag of something else": (lambda place: _bag(place, "lvdt"), "no message on /stage/head_a|no samples"),
}


def command(name: str, bag: Path, folder: Path) -> tuple[list[str], list[Path]]:
    """Words of a command that writes into a folder, and the files that it would write there."""
    if name == "analyse":
        out = [folder / "page.html"]
        return ["analyse", str(bag), "-o", str(out[0])], out
    if name == "diagnose":
        twin = str(config("stage.yaml"))
        words = ["diagnose", str(bag), "--twin", twin, "-o", str(folder), "--write-twin", str(folder / "twin.yaml")]
        return words, [folder / f"diagnosis.{each}" for each in ("html", "json", "png")] + [folder / "twin.yaml"]
    nominal = bag.parent / "nominal.yaml"
    nominal.write_text(yaml.safe_dump({"stage": build(1, count=4, duration=1.0).nominal}), encoding="utf-8")
    words = ["commission", str(bag), "--stage", str(nominal), "-o", str(folder / "stage.yaml")]
    return [*words, "--page", str(folder / "page.html")], [folder / "page.html"]


@pytest.mark.parametrize("wrong", WRONG)
@pytest.mark.parametrize("name", ["analyse", "commission", "diagnose"])
def test_a_wrong_bag_is_named_and_the_old_page_stays(
    name: str, wrong: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make, said = WRONG[wrong]
    bag = make(tmp_path / "recording")
    out = _folder(tmp_path / "out")
    words, old = command(name, bag, out)
    for path in old:
        path.write_text(OLD, encoding="utf-8")
    assert main(words) == 2
    told = capsys.readouterr().err
    assert "Traceback" not in told and "recording" in told
    assert re.search(said, told), told
    assert {path: path.read_text(encoding="utf-8") for path in out.iterdir()} == dict.fromkeys(old, OLD)


@pytest.mark.parametrize("name", ["analyse", "commission", "diagnose"])
def test_an_output_that_is_a_folder_is_refused_at_once(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = _folder(tmp_path / "out")
    words, files_ = command(name, tmp_path / "recording", out)
    files_[0].mkdir()
    assert main(words) == 2
    told = capsys.readouterr().err
    assert f"{files_[0]}: cannot be written (it is a folder); give a file in one" in told
    assert list(out.iterdir()) == [files_[0]]


@pytest.mark.parametrize("name", ["analyse", "commission"])
def test_a_page_in_no_folder_is_refused_at_once(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words, _ = command(name, tmp_path / "recording", tmp_path / "no" / "such")
    if name == "commission":
        words[words.index("-o") + 1] = str(tmp_path / "stage.yaml")
    assert main(words) == 2
    assert f"no folder {tmp_path}/no/such" in capsys.readouterr().err


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recording and twin that take a second to diagnose."""
    folder = tmp_path_factory.mktemp("machine") / "case"
    write_case(make_machine_case(draw_machine(5), 5, "single", ["squareness"]), folder)
    return folder


def diagnose(case: Path, out: Path) -> int:
    return main(
        ["diagnose", str(case / "bag"), "--twin", str(case / "twin.yaml"), "-o", str(out), "--most-causes", "1"]
    )


@contextmanager
def full_disk(room: int) -> Iterator[None]:
    """Files that this process writes end after so many bytes, as on a disk that is full."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_disk_that_is_full_leaves_the_old_diagnosis(
    case: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The small file would have had room: it is not changed either, for it belongs to the page."""
    out = _folder(tmp_path / "out")
    old = {out / f"diagnosis.{each}": OLD for each in ("html", "json", "png")}
    for path, text in old.items():
        path.write_text(text, encoding="utf-8")
    with full_disk(20_000):
        assert diagnose(case, out) == 2
    told = capsys.readouterr().err
    assert "diagnosis." in told and "cannot be written (File too large)" in told and "Traceback" not in told
    assert {path: path.read_text(encoding="utf-8") for path in out.iterdir()} == old


@pytest.mark.parametrize("form", ["html", "html,json"])
def test_a_disk_that_is_full_leaves_the_old_analysis(
    form: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, out = write_stage_bag(tmp_path / "recording", 4), _folder(tmp_path / "out")
    old = {out / f"page.{each}": OLD for each in form.split(",")}
    for path, text in old.items():
        path.write_text(text, encoding="utf-8")
    with full_disk(20_000):
        assert main(["analyse", str(bag), "--format", form, "-o", str(out / "page.html")]) == 2
    told = capsys.readouterr().err
    assert "page." in told and "cannot be written (File too large)" in told and "Traceback" not in told
    assert {path: path.read_text(encoding="utf-8") for path in out.iterdir()} == old


@pytest.mark.parametrize("place", ["recording", "recording/*.mcap"])
def test_a_bag_that_may_not_be_read_is_told(place: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Also where the tests are run by root: it is tried as somebody else, in a folder that everybody may enter."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o755)
        bag, page = write_stage_bag(folder / "recording", 1), _folder(folder / "out") / "page.html"
        page.write_text(OLD, encoding="utf-8")
        page.parent.chmod(0o777)
        for path in folder.glob(place):
            path.chmod(0)
        is_root = os.geteuid() == 0
        if is_root:
            os.seteuid(65534)
        try:
            assert main(["analyse", str(bag), "-o", str(page)]) == 2
        finally:
            if is_root:
                os.seteuid(0)
            bag.chmod(0o755)
        assert re.search(r"recording.*Permission denied", capsys.readouterr().err)
        assert [each.read_text(encoding="utf-8") for each in page.parent.iterdir()] == [OLD]


def test_ctrl_c_while_a_page_is_written_leaves_the_old_one(
    case: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = _folder(tmp_path / "out")
    (out / "diagnosis.html").write_text(OLD, encoding="utf-8")
    synchronised: list[int] = []

    def interrupted(descriptor: int) -> None:
        synchronised.append(descriptor)
        if len(synchronised) == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(files.os, "fsync", interrupted)
    assert diagnose(case, out) == 130
    assert [path.name for path in out.iterdir()] == ["diagnosis.html"]
    assert (out / "diagnosis.html").read_text(encoding="utf-8") == OLD


def test_files_that_belong_together_are_all_written_or_none(tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    write_all({first: b"old", second: b"old"})
    with full_disk(SOME), pytest.raises(InputError, match=r"second: cannot be written \(File too large\)"):
        write_all({first: b"new", second: bytes(SOME + 1)})
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"first": b"old", "second": b"old"}
    write_all({first: b"new", second: b"newer"})
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"first": b"new", "second": b"newer"}
    write_all({})


@pytest.mark.parametrize("name", ["", "folder", "no/page.html", "a\0b", "a" * 300])
def test_a_place_where_no_file_can_be_is_told(name: str, tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    with pytest.raises(InputError, match=r"cannot be written \(.+\); give a file in a folder that exists"):
        write_whole(tmp_path / name, b"content")
    assert [path.name for path in tmp_path.iterdir()] == ["folder"] and not list((tmp_path / "folder").iterdir())


def test_a_folder_that_is_not_ours_is_told(tmp_path: Path) -> None:
    """Also where the tests are run by root: what is not allowed is tried as somebody else."""
    place = _folder(tmp_path / "theirs")
    (place / "page.html").write_text(OLD, encoding="utf-8")
    is_root = os.geteuid() == 0
    place.chmod(0o555)
    if is_root:
        os.seteuid(65534)
    try:
        with pytest.raises(InputError, match=r"page.html: cannot be written \(Permission denied\)"):
            write_whole(place / "page.html", b"new")
    finally:
        if is_root:
            os.seteuid(0)
        place.chmod(0o755)
    assert (place / "page.html").read_text(encoding="utf-8") == OLD


def test_nothing_takes_the_place_of_a_device_or_a_pipe(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    got: list[bytes] = []
    reader = threading.Thread(target=lambda: got.append(pipe.read_bytes()))
    reader.start()
    write_whole(pipe, b"content")
    reader.join(20.0)
    assert got == [b"content"] and stat.S_ISFIFO(pipe.stat().st_mode)
    assert list(tmp_path.iterdir()) == [pipe]
