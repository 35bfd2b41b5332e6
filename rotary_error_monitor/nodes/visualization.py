"""Error motion for RViz and Foxglove: ring, heads, orbit and tilt of the axis of rotation, magnified, as markers.

ros2 run rotary_error_monitor visualization --ros-args -p stage:=my_stage.yaml -p machine:=my_machine.yaml

The markers stand in the frame `stage`, which RViz takes as its fixed frame without any transform. Where tf2 is
installed, `/tf` has the frames of stage and rotor, not magnified, and of the machine's bodies at its joint states.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from numpy.typing import NDArray
from sensor_msgs.msg import JointState
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from rotary_error_monitor.codec.error_motion_blocks import error_motion_from_block
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.machine.frames import Frame, body_frames, rotor_frame, stage_frame
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.nodes import messages, parameters
from rotary_error_monitor.nodes.compensation_settings import MOUNTING
from rotary_error_monitor.nodes.diagnostics import Condition, Level, StreamWatch
from rotary_error_monitor.nodes.frame_broadcaster import FrameBroadcaster
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.nodes.process import program
from rotary_error_monitor.pipeline.last_turn import LastTurn, TurnPicture
from rotary_error_monitor.signals.blocks import SampleBlock

_LATE_AFTER, _STALE_AFTER = 0.5, 1.0
"""Age, s, from which an estimate is late for a picture of now, and of the last one from which its silence is told: with
the next diagnostics."""

_LIFETIME = 2
"""s after which what is not drawn anew goes: an old picture must not look alive."""

_CIRCLE = 90
"""Corners of the drawn ring: the sides leave the circle by 0.06 % of its radius, less than a pixel of any screen."""

# of Okabe and Ito (2008), told apart by people who see few colours
_COLOURS = {
    "ring": (0.6, 0.6, 0.6),
    "heads": (0.34, 0.71, 0.91),
    "orbit": (0.84, 0.37, 0.0),
    "polar": (0.0, 0.45, 0.70),
    "axis": (0.80, 0.47, 0.65),
    "scale": (0.9, 0.9, 0.9),
}
_UNKNOWN_RADIUS = 0.1
"""m, of the drawn ring of a stage without one."""


class Visualization(ManagedNode):
    """Draws where the axis of rotation was at each angle of the last turn, and how it leans."""

    settings = (
        Setting("period", 0.2, "time between two pictures, s", (0.02, 10.0)),
        *parameters.cell_settings("machine"),
        *MOUNTING,
    )

    def open(self) -> None:
        """Listen to the error motion and draw in turn."""
        self._radius = self.stage.encoder.disc_radius if self.stage.encoder else _UNKNOWN_RADIUS
        self._turn, self._drawn_ns = LastTurn(self._radius), 0
        samples, self._topic = self.wire.topic("error_motion_samples"), self.wire.topic("error_motion_markers")
        self._watch = StreamWatch(samples.name, _LATE_AFTER, _STALE_AFTER, self.now_ns())
        self._publisher, self._frames = self.publish_on(self._topic), FrameBroadcaster(self)
        self._motion: ErrorMotion | None = None
        name = self.setting("machine")
        self._machine, self._joints = load_machine(name) if name else None, dict[str, float]()
        if self._machine is not None:
            self.listen_to(self.wire.topic("machine_joint_states"), self._take_joints)
        self.listen_to_blocks(samples, self._take)
        self.every(self.setting("period"), self._draw)

    def release(self) -> None:
        """Publish frames no longer."""
        frames = self.__dict__.pop("_frames", None)
        if frames is not None:
            frames.close()

    def conditions(self, now_ns: int) -> list[Condition]:
        """What comes in; that no stage moves is no fault of a picture."""
        flow = self._watch.report(now_ns)
        return [Condition(flow.what, min(flow.level, Level.WARN), flow.message, flow.figures)]

    def _take(self, block: SampleBlock) -> None:
        self._watch.observe(block, self.now_ns())
        try:
            self._motion = error_motion_from_block(block)
            self._turn.add(self._motion)
        except InputError as error:
            self._watch.refuse(str(error))
            raise

    def _take_joints(self, message: JointState) -> None:
        self._joints |= messages.joint_motion(message)[0]

    def _draw(self) -> None:
        newest_ns = self._watch.last_ns
        if self.active and newest_ns is not None and newest_ns != self._drawn_ns:
            self._drawn_ns = newest_ns
            markers = [*self._stage_markers(), *_picture_markers(self._turn.picture(), self._radius)]
            for number, marker in enumerate(markers):
                marker.header, marker.id = messages.header(newest_ns, self._topic.frame), number
            self._publisher.publish(MarkerArray(markers=markers))
            self._frames.send(newest_ns, self._standing())

    def _standing(self) -> list[Frame]:
        """Frames of the machine's bodies, the stage and its rotor, as far as they are known."""
        frames = []
        if self._machine is not None:
            frames = body_frames(self._machine, self._joints)
            stage = stage_frame(self._machine, self.setting("ring_height"), self.setting("ring_azimuth"))
            frames += [stage] if stage is not None else []
        if self._motion is not None:
            frames.append(rotor_frame(float(self._motion.theta[-1]), self._motion.components[-1]))
        return frames

    def _stage_markers(self) -> Iterator[Marker]:
        angle = np.linspace(0.0, 2 * np.pi, _CIRCLE + 1)
        circle = self._radius * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
        yield _line("ring", circle, 0.005 * self._radius)
        for letter, azimuth in self.stage.azimuths.items():
            place = 1.15 * self._radius * np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
            yield _text("heads", letter, place, 0.12 * self._radius)


def _picture_markers(picture: TurnPicture, radius: float) -> Iterator[Marker]:
    width = 0.01 * radius
    if len(picture.orbit) > 1:
        yield _line("orbit", picture.orbit, width)
        yield _line("polar", picture.polar, width)
    scale = [f"radial × {picture.magnification:,.0f}"] if picture.magnification else ["radial not observable"]
    if len(picture.axis):
        arrow = _marker("axis", Marker.ARROW)
        arrow.points, arrow.scale = _points(picture.axis), Vector3(x=2 * width, y=4 * width, z=0.1 * radius)
        yield arrow
        scale.append(f"tilt × {picture.tilt_magnification:,.0f}")
    yield _text("scale", "\n".join(scale), np.array([0.0, -1.5 * radius, 0.0]), 0.12 * radius)


def _line(name: str, points: NDArray[np.float64], width: float) -> Marker:
    line = _marker(name, Marker.LINE_STRIP)
    line.points, line.scale = _points(points), Vector3(x=width)
    return line


def _text(name: str, words: str, place: NDArray[np.float64], height: float) -> Marker:
    text = _marker(name, Marker.TEXT_VIEW_FACING)
    text.text, text.scale = words, Vector3(z=height)
    (text.pose.position,) = _points(place[None])
    return text


def _marker(name: str, kind: int) -> Marker:
    red, green, blue = _COLOURS[name]
    return Marker(
        ns=name,
        type=kind,
        action=Marker.ADD,
        pose=Pose(orientation=Quaternion(w=1.0)),
        color=ColorRGBA(r=red, g=green, b=blue, a=1.0),
        lifetime=Duration(sec=_LIFETIME),
    )


def _points(rows: NDArray[np.float64]) -> list[Point]:
    return [Point(x=x, y=y, z=z) for x, y, z in rows.tolist()]


main = program(Visualization, "visualization")

if __name__ == "__main__":
    raise SystemExit(main())
