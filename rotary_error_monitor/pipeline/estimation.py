"""The estimator: sample blocks of heads, autocollimator and command in, blocks of error motion out.

The same class runs live and in replay. Estimates stand on a grid of ticks fixed in absolute time. A tick is computed
as soon as every stream that is present has the samples for it; a stream that stays behind the others by more than
`patience` counts as absent. Both are judged by stamps, never by when a message happened to arrive. Should a block come
so late live that the estimator went on without it, the column `streams` of the published block says so, and a replay
that is given these masks repeats the decision.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology import error_motion as motion
from rotary_error_monitor.metrology.encoder_heads import HeadLayout, estimate_ring_pose
from rotary_error_monitor.metrology.tilt import check_saturation
from rotary_error_monitor.signals.blocks import SampleBlock, block_from_samples
from rotary_error_monitor.signals.resampling import Resampled, count_decided, resample_all, tick_times
from rotary_error_monitor.signals.streams import SampleStream

COLUMNS = (
    "theta",
    *motion.COMPONENTS,
    "observable",
    "var_exc",
    "var_eyc",
    "cov_exc_eyc",
    "var_eac",
    "var_ebc",
    "var_ecc",
    "cov_exc_ecc",
    "cov_eyc_ecc",
    "streams",
)
"""Columns of a block of error motion after `t`; `observable` and `streams` are bit masks."""

AUTOCOLLIMATOR, COMMAND = "autocollimator", "command"
HIGHEST_ORDER = 12
"""Harmonics of the graduation up to which the status says what the heads cannot see."""

CHUNK = 4096
"""Ticks computed at once at most, so that a replay needs no more memory than a live run."""


@dataclass(frozen=True)
class EstimatorSettings:
    """How the estimator samples and when it goes on without a stream.

    Attributes:
        period_ns: distance of two estimates, ns.
        patience_ns: how far a stream may stay behind the others before it counts as absent, ns; the longest block
            comes on top.
        max_gap_ns: samples further apart than this are not joined, ns.
        disagreement_limit: contradiction among the heads, in standard deviations, from which nothing is published.
    """

    period_ns: int = 1_000_000
    patience_ns: int = 100_000_000
    max_gap_ns: int = 20_000_000
    disagreement_limit: float = 10.0

    def __post_init__(self) -> None:
        for name in ("period_ns", "patience_ns", "max_gap_ns"):
            if getattr(self, name) <= 0:
                raise InputError(f"estimator setting {name} is {getattr(self, name)}; it must be above 0")
        if not self.disagreement_limit > 0:
            raise InputError(f"estimator setting disagreement_limit is {self.disagreement_limit}; it must be above 0")


@dataclass
class EstimatorStatus:
    """What a diagnostic tells of the estimator; counts since the start.

    Attributes:
        estimates: ticks published.
        withheld: ticks not published because the heads contradict one another.
        unobservable: ticks not published because too few heads were alive to tell the rotation.
        saturated: autocollimator samples at the end of the measuring range.
        absent: streams that nobody waits for now.
        disagreement: contradiction among the heads at the latest tick, standard deviations.
        unseen_orders: harmonics of the graduation, up to `HIGHEST_ORDER`, that the heads alive cannot contradict: they
            pass for rotation or radial motion.
    """

    estimates: int = 0
    withheld: int = 0
    unobservable: int = 0
    saturated: int = 0
    absent: tuple[str, ...] = ()
    disagreement: float = 0.0
    unseen_orders: tuple[int, ...] = ()
    streams: Mapping[str, SampleStream] = field(default_factory=dict)


class Estimator:
    """Joins the streams of one stage and gives its error motion.

    Attributes:
        status: counts for diagnostics.
    """

    def __init__(
        self,
        stage: StageDescription,
        settings: EstimatorSettings | None = None,
        decisions: Mapping[int, int] | None = None,
    ) -> None:
        """Estimator of `stage`.

        Args:
            stage: description with the assembly errors that are removed.
            settings: sampling and patience.
            decisions: mask of the streams by stamp (ns) of a tick, as a live run published them; a replay repeats them.
        """
        self._stage = stage
        self._settings = settings or EstimatorSettings()
        self._decisions = decisions
        self._heads = {f"head_{name}": azimuth for name, azimuth in stage.encoder.azimuths.items()}
        fields = dict.fromkeys((*self._heads, COMMAND), ("angle",)) | {AUTOCOLLIMATOR: ("tilt_x", "tilt_y")}
        self._streams = {name: SampleStream(names, self._settings.patience_ns) for name, names in fields.items()}
        self._decided = dict.fromkeys(self._streams, -1)
        self._grown: set[str] = set()
        self._bits = {name: 1 << i for i, name in enumerate((*self._heads, AUTOCOLLIMATOR, COMMAND))}
        self._next: int | None = None
        self._watermark = -1
        self._longest_block_ns = 0
        self._layouts: dict[tuple[float, ...], HeadLayout] = {}
        self._unseen: dict[HeadLayout, tuple[int, ...]] = {}
        self.status = EstimatorStatus(streams=self._streams)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the streams that are taken: `head_<letter>`, `autocollimator`, `command`."""
        return tuple(self._streams)

    def push(self, name: str, block: SampleBlock) -> list[SampleBlock]:
        """Take in a block of stream `name`; give the blocks of error motion that are complete now, columns `COLUMNS`.

        Raises:
            InputError: there is no such stream, or the block lacks its fields.
        """
        self.accept(name, block)
        return self.advance()

    def accept(self, name: str, block: SampleBlock) -> None:
        """Take in a block of stream `name` and wait for `advance`: of blocks that came together, one reckoning.

        Raises:
            InputError: there is no such stream, or the block lacks its fields.
        """
        if name not in self._streams:
            raise InputError(f"no stream '{name}' in this stage; it has {', '.join(self._streams)}")
        stream = self._streams[name]
        if name == AUTOCOLLIMATOR:
            block = self._without_saturated(block)
        if stream.push(block) == 0:
            return
        newest = stream.newest_ns
        assert newest is not None
        period = self._settings.period_ns
        if self._next is None:
            self._next = int(stream.times_ns[0]) // period + 1
            for each in self._streams.values():
                each.expect(int(stream.times_ns[0]))
        self._watermark = max(self._watermark, newest)
        self._allow_for_blocks(stream.block_duration_ns)
        self._grown.add(name)

    def advance(self) -> list[SampleBlock]:
        """Blocks of error motion that are complete with what was accepted, columns `COLUMNS`."""
        for name in self._grown:
            self._decided[name] = self._decided_until(self._streams[name], self._decided[name])
        self._grown.clear()
        return self._advance()

    def finish(self) -> list[SampleBlock]:
        """Blocks of the ticks that were still waiting: no more samples will come."""
        return self._advance(last=True)

    def _allow_for_blocks(self, duration_ns: int) -> None:
        """A stream is behind the others by a whole block until its own block is complete."""
        if duration_ns > self._longest_block_ns:
            self._longest_block_ns = duration_ns
            for stream in self._streams.values():
                stream.patience_ns = self._settings.patience_ns + duration_ns

    def _without_saturated(self, block: SampleBlock) -> SampleBlock:
        saturated = check_saturation(block.columns(("tilt_x", "tilt_y")), self._stage.autocollimator)
        if not saturated.any():
            return block
        self.status.saturated += int(saturated.sum())
        return SampleBlock(block.stamp_ns, block.names, block.rows[~saturated])

    def _decided_until(self, stream: SampleStream, before: int) -> int:
        """Index of the first tick for which `stream` still misses samples; `before` is what it was until now."""
        assert self._next is not None and stream.newest_ns is not None
        first = max(before, self._next)
        count = stream.newest_ns // self._settings.period_ns + 1 - first
        if count <= 0:
            return first
        ticks = tick_times(first, count, self._settings.period_ns)
        return first + count_decided(stream.times_ns, ticks, self._settings.period_ns)

    def _advance(self, last: bool = False) -> list[SampleBlock]:
        if self._next is None:
            return []
        present = [name for name, stream in self._streams.items() if not stream.is_absent(self._watermark)]
        self.status.absent = tuple(name for name in self._streams if name not in present)
        limit = self._watermark // self._settings.period_ns if last else min(self._decided[name] for name in present)
        if self._next >= limit:
            return []
        blocks = []
        while self._next < limit:
            count = min(limit - self._next, CHUNK)
            blocks += self._compute(tick_times(self._next, count, self._settings.period_ns))
            self._next += count
        for stream in self._streams.values():
            stream.trim(self._next * self._settings.period_ns)
        return blocks

    def _compute(self, ticks: NDArray[np.int64]) -> list[SampleBlock]:
        settings = self._settings
        signals = [(stream.times_ns, stream.values) for stream in self._streams.values()]
        resampled = resample_all(signals, ticks, settings.period_ns, settings.max_gap_ns)
        sampled = dict(zip(self._streams, resampled, strict=True))
        masks = np.zeros(len(ticks), np.int64)
        for name, stream in self._streams.items():
            # what a live run decided stands: the bag may begin later than the stream did
            heard = stream.is_whole(ticks, settings.period_ns, after_patience=self._decisions is None)
            usable = sampled[name].valid & heard
            masks += np.where(usable, self._bits[name], 0)
        if self._decisions is not None:
            decided = np.array([self._decisions.get(int(tick), 0) for tick in ticks])
            masks = np.where((masks & decided) == decided, decided, 0)
        rows = np.zeros((len(ticks), len(COLUMNS)))
        publish = np.zeros(len(ticks), np.bool_)
        for mask in set(masks.tolist()):
            chosen = np.flatnonzero(masks == mask)
            whole = len(chosen) == len(ticks)
            part = sampled if whole else {name: each.at(chosen) for name, each in sampled.items()}
            found = self._estimate(mask, part)
            if found is not None:
                rows[chosen], publish[chosen] = found
            else:
                self.status.unobservable += len(chosen)
        self.status.estimates += int(publish.sum())
        if not publish.any():
            return []
        return [block_from_samples(ticks[publish], COLUMNS, rows[publish])]

    def _estimate(
        self, mask: int, sampled: Mapping[str, Resampled]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]] | None:
        """Rows of ticks that all have the same streams, and which of them may be published."""
        encoder = self._stage.encoder
        heads = [name for name in self._heads if mask & self._bits[name]]
        if len(heads) < 2:
            return None
        azimuths = tuple(self._heads[name] for name in heads)
        layout = self._layouts.setdefault(azimuths, HeadLayout(azimuths))
        if "theta" not in layout.observable:
            return None
        readings = np.column_stack([sampled[name].values for name in heads])
        readings = motion.remove_graduation(readings, np.array(azimuths), encoder.graduation)
        gain = np.column_stack([sampled[name].gain for name in heads])
        travel = np.column_stack([sampled[name].travel for name in heads])
        ring = estimate_ring_pose(layout, encoder.disc_radius, readings, motion.head_variance(encoder, gain, travel))
        rows = np.zeros((len(ring.theta), len(COLUMNS)))
        column = {name: i for i, name in enumerate(COLUMNS)}
        rows[:, column["theta"]] = ring.theta
        radial = motion.remove_eccentricity(ring.centre, ring.theta, encoder)
        observable = 0
        for axis, name in enumerate(("x", "y")):
            if name in layout.observable:
                rows[:, column[f"e{name}c"]] = radial[:, axis]
                rows[:, column[f"var_e{name}c"]] = ring.covariance[:, 1 + axis, 1 + axis]
                observable |= 1 << axis
        rows[:, column["cov_exc_eyc"]] = ring.covariance[:, 1, 2]
        observable |= self._add_tilt(rows, column, mask, sampled[AUTOCOLLIMATOR], ring.theta)
        if mask & self._bits[COMMAND]:
            command = sampled[COMMAND].values[:, 0]
            rows[:, column["ecc"]] = ring.theta - command
            bends = [sampled[name].bend for name in (*heads, COMMAND)]
            rows[:, column["var_ecc"]] = ring.covariance[:, 0, 0] + motion.bend_variance(np.column_stack(bends))
            rows[:, column["cov_exc_ecc"]] = ring.covariance[:, 0, 1]
            rows[:, column["cov_eyc_ecc"]] = ring.covariance[:, 0, 2]
            observable |= 1 << 5
        rows[:, column["observable"]] = observable
        rows[:, column["streams"]] = mask
        agree = ring.disagreement <= self._settings.disagreement_limit
        self.status.withheld += int((~agree).sum())
        self.status.disagreement = float(ring.disagreement[-1])
        self.status.unseen_orders = self._unseen_orders(layout)
        return rows, agree & np.isfinite(rows).all(axis=1)

    def _unseen_orders(self, layout: HeadLayout) -> tuple[int, ...]:
        if layout not in self._unseen:
            self._unseen[layout] = layout.hidden_orders(HIGHEST_ORDER)
        return self._unseen[layout]

    def _add_tilt(
        self,
        rows: NDArray[np.float64],
        column: Mapping[str, int],
        mask: int,
        sampled: Resampled,
        theta: NDArray[np.float64],
    ) -> int:
        if not mask & self._bits[AUTOCOLLIMATOR]:
            return 0
        tilt = motion.remove_mirror(sampled.values, theta, self._stage.mirror)
        for axis, name in enumerate(("eac", "ebc")):
            rows[:, column[name]] = tilt[:, axis]
            rows[:, column[f"var_{name}"]] = motion.tilt_variance(
                self._stage.autocollimator, sampled.gain, sampled.travel[:, axis]
            )
        return 1 << 3 | 1 << 4


def error_motion_from_block(block: SampleBlock) -> motion.ErrorMotion:
    """Error motion with its (m, 6, 6) covariance from a block with the columns `COLUMNS`.

    Raises:
        InputError: the block lacks one of the columns.
    """
    column = {name: block.column(name) for name in COLUMNS}
    covariance = np.zeros((len(block.rows), 6, 6))
    for (i, j), name in {
        (0, 0): "var_exc",
        (1, 1): "var_eyc",
        (0, 1): "cov_exc_eyc",
        (3, 3): "var_eac",
        (4, 4): "var_ebc",
        (5, 5): "var_ecc",
        (0, 5): "cov_exc_ecc",
        (1, 5): "cov_eyc_ecc",
    }.items():
        covariance[:, i, j] = covariance[:, j, i] = column[name]
    bits = column["observable"].astype(np.int64)
    observable = (bits[:, None] >> np.arange(6)) & 1 == 1
    components = np.stack([column[name] for name in motion.COMPONENTS], axis=1)
    return motion.ErrorMotion(column["theta"], components, observable, covariance)
