"""Users of a file: their own passwords alone let them in, no password stands there, and wrong files are refused."""

from __future__ import annotations

import hashlib
import io
import random
import stat
import string

import pytest

from rotary_error_monitor.cli import main
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.security.users import add_user, load_users


def test_only_its_own_password_lets_a_user_in(tmp_path):
    drawn = random.Random(5)
    file = tmp_path / "users"
    passwords = {f"user{n}": "".join(drawn.choices(string.printable[:94] + "µ°", k=12)) for n in range(2)}
    for name, password in passwords.items():
        add_user(file, name, password)
    users = load_users(file)
    assert [users.accepts(*each) for each in passwords.items()] == [True, True]
    assert not users.accepts("user0", passwords["user1"])
    assert not users.accepts("nobody", passwords["user1"])
    assert not users.accepts(None, None)
    text = file.read_text(encoding="utf-8")
    assert not any(password in text for password in passwords.values())
    assert stat.S_IMODE(file.stat().st_mode) == 0o600


def test_the_file_holds_what_scrypt_makes(tmp_path):
    """Against the standard library, by the line's own words (RFC 7914)."""
    add_user(tmp_path / "users", "ann", "correct horse")
    name, form = (tmp_path / "users").read_text().strip().split(":")
    kind, n, r, p, salt, digest = form.split("$")
    made = hashlib.scrypt(
        b"correct horse", salt=bytes.fromhex(salt), n=int(n), r=int(r), p=int(p), dklen=32, maxmem=1 << 26
    )
    assert (name, kind, digest) == ("ann", "scrypt", made.hex())


def test_a_user_who_is_there_gets_the_new_password(tmp_path, monkeypatch, capsys):
    file = tmp_path / "users"
    for password in ("first one", "second one"):
        monkeypatch.setattr("sys.stdin", io.StringIO(f"{password}\n"))
        assert main(["security", "user", str(file), "ann"]) == 0
    assert "second one" not in capsys.readouterr().out
    assert file.read_text(encoding="utf-8").count("ann:") == 1
    assert not load_users(file).accepts("ann", "first one")
    assert load_users(file).accepts("ann", "second one")


GOOD = f"ann:scrypt$16384$8$5${'ab' * 16}${'cd' * 32}"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "no user in this file"),
        ("# none\n\n", "no user in this file"),
        ("ann:secret-word\n", r"users:1: no user; expected name:scrypt"),
        (f"{GOOD}\nbob:scrypt$1$8$5$ab$cd\n", r"users:2: no user"),
        (f"{GOOD}\n{GOOD}\n", r"users:2: user 'ann' stands twice"),
        (GOOD.replace("16384", "16385"), "N=16385, r=8, p=5 of scrypt; expected N a power of two"),
        (GOOD.replace("16384", "524288"), "below 64 MiB"),
        (GOOD + "e", "65 hexadecimal digits; expected an even number"),
    ],
)
def test_what_is_no_file_of_users_is_refused_with_its_place(tmp_path, text, reason):
    (tmp_path / "users").write_text(text)
    with pytest.raises(InputError, match=reason) as refused:
        load_users(tmp_path / "users")
    assert "secret-word" not in str(refused.value)


def test_names_and_passwords_that_will_not_do_are_refused(tmp_path):
    with pytest.raises(InputError, match="has 5 characters; expected at least 8"):
        add_user(tmp_path / "users", "ann", "short")
    with pytest.raises(InputError, match="expected letters, digits"):
        add_user(tmp_path / "users", "a:b", "long enough")
    with pytest.raises(InputError, match=r"absent/users: the user cannot be written"):
        add_user(tmp_path / "absent" / "users", "ann", "long enough")
    assert not (tmp_path / "users").exists()
    with pytest.raises(InputError, match="users cannot be read"):
        load_users(tmp_path / "users")
