"""Bags below a folder, in every layout in which recorders and people leave them."""

from __future__ import annotations

import os

import pytest

from rotary_error_monitor.bags.marks import is_bag
from rotary_error_monitor.bags.search import find_bags, fingerprint_of
from rotary_error_monitor.errors import InputError


def make(folder, *names):
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        (folder / name).write_text(name)
    return folder


def found(folder):
    return [path.relative_to(folder).as_posix() for path in find_bags(folder)]


def test_bags_are_found_in_every_layout(tmp_path):
    make(tmp_path / "b" / "whole", "metadata.yaml", "whole_0.mcap", "whole_1.mcap")
    make(tmp_path / "b" / "whole" / "within", "metadata.yaml")
    make(tmp_path / "killed", "killed_0.mcap", "killed_1.mcap")
    make(tmp_path / "v1.2_x", "v1.2_x_0.db3.zstd")
    make(tmp_path / "loose", "run_1.mcap", "run_2.mcap", "other.db3", "notes.txt")
    make(tmp_path / "empty")
    (tmp_path / "link").symlink_to(tmp_path / "b", target_is_directory=True)
    (tmp_path / "circle").symlink_to(tmp_path, target_is_directory=True)
    assert found(tmp_path) == [
        *("b/whole", "killed", "loose/other.db3", "loose/run_1.mcap", "loose/run_2.mcap", "v1.2_x")
    ]
    assert found(tmp_path / "b" / "whole") == ["."]
    assert is_bag(tmp_path / "killed") and is_bag(tmp_path / "loose" / "other.db3") and is_bag(tmp_path / "loose")
    assert not is_bag(tmp_path) and not is_bag(tmp_path / "empty") and not is_bag(tmp_path / "loose" / "notes.txt")


def test_a_folder_without_bags_and_none_at_all_are_named(tmp_path):
    make(tmp_path / "empty", "notes.txt")
    for path, said in ((tmp_path / "empty", "no bag below it"), (tmp_path / "nothing", "no such folder")):
        with pytest.raises(InputError, match=said):
            find_bags(path)
    with pytest.raises(InputError, match="no folder; give a folder"):
        find_bags(tmp_path / "empty" / "notes.txt")


def test_a_fingerprint_changes_with_the_files_and_not_with_the_place(tmp_path):
    bag = make(tmp_path / "bag", "metadata.yaml", "bag_0.mcap")
    first = fingerprint_of(bag)
    (bag / "within").mkdir()
    assert fingerprint_of(bag.rename(tmp_path / "moved")) == first
    bag = tmp_path / "moved"
    status = (bag / "bag_0.mcap").stat()
    os.utime(bag / "bag_0.mcap", ns=(status.st_atime_ns, status.st_mtime_ns + 1))
    touched = fingerprint_of(bag)
    (bag / "bag_0.mcap").write_text("longer than before")
    os.utime(bag / "bag_0.mcap", ns=(status.st_atime_ns, status.st_mtime_ns))
    longer = fingerprint_of(bag)
    (bag / "bag_0.mcap").rename(bag / "bag_1.mcap")
    assert len({first, touched, longer, fingerprint_of(bag)}) == 4
    (bag / "metadata.yaml").unlink()
    (bag / "bag_1.mcap").unlink()
    with pytest.raises(InputError, match="is it being removed"):
        fingerprint_of(bag / "bag_1.mcap")
