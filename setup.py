"""Builds and installs the package: by colcon for `ros2 run`, by pip for a virtual environment."""

import hashlib
import os
from pathlib import Path

from setuptools import Extension, find_packages, setup

PACKAGE = "rotary_error_monitor"
NODES = [
    "encoder_head",
    "autocollimator",
    "lvdt",
    "listed_sensor",
    "stage_command",
    "stage_force",
    "stage_temperature",
    "mock_controller",
    "error_estimator",
    "compensation",
    "recorder",
    "gap_monitor",
    "visualization",
    "metrics",
    "opcua_server",
    "dashboard",
    "linuxcnc_bridge",
    "stage_follower",
]


def data_files() -> list[tuple[str, list[str]]]:
    """Index marker, package.xml, and the folders that the package reads below share/."""
    share = f"share/{PACKAGE}"
    files = [
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (share, ["package.xml"]),
    ]
    for top in ("config", "msg_defs"):
        for folder, _, names in os.walk(top):
            files.append((f"{share}/{folder}", [str(Path(folder) / name) for name in sorted(names)]))
    return files


def kernel(folder: Path) -> Extension:
    """What a room has in its folder `compiled` (rotary_error_monitor/libraries.py); it uses nothing of Python.

    `optional`: where it cannot be built the package is installed without it, and numpy computes, slower.
    """
    files = sorted(folder.glob("*.[ch]"))
    digest = hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
    return Extension(
        ".".join((*folder.parent.parts, "_kernel")),
        [str(file) for file in files if file.suffix == ".c"],
        depends=[str(file) for file in files],
        define_macros=[("SOURCE", f'"{digest}"')],
        libraries=["m"],
        # No contraction: the same bits on processors with and without fused multiply-add. Vectors wider than the
        # processor's are passed to functions that are all inlined: their ABI, of which -Wpsabi warns, plays no part.
        extra_compile_args=[
            "-std=gnu11",
            "-O2",
            "-fvisibility=hidden",
            "-ffp-contract=off",
            "-fno-fast-math",
            "-fno-math-errno",
            "-Wno-psabi",
        ],
        optional=True,
    )


setup(
    name=PACKAGE,
    version="0.2.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed"]},
    data_files=data_files(),
    ext_modules=[kernel(folder) for folder in sorted(Path(PACKAGE).glob("*/compiled"))],
    python_requires=">=3.11",
    install_requires=[
        "setuptools",
        "numpy>=1.26,<3",
        "scipy>=1.11,<2",
        "PyYAML>=6,<7",
        "matplotlib>=3.6,<4",
        "tqdm>=4.60,<5",
        "rosbags>=0.11.8,<0.12",
        "mcap>=1.5,<2",
        "cryptography>=38,<60",
        "lz4>=4,<5",
        "zstandard>=0.20,<1",
    ],
    extras_require={
        # The documentation as a site: `make docs`, which installs them beside the environment of the tests.
        "docs": [
            "mkdocs>=1.6,<2",
            "mkdocs-material>=9.6,<10",
            "mkdocstrings-python>=1.16,<3",
            "grandalf>=0.8,<0.9",
        ],
        # The node `metrics`, for Prometheus.
        "metrics": ["prometheus-client>=0.20,<1"],
        # `rotary_error_monitor trend` and `diagnose` of a folder: their index, and more computers than one.
        "trend": ["duckdb>=1.1,<3", "distributed>=2024.8"],
        # The node `dashboard`: the cell as a live page.
        "dashboard": ["nicegui>=3,<4"],
        # The node `opcua_server`, for machine controls and their historians.
        "opcua": ["asyncua>=1.1,<3"],
        # Results as tables in notebooks.
        "notebook": ["pandas>=2.2,<4"],
        # What a bag is read by elsewhere: peers in `make bench`.
        "bench": ["mcap-ros2-support>=0.5,<1", "rosbags-dataframe>=0.10,<0.11"],
        # ROS 2 Jazzy from the package index, where it is not installed by apt.
        "ros": [
            "ros-jazzy-rclpy>=7.1.5,<7.2",
            "ros-jazzy-common-interfaces>=5.3.5,<5.4",
            "ros-jazzy-rmw-fastrtps-cpp>=8.4.2,<8.5",
            "ros-jazzy-domain-coordinator>=0.12,<0.13",
        ],
        "test": [
            "pytest>=9,<10",
            "pytest-cov>=5,<8",
            "hypothesis>=6.100,<7",
            "pytransform3d>=3.5,<4",
            "scikit-learn>=1.5,<2",
            "playwright>=1.45,<2",
            "nbclient>=0.10,<1",
            "ipykernel>=6.29,<8",
            "mypy>=1.11,<3",
            "ruff>=0.6,<1",
            "scipy-stubs>=1.14",
            "types-PyYAML",
            "types-tqdm",
            "colcon-core",
            "colcon-ros",
            "colcon-python-setup-py",
            "colcon-library-path",
            "colcon-metadata",
            "colcon-output",
            "colcon-package-information",
            "colcon-recursive-crawl",
            "colcon-test-result",
        ],
    },
    zip_safe=False,
    maintainer="rotary_error_monitor maintainers",
    maintainer_email="maintainers@example.org",
    description="Monitors the error motion of a rotary stage and compensates the machine that carries it.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            f"{PACKAGE} = {PACKAGE}.start:command",
            *(f"{node} = {PACKAGE}.start:{node}" for node in NODES),
        ],
        # What can be diagnosed, by the section of its twin, and effects beside the package's own folder of them.
        f"{PACKAGE}.kinds": [
            f"stage = {PACKAGE}.kinds.stage.kind:StageKind",
            f"machine = {PACKAGE}.kinds.machine.kind:MachineKind",
            f"mount = {PACKAGE}.kinds.mount.kind:MountKind",
            f"quadrature = {PACKAGE}.kinds.quadrature.kind:QuadratureKind",
        ],
        f"{PACKAGE}.effects": [f"{kind} = {PACKAGE}.kinds.{kind}.effects" for kind in ("mount", "quadrature")],
    },
)
