"""What is fuzzed: each kind of file that the package reads, whole ones to begin with, and the commands that read it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random
from shutil import copytree, rmtree

from mcap.writer import CompressionType
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from simulated_pointings import pointing_file, simulate_pointings

from rotary_error_monitor.bags.metadata import type_definition
from rotary_error_monitor.blind_check.cases import write_case
from rotary_error_monitor.cases.making import make_stage_case
from rotary_error_monitor.codec.contents import TYPES, JointState
from rotary_error_monitor.codec.messages import encode

from .bags import pose_contents, stage_contents, write_bag, write_defined, write_mcap, write_with_rosbags
from .mutations import BINARY, DEFINITION, MCAP, TEXT, Mutation, mutate

ROOT = Path(__file__).parents[2]
CONFIG, CSV = ROOT / "config", ROOT / "doc" / "calibration"
CORPUS = Path(__file__).parent / "corpus"
MACHINES = sorted((CONFIG / "machines").glob("*.yaml"))
PARAMETERS = """\
machine:
  travel: {X: [-3, 3], Y: [-1, 1], Z: [-1, 1], C: [-3.1, 3.1], A: [-1.9, 1.9]}
  squareness: {XY: 1.0e-05, XZ: 2.0e-05, YZ: 3.0e-05}
  head_length: 0.35
  tool_length: 0.15
  expansion: {X: 1.0e-06}
  errors: {EXX: {poly: [0.0, 1.0e-06]}, ECC: {harmonic: [{order: 1, cos: 1.0e-06, sin: 0.0}]}}
  uncertainty: {errors.linear: 8.0e-07}
"""
POSES = """\
X_mm,Y_mm,Z_mm,C_deg,A_deg,X_direction,Y_direction,Z_direction,C_direction,A_direction,temperature_degC,dx_um,dy_um,dz_um
""" + "".join(f"{10 * k},{-5 * k},{k},{k},{2 * k},1,-1,1,1,0,2{k}.5,1.{k},0.{k},-{k}\n" for k in range(9))
PROFILE = "distance_mm,height_um\n" + "".join(f"{100 * k},0.{k}\n" for k in range(12))
SIGNALS = "cos,sin\n" + "".join(
    f"{round(500 * math.cos(0.37 * k))},{round(500 * math.sin(0.37 * k) + 3)}\n" for k in range(600)
)
JOINTS = type_definition(TYPES[JointState]).encode()
"""What a bag says that joint states are."""

EFFECTS = {
    "stage": """
effects:
- {effect: bearing_asynchronous, location: '', parameters: {order: 1.5, phase: 0.0, radial: 1.0e-07, tilt: 0.0}}
- {effect: autocollimator_drift, parameters: {rate: [1.0e-09, -1.0e-09]}}
""",
    "machine": """
effects:
- {effect: axis_backlash, location: X, parameters: {width: 1.0e-06}}
- {effect: cyclic_error, location: Y, parameters: {period: 0.002, cos: 1.0e-06, sin: 0.0}}
""",
    "mount": """
effects:
- {effect: axis_harmonic, location: H, parameters: {order: 2.0, cos: 1.0e-05, sin: 0.0}}
- {effect: declination_axis_flexure, parameters: {sag: 1.0e-05}}
""",
    "quadrature": """
effects:
- {effect: circle_harmonic, parameters: {order: 2.0, cos: 1.0, sin: 0.0}}
- {effect: signal_offset, parameters: {shift: [1.0, 2.0]}}
""",
}
"""Rows below each kind of twin."""

Command = list[str | Path]


@dataclass(frozen=True)
class Target:
    """One kind of file.

    Attributes:
        name: of it; its corpus is the folder of that name.
        file: what it is called in the folder where it is tried.
        seeds: whole files.
        mutations: how they are changed.
        commands: what is run on the file, by the folder that holds it; one of them is drawn. The corpus names them by
            their place: new ones come last.
    """

    name: str
    file: str
    seeds: Sequence[bytes]
    mutations: Sequence[Mutation]
    commands: Callable[[Path], Sequence[Command]]

    def input(self, random: Random) -> bytes:
        """A changed file."""
        seed = random.choice(self.seeds)
        if random.random() < 0.05:
            other = random.choice(self.seeds)
            seed = seed[: random.randrange(len(seed) + 1)] + other[random.randrange(len(other) + 1) :]
        return mutate(seed, self.mutations, random)

    def corpus(self) -> Iterator[Path]:
        """Files that once failed."""
        yield from sorted(path for path in (CORPUS / self.name).glob("*") if path.is_file())


def place(target: Target, content: bytes, folder: Path, templates: Path) -> None:
    """An empty folder with the file in it, and with what belongs beside it."""
    rmtree(folder, ignore_errors=True)
    folder.mkdir()
    if target.name == "metadata":
        copytree(templates / "bag", folder / "bag")
    path = folder / target.file
    path.parent.mkdir(exist_ok=True)
    if target.name == "definition":
        write_defined(path, content)
        return
    path.write_bytes(content)


def targets(templates: Path) -> list[Target]:
    """All of them; `templates` is a folder for whole bags."""
    stage, bag = CONFIG / "stage.yaml", write_bag(templates / "bag", stage_contents(3, 0.03))
    poses = write_bag(templates / "poses", pose_contents())
    case = templates / "case"
    write_case(make_stage_case(5, "null", (), (150.0, 300.0), duration=20.0), case)
    pointings = pointing_file(simulate_pointings(9)).encode()
    (templates / "pointings.dat").write_bytes(pointings)
    (templates / "signals.csv").write_text(SIGNALS)
    pan, out = CONFIG / "machines" / "pan2013.yaml", "out"

    def calibrate(step: str, *options: str | Path) -> Callable[[Path], Sequence[Command]]:
        return lambda folder: [
            ["calibrate", step, folder / "measured.csv", "--machine", pan, "-o", folder / out, *options]
        ]

    def diagnose(recording: Path, twin: Path, folder: Path) -> Command:
        return ["diagnose", recording, "--twin", twin, "-o", folder / out, "--no-report"]

    def bag_commands(name: str) -> Callable[[Path], Sequence[Command]]:
        return lambda folder: [
            ["replay", folder / name, "--twin", stage, "-o", folder / out],
            [
                "replay",
                folder / name,
                "--twin",
                stage,
                "-o",
                folder / out,
                "--machine",
                CONFIG / "machines/xyzac_trt.yaml",
            ],
            ["replay", folder / name, "-o", folder / out, "--machine", CONFIG / "machines/grinder_zhou2023.yaml"],
            ["recover", folder / name],
            ["calibrate", "assembly", folder / name, "--stage", stage, "-o", folder / out],
            diagnose(folder / name, stage, folder),
            diagnose(folder / name, pan, folder),
            ["calibrate", "machine", folder / name, "--machine", pan, "-o", folder / out],
            ["calibrate", "positioning", folder / name, "--machine", pan, "--axis", "X", "-o", folder / out],
            ["check", folder / name, "--stage", stage],
        ]

    stages = [stage.read_bytes(), (case / "twin.yaml").read_bytes() + EFFECTS["stage"].encode()]
    mounts = [path.read_bytes() for path in sorted((CONFIG / "mounts").glob("*.yaml"))]
    mounts.append(mounts[0] + EFFECTS["mount"].encode())
    signals = (CONFIG / "quadrature.yaml").read_bytes()
    machines = [path.read_bytes() for path in MACHINES] + [
        PARAMETERS.encode(),
        pan.read_bytes() + EFFECTS["machine"].encode(),
    ]
    mirror = ["--mirror-length-mm", "1100", "--mirror-flatness-um", "1", "--noise-um", "0.1", "--component", "EYX"]
    straightness = ["calibrate", "straightness", "--machine", pan, "--noise-um", "0.1", "--component", "EYX"]
    return [
        Target("stage", "twin.yaml", stages, TEXT, lambda folder: [
            ["diagnose", "nowhere", "--twin", folder / "twin.yaml", "-o", folder / out],
            diagnose(case / "bag", folder / "twin.yaml", folder),
            ["replay", bag, "--twin", folder / "twin.yaml", "-o", folder / out],
            ["calibrate", "assembly", bag, "--stage", folder / "twin.yaml", "-o", folder / out],
        ]),
        Target("machine", "twin.yaml", machines, TEXT, lambda folder: [
            ["diagnose", "nowhere", "--twin", folder / "twin.yaml", "-o", folder / out],
            diagnose(poses, folder / "twin.yaml", folder),
            ["calibrate", "errors", folder / "twin.yaml"],
            ["offset", folder / "twin.yaml", "--at", "X=10"],
            ["offset", folder / "twin.yaml", "--array", "text"],
            ["calibrate", "tables", folder / "twin.yaml", "--axis", "X", "-o", folder / out],
            ["replay", bag, "--machine", folder / "twin.yaml", "-o", folder / out],
            ["calibrate", "positioning", CSV / "x_positioning.csv", "--machine", folder / "twin.yaml",
             "--axis", "X", "-o", folder / out],
            ["calibrate", "squareness", CSV / "tracker.csv", "--machine", folder / "twin.yaml", "-o", folder / out],
        ]),
        Target("mount", "twin.yaml", mounts, TEXT, lambda folder: [
            diagnose(Path("nowhere"), folder / "twin.yaml", folder),
            diagnose(templates / "pointings.dat", folder / "twin.yaml", folder),
        ]),
        Target("quadrature", "twin.yaml", [signals, signals + EFFECTS["quadrature"].encode()], TEXT, lambda folder: [
            diagnose(Path("nowhere"), folder / "twin.yaml", folder),
            diagnose(templates / "signals.csv", folder / "twin.yaml", folder),
        ]),
        Target("wire", "wire.yaml", [path.read_bytes() for path in sorted((ROOT / "msg_defs").glob("*.yaml"))], TEXT,
               lambda folder: [["load_wire", folder]]),
        Target("cell", "cell.yaml", [(CONFIG / "cell.yaml").read_bytes()], TEXT,
               lambda folder: [["load_parameters", folder / "cell.yaml"]]),
        Target("positioning", "measured.csv", [(CSV / "x_positioning.csv").read_bytes()], TEXT,
               calibrate("positioning", "--axis", "X")),
        Target("straightness", "measured.csv", [(CSV / "x_straightness.csv").read_bytes()], TEXT,
               calibrate("straightness", *mirror)),
        Target("profile", "profile.csv", [PROFILE.encode()], TEXT, lambda folder: [
            ["calibrate", "straightness", CSV / "x_straightness.csv", "--machine", pan, "-o", folder / out, *mirror,
             "--mirror-profile", folder / "profile.csv"]]),
        Target("direct", "measured.csv", [(CSV / "x_direct.csv").read_bytes()], TEXT, lambda folder: [
            [*straightness, folder / "measured.csv", "-o", folder / out],
            [*straightness, CSV / "x_straightness.csv", "-o", folder / out, *mirror[:4], "--direct",
             folder / "measured.csv"]]),
        Target("workpiece", "measured.csv", [(CSV / "workpiece_before.csv").read_bytes()], TEXT, lambda folder: [
            ["calibrate", "flatness", "grinder_zhou2023", "--vertical", "Y", "--workpiece", "X=-1400,0", "Z=-650,-150",
             "--reversal-um", "1", "--positioning-um", "0", "--measured", folder / "measured.csv"]]),
        Target("tracker", "measured.csv", [(CSV / "tracker.csv").read_bytes(), (CSV / "tracker_head.csv").read_bytes()],
               TEXT, calibrate("squareness")),
        Target("program", "poses.csv", [(CSV.parent / "examples" / "poses.csv").read_bytes()], TEXT, lambda folder: [
            ["offset", "xyzac_trt", "--program", folder / "poses.csv"]]),
        Target("collimator", "measured.csv", [(CSV / "autocollimator.csv").read_bytes()], TEXT, lambda folder: [
            ["calibrate", "autocollimator", folder / "measured.csv", "--stage", stage, "-o", folder / out,
             "--reference-arcsec", "0.115", "--sensitivity", "0.0015"]]),
        Target("poses", "measured.csv", [POSES.encode()], TEXT, calibrate("machine")),
        Target("pointings", "pointings.dat", [pointings], TEXT, lambda folder: [
            diagnose(folder / "pointings.dat", CONFIG / "mounts" / "cgx_l.yaml", folder)]),
        Target("signals", "signals.csv", [SIGNALS.encode()], TEXT, lambda folder: [
            diagnose(folder / "signals.csv", CONFIG / "quadrature.yaml", folder)]),
        Target("mcap", "bag.mcap", _mcap_files(templates, bag, poses), MCAP, bag_commands("bag.mcap")),
        Target("definition", "bag.mcap", [JOINTS, JOINTS.partition(b"=====")[0]], DEFINITION, lambda folder: [
            ["replay", folder / "bag.mcap", "-o", folder / out, "--machine", CONFIG / "machines/grinder_zhou2023.yaml"],
            diagnose(folder / "bag.mcap", pan, folder),
            ["calibrate", "machine", folder / "bag.mcap", "--machine", pan, "-o", folder / out],
            ["recover", folder / "bag.mcap"],
        ]),
        Target("metadata", "bag/metadata.yaml", _metadata(templates), TEXT, bag_commands("bag")),
        Target("db3", "bag.db3", _databases(templates), BINARY, bag_commands("bag.db3")),
    ]  # fmt: skip


def _mcap_files(templates: Path, bag: Path, poses: Path) -> list[bytes]:
    contents = [(name, value) for name, values in stage_contents(3, 0.03).items() for value in values]
    contents.sort(key=lambda pair: pair[1].stamp_ns)
    messages = [(name, TYPES[type(value)], encode(value)) for name, value in contents]
    packed = [
        write_mcap(templates / f"{kind.name}.mcap", messages, kind)
        for kind in (CompressionType.ZSTD, CompressionType.LZ4)
    ]
    plain = write_with_rosbags(templates / "rosbags", stage_contents(3, 0.03), StoragePlugin.MCAP)
    return [path.read_bytes() for path in (*bag.glob("*.mcap"), *poses.glob("*.mcap"), *packed, *plain.glob("*.mcap"))]


def _databases(templates: Path) -> list[bytes]:
    found = []
    for name, contents in (("stage", stage_contents(3, 0.03)), ("poses", pose_contents())):
        folder = write_with_rosbags(templates / f"sqlite_{name}", contents, StoragePlugin.SQLITE3)
        found += [path.read_bytes() for path in folder.glob("*.db3")]
    return found


def _metadata(templates: Path) -> list[bytes]:
    folders = [templates / "bag", templates / "sqlite_stage", templates / "rosbags"]
    message = write_with_rosbags(
        templates / "packed", stage_contents(3, 0.03), StoragePlugin.MCAP, CompressionMode.MESSAGE
    )
    return [(folder / "metadata.yaml").read_bytes() for folder in (*folders, message) if folder.exists()]
