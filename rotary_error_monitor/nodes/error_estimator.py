"""The estimator: samples of heads, autocollimator and command in, the error motion of the stage out.

ros2 run rotary_error_monitor error_estimator --ros-args -p stage:=my_stage.yaml
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence

from rotary_error_monitor.description.wire import Topic
from rotary_error_monitor.metrology.error_motion import COMPONENTS
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.diagnostics import Condition, Level, StreamWatch
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.nodes.parameters import Setting
from rotary_error_monitor.nodes.process import run
from rotary_error_monitor.pipeline.estimation import Estimator, EstimatorSettings, error_motion_from_block
from rotary_error_monitor.signals.blocks import NANOSECONDS, SampleBlock

NAME = "error_estimator"
_HUMAN_PERIOD = 50_000_000
_DEFAULTS = EstimatorSettings()
_CATCH_UP = 10


class ErrorEstimator(ManagedNode):
    """Passes blocks to the pipeline's estimator as they come and publishes what it gives.

    It goes on without a stream that falls silent, as long as two opposed heads are left, and says so. Samples that are
    older than `max_age` at their arrival are dropped: after a restart, the middleware delivers some of the past.
    """

    settings = (
        Setting("period", _DEFAULTS.period_ns / NANOSECONDS, "distance of two estimates, s", (1e-5, 1.0)),
        Setting(
            "patience",
            _DEFAULTS.patience_ns / NANOSECONDS,
            "how far a stream may stay behind the others before the estimate goes on without it, s",
            (0.001, 10.0),
        ),
        Setting(
            "max_gap",
            _DEFAULTS.max_gap_ns / NANOSECONDS,
            "samples further apart than this are not joined, s",
            (0.0001, 1.0),
        ),
        Setting(
            "disagreement_limit",
            _DEFAULTS.disagreement_limit,
            "contradiction among the heads, in standard deviations, from which nothing is published",
            (1.0, 1e6),
        ),
        Setting("max_age", 1.0, "samples older than this at their arrival are dropped, s", (0.01, 60.0)),
    )

    def open(self) -> None:
        """Build the estimator and listen to its streams."""
        self._estimator = Estimator(
            self.stage,
            EstimatorSettings(
                period_ns=round(self.setting("period") * NANOSECONDS),
                patience_ns=round(self.setting("patience") * NANOSECONDS),
                max_gap_ns=round(self.setting("max_gap") * NANOSECONDS),
                disagreement_limit=self.setting("disagreement_limit"),
            ),
        )
        self._behind: set[str] = set()
        self._max_age_ns = round(self.setting("max_age") * NANOSECONDS)
        self._samples, self._pose = self.wire.topic("error_motion_samples"), self.wire.topic("error_motion_pose")
        self._sample_publisher, self._pose_publisher = self.publish_on(self._samples), self.publish_on(self._pose)
        self._pose_ns = 0
        self._reported = (0, 0, 0)
        self._components = 0
        now_ns, patience = self.now_ns(), self.setting("patience")
        self._output = StreamWatch(self._samples.name, patience, 1.0, now_ns)
        self._inputs = {}
        for stream in self._estimator.inputs:
            topic = self._topic(stream)
            self._inputs[stream] = StreamWatch(topic.name, patience, 1.0, now_ns)
            self.listen_to_blocks(topic, self._receiver(stream))
        self.after_messages(self._estimate)

    def conditions(self, now_ns: int) -> list[Condition]:
        """Each stream that comes in, and the estimate."""
        return [*(watch.report(now_ns) for watch in self._inputs.values()), self._estimate_condition(now_ns)]

    def _topic(self, stream: str) -> Topic:
        """Topic of a stream by the estimator's name for it: `head_a`, `autocollimator`, `command`."""
        head = stream.removeprefix("head_")
        return self.wire.topic("head_samples", head) if head != stream else self.wire.topic(f"{stream}_samples")

    def _receiver(self, stream: str) -> Callable[[SampleBlock], None]:
        watch = self._inputs[stream]

        def receive(block: SampleBlock) -> None:
            now_ns = self.now_ns()
            watch.observe(block, now_ns)
            if self._is_old(stream, now_ns - int(block.times_ns[-1])):
                watch.refuse(f"older than {self._max_age_ns / NANOSECONDS} s; are the clocks of all computers alike?")
                return
            self._estimator.accept(stream, block)

        return receive

    def _estimate(self) -> None:
        """The blocks of all streams that came together are reckoned with once."""
        for estimate in self._estimator.advance():
            self._publish(estimate)

    def _is_old(self, stream: str, age_ns: int) -> bool:
        """Whether to drop a block. Once behind, all is dropped until it is nearly fresh: a backlog must not stay."""
        limit_ns = self._max_age_ns // _CATCH_UP if stream in self._behind else self._max_age_ns
        if age_ns > limit_ns:
            self._behind.add(stream)
            return True
        self._behind.discard(stream)
        return False

    def _publish(self, estimate: SampleBlock) -> None:
        self._sample_publisher.publish(messages.block_bytes(estimate, self._samples.frame))
        self._output.observe(estimate, self.now_ns())
        self._components = int(estimate.column("observable")[-1])
        if estimate.stamp_ns - self._pose_ns < _HUMAN_PERIOD:
            return
        self._pose_ns = estimate.stamp_ns
        latest = SampleBlock(estimate.stamp_ns, estimate.names, estimate.rows[-1:])
        motion = error_motion_from_block(latest)
        self._pose_publisher.publish(
            messages.pose_message(
                int(latest.times_ns[0]),
                self._pose.frame,
                motion.components[0],
                motion.covariance[0],
                motion.observable[0],
            )
        )

    def _estimate_condition(self, now_ns: int) -> Condition:
        status, flow = self._estimator.status, self._output.report(now_ns)
        totals = (status.withheld, status.unobservable, status.saturated)
        withheld, unobservable, saturated = (now - before for now, before in zip(totals, self._reported, strict=True))
        self._reported = totals
        hidden = [name for bit, name in enumerate(COMPONENTS) if name != "ezc" and not self._components >> bit & 1]
        level, reasons = Level.OK, []
        for happened, badness, reason in (
            (withheld, Level.ERROR, f"{withheld} estimates withheld: the heads contradict one another"),
            (unobservable, Level.ERROR, f"{unobservable} estimates impossible: too few heads"),
            (flow.level == Level.ERROR, Level.ERROR, f"no estimate: {flow.message}"),
            (saturated, Level.WARN, f"{saturated} autocollimator samples at the end of its range"),
            (status.absent, Level.WARN, f"without {', '.join(status.absent)}"),
            (hidden and flow.level != Level.ERROR, Level.WARN, f"not observable: {', '.join(hidden)}"),
        ):
            if happened:
                level = max(level, badness)
                reasons.append(reason)
        figures = dict(flow.figures) | {
            "estimates": status.estimates,
            "withheld": status.withheld,
            "impossible": status.unobservable,
            "saturated_samples": status.saturated,
            "disagreement_sigma": status.disagreement,
            "unseen_graduation_orders": " ".join(map(str, status.unseen_orders)),
        }
        return Condition("estimate", level, "; ".join(reasons) or "complete", figures)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until a signal; the exit code is 0 then, 2 after wrong input."""
    return run(lambda: ErrorEstimator(NAME), args)


if __name__ == "__main__":
    sys.exit(main())
