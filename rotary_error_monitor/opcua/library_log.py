"""What the OPC UA library logs, handed to whoever runs the server: a line each, without tracebacks."""

from __future__ import annotations

import logging
from collections.abc import Callable

from rotary_error_monitor.errors import excerpt

_LOGGER = "asyncua"


class LibraryLog(logging.Handler):
    """Hands on warnings and errors of the library; any client can cause some."""

    def __init__(self, say: Callable[[str], None]) -> None:
        """Hand on to `say` until `close`."""
        super().__init__(logging.WARNING)
        self._say = say
        self._logger = logging.getLogger(_LOGGER)
        self._logger.addHandler(self)

    def emit(self, record: logging.LogRecord) -> None:
        """Hand on one."""
        self._say(excerpt(record.getMessage()))

    def close(self) -> None:
        """Hand on no longer."""
        self._logger.removeHandler(self)
        super().close()
