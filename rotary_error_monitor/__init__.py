"""Monitor, compensate and diagnose the error motion of a rotary stage and the machine that carries it.

For notebooks, `read_bag`, `estimate`, `analyse` and `diagnose` give what the commands of these names give, as arrays,
tables and figures; `rotary_error_monitor.notebook` describes them.
"""

__version__ = "0.2.0"

# Libraries of arrays take a tenth of a second to load, which commands and nodes choose to spend when they need them:
# what notebooks use is loaded when it is asked for, and known to type checkers by these lines alone.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from rotary_error_monitor.notebook.analyses import Analysis as Analysis
    from rotary_error_monitor.notebook.analyses import analyse as analyse
    from rotary_error_monitor.notebook.diagnoses import Diagnosis as Diagnosis
    from rotary_error_monitor.notebook.diagnoses import diagnose as diagnose
    from rotary_error_monitor.notebook.estimates import Estimate as Estimate
    from rotary_error_monitor.notebook.estimates import estimate as estimate
    from rotary_error_monitor.notebook.recording import Recording as Recording
    from rotary_error_monitor.notebook.recording import read_bag as read_bag

__all__ = [
    "Analysis",
    "Diagnosis",
    "Estimate",
    "Recording",
    "__version__",
    "analyse",
    "diagnose",
    "estimate",
    "read_bag",
]

_MODULES = {
    "Analysis": "analyses",
    "analyse": "analyses",
    "Diagnosis": "diagnoses",
    "diagnose": "diagnoses",
    "Estimate": "estimates",
    "estimate": "estimates",
    "Recording": "recording",
    "read_bag": "recording",
}


def __getattr__(name: str) -> object:
    """What notebooks use, loaded when it is first asked for (PEP 562)."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    found = globals()[name] = getattr(import_module(f"{__name__}.notebook.{_MODULES[name]}"), name)
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
