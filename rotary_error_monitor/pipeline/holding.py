"""How long a correction has been held, and when the description alone takes over."""

from __future__ import annotations


class Holding:
    """Time of a hold, by the stamps of the inputs.

    A held correction belongs to the place where it was made; as the axes move on, it becomes wrong. Only where
    corrections have flowed is there one to hold.

    Attributes:
        since_ns: when the hold began, timestamp (ns); None while corrections flow.
    """

    def __init__(self, limit_ns: int) -> None:
        """Let the description take over after `limit_ns`."""
        self._limit_ns = limit_ns
        self._last_ns: int | None = None
        self._flowed = False
        self.since_ns: int | None = None

    def begin(self, time_ns: int) -> None:
        """Corrections are held at `time_ns`, and maybe were before."""
        self.since_ns = time_ns if self.since_ns is None else self.since_ns

    def flow(self, time_ns: int) -> None:
        """A correction went out at `time_ns`."""
        self._flowed, self._last_ns, self.since_ns = True, time_ns, None

    def is_over(self, time_ns: int) -> bool:
        """Whether at `time_ns` the last correction has been held for long enough."""
        return self._flowed and self._last_ns is not None and time_ns - self._last_ns > self._limit_ns

    def forget_time(self) -> None:
        """The clock was set back: a hold counts from the next input on."""
        self._last_ns = self.since_ns = None
