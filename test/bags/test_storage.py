"""The file below a recorder: all or nothing of each write, and space kept back."""

from __future__ import annotations

import errno
import os
import resource
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from rotary_error_monitor.bags.lock import holder
from rotary_error_monitor.bags.part import CHUNK_SIZE
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.bags.storage import RecordFile, Reserve
from rotary_error_monitor.bags.writer import BagTopic, BagWriter, RecordingStoppedError
from rotary_error_monitor.codec.contents import TYPES, Temperature
from rotary_error_monitor.codec.messages import encode

TOPIC = BagTopic("/machine/temperature", TYPES[Temperature])
KIB = 1024


@contextmanager
def file_size_limit(size: int) -> Iterator[None]:
    """No file of this process may grow beyond `size` bytes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_write_that_does_not_fit_leaves_the_file_as_it_was(tmp_path: Path) -> None:
    file = RecordFile(tmp_path / "file", Reserve(tmp_path / "reserve"))
    file.write(b"a" * 60 * KIB)
    with file_size_limit(100 * KIB), pytest.raises(OSError, match="File too large"):
        file.write(b"b" * 60 * KIB)  # the first 40 KiB of it fit
    assert (tmp_path / "file").read_bytes() == b"a" * 60 * KIB
    assert file.trouble is not None and file.trouble.errno == errno.EFBIG
    assert not (tmp_path / "reserve").exists()
    file.write(b"c")  # where there is room again, it goes on behind what is whole
    file.close()
    assert (tmp_path / "file").read_bytes() == b"a" * 60 * KIB + b"c"


def test_the_reserve_holds_space_until_it_is_released(tmp_path: Path) -> None:
    reserve = Reserve(tmp_path / "reserve")
    reserve.grow_to(1)
    status = (tmp_path / "reserve").stat()
    assert status.st_size == 256 * KIB and status.st_blocks * 512 >= 256 * KIB
    reserve.grow_to(300 * KIB)
    assert (tmp_path / "reserve").stat().st_size == 512 * KIB
    reserve.release()
    assert not reserve.held and not (tmp_path / "reserve").exists()
    reserve.grow_to(KIB)  # what is released stays released
    assert not (tmp_path / "reserve").exists()


@pytest.mark.parametrize(("code", "full"), [(errno.ENOSPC, True), (errno.EDQUOT, True), (errno.EOPNOTSUPP, False)])
def test_a_disk_without_room_for_the_reserve_is_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int, full: bool
) -> None:
    def fail(*_: int) -> None:
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(os, "posix_fallocate", fail)
    file = RecordFile(tmp_path / "file", Reserve(tmp_path / "reserve"))
    file.reserve(KIB)
    # A file system that cannot keep space back is no reason not to record.
    assert (file.trouble is not None) == full
    assert not (tmp_path / "reserve").exists()
    file.write(b"a")
    file.close()


def test_a_recording_ends_with_a_whole_bag_while_there_is_room_for_its_index(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    left = 2 * CHUNK_SIZE + 4 * 256 * KIB

    def allocate(_: int, __: int, size: int) -> None:
        if size > left:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "posix_fallocate", allocate)
    with pytest.raises(RecordingStoppedError, match=r"No space left on device; the bag is complete up to here"):  # noqa: SIM117
        with BagWriter(tmp_path / "bag", [TOPIC], flush_period=0.0) as writer:
            for number in range(100_000):
                writer.write(TOPIC.name, encode(Temperature(number, float(number))), number)
    # The room that was kept back does for the index of all chunks; the footer says where it starts.
    content = (tmp_path / "bag" / "bag_0.mcap").read_bytes()
    (summary_start,) = struct.unpack("<Q", content[-28:-20])
    assert 2 * 256 * KIB < len(content) - summary_start < left
    reader = BagReader(tmp_path / "bag")
    assert reader.damage is None and reader.topics[TOPIC.name].count == writer.counts.total() > 5_000
    with pytest.raises(RecordingStoppedError, match="No space left"):
        writer.flush()


def test_a_bag_that_cannot_grow_at_all_leaves_nothing_open(tmp_path: Path) -> None:
    with file_size_limit(4), pytest.raises(OSError, match="File too large"):
        BagWriter(tmp_path / "bag", [TOPIC])
    assert list((tmp_path / "bag").iterdir()) == []


@pytest.mark.parametrize("place", [".reserve", "bag_0.mcap", ".metadata.yaml.new"])
def test_a_bag_that_cannot_be_begun_is_let_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str) -> None:
    made = Path.open

    def refuse(path: Path, *arguments: str, **options: str) -> object:
        if path.name == place:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return made(path, *arguments, **options)  # type: ignore[call-overload]

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(OSError, match="Input/output error"):
        BagWriter(tmp_path / "bag", [TOPIC])
    monkeypatch.undo()
    assert holder(tmp_path / "bag") == "" and not (tmp_path / "bag" / ".reserve").exists()


def test_a_bag_that_cannot_be_closed_says_so(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "bag", [TOPIC], flush_period=0.0)
    writer.write(TOPIC.name, encode(Temperature(1, 1.0)), 1)
    size = (tmp_path / "bag" / "bag_0.mcap").stat().st_size
    with (
        file_size_limit(size + 10),
        pytest.raises(RecordingStoppedError, match="File too large; what was written is kept"),
    ):
        writer.close()
    reader = BagReader(tmp_path / "bag")
    assert reader.damage is not None and reader.read() == {TOPIC.name: [Temperature(1, 1.0)]}
