"""Where each executable of the package begins.

Python answers Ctrl-C by an exception at whatever it does, and until a program handles that, it ends in a traceback.
What the nodes import takes up to a second to load, so each program first lets SIGINT do what SIGTERM does: end it at
once, with nothing said and the signal as its exit status. Nothing is there yet that would have to be put away. What is
ready for more sets handlers of its own.

Before this module Python itself starts, some hundredths of a second, and is as it is.
"""

from __future__ import annotations

import gc
import signal
import sys
from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import LazyLoader
from types import ModuleType

PACKAGE = "rotary_error_monitor"

UNUSED = ("numpy.f2py", "numpy.testing")
"""Parts of numpy that scipy names as it loads and never uses: to load them takes as long as to load numpy."""


def end_at_once() -> None:
    """Have SIGINT end this process without a word, unless somebody has decided otherwise."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)


def collect_rarely() -> None:
    """Have Python look for reference cycles less often than it does by itself.

    A command makes hundreds of thousands of objects that live as long as it does, those of its libraries and of
    pictures: to go through them again and again takes a tenth of its time, and frees next to nothing.
    """
    gc.set_threshold(20_000, 20, 50)


def end_without_collecting() -> None:
    """Have Python look for no more reference cycles, as it does at its end, where all memory goes back at once.

    To go through all that a command and its libraries have made takes up to a quarter of a second. Whoever opens a file
    or makes a temporary one closes or removes it, and does not leave that to the collector.
    """
    gc.freeze()


class _WhenUsed:
    """Finds the modules `UNUSED`, which are loaded once something in them is asked for."""

    @staticmethod
    def find_spec(name: str, path: Sequence[str] | None = None, target: ModuleType | None = None) -> ModuleSpec | None:
        """As finders on `sys.meta_path` do; None of all other modules."""
        found = PathFinder.find_spec(name, path, target) if name in UNUSED else None
        if found is not None and found.loader is not None:
            found.loader = LazyLoader(found.loader)
        return found


def load_when_used() -> None:
    """Have Python load the modules `UNUSED` only when something in them is asked for."""
    if _WhenUsed not in sys.meta_path:
        sys.meta_path.insert(0, _WhenUsed)


def command() -> int:
    """Run the command `rotary_error_monitor`; give its exit code."""
    end_at_once()
    load_when_used()
    collect_rarely()
    try:
        return int(import_module(f"{PACKAGE}.cli").main())
    finally:
        end_without_collecting()


def node(name: str) -> int:
    """Run the executable of a node until a signal; give its exit code."""
    end_at_once()
    load_when_used()
    return int(import_module(f"{PACKAGE}.nodes.{name}").main())


def __getattr__(name: str) -> Callable[[], int]:
    """Entry point of a node, by the name of its executable."""
    if name.startswith("_"):
        raise AttributeError(f"module {__name__} has no attribute {name}")
    return partial(node, name)


if __name__ == "__main__":
    sys.exit(node(sys.argv.pop(1)))
