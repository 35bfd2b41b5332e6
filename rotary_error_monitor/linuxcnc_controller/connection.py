"""The other side of a program beside LinuxCNC: starts it, hands over what it says, and passes records on."""

from __future__ import annotations

import json
import os
import subprocess
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.linuxcnc_controller import link, observer
from rotary_error_monitor.linuxcnc_controller.modules import SYSTEM_PYTHON, system_environment, system_program
from rotary_error_monitor.linuxcnc_controller.protocol import (
    End,
    LinkSettings,
    ObserverSettings,
    Record,
    decode,
    encode,
)

_PROGRAMS = {LinkSettings: link.__name__, ObserverSettings: observer.__name__}
_PATIENCE = 0.5
_LAST_LINES = 5


class Connection:
    """One run of the link or the observer; its records arrive on a thread of their own.

    Attributes:
        dropped: how many records it did not take in time.
    """

    def __init__(
        self,
        settings: LinkSettings | ObserverSettings,
        receive: Callable[[Record], None],
        *,
        enter: Sequence[str] = (),
        environment: Mapping[str, str] | None = None,
        python: str = SYSTEM_PYTHON,
    ) -> None:
        """Start the program to which the settings belong.

        Args:
            settings: how it works; those of the link start the link, those of the observer an observer.
            receive: takes each record, on another thread; the last one is always an `End`.
            enter: command that runs what follows it where the LinuxCNC runs (`nsenter …`); empty for here.
            environment: variables in place of this process's own.
            python: interpreter for which LinuxCNC's modules are built.

        Raises:
            InputError: there is no such interpreter or command.
        """
        self.dropped = 0
        self._receive = receive
        command = [*enter, *system_program(_PROGRAMS[type(settings)], python), json.dumps(asdict(settings))]
        try:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                env=system_environment(os.environ if environment is None else environment),
                start_new_session=True,
            )
        except OSError as error:
            raise InputError(f"cannot run {command[0]}: {error.strerror}") from error
        assert self._process.stdin is not None
        os.set_blocking(self._process.stdin.fileno(), False)
        self._thread = threading.Thread(target=self._listen, name="controller")
        self._thread.start()

    def send(self, record: Record) -> None:
        """Pass a record on; one that the program does not take at once is dropped, as the next one is newer."""
        assert self._process.stdin is not None
        line = encode(record)
        try:
            # A line is far below the size up to which a pipe takes all or nothing.
            os.write(self._process.stdin.fileno(), line)
        except BlockingIOError:
            self.dropped += 1
        except BrokenPipeError:
            pass  # its end is on the way, with the reason

    def close(self) -> None:
        """End the program; the link leaves the external offsets as they are."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._thread.join()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        assert self._process.stderr is not None
        ended = False
        for line in self._process.stdout:
            try:
                record = decode(line)
            except InputError:
                continue  # LinuxCNC's libraries print to standard output as they like
            ended = ended or isinstance(record, End)
            self._receive(record)
        said = self._process.stderr.read().decode(errors="replace").strip().splitlines()[-_LAST_LINES:]
        self._process.stdout.close()
        self._process.stderr.close()
        code = self._process.wait()
        if not ended:
            what = f"the program beside LinuxCNC ended with exit code {code}" + (
                f": {' | '.join(said)}" if said else ""
            )
            self._receive(End(what if code else ""))
