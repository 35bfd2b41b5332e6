"""Where the data files of the package lie: `config/` and `msg_defs/`."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from rotary_error_monitor.errors import InputError

PACKAGE = "rotary_error_monitor"


@cache
def share() -> Path:
    """Folder that holds `package.xml`, `config/` and `msg_defs/`.

    In a checkout (and an editable install) it is the checkout; where the package is installed (pip, colcon, apt) it is
    `share/rotary_error_monitor` below the prefix. Climbing from this file finds either without an environment variable.

    Raises:
        InputError: the installation holds no such folder.
    """
    here = Path(__file__).resolve()
    for parent in here.parents:
        for folder in (parent, parent / "share" / PACKAGE):
            if (folder / "package.xml").is_file() and (folder / "msg_defs").is_dir():
                return folder
    raise InputError(f"no share/{PACKAGE} above {here}: the installation is incomplete, install the package again")


def config(name: str) -> Path:
    """Path of a file below `config/`, such as `stage.yaml` or `machines/pan2013.yaml`.

    Raises:
        InputError: there is no such file.
    """
    path = share() / "config" / name
    if not path.is_file():
        raise InputError(f"no {name} in {share() / 'config'}")
    return path
