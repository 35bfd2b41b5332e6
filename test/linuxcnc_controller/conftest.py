"""A controller that behaves as LinuxCNC does where it surprises, and a real one where LinuxCNC is installed."""

import math
import shutil
from pathlib import Path

import pytest

from rotary_error_monitor.linuxcnc_controller.instance import Instance
from rotary_error_monitor.linuxcnc_controller.kinematics import RotaryTableKinematics, TrivialKinematics
from rotary_error_monitor.resources import config

PER_METRE, PER_RADIAN = 1000.0, 180 / math.pi


class FakeController:
    """Stands in for LinuxCNC's module `hal`: pins in mm and degrees, servo periods when a test says so.

    What it imitates was measured on LinuxCNC 2.9: offsets are numbers that changes of the counts pins add to, but only
    while the machine is on and homed; joint mode queues them; machine off holds them, machine on zeroes the number and
    moves the command instead; soft limits clip them.
    """

    def __init__(self, names="XYZAC", table=True, limit=0.25, speed=1e-6):
        self.names = names
        self.kinematics = RotaryTableKinematics((0, 0, 0), (0.02, 0.01)) if table else TrivialKinematics()
        self.limit, self.speed = limit, speed
        self.axes = [0.0] * len(names)
        self.requested = [0.0] * len(names)
        self.applied = [0.0] * len(names)
        self.velocities = [0.0] * len(names)
        self.on = self.homed = self.teleop = True
        self.driven = set()
        self.pins = {"motion-controller.time": 0, "motion.eoffset-limited": False, "motion.coord-mode": False}
        if table:
            self.pins |= {f"xyzac-trt-kins.{pin}-rot-point": 0.0 for pin in "xyz"}
            offsets = {"y-offset": 20.0, "z-offset": 10.0, "tool-offset": 0.0}
            self.pins |= {f"xyzac-trt-kins.{pin}": value for pin, value in offsets.items()}
        for name in names.lower():
            for pin, value in (("counts", 0), ("scale", 0.0), ("enable", False), ("clear", False)):
                self.pins[f"axis.{name}.eoffset-{pin}"] = value
        self.taken = [0] * len(names)
        self.between_looks = lambda: None
        self.show()

    # What is used of the module `hal`.

    def get_info_pins(self):
        return [{"NAME": name} for name in self.pins]

    def get_value(self, name):
        if name == f"joint.{len(self.names) - 1}.coarse-pos-cmd":
            self.between_looks()
        return self.pins[name]

    def set_p(self, name, value):
        if name in self.driven:
            raise RuntimeError(f"pin '{name}' is connected to a signal")
        self.pins[name] = type(self.pins[name])(float(value))

    # What a test does to it.

    def switch(self, on):
        if on and not self.on:
            self.axes = [axis + offset for axis, offset in zip(self.axes, self.applied, strict=True)]
            self.requested = [0.0] * len(self.names)
            self.applied = [0.0] * len(self.names)
        self.on = on
        self.show()

    def move(self, *axes):
        self.axes = list(axes)
        self.show()

    def tick(self, periods=1):
        for _ in range(periods):
            self.pins["motion-controller.time"] += 1
            self.pins["motion.eoffset-limited"] = False
            for index, name in enumerate(self.names.lower()):
                self._take_up(index, name)
        self.show()

    def _take_up(self, index, name):
        counts, prefix = self.pins[f"axis.{name}.eoffset-counts"], f"axis.{name}.eoffset-"
        new, self.taken[index] = counts - self.taken[index], counts
        if not (self.on and self.homed and self.pins[f"{prefix}enable"]):
            return
        unit = PER_RADIAN if name in "abc" else PER_METRE
        self.requested[index] += new * self.pins[f"{prefix}scale"] / unit
        if self.pins[f"{prefix}clear"]:
            self.requested[index] = 0.0
        if self.teleop:
            wanted = self.requested[index]
            if name in "xyz":
                wanted = max(-self.limit - self.axes[index], min(self.limit - self.axes[index], wanted))
                self.pins["motion.eoffset-limited"] |= wanted != self.requested[index]
            step = wanted - self.applied[index]
            self.applied[index] += max(-self.speed, min(self.speed, step))

    @property
    def joints(self):
        return self.kinematics.to_joints([a + o for a, o in zip(self.axes, self.applied, strict=True)])

    def show(self):
        self.pins["motion.motion-enabled"] = self.on
        self.pins["motion.is-all-homed"] = self.homed
        self.pins["motion.teleop-mode"] = self.teleop
        for index, (name, joint) in enumerate(zip(self.names.lower(), self.joints, strict=True)):
            unit = PER_RADIAN if name in "abc" else PER_METRE
            self.pins[f"axis.{name}.pos-cmd"] = self.axes[index] * unit
            self.pins[f"axis.{name}.eoffset-request"] = self.requested[index] * unit
            self.pins[f"axis.{name}.eoffset"] = self.applied[index] * unit
            self.pins[f"joint.{index}.coarse-pos-cmd"] = joint * unit
            self.pins[f"joint.{index}.pos-cmd"] = joint * unit
            self.pins[f"joint.{index}.vel-cmd"] = self.velocities[index] * unit


@pytest.fixture
def controller():
    return FakeController()


@pytest.fixture
def make_controller():
    return FakeController


@pytest.fixture(scope="session")
def linuxcnc_ini() -> Path:
    if shutil.which("linuxcnc") is None:
        pytest.skip("LinuxCNC is not installed (apt-get install linuxcnc-uspace)")
    return config("linuxcnc/xyzac_trt.ini")


@pytest.fixture
def instance(linuxcnc_ini):
    with Instance(linuxcnc_ini) as running:
        yield running
