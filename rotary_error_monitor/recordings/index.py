"""What is known of the bags below a folder, in one DuckDB file: what did not change is not read again.

Each bag is written in one transaction with all that was found in it, so that whoever is ended, and however, leaves an
index that is right as far as it goes.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from types import ModuleType
from typing import Any, Self

from rotary_error_monitor import __version__
from rotary_error_monitor.analysis.result import Figure
from rotary_error_monitor.errors import InputError, excerpt
from rotary_error_monitor.files import exists

APPLICATION = "rotary_error_monitor trend"
SCHEMA = 1
NAME = "trend.duckdb"
"""Of the index within the folder that it is of."""

_FIGURE = tuple(each.name for each in fields(Figure))
_TABLES = (
    "CREATE TABLE about (application VARCHAR, schema INTEGER, made_by VARCHAR)",
    "CREATE TABLE questions (question VARCHAR, asked JSON)",
    "CREATE SEQUENCE recording_ids",
    "CREATE TABLE recordings (recording BIGINT, folder VARCHAR, bag VARCHAR, cell VARCHAR, question VARCHAR, "
    "fingerprint VARCHAR, version VARCHAR, stage VARCHAR, started_ns BIGINT, reason VARCHAR, remarks VARCHAR[])",
    "CREATE TABLE segments (recording BIGINT, segment VARCHAR, speed DOUBLE)",
    "CREATE TABLE figures (recording BIGINT, name VARCHAR, segment VARCHAR, value DOUBLE, expanded_uncertainty DOUBLE, "
    "unit VARCHAR, measured DOUBLE, turns INTEGER, cut_off INTEGER, bandwidth DOUBLE)",
    "CREATE VIEW history AS SELECT stage, cell, bag, make_timestamp_ns(started_ns) AS started, question, name, "
    "segment, value, expanded_uncertainty, unit FROM recordings JOIN figures USING (recording)",
)
_CONFIG: dict[str, str | bool | int | float | list[str]] = {
    "threads": 1,  # the others are for what reads bags
    "memory_limit": "512MB",
    "autoinstall_known_extensions": False,  # nothing is fetched
}


@dataclass(frozen=True)
class IndexEntry:
    """What a bag says of one of its cells, or why it says nothing.

    Attributes:
        cell: namespace; `/` for none, empty where the bag cannot be read at all.
        stage: name that the bag gives to the stage; empty where it gives none.
        started_ns: when the recording began, ns; None where nobody knows.
        figures: as `analyse` gives them.
        speeds: of the segments, rad/s, by their names.
        reason: why it cannot be analysed; empty where it can.
        remarks: what a reader should know.
    """

    cell: str
    stage: str = ""
    started_ns: int | None = None
    figures: tuple[Figure, ...] = ()
    speeds: tuple[tuple[str, float], ...] = ()
    reason: str = ""
    remarks: tuple[str, ...] = ()


class Index:
    """The index, open to be read and written by this process alone.

    Raises:
        InputError: DuckDB is not installed; the file is none of ours, or of a newer version; it cannot be written.
    """

    def __init__(self, path: Path, folder: Path) -> None:
        self._duckdb = _library()
        # an index within its folder goes where the folder goes
        inside = path.resolve().is_relative_to(folder.resolve())
        self._folder = "." if inside else str(folder.resolve())
        self.path = path
        if not exists(path):
            self._make()
        self._check()
        with self._errors("cannot be opened"):
            self._connection = self._duckdb.connect(str(path), config=_CONFIG)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._connection.close()

    def fingerprints(self, question: str) -> Mapping[str, str]:
        """Fingerprint by bag, of those that this version of the package has read for the question."""
        rows = self._all(
            "SELECT DISTINCT bag, fingerprint FROM recordings WHERE folder = ? AND question = ? AND version = ?",
            [self._folder, question, __version__],
        )
        return dict(rows)

    def bags(self) -> set[str]:
        """All bags, whatever was asked of them."""
        return {bag for (bag,) in self._all("SELECT DISTINCT bag FROM recordings WHERE folder = ?", [self._folder])}

    def entries(self, question: str) -> Iterator[tuple[str, IndexEntry]]:
        """What is known, with the bag that it is of, ordered by bag and cell."""
        rows = self._all(
            "SELECT recording, bag, cell, stage, started_ns, reason, remarks FROM recordings "
            "WHERE folder = ? AND question = ? ORDER BY bag, cell",
            [self._folder, question],
        )
        figures: dict[int, list[Figure]] = defaultdict(list)
        speeds: dict[int, list[tuple[str, float]]] = defaultdict(list)
        here = "FROM recordings JOIN {} USING (recording) WHERE folder = ? AND question = ? ORDER BY {}.rowid"
        for recording, *columns in self._all(
            f"SELECT recording, {', '.join(_FIGURE)} {here.format('figures', 'figures')}", [self._folder, question]
        ):
            figures[recording].append(Figure(*columns))
        for recording, segment, speed in self._all(
            f"SELECT recording, segment, speed {here.format('segments', 'segments')}", [self._folder, question]
        ):
            speeds[recording].append((segment, speed))
        for recording, bag, cell, stage, started_ns, reason, remarks in rows:
            own = tuple(figures[recording]), tuple(speeds[recording])
            yield bag, IndexEntry(cell, stage, started_ns, *own, reason, tuple(remarks))

    def put(self, bag: str, question: str, fingerprint: str, entries: Iterable[IndexEntry]) -> None:
        """Replace what is known of a bag for a question: all of it at once, or nothing."""
        with self._transaction():
            self._delete("folder = ? AND bag = ? AND question = ?", [self._folder, bag, question])
            for entry in entries:
                ((recording,),) = self._all("SELECT nextval('recording_ids')", [])
                about = [recording, self._folder, bag, entry.cell, question, fingerprint, __version__, entry.stage]
                self._insert("recordings", [[*about, entry.started_ns, entry.reason, list(entry.remarks)]])
                self._insert("segments", [[recording, *row] for row in entry.speeds])
                self._insert("figures", [[recording, *astuple(figure)] for figure in entry.figures])

    def note_question(self, question: str, asked: Mapping[str, object]) -> None:
        """Write down in plain words what a question is, for people."""
        with self._transaction():
            self._connection.execute("DELETE FROM questions WHERE question = ?", [question])
            self._insert("questions", [[question, json.dumps(asked)]])

    def forget(self, bags: Iterable[str]) -> None:
        """Remove all that is known of bags."""
        with self._transaction():
            for bag in bags:
                self._delete("folder = ? AND bag = ?", [self._folder, bag])

    def _delete(self, where: str, values: Sequence[object]) -> None:
        chosen = f"IN (SELECT recording FROM recordings WHERE {where})"
        for table in ("figures", "segments"):
            self._connection.execute(f"DELETE FROM {table} WHERE recording {chosen}", values)
        self._connection.execute(f"DELETE FROM recordings WHERE {where}", values)

    def _insert(self, table: str, rows: Sequence[Sequence[object]]) -> None:
        """One statement for all rows: each for itself takes as long as all."""
        if rows:
            marks = f"({', '.join('?' * len(rows[0]))})"
            values = [value for row in rows for value in row]
            self._connection.execute(f"INSERT INTO {table} VALUES {', '.join([marks] * len(rows))}", values)

    def _all(self, statement: str, values: Sequence[object]) -> list[Any]:
        with self._errors("cannot be read"):
            found: list[Any] = self._connection.execute(statement, values).fetchall()
            return found

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[None]:
        with self._errors("cannot be written"):
            self._connection.begin()
            try:
                yield
            except BaseException:
                self._connection.rollback()
                raise
            self._connection.commit()

    def _make(self) -> None:
        """A new index takes its place when it is whole."""
        temporary = self.path.with_name(f".{self.path.name}.{os.getpid()}.part")
        try:
            with self._errors("cannot be made"):
                connection = self._duckdb.connect(str(temporary), config=_CONFIG)
                with connection:
                    for table in _TABLES:
                        connection.execute(table)
                    about = [APPLICATION, SCHEMA, f"rotary_error_monitor {__version__}"]
                    connection.execute("INSERT INTO about VALUES (?, ?, ?)", about)
                temporary.replace(self.path)
        finally:
            with contextlib.suppress(OSError):
                temporary.unlink()

    def _check(self) -> None:
        """Refuse a file of somebody else before anything in it could be changed."""
        with self._errors("no index of the trend, left as it is"):
            # configured otherwise, this process could not open it again to write
            connection = self._duckdb.connect(str(self.path), read_only=True, config=_CONFIG)
            with connection:
                tables = {row[0] for row in connection.execute("SELECT table_name FROM duckdb_tables()").fetchall()}
                ours = "about" in tables
                rows = connection.execute("SELECT application, schema FROM about").fetchall() if ours else []
        if [row[0] for row in rows] != [APPLICATION]:
            raise InputError(
                f"{self.path}: a database of something else, left as it is; name another file with --index"
            )
        if rows[0][1] != SCHEMA:
            raise InputError(
                f"{self.path}: an index of version {rows[0][1]}, and this program knows version {SCHEMA}; left as it "
                "is: name another file with --index, or use the program that made it"
            )

    @contextlib.contextmanager
    def _errors(self, what: str) -> Iterator[None]:
        try:
            yield
        except (self._duckdb.Error, OSError) as error:
            told = str(error)
            if "lock" in told:
                raise InputError(f"{self.path}: another process has the index open; let it end first") from error
            raise InputError(
                f"{self.path}: {what} ({excerpt(told)}); name a file in a folder that may be written with --index"
            ) from error


def _library() -> ModuleType:
    try:
        import duckdb
    except ImportError:
        raise InputError("the index needs the package duckdb: pip install 'rotary_error_monitor[trend]'") from None
    return duckdb
