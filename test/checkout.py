"""The files of this checkout, as whoever clones it has them."""

from __future__ import annotations

import ast
import shutil
import subprocess
import sysconfig
from pathlib import Path

ROOT = Path(__file__).parents[1]


def names() -> list[str]:
    """Paths below ROOT that git tracks or would track, and that are there."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, check=True, capture_output=True, text=True,
    )  # fmt: skip
    return sorted({name for name in listed.stdout.split("\n") if name and (ROOT / name).is_file()})


def copy_to(folder: Path) -> Path:
    """Copy these files below a folder, which is given back."""
    for name in names():
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, target)
    return folder


def quick_compiler(folder: Path) -> Path:
    """Program to be the environment's CC: the compiler of this Python, less optimized and for one width of vectors.

    That takes a quarter of the time, where the machine model is most of a build. What users build, `make setup` builds.
    """
    path = folder / "quick_compiler"
    path.write_text(f'#!/bin/sh\nexec {sysconfig.get_config_var("CC")} "$@" -O1 -DENTRY=ENTRY_ONCE\n', encoding="utf-8")
    path.chmod(0o755)
    return path


def node_names() -> list[str]:
    """NODES of setup.py, read without running it."""
    for node in ast.parse((ROOT / "setup.py").read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "NODES":
            return list(ast.literal_eval(node.value))
    raise AssertionError("setup.py has no list NODES")
