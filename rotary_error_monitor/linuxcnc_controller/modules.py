"""LinuxCNC's own Python modules, `linuxcnc` and `hal`, which its package installs for the system's Python."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType

import rotary_error_monitor
from rotary_error_monitor.errors import InputError

APT_PACKAGE = "linuxcnc-uspace"
SYSTEM_PYTHON = "/usr/bin/python3"
SYSTEM_MODULES = Path("/usr/lib/python3/dist-packages")


def load_module(name: str) -> ModuleType:
    """`linuxcnc` or `hal`.

    Raises:
        InputError: LinuxCNC is not installed, or its modules are built for another Python.
    """
    # At the end, and for this import alone: nothing else may come from the system's folder.
    sys.path.append(str(SYSTEM_MODULES))
    try:
        return importlib.import_module(name)
    except ImportError as error:
        version = ".".join(map(str, sys.version_info[:2]))
        built = sorted(path.name for path in SYSTEM_MODULES.glob("linuxcnc.cpython-*.so"))
        if built:
            raise InputError(
                f"LinuxCNC's module '{name}' does not load in Python {version} ({error}); {SYSTEM_MODULES} holds "
                f"{', '.join(built)}: use the Python that it is built for"
            ) from error
        raise InputError(
            f"no module '{name}' in {SYSTEM_MODULES}; install LinuxCNC: apt-get install {APT_PACKAGE}"
        ) from error
    finally:
        sys.path.remove(str(SYSTEM_MODULES))


def system_program(module: str, python: str = SYSTEM_PYTHON) -> list[str]:
    """Command that runs `main()` of a module of this package under the system's Python; arguments may follow.

    The folder of the package comes last on the path: that Python must find its own libraries first.
    """
    root = str(Path(rotary_error_monitor.__file__).parents[1])
    return [python, "-c", f"import sys; sys.path.append({root!r}); from {module} import main; sys.exit(main())"]


def system_environment(environment: Mapping[str, str]) -> dict[str, str]:
    """An environment without what would make the system's Python load the libraries of another installation."""
    dropped = ("LD_LIBRARY_PATH", "PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")
    return {name: value for name, value in environment.items() if name not in dropped}
