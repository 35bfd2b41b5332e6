"""A headless LinuxCNC of one's own: started in a copy of its configuration, apart from any other, and stopped clean."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Self

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.linuxcnc_controller import presence
from rotary_error_monitor.linuxcnc_controller.modules import APT_PACKAGE, system_environment

_START = 10.0
_ATTEMPTS = 3
"""LinuxCNC without real time now and then does not come up; where nothing but its own namespaces is at stake, again."""
_STOP = 20.0
_STEP = 0.05
_LAST_LINES = 15
_STARTED = "DUMMY DISPLAY MODULE"
"""What `DISPLAY = dummy` prints when all is loaded."""
_NOBODY = 65534
_CONFIG = "config"
_HOME = "home"
_LOG = "linuxcnc.log"

# LinuxCNC finds its shared memory by fixed keys, kills namesakes of its processes, keeps its lock in /tmp and listens
# on a fixed port: each of these becomes the instance's own. Whoever talks to it enters the first two alone (`enter`),
# and so keeps the machine's network and /dev/shm, which ROS needs.
_UNSHARE = ("unshare", "--ipc", "--pid", "--net", "--mount", "--fork", "--mount-proc", "--kill-child")
_ON_TIME = "chrt --all-tasks --rr --pid 1 $(pidof rtapi_app)"
_AS_USER = ("--user", "--map-current-user", "--keep-caps")
_PRIVATE_TMP = 'mount -t tmpfs -o mode=1777 tmpfs /tmp && exec "$@"'
_FOLDERS = "/var/tmp"  # outside /tmp, which an isolated instance does not see


class Instance:
    """One headless LinuxCNC; use it in a `with` statement.

    Attributes:
        folder: its configuration, home and log; gone when it has stopped.
    """

    def __init__(self, ini: Path, *, isolated: bool | None = None) -> None:
        """Prepare the instance whose configuration is the folder of `ini`.

        Args:
            ini: LinuxCNC's ini file; its `[DISPLAY]` must end when standard input does (`DISPLAY = dummy`).
            isolated: in namespaces of its own; None for where the system allows it. One that is not isolated refuses to
                start beside another, as LinuxCNC would end that one.

        Raises:
            InputError: no such file, or LinuxCNC is not installed.
        """
        if not ini.is_file():
            raise InputError(f"no LinuxCNC configuration {ini}")
        if shutil.which("linuxcnc") is None:
            raise InputError(f"LinuxCNC is not installed; apt-get install {APT_PACKAGE}")
        self._ini = ini
        self._isolation = _isolation() if isolated is None or isolated else ()
        if isolated and not self._isolation:
            raise InputError("LinuxCNC cannot be isolated: the system allows no namespaces (unshare)")
        self._process: subprocess.Popen[bytes] | None = None
        self._pid = 0
        self.folder = Path()

    @property
    def isolated(self) -> bool:
        """Whether it runs in namespaces of its own."""
        return bool(self._isolation)

    @property
    def enter(self) -> tuple[str, ...]:
        """Command that runs what follows it where the instance's shared memory and processes are."""
        if not self.isolated:
            return ()
        user = () if os.getuid() == 0 else ("--user", "--preserve-credentials")
        return ("nsenter", "--target", str(self._pid), *user, "--ipc", "--pid")

    @property
    def environment(self) -> dict[str, str]:
        """Variables for the instance and for whoever talks to it."""
        own = {"HOME": str(self.folder / _HOME)}
        if os.getuid() == 0:
            # The real-time process refuses to work for root: it then gives up what it does not need.
            own |= {"RTAPI_UID": str(_NOBODY), "RTAPI_FIFO_PATH": str(self.folder / _HOME / "fifo")}
        inherited = system_environment(os.environ)
        inherited.pop("DISPLAY", None)  # it would ask in a window what it cannot ask on a terminal
        return inherited | own

    @property
    def log(self) -> str:
        """What it has printed so far."""
        path = self.folder / _LOG
        return path.read_text(errors="replace") if path.is_file() else ""

    @property
    def is_running(self) -> bool:
        """Whether LinuxCNC still runs."""
        return self._process is not None and self._process.poll() is None

    def __enter__(self) -> Self:
        """Start it and wait until its task process runs.

        Raises:
            InputError: it does not start; the message holds the end of its log.
        """
        if not self.isolated and presence.find_namesakes(Path("/proc")):
            raise InputError("another LinuxCNC runs here; it would be ended by a second one that is not isolated")
        for attempts_left in reversed(range(_ATTEMPTS if self.isolated else 1)):
            self.folder = Path(tempfile.mkdtemp(prefix="linuxcnc-", dir=_FOLDERS))
            try:
                self._start()
                break
            except BaseException as error:
                self.stop(at_once=self.isolated)
                if not (isinstance(error, InputError) and attempts_left):
                    raise
        return self

    def __exit__(self, *_: object) -> None:
        """Stop it."""
        self.stop()

    def run(self, command: Sequence[str]) -> subprocess.CompletedProcess[str]:
        """Run a command where the instance is, such as `halcmd`."""
        return subprocess.run(
            [*self.enter, *command], env=self.environment, capture_output=True, text=True, check=False
        )

    def stop(self, *, at_once: bool = False) -> None:
        """End it in good order, or by force if that takes too long or `at_once`, and remove its folder."""
        if self._process is not None:
            assert self._process.stdin is not None
            with suppress(BrokenPipeError):
                self._process.stdin.close()
            try:
                self._process.wait(0 if at_once else _STOP)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
            self._process = None
        shutil.rmtree(self.folder, ignore_errors=True)

    def _start(self) -> None:
        shutil.copytree(self._ini.parent, self.folder / _CONFIG)
        (self.folder / _HOME).mkdir()
        for path in (self.folder, self.folder / _HOME):
            path.chmod(0o777)  # the real-time process works as another user
        ini = self.folder / _CONFIG / self._ini.name
        launch = ["linuxcnc", "-r", str(ini)]
        if self.isolated:
            launch = [*self._isolation, "sh", "-c", _PRIVATE_TMP, "sh", *launch]
        with (self.folder / _LOG).open("wb") as log:
            self._process = subprocess.Popen(
                launch, stdin=subprocess.PIPE, stdout=log, stderr=log, env=self.environment, start_new_session=True
            )
        self._wait()
        self._keep_on_time()

    def _wait(self) -> None:
        """Wait until the task process stands, inside the namespaces if there are any."""
        assert self._process is not None
        end = time.monotonic() + _START
        while time.monotonic() < end:
            if self._process.poll() is not None:
                break
            self._pid = _child(self._process.pid) if self.isolated else self._process.pid
            if self._pid and self._has_task():
                return
            time.sleep(_STEP)
        last = "\n".join(self.log.splitlines()[-_LAST_LINES:])
        raise InputError(f"LinuxCNC did not start with {self._ini}; its log ends:\n{last}")

    def _keep_on_time(self) -> None:
        """Let the servo thread run before ordinary processes, where the system allows it.

        Without a real-time kernel it is an ordinary thread, and stops for as long as the computer is busy with others.
        """
        inside = (*self.enter, "--mount") if self.isolated else ()
        subprocess.run([*inside, "sh", "-c", _ON_TIME], capture_output=True, check=False)

    def _has_task(self) -> bool:
        # Its own tools are asked last: while it starts they would get in its way.
        if _STARTED not in self.log:
            return False
        return presence.component_pid(self.run(["halcmd", "show", "comp"]).stdout, presence.TASK) is not None


def _child(pid: int) -> int:
    """The only child of a process, 0 before it has one."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return int(children[0]) if children else 0


def _isolation() -> tuple[str, ...]:
    """Command that gives what follows it namespaces of its own; empty where the system allows none."""
    command = _UNSHARE if os.getuid() == 0 else (*_UNSHARE, *_AS_USER)
    try:
        trial = subprocess.run([*command, "sh", "-c", _PRIVATE_TMP, "sh", "true"], capture_output=True, check=False)
    except OSError:
        return ()
    return command if trial.returncode == 0 else ()
