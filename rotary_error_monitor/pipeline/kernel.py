"""The compiled form of what is done at each tick, where it was built; numpy computes the same bits.

A block of 5 ms has five ticks, for which numpy takes longer to be called than to compute. `compiled/*.h` do the
operations of `ticks` and `publication` on the same numbers in the same order.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from ctypes import c_double, c_int64, c_void_p
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.libraries import INTEGERS, REALS, address, is_plain, kernel_of, room_library
from rotary_error_monitor.metrology.error_motion import ErrorMotion

_FLAGS = np.dtype(np.bool_)


class RingParts(NamedTuple):
    """What the heads show at m ticks, in the order of `ring` of compiled/ticks.h.

    Attributes:
        theta: (m,) rotation, rad.
        centre, radial: (m, 2) displacement of the ring, and what of it is error motion, m.
        described, predicted: (m, 2) error motion and displacement that the description predicts, as far as seen, m.
        seen: (m, 2) displacement as far as seen, m.
        covariance: (m, 3, 3) of rotation (rad) and displacement (m).
        disagreement: (m,) of the heads, in standard deviations.
        variance: (m,) larger one of what is seen along x and y, m²; None where it is that of the covariance.
        bend: (m,) mean third difference of the samples of the heads, rad.
        sees_x, sees_y: whether both components are seen.
        samples: independent samples behind a tick, at most 1.
    """

    theta: Array
    centre: Array
    radial: Array
    described: Array
    predicted: Array
    seen: Array
    covariance: Array
    disagreement: Array
    variance: Array | None
    bend: Array
    sees_x: bool
    sees_y: bool
    samples: float


class TiltParts(NamedTuple):
    """What the autocollimator shows at m ticks, in the order of `tilt` of compiled/ticks.h.

    Attributes:
        read, tilt, surplus: (m, 2) what is read, what of it is error motion, and what of that is not described, rad.
        variance: (m, 2) rad².
        samples: independent samples behind a tick, at most 1.
    """

    read: Array
    tilt: Array
    surplus: Array
    variance: Array
    samples: float


class CommandParts(NamedTuple):
    """What the command says at m ticks, in the order of `command` of compiled/ticks.h.

    Attributes:
        angle: (m,) rad.
        bends: (m, h + 1) third differences of the samples of the heads and, last, of the command, rad.
    """

    angle: Array
    bends: Array


class StatedStructure(ctypes.Structure):
    """`stated` of compiled/publication.h."""

    _fields_ = (
        *((name, c_double) for name in ("most", "sigmas", "unseen", "unproven_radial", "unproven_tilt")),
        *((name, c_double) for name in ("radial", "tilt", "along", "across", "radius_square", "rounding")),
        *((name, c_int64) for name in ("autocollimator", "command", "heads", "commanded")),
        *((f"doubt_{name}", c_int64) for name in ("heads", "ring", "unverified", "unverified_tilt")),
    )


class _Ring(ctypes.Structure):
    """`ring` of compiled/ticks.h."""

    _fields_ = (
        *((name, c_void_p) for name in RingParts._fields[:10]),
        ("sees_x", c_int64),
        ("sees_y", c_int64),
        ("samples", c_double),
    )


class _Tilt(ctypes.Structure):
    """`tilt` of compiled/ticks.h."""

    _fields_ = (*((name, c_void_p) for name in TiltParts._fields[:4]), ("samples", c_double))


class _Command(ctypes.Structure):
    """`command` of compiled/ticks.h."""

    _fields_ = (("angle", c_void_p), ("bends", c_void_p), ("count", c_int64), ("missed", c_double))


class Joints(ctypes.Structure):
    """`joints` of compiled/joints.h."""

    _fields_ = (
        *((name, c_void_p) for name in ("stamps", "refused", "values", "quickest", "rotary")),
        *((name, c_int64) for name in ("count", "refusals", "axes", "lag")),
        ("longest_step", c_double),
        ("still", c_double),
    )


class Tolerated(ctypes.Structure):
    """`tolerances` of compiled/joints.h."""

    _fields_ = (
        ("stamps", c_void_p),
        *((name, c_int64) for name in ("count", "largest_gap", "age_limit", "column")),
        *((name, c_int64) for name in ("doubt_ring", "doubt_unverified")),
        ("position", c_double),
        ("command", c_double),
    )


class JudgedTicks(NamedTuple):
    """What m ticks can be used for, and why not, each (m,), as `InputChecks.judge` has it.

    Attributes:
        difference: joint state less command, rad.
        usable, command, fresh, agree, fits, proven: whether an offset can be computed, whether the command is believed,
            and what the first of these follows from.
    """

    difference: Array
    usable: NDArray[np.bool_]
    command: NDArray[np.bool_]
    fresh: NDArray[np.bool_]
    agree: NDArray[np.bool_]
    fits: NDArray[np.bool_]
    proven: NDArray[np.bool_]


_ROOM = Path(__file__).parent


class PipelineKernel:
    """The library, called with the package's own arrays."""

    def __init__(self, library: ctypes.CDLL) -> None:
        """Kernel of a library that was built of these sources."""
        self._put, self._publish = library.rem_put, library.rem_publish
        self._put.argtypes = [c_void_p] * 4
        self._publish.argtypes = [c_void_p] * 2
        self._put.restype = self._publish.restype = None
        self._axes_at, self._judge = library.rem_axes_at, library.rem_judge
        self._axes_at.argtypes = [c_void_p, c_void_p, c_int64, c_void_p]
        self._judge.argtypes = [c_void_p, c_void_p, c_int64, c_int64, c_int64, c_void_p]
        self._axes_at.restype, self._judge.restype = c_int64, None
        self._components = library.rem_components
        self._components.argtypes = [c_void_p, c_void_p, c_void_p, c_int64, c_void_p]
        self._components.restype = None

    def put(
        self,
        motion: ErrorMotion,
        seen: Array,
        ring: RingParts,
        tilt: TiltParts | None,
        command: CommandParts | None,
        missed: float,
    ) -> None:
        """Put what the streams show into an error motion and its evidence that are `unknown` so far.

        Args:
            motion: at m ticks.
            seen: (m, l) evidence, columns as in `pipeline.evidence`.
            ring: what the heads show.
            tilt: what the autocollimator shows, where it is there.
            command: what the command says, where it is there.
            missed: variance of an interpolation over the square of a third difference.
        """
        kept: list[Any] = []
        at = [_place(each, kept) for each in (motion.theta, motion.components, motion.covariance, seen)]
        to = (c_int64 * 6)(len(seen), *at, address(motion.observable))
        heads = _Ring(*(_place(each, kept) for each in ring[:10]), *ring[10:])
        mirror = None if tilt is None else _Tilt(*(_place(each, kept) for each in tilt[:4]), tilt.samples)
        asked = None
        if command is not None:
            asked = _Command(_place(command.angle, kept), _place(command.bends, kept), command.bends.shape[1], missed)
        self._put(*(None if each is None else ctypes.addressof(each) for each in (to, heads, mirror, asked)))

    def publish(
        self,
        stated: StatedStructure,
        motion: ErrorMotion,
        inputs: Sequence[Array | NDArray[np.int64] | None],
        believed: tuple[Array, NDArray[np.int64]],
        streams: NDArray[np.int64],
    ) -> NDArray[np.bool_] | None:
        """Which ticks (m,) may go out; None where arrays do not lie as the library takes them: then all is as before.

        Args:
            stated: variances and limits of the stage.
            motion: whose four first arrays are changed in place.
            inputs: evidence (m, l), disagreement (m,), bounds by redundancy, variance of the tilt by distortion and
                latency (m, 2) or None, and redundancy (m,).
            believed: (m, 15) and (m, 3) as of `Believed`, of which the latter is changed in place.
            streams: (m,) masks that are used, changed in place.
        """
        changed = (motion.components, motion.covariance, believed[0])
        whole = all(is_plain(each, REALS) for each in changed) and is_plain(motion.observable, _FLAGS)
        if not (whole and is_plain(believed[1], INTEGERS) and is_plain(streams, INTEGERS)):
            return None
        publish = np.empty(len(streams), np.bool_)
        kept: list[Any] = []
        seen, disagreement, bounds, distorted, redundancy = inputs
        theta, reals = motion.theta, believed[0]
        at = [_place(each, kept) for each in (theta, seen, disagreement, reals, bounds, distorted, redundancy)]
        at += [address(each) for each in (motion.components, motion.covariance, motion.observable)]
        at += [address(each) for each in (believed[1], streams, publish)]
        ticks = (c_int64 * 14)(len(streams), *at)  # `ticks` of compiled/publication.h
        self._publish(ctypes.addressof(stated), ctypes.addressof(ticks))
        return publish

    def axes_at(
        self, of: Joints, times: NDArray[np.int64], values: Array, refused: NDArray[np.int64], ticks: NDArray[np.int64]
    ) -> tuple[list[Array], NDArray[np.int64], NDArray[np.bool_]] | None:
        """Where the axes stand at ticks (m,): None where no joint state is old enough, or arrays do not lie so.

        Gives positions, directions, turned and stamped (m, axes) and age (m,), stamps (m,), and whether they are known,
        told and doubted (3, m), as of `AxisPositions`.

        Args:
            of: the machine's axes; what it says of joint states is filled in.
            times: stamps (n,) of at least one joint state, ns.
            values: (n, 2 axes + 1) their rows.
            refused: stamps of those that were not believed.
            ticks: timestamps (ns).
        """
        stamped = is_plain(times, INTEGERS) and is_plain(refused, INTEGERS) and is_plain(ticks, INTEGERS)
        if not (stamped and is_plain(values, REALS)):
            return None
        m, axes = len(ticks), of.axes
        size = m * axes
        of.stamps, of.values, of.refused = address(times), address(values), address(refused)
        of.count, of.refusals = len(times), len(refused)
        found, stamps, flags = np.empty(4 * size + m), np.empty(m, np.int64), np.empty((3, m), np.bool_)
        at, flagged = address(found), address(flags)
        places = [at, at + 8 * size, at + 16 * size, at + 32 * size, at + 24 * size, address(stamps)]
        to = (c_int64 * 9)(*places, flagged, flagged + m, flagged + 2 * m)  # `axes` of compiled/joints.h
        if not self._axes_at(ctypes.addressof(of), address(ticks), m, ctypes.addressof(to)):
            return None
        parts: list[Array] = [*found[: 4 * size].reshape(4, m, axes), found[4 * size :]]
        return parts, stamps, flags

    def judge(
        self,
        of: Tolerated,
        times: NDArray[np.int64],
        axes: Sequence[Array | NDArray[np.int64] | NDArray[np.bool_]],
        commands: tuple[Array, Array],
        doubts: NDArray[np.int64],
        *,
        verified: bool,
    ) -> JudgedTicks:
        """What ticks (m,) can be used for.

        Args:
            of: how far inputs may be apart; what it says of commands is filled in.
            times: (n,) stamps of the commands, ns.
            axes: stamped (m, axes), age, stamps, known, told and doubted (m,) as of `AxisPositions`.
            commands: (m,) at the stamps of the joint states, and somewhat before, rad.
            doubts: (m,) masks.
            verified: whether the description has passed a turn before.
        """
        m, kept = len(doubts), list[Any]()
        of.stamps, of.count = _place(times, kept), len(times)
        stamped, age, stamps, known, told, doubted = (_place(each, kept) for each in axes)
        at = (c_int64 * 9)(0, 0, 0, age, stamped, stamps, known, told, doubted)  # `axes` of compiled/joints.h
        difference, flags = np.empty(m), np.empty((6, m), np.bool_)
        given = (_place(each, kept) for each in (*commands, doubts))
        begin = address(flags)
        to = (c_int64 * 10)(*given, address(difference), *(begin + i * m for i in range(6)))  # `checked`
        width = axes[0].shape[1]
        self._judge(ctypes.addressof(of), ctypes.addressof(at), width, m, verified, ctypes.addressof(to))
        return JudgedTicks(difference, *flags)

    def components(self, weights: Array, components: Array, observable: NDArray[np.bool_]) -> Array:
        """(m, 6) components carried by weights (6, 6); NaN where they depend on what is not observable, (m, 6)."""
        kept: list[Any] = []
        carried = np.empty(components.shape)
        at = [_place(each, kept) for each in (weights, components, observable)]
        self._components(*at, len(components), address(carried))
        return carried


@cache
def chosen_kernel() -> PipelineKernel | None:
    """The compiled kernel, see `kernel_of`; None where numpy computes."""
    return kernel_of(_ROOM, PipelineKernel)


def describe_kernel() -> str:
    """That ticks are computed by numpy, and why; empty where they are by the library."""
    reason = room_library(_ROOM)[1]
    return f"ticks are computed by numpy, which is slower: {reason}" if reason else ""


def _place(array: Array | NDArray[np.int64] | NDArray[np.bool_] | None, kept: list[Any]) -> int:
    """Where the numbers of an array lie in one piece, of it or of a copy that is kept; 0 where there is none."""
    if array is None:
        return 0
    whole: NDArray[Any] = array if array.flags.c_contiguous else np.ascontiguousarray(array)
    kept.append(whole)
    return address(whole)
