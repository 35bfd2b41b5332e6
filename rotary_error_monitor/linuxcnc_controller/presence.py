"""Whether a LinuxCNC runs here, and whether it still does."""

from __future__ import annotations

import os
import subprocess
from contextlib import suppress
from pathlib import Path

from rotary_error_monitor.errors import InputError

SHARED_MEMORY = Path("/proc/sysvipc/shm")
_HAL_KEY = 0x48414C32
_STATUS_KEY = 1002
TASK = "inihal"
"""HAL component of the task process."""

_PROCESSES = ("linuxcncsvr", "milltask", "rtapi_app")


def runs(table: str) -> bool:
    """Whether the system's table of shared memory (`/proc/sysvipc/shm`) shows a LinuxCNC.

    Asked before LinuxCNC's modules are: they would wait, or make empty segments of their own.
    """
    keys = {int(line.split()[0]) for line in table.splitlines()[1:] if line.split()}
    return {_HAL_KEY, _STATUS_KEY} <= keys


def component_pid(listing: str, name: str) -> int | None:
    """Process id of a component in what `halcmd show comp` prints; None if it is not there.

    The columns are id, type (User or RT), name, process id, state.
    """
    for line in listing.splitlines():
        words = line.split()
        if len(words) >= 4 and words[1] == "User" and words[2] == name:
            return int(words[3])
    return None


def find_namesakes(processes: Path) -> list[int]:
    """Ids of processes of any LinuxCNC, in namespaces or not, that starting or stopping one by name would end.

    Args:
        processes: the system's table of processes, `/proc`.
    """
    found = []
    for path in processes.glob("[0-9]*/stat"):
        with suppress(OSError):  # it may end while we look
            name, _, rest = path.read_text().partition("(")[2].rpartition(")")
            if name in _PROCESSES and not rest.startswith(" Z"):
                found.append(int(path.parent.name))
    return sorted(found)


def open_task() -> int:
    """File descriptor that becomes readable when the task process ends.

    Raises:
        InputError: there is no task process.
    """
    listing = subprocess.run(["halcmd", "show", "comp"], capture_output=True, text=True, check=False).stdout
    pid = component_pid(listing, TASK)
    if pid is None:
        raise InputError(f"LinuxCNC's task process (HAL component {TASK}) does not run")
    try:
        return os.pidfd_open(pid)
    except ProcessLookupError:
        raise InputError(f"LinuxCNC's task process {pid} has ended") from None
