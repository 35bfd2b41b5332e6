"""Execute a notebook by this Python: `python executed_notebook.py IN.ipynb OUT.ipynb`.

Its sockets and its event loop are those of a process of its own.
"""

from __future__ import annotations

import sys
from pathlib import Path

import nbformat
from jupyter_client.kernelspec import KernelSpecManager
from jupyter_client.manager import KernelManager
from nbclient import NotebookClient

LATEST = 600
"""Time, s, after which a cell hangs: others take what they like of this computer."""


def main(source: Path, target: Path) -> None:
    """Write the notebook with its outputs; it runs in the folder of `target`."""
    notebook = nbformat.read(source, nbformat.NO_CONVERT)
    # with no folders of kernels there is one: this Python
    kernel = KernelManager(kernel_name="python3", kernel_spec_manager=KernelSpecManager(kernel_dirs=[]))
    place = {"metadata": {"path": str(target.parent)}}
    try:
        NotebookClient(notebook, km=kernel, timeout=LATEST, startup_timeout=LATEST, resources=place).execute()
    finally:
        kernel.shutdown_kernel(now=True)
    nbformat.write(notebook, target)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
