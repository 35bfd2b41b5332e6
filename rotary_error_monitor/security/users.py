"""Users of a server by a file of hashed passwords: a line a user, `name:scrypt$N$r$p$salt$hash`, in hexadecimal."""

from __future__ import annotations

import hashlib
import hmac
import os
import re
import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from rotary_error_monitor.errors import InputError, excerpt

_N, _R, _P = 1 << 14, 8, 5
"""Cost of scrypt: 16 MiB and some 0.2 s a guess (OWASP, Password Storage Cheat Sheet)."""

_MOST_MEMORY = 64 << 20
_LINE = re.compile(r"([\w.@-]{1,64}):scrypt\$(\d{4,6})\$(\d{1,2})\$(\d{1,2})\$([0-9a-f]{16,128})\$([0-9a-f]{32,128})")
_FORM = "name:scrypt$N$r$p$salt$hash, as `rotary_error_monitor security user` writes it"
_OWNER_ONLY = 0o600


@dataclass(frozen=True)
class _Hash:
    """What is kept of a password: cost, salt, hash."""

    cost: tuple[int, int, int]
    salt: bytes
    digest: bytes

    def fits(self, password: str) -> bool:
        made = _derive(password, self.cost, self.salt, len(self.digest))
        return hmac.compare_digest(made, self.digest)


class Users:
    """Names and passwords that are let in."""

    def __init__(self, hashes: Mapping[str, _Hash]) -> None:
        self._hashes = dict(hashes)
        self._nobody = _Hash((_N, _R, _P), secrets.token_bytes(16), secrets.token_bytes(32))

    def accepts(self, name: str | None, password: str | None) -> bool:
        """Whether that is the password of that user; a name that is none takes as long as one that is."""
        known = self._hashes.get(name or "", self._nobody)
        return known.fits(password or "") and known is not self._nobody


def load_users(path: Path) -> Users:
    """Users of a file; empty lines and those that begin with `#` are left out.

    Raises:
        InputError: the file cannot be read, holds none, or a line is no user; the message names file and line.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: users cannot be read ({error}); expected lines {_FORM}") from error
    hashes: dict[str, _Hash] = {}
    for number, line in enumerate(lines, 1):
        if line.strip() and not line.startswith("#"):
            name, found = _read_line(line.strip(), f"{path}:{number}")
            if name in hashes:
                raise InputError(f"{path}:{number}: user '{name}' stands twice; keep one line")
            hashes[name] = found
    if not hashes:
        raise InputError(f"{path}: no user in this file; expected lines {_FORM}")
    return Users(hashes)


def add_user(path: Path, name: str, password: str) -> None:
    """Write a user into a file, in place of a line of that name; only the owner may read it.

    Raises:
        InputError: the name or the password will not do, the file cannot be written or is no file of users.
    """
    if len(password) < 8:
        raise InputError(f"the password of '{excerpt(name)}' has {len(password)} characters; expected at least 8")
    salt = secrets.token_bytes(16)
    cost = "$".join(map(str, (_N, _R, _P)))
    line = f"{name}:scrypt${cost}${salt.hex()}${_derive(password, (_N, _R, _P), salt, 32).hex()}"
    if not _LINE.fullmatch(line):
        raise InputError(f"user '{excerpt(name)}': expected letters, digits and . _ @ - in a name, at most 64")
    if path.exists():
        load_users(path)
    try:
        kept = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
        kept = [each for each in kept if not each.startswith(f"{name}:")]
        new = path.with_name(f"{path.name}.new")
        new.unlink(missing_ok=True)
        with os.fdopen(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, _OWNER_ONLY), "w", encoding="utf-8") as file:
            file.write("\n".join([*kept, line]) + "\n")
        new.replace(path)
    except OSError as error:
        raise InputError(f"{path}: the user cannot be written ({error}); give a file in a folder of yours") from error


def _read_line(line: str, where: str) -> tuple[str, _Hash]:
    found = _LINE.fullmatch(line)
    if found is None:
        raise InputError(f"{where}: no user; expected {_FORM}")  # never the line itself: it may be a plain password
    name, *cost, salt, digest = found.groups()
    n, r, p = map(int, cost)
    if n & (n - 1) or 128 * n * r > _MOST_MEMORY or not (r and p):
        raise InputError(
            f"{where}: cost N={n}, r={r}, p={p} of scrypt; expected N a power of two, 128 N r below 64 MiB"
        )
    return name, _Hash((n, r, p), bytes.fromhex(_even(salt, where)), bytes.fromhex(_even(digest, where)))


def _even(text: str, where: str) -> str:
    if len(text) % 2:
        raise InputError(f"{where}: salt or hash of {len(text)} hexadecimal digits; expected an even number: {_FORM}")
    return text


def _derive(password: str, cost: tuple[int, int, int], salt: bytes, length: int) -> bytes:
    n, r, p = cost
    return hashlib.scrypt(password.encode(), salt=salt, n=n, r=r, p=p, maxmem=2 * _MOST_MEMORY, dklen=length)
