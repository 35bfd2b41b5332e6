"""YAML files changed in place: only the lines of what is calibrated differ, and what was there before is kept."""

from __future__ import annotations

import hashlib
import os
import re
import secrets
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import yaml
from numpy.typing import NDArray

from rotary_error_monitor.bags.lock import FileLock
from rotary_error_monitor.calibration.yaml_text import LOADER, CannotChangeError, Keys, YamlRows, YamlText, plain
from rotary_error_monitor.description.provenance import MOST_HISTORY, Calibrated
from rotary_error_monitor.description.sections import write
from rotary_error_monitor.description.yaml_files import read_yaml
from rotary_error_monitor.errors import InputError

T = TypeVar("T")
_PART = 1 << 20
"""Bytes of a file that are hashed at once: a bag may be larger than the memory."""

DIGITS = 6
"""Significant digits of a number in a file: a part in a million of an error is far below any uncertainty."""


def hash_source(path: Path) -> str:
    """SHA-256 of a file, or of all files of a folder such as a bag.

    Raises:
        InputError: there is nothing to read.
    """
    files = [path] if path.is_file() else sorted(file for file in path.rglob("*") if file.is_file())
    if not files:
        raise InputError(f"{path}: no such file or folder")
    digest = hashlib.sha256()
    for file in files:
        with file.open("rb") as content:
            while part := content.read(_PART):
                digest.update(part)
    return digest.hexdigest()


@contextmanager
def changing(path: Path) -> Iterator[None]:
    """The right to change a file, from before it is read until it is replaced; a file that is not there needs none.

    Raises:
        InputError: another process has it.
    """
    try:
        lock = FileLock.wait(path) if path.is_file() else None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    try:
        yield
    finally:
        if lock is not None:
            lock.release()


class YamlDocument:
    """A YAML file of which one section is being calibrated; nothing is on disk before `save`.

    Attributes:
        section: path of that section.
    """

    def __init__(self, path: Path, section: str) -> None:
        """Read the file, which has been found valid before.

        Raises:
            InputError: the file cannot be read or is no such YAML as the package reads.
        """
        self.section: Keys = (section,)
        self._path = path
        self._before = read_yaml(path).text
        self._text = YamlText(self._before)
        self._replaced: dict[str, dict[str, Any]] = {}

    @property
    def content(self) -> dict[str, Any]:
        """The section as it is now."""
        found: dict[str, Any] = self._text.get(self.section)
        return found

    def get(self, *place: str | int) -> Any:  # noqa: ANN401 (YAML content)
        """The value at a place in the section, None if there is none."""
        return self._text.get((*self.section, *place))

    def set(self, part: str, name: str, place: Keys, value: Any) -> None:  # noqa: ANN401 (YAML content)
        """Put a value there; what it was before goes by `name` to the history of the calibrated `part`.

        Raises:
            InputError: another place of the file needs what stands there (an anchor and its alias).
        """
        self._keep(part, name, self.get(*place))
        with _said(self._path):
            comment = self._text.set((*self.section, *place), value)
        if comment is not None:
            self._replaced[part].setdefault("comment", comment.lstrip("# "))

    def remove(self, part: str, name: str, place: Keys) -> None:
        """Take an entry out; what it was before goes by `name` to the history of the calibrated `part`.

        Raises:
            InputError: another place of the file needs what stands there, or it is merged in from one.
        """
        if self.get(*place) is not None:
            self._keep(part, name, self.get(*place))
            with _said(self._path):
                self._text.remove((*self.section, *place))

    def rewrite(self, content: YamlRows) -> None:
        """Write the whole section anew."""
        with _said(self._path):
            self._text.set(self.section, content)

    def note(self, part: str, provenance: Calibrated) -> None:
        """Write down under `calibration` where a part of the section is from, and what was there before."""
        before = self.get("calibration", part)
        before = dict(before) if isinstance(before, dict) else {}
        earlier = before.pop("history", [])
        replaced = self._replaced.pop(part, {})
        if replaced or before:
            earlier = [{**before, **replaced}, *earlier]
        uncertainty = None if provenance.uncertainty is None else number(provenance.uncertainty)
        figures = {key: number(value) for key, value in provenance.figures.items()}
        row = write(replace(provenance, uncertainty=uncertainty, figures=figures))
        if earlier:
            row["history"] = YamlRows(earlier[:MOST_HISTORY])
        with _said(self._path):
            self._text.set((*self.section, "calibration", part), YamlRows(row))

    def save(self, path: Path, check: Callable[[Path], T], source: Path | None = None) -> T:
        """Write the file, whole or not at all; `check` loads the draft beside it and gives what is in it.

        What `check` does not accept is told of the `source`, the measurements that it comes from.

        Raises:
            InputError: what `check` raises, or the file has changed since it was read (nothing is written then), or it
                cannot be written.
        """
        target = path.resolve()
        # a name of its own: another process may write a draft of the same file
        draft = target.with_name(f".{target.name}.{secrets.token_hex(4)}.draft")
        try:
            with draft.open("xb") as file:
                file.write(self._text.text.encode("utf-8"))
            if yaml.load(self._text.text, LOADER) != self._text.content:
                raise InputError(
                    f"{self._path}: its YAML cannot be changed in place; load it and write it out plainly, then "
                    "calibrate that"
                )
            found = _checked(draft, path, source or self._path, check)
            if target == self._path.resolve() and read_yaml(target).text != self._before:
                raise InputError(f"{path}: somebody has changed it since it was read; calibrate once more")
            if target.exists():
                _keep_owner(target, draft)
                shutil.copymode(target, draft)
            draft.replace(target)
        except OSError as error:
            raise InputError(f"{path}: cannot be written ({error})") from error
        finally:
            draft.unlink(missing_ok=True)
        return found

    def _keep(self, part: str, name: str, value: Any) -> None:  # noqa: ANN401 (YAML content)
        """The first value that stood there counts: a later one is of this calibration itself."""
        self._replaced.setdefault(part, {}).setdefault("values", {}).setdefault(name, plain(value))


def _checked(draft: Path, path: Path, source: Path, check: Callable[[Path], T]) -> T:
    """What is in a draft; what is wrong with it is told of what was read, for the draft has no lines to look at."""
    try:
        return check(draft)
    except InputError as error:
        problem = re.sub(rf"^{re.escape(str(draft))}(:\d+)?: ", "", str(error)).replace(str(draft), str(path))
        raise InputError(f"{source}: what was found cannot stand in {path}: {problem}") from error


def _keep_owner(target: Path, draft: Path) -> None:
    """Give the draft the owner and group of the file that it replaces, as far as this process may."""
    status = target.stat()
    for user, group in ((-1, status.st_gid), (status.st_uid, -1)):
        with suppress(OSError):  # not permitted, or not known to the file system
            os.chown(draft, user, group)


@contextmanager
def _said(path: Path) -> Iterator[None]:
    try:
        yield
    except CannotChangeError as error:
        raise InputError(f"{path}: {error}") from error


def number(value: float) -> float:
    """The value to the digits that a file holds."""
    return float(f"{value:.{DIGITS}g}")


def numbers(values: NDArray[np.float64]) -> list[float]:
    """The values to the digits that a file holds."""
    return [number(float(value)) for value in values]
