"""What becomes of the faults of a recording: the stated behaviour of each."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from world import DESCRIPTIONS, FAULTS

from faults.documenting import Row
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.metrology.encoder_heads import HeadLayout

WRONG_DESCRIPTIONS = {f"described_{name}": each for name, each in DESCRIPTIONS.items()}
"""What can be wrong in the description of a stage; some faults of a recording have the same names."""

Bound = Callable[[StageDescription], Mapping[str, float]]


def command_bound(stage: StageDescription) -> Mapping[str, float]:
    """A command that is off by no more than drive and stamps can be is one that the rotor follows as badly."""
    limits = stage.limits
    return {"ecc": limits.following_error + limits.latency * limits.speed}


def tilt_bound(stage: StageDescription) -> Mapping[str, float]:
    """A tilt that the stage itself can make, however it came about."""
    return {"eac": 2.0 * stage.limits.tilt, "ebc": 2.0 * stage.limits.tilt}


def slow_head_bound(stage: StageDescription) -> Mapping[str, float]:
    """Without redundancy, a fault that grows no faster than a bearing moves is one, up to what it can move."""
    if HeadLayout(tuple(stage.encoder.azimuths.values())).redundancy > 0:
        return {}
    radial = stage.limits.radial
    return {"exc": radial, "eyc": radial, "ecc": radial / stage.encoder.disc_radius}


def everything_bound(stage: StageDescription) -> Mapping[str, float]:
    """As far as the stage itself can move."""
    radial = stage.limits.radial
    return {"exc": radial, "eyc": radial, **tilt_bound(stage), **command_bound(stage)}


@dataclass(frozen=True)
class Behaviour:
    """The stated behaviour under some faults of the independent world.

    Attributes:
        faults: their names there.
        group: chapter of the page.
        seen, done, published, recovery: as in `Row`.
        bound: what of a fault by its nature cannot be told from the stage: largest error of components, m and rad.
        goes_on: components that are published as without the fault.
        heads: from how many heads of a stage on they are.
        apart: whether those that need an instrument that the fault touches are left out of it.
        named: whether the head that is wrong is left out by name, from as many heads on.
    """

    faults: tuple[str, ...]
    group: str
    seen: str
    done: str
    published: str
    recovery: str
    bound: Bound | None = None
    goes_on: tuple[str, ...] = ()
    heads: int = 2
    apart: bool = False
    named: bool = False

    def going_on(self, wrong: Sequence[str]) -> tuple[str, ...]:
        """Components that go on where the streams `wrong` are touched."""
        lost = {name for stream in wrong for name in _OF_INSTRUMENT.get(stream, ())} if self.apart else set()
        return tuple(name for name in self.goes_on if name not in lost)


_RADIAL, _TILT, _ECC = ("exc", "eyc"), ("eac", "ebc"), ("ecc",)
_ALL = (*_RADIAL, *_TILT, *_ECC)
_OF_INSTRUMENT = {"autocollimator": _TILT, "command": _ECC}
_ONE_TO_SPARE = 4
"""Heads of which one may be left out: three tell rotation from radial motion."""

_TWO_TO_SPARE = 5
"""Heads of which two may be left out."""

_LATCH = "within 1 s of its end, once nothing has contradicted for 0.5 s"
_NOTHING = "nothing is needed"
_REST = "everything, from the other heads"
_LEFT_OUT = "all, from the other heads, with their larger uncertainty; of fewer than three what these determine"
_ESTIMATOR = "`error_estimator: estimate` names it"

BEHAVIOUR = (
    Behaviour(
        ("head_turns_start", "head_turns_later", "heads_turns_start", "heads_turns_later"),
        "heads",
        "not a fault; `turns` counts them",
        "whole turns between heads and command are taken out once, and checked on",
        "everything",
        _NOTHING,
        goes_on=_ALL,
    ),
    Behaviour(
        ("head_wraps_0_2pi", "head_wraps_pm_pi", "heads_wraps_0_2pi", "heads_wraps_pm_pi"),
        "heads",
        "not a fault; `wraps` counts them",
        "a step of whole turns, which no axis makes between two samples, is taken out",
        "everything",
        _NOTHING,
        goes_on=_ALL,
    ),
    Behaviour(
        ("command_turns_start", "command_turns_later", "command_wraps_0_2pi", "command_wraps_pm_pi"),
        "command",
        "not a fault",
        "whole turns are taken out; `ecc` lies within half a turn",
        "everything",
        _NOTHING,
        goes_on=_ALL,
    ),
    Behaviour(
        ("head_restarted",),
        "heads",
        f"{_ESTIMATOR}: off by so many counts, or rotation and command apart",
        "the head is left out, within 0.1 s: no stage moves as far",
        _LEFT_OUT,
        "when the zero is as described again",
        goes_on=_ALL,
        heads=_ONE_TO_SPARE,
        named=True,
    ),
    Behaviour(
        ("heads_restarted",),
        "heads",
        f"{_ESTIMATOR}: rotation and command apart, and a ring that does not fit",
        "where all lost their zero, none is believed",
        "no radial motion, no positioning, no tilt",
        "when the zero is as described again",
    ),
    Behaviour(
        ("head_degrees", "head_arcseconds"),
        "heads",
        f"{_ESTIMATOR}: off against the others, or samples faster than the axis can turn",
        "the head is left out",
        _LEFT_OUT,
        _LATCH,
        goes_on=_ALL,
        heads=_ONE_TO_SPARE,
        named=True,
    ),
    Behaviour(
        ("heads_degrees", "heads_arcseconds"),
        "heads",
        f"{_ESTIMATOR}: rotation and command apart, or samples beyond the speed of the axis",
        "neither ring nor command is believed",
        "no radial motion, no positioning, no tilt",
        _LATCH,
    ),
    Behaviour(
        ("heads_swapped",),
        "description",
        f"{_ESTIMATOR}: the heads contradict one another, and nothing tells which is wrong",
        "no head is believed until all agree",
        "nothing",
        _LATCH,
    ),
    Behaviour(
        ("head_two_publishers",),
        "heads",
        f"{_ESTIMATOR}: samples not after the one before; do two publish?",
        "the head is left out while a tenth of its samples is refused",
        _LEFT_OUT,
        _LATCH,
        goes_on=_ALL,
        heads=_TWO_TO_SPARE,
    ),
    Behaviour(
        ("head_dead_start", "head_dead_later"),
        "heads",
        "its stream is stale or waiting; redundancy is lost is said",
        "the estimate goes on after `patience` (0.1 s)",
        _LEFT_OUT,
        "0.1 s after its first whole block",
        goes_on=_ALL,
        heads=_ONE_TO_SPARE,
    ),
    Behaviour(
        ("two_heads_dead_opposed", "two_heads_dead_neighbours"),
        "heads",
        "their streams are stale; redundancy is lost is said",
        "as the remaining heads tell rotation and motion apart",
        "what they determine: three or more everything, two opposed heads rotation and one direction, two others "
        "or one positioning, as sure as the ring is in place",
        "0.1 s after the first whole block",
        goes_on=_ALL,
        heads=_TWO_TO_SPARE,
    ),
    Behaviour(
        ("head_stuck", "head_reversed", "head_late", "head_noisy", "head_drifts", "head_future_10ms"),
        "heads",
        f"{_ESTIMATOR}: off against the others by so many counts",
        "what it changed of late, over 10 ms to a turn, tells which head it is: that one is left out",
        _LEFT_OUT
        + "; until it is found the uncertainty holds what it contradicts; without redundancy a fault that grows "
        "no faster than a bearing moves goes on until it is beyond what the stage can move",
        _LATCH,
        slow_head_bound,
        goes_on=_ALL,
        heads=_ONE_TO_SPARE,
        named=True,
    ),
    Behaviour(
        ("head_copied",),
        "heads",
        f"{_ESTIMATOR}: off against the others by so many counts, or a ring that does not fit",
        "as of a head that is off by what its place shows of the ring's displacement",
        _LEFT_OUT,
        _LATCH,
        slow_head_bound,
    ),
    Behaviour(
        ("head_jumps_1", "head_jumps_2", "head_jumps_10", "head_jumps_100", "head_jumps_line"),
        "heads",
        f"{_ESTIMATOR}: off by so many counts against the others; without redundancy a step that no bearing makes",
        "the head is left out; without redundancy none is believed until the ring is where it was at this angle",
        _LEFT_OUT,
        _LATCH,
        goes_on=_ALL,
        heads=_ONE_TO_SPARE,
    ),
    Behaviour(
        ("head_dead_then_other_jumps_1", "head_dead_then_other_jumps_10", "head_dead_then_other_jumps_100"),
        "heads",
        "redundancy is lost is said with the first; a step that no bearing makes with the second",
        "the uncertainty counts what could go unseen; a larger step takes the estimate away",
        "of five heads and more everything; from three heads with the smallest step that would show as uncertainty, "
        "then nothing",
        "when the ring is back where it was at this angle for 0.5 s, or on a reset",
        goes_on=_ALL,
        heads=_TWO_TO_SPARE,
    ),
    Behaviour(
        ("head_nan", "head_inf", "head_1e30", "head_1e300"),
        "heads",
        "samples refused: not finite, or beyond what the instrument can show",
        "they are left out; a head with more than a tenth of them is not used",
        "everything",
        _LATCH,
        goes_on=_ALL,
        heads=_ONE_TO_SPARE,
    ),
    Behaviour(
        ("head_time_equal", "head_time_falls", "blocks_overlapping", "blocks_duplicated"),
        "messages",
        "samples refused: not after the one before, or stamped later than those behind it; do two publish?",
        "they are left out; a stream with more than a tenth of them is not used",
        "everything",
        _LATCH,
        goes_on=_ALL,
        heads=_ONE_TO_SPARE,
    ),
    Behaviour(
        ("head_future_1s", "head_future_1h", "head_future_365d", "head_future_once", "head_1969"),
        "messages",
        "messages refused: in the future, or older than `max_age`; `refused` names stream and reason",
        "what is stamped more than 0.1 s ahead of its arrival is refused",
        _REST,
        "with the first right stamp",
        goes_on=_ALL,
        heads=_ONE_TO_SPARE,
    ),
    Behaviour(
        ("blocks_late", "blocks_lost", "blocks_out_of_order", "blocks_empty"),
        "messages",
        "its stream is stale, samples are late or missing",
        "what comes within `patience` counts, what comes later does not; over a gap nothing is joined",
        "from the streams that are there",
        "with the first whole block after `patience`",
        goes_on=_ALL,
        heads=_ONE_TO_SPARE,
        apart=True,
    ),
    Behaviour(
        ("recording_paused",),
        "messages",
        "all streams are stale",
        "over a gap nothing is joined",
        "nothing meanwhile, then everything",
        "with the first whole block after `patience`",
        goes_on=_ALL,
    ),
    Behaviour(
        ("clocks_step_forward", "clocks_step_back"),
        "messages",
        "a warning that the clock was set back; a pause after a step ahead",
        "after a step back everything begins anew; a step ahead is a pause. Where this computer's clock does not step "
        "with them, what is stamped more than 0.1 s ahead of it or `max_age` (1 s) behind is refused",
        "everything, with the new stamps; of what is refused nothing",
        "at once; of what is refused with the first right stamp",
        everything_bound,
        goes_on=_ALL,
    ),
    Behaviour(
        ("autocollimator_stuck", "autocollimator_unlit_zero", "autocollimator_saturated"),
        "autocollimator",
        f"{_ESTIMATOR}: the same reading for so many ms, a step, or at the end of its range",
        "the tilt is not used",
        "everything but tilt",
        "within 1 s of its end, once it was for 0.5 s near what it was before",
        goes_on=(*_RADIAL, *_ECC),
    ),
    Behaviour(
        ("autocollimator_stepped", "autocollimator_unlit_noise"),
        "autocollimator",
        f"{_ESTIMATOR}: a step that no bearing makes",
        "the tilt is not used",
        "everything but tilt",
        "within 1 s of its end, once it was for 0.5 s near what it was before",
        tilt_bound,
        goes_on=(*_RADIAL, *_ECC),
    ),
    Behaviour(
        ("autocollimator_spikes",),
        "autocollimator",
        "samples refused: a spike; `error_estimator: estimate` names one of many samples: a step that no bearing makes",
        "what stands off from the median of five by more than noise, the samples before it and a rotor that turns on "
        "explain is left out; a step that came back may come again, and counts as uncertainty for 10 s",
        "everything, tilt with that uncertainty; of samples 10 ms apart and more, a spike of five that rises no "
        "faster than `limits.tilt_rate` and noise allow is a tilt",
        "within 1 s of its end, once it was for 0.5 s near what it was before",
        goes_on=(*_RADIAL, *_ECC),
    ),
    Behaviour(
        ("autocollimator_noisy",),
        "autocollimator",
        "the uncertainty is raised by the noise that is measured",
        "what stands off by much more than the samples before it is left out",
        "everything, tilt with its measured noise",
        "as the noise falls, within 1 s",
        goes_on=(*_RADIAL, *_ECC),
    ),
    Behaviour(
        ("autocollimator_degrees", "autocollimator_arcseconds"),
        "autocollimator",
        f"samples refused: beyond what the instrument can show; {_ESTIMATOR}: what no bearing makes",
        "the tilt is not used",
        "everything but tilt",
        _LATCH,
        tilt_bound,
        goes_on=(*_RADIAL, *_ECC),
    ),
    Behaviour(
        (
            "autocollimator_axes_swapped",
            "autocollimator_x_reversed",
            "autocollimator_y_reversed",
            "autocollimator_gain_half",
            "autocollimator_gain_double",
            "autocollimator_late",
        ),
        "autocollimator",
        f"{_ESTIMATOR}: it does not fit its description, and which mistake explains it; one that changes the figure by "
        "less than half of `limits.tilt` is not told: the rotor may tilt so, and heads see none of it. Of drawn stages "
        "a wrong sign of x does so in a fifth",
        "before a turn has verified it, its uncertainty is what the stage can tilt; after that the figure over the "
        "angles of the last turn tells, of which 16 are told apart: where the rotor indexes, what began meanwhile "
        "shows only as it comes to them again",
        "everything but tilt; until enough angles were visited, a tilt that is off by no more than the stage can tilt",
        "within 1 s of its end, once it has fitted for 0.5 s",
        tilt_bound,
        goes_on=(*_RADIAL, *_ECC),
    ),
    Behaviour(
        ("autocollimator_low_pass",),
        "autocollimator",
        f"{_ESTIMATOR}: what is read is so many times what is described, and turned",
        "what goes with the rotor is smaller and late, the faster it turns: held against the description over a turn; "
        "what is not told from the rotor's own motion counts as uncertainty",
        "everything but tilt; until enough angles were visited, a tilt that is off by no more than the stage can tilt",
        "within 1 s of its end, once it has fitted for 0.5 s",
        tilt_bound,
        goes_on=(*_RADIAL, *_ECC),
    ),
    Behaviour(
        ("autocollimator_drifts",),
        "autocollimator",
        f"{_ESTIMATOR}, once it is beyond what the stage can tilt",
        "a slow drift of the only tilt signal cannot be told from a tilt of the rotor",
        "a tilt that is off by no more than the stage can tilt, then none",
        "within 1 s of its end, once it was for 0.5 s near what it was before",
        tilt_bound,
        goes_on=(*_RADIAL, *_ECC),
    ),
    Behaviour(
        ("autocollimator_dead_start", "autocollimator_dead_later"),
        "autocollimator",
        "its stream is stale",
        "the tilt is not used; the corrections' covariance says what that costs",
        "everything but tilt",
        "0.1 s after its first whole block",
        goes_on=(*_RADIAL, *_ECC),
    ),
    Behaviour(
        ("command_stamps_off", "command_offset", "command_wrong_rate"),
        "command",
        f"{_ESTIMATOR}: apart by more than following error and latency explain, a step, or heads behind the command",
        "the command is not used; the compensation holds it against the joint states besides",
        "everything but positioning; a positioning error that is off by no more than `following_error`, and `latency` "
        "as long as neither rest nor a change of speed shows that it is none",
        "within 1 s of its end, once it was for 0.5 s near what it was before; off from the first sample on, once the "
        "speed leaves open no more of a delay than it was off by",
        command_bound,
        goes_on=(*_RADIAL, *_TILT),
    ),
    Behaviour(
        ("command_degrees", "command_arcseconds", "command_stuck", "command_staircase", "command_noisy"),
        "command",
        f"{_ESTIMATOR}: apart, a step, or it stands while the rotor turns; its noise raises the uncertainty",
        "the command is not used",
        "everything but positioning",
        _LATCH,
        command_bound,
        goes_on=(*_RADIAL, *_TILT),
    ),
    Behaviour(
        ("command_dead_start", "command_dead_later"),
        "command",
        "its stream is stale",
        "the command is not used",
        "everything but positioning",
        "0.1 s after its first whole block",
        goes_on=(*_RADIAL, *_TILT),
    ),
    Behaviour(
        ("command_wrong_velocity",),
        "command",
        "not looked at",
        "the angle alone counts",
        "everything",
        _NOTHING,
        goes_on=_ALL,
    ),
    Behaviour(
        tuple(WRONG_DESCRIPTIONS),
        "description",
        f"{_ESTIMATOR}; `rotary_error_monitor check BAG` says what does not fit",
        "held against the stage over a turn before corrections flow; before as uncertain as the stage can move",
        "nothing that rests on what is contradicted; what is not told from the rotor's own motion is as uncertain",
        "with the right description",
        command_bound,
    ),
)
"""The stated behaviour under every fault of the world."""


def behaviour_of(name: str) -> Behaviour:
    """The stated behaviour under a fault or with a wrong description."""
    (found,) = (each for each in BEHAVIOUR if name in each.faults)
    return found


def rows() -> tuple[Row, ...]:
    """Rows of the page, one for each behaviour."""
    sentences = {name: each.sentence for name, each in (FAULTS | WRONG_DESCRIPTIONS).items()}
    return tuple(
        Row(
            each.group,
            "; ".join(dict.fromkeys(sentences[name].rstrip(".") for name in each.faults)),
            each.seen,
            each.done,
            each.published,
            each.recovery,
        )
        for each in BEHAVIOUR
    )
