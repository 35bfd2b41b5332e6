"""A short fuzz of every kind of file that the package reads, and again what once failed.

Inputs are drawn from seeds that are always the same: what is new is found by `make fuzz` and kept in the corpus.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from random import Random

import pytest

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.errors import InputError

from .fuzzing import Fault, Fuzzer
from .mutations import BINARY, MCAP, TEXT, change_record, mutate
from .sandbox import Run, Sandbox
from .targets import CORPUS, Target, targets

RUNS = 4
"""Files of each kind: some ten seconds in all."""

LARGEST = 30_000
"""Bytes of a file in the corpus, which every checkout holds."""

NAMES = (
    *("stage", "machine", "mount", "quadrature", "wire", "cell", "positioning", "straightness", "profile", "tracker"),
    *("direct", "workpiece", "program"),
    *("collimator", "poses", "pointings", "signals", "mcap", "definition", "metadata", "db3"),
)


@pytest.fixture(scope="module")
def templates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("templates")


@pytest.fixture(scope="module")
def all_targets(templates: Path) -> dict[str, Target]:
    return {target.name: target for target in targets(templates)}


@pytest.fixture
def fuzzer(sandbox: Sandbox, tmp_path: Path, templates: Path) -> Iterator[Fuzzer]:
    """After the test, every run of it must have ended cleanly."""
    found = Fuzzer(sandbox, tmp_path / "tried", templates)
    yield found
    assert not found.faults, "\n".join(str(fault.run) for fault in found.faults)


@pytest.mark.parametrize("name", NAMES)
def test_whole_files_are_read(name: str, all_targets: dict[str, Target], fuzzer: Fuzzer) -> None:
    """What is fuzzed is read where nothing is wrong with it: else every error would be the same one."""
    target = all_targets[name]
    for seed in target.seeds[1:]:
        fuzzer.read(target, 0, seed)
    for command in range(len(target.commands(fuzzer.folder))):
        fuzzer.read(target, command, target.seeds[0])
    codes = {code for (_, code), count in fuzzer.codes.items() if count}
    assert codes & {0, 10, 11, 12}, codes


@pytest.mark.parametrize("name", NAMES)
def test_changed_files_end_cleanly(name: str, all_targets: dict[str, Target], fuzzer: Fuzzer) -> None:
    for seed in range(RUNS):
        fuzzer.draw(all_targets[name], seed)
    assert fuzzer.codes.total() == RUNS


@pytest.mark.parametrize("path", sorted(CORPUS.glob("*/*")), ids=lambda path: f"{path.parent.name}-{path.name}")
def test_what_once_failed_ends_cleanly(path: Path, all_targets: dict[str, Target], fuzzer: Fuzzer) -> None:
    fuzzer.read(all_targets[path.parent.name], int(path.name.partition("_")[0]), path.read_bytes())


def test_the_corpus_is_small_and_belongs_to_targets(all_targets: dict[str, Target]) -> None:
    assert set(all_targets) == set(NAMES)
    for path in CORPUS.glob("*/*"):
        assert path.parent.name in all_targets and path.stat().st_size <= LARGEST, path


def test_mutations_change_files_and_give_the_same_for_the_same_seed(all_targets: dict[str, Target]) -> None:
    for target in all_targets.values():
        drawn = [target.input(Random(seed)) for seed in range(30)]
        assert drawn == [target.input(Random(seed)) for seed in range(30)]
        assert len(set(drawn) - set(target.seeds)) > 20, target.name
    for mutations in (TEXT, BINARY, MCAP):
        assert isinstance(mutate(b"", mutations, Random(1)), bytes)


def test_some_changes_of_a_record_are_believed(all_targets: dict[str, Target], tmp_path: Path) -> None:
    """The checksum of the chunk is made good: else all that is tried would end at the checksum."""
    whole, believed = all_targets["mcap"].seeds[0], 0
    for seed in range(60):
        path = tmp_path / f"{seed}.mcap"
        path.write_bytes(change_record(whole, Random(seed)))
        with contextlib.suppress(InputError):
            believed += path.read_bytes() != whole and BagReader(path).damage is None
    assert believed > 3


def test_what_fails_is_kept_under_a_name_of_its_own(all_targets: dict[str, Target], tmp_path: Path) -> None:
    run = Run((), 1, None, 0.0, "")
    faults = [Fault(all_targets[name], 0, content, run) for name in ("stage", "db3") for content in (b"a", b"b", b"a")]
    paths = {fault.keep(tmp_path) for fault in faults}
    assert len(paths) == 4 and all(path.parent.parent == tmp_path for path in paths)
    assert {path.read_bytes() for path in paths} == {b"a", b"b"} and {path.name[:2] for path in paths} == {"0_"}
