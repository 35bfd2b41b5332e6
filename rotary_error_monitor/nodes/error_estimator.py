"""The estimator: samples of heads, autocollimator, listed sensors and command in, the stage's error motion out.

ros2 run rotary_error_monitor error_estimator --ros-args -p stage:=my_stage.yaml
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Hashable, Iterator, Sequence

import numpy as np
from std_srvs.srv import Trigger

from rotary_error_monitor.codec.cdr_blocks import BlockDecoder
from rotary_error_monitor.codec.error_motion_blocks import block_from_error_motion
from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.description.streams import COMMAND
from rotary_error_monitor.description.wire import Topic
from rotary_error_monitor.errors import InputError, without_numbers
from rotary_error_monitor.metrology.error_motion import COMPONENTS, ErrorMotion
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.diagnostics import Condition, Level, StreamWatch
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.nodes.pace import Pace
from rotary_error_monitor.nodes.process import program
from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.pipeline.estimator_settings import LONGEST_GAP_NS, SHORTEST_GAP_NS, EstimatorSettings
from rotary_error_monitor.pipeline.kernel import describe_kernel
from rotary_error_monitor.pipeline.mixed_rotation import is_mixed
from rotary_error_monitor.pipeline.observability import possible_components, unchecked_sensors
from rotary_error_monitor.pipeline.radial_heights import HIGHEST, figures_of, radial_block
from rotary_error_monitor.signals.blocks import NANOSECONDS

_POSE_PERIOD, _FIGURES_PERIOD = 50_000_000, 20_000_000  # ns, between two messages for people and for plotting
_SILENT_AFTER = 0.5  # s without an estimate from which it is said: beyond what a computer that is busy takes
_DEFAULTS = EstimatorSettings()
_TOLD_SCALE = 2.0
"""Factor on the uncertainty of the heads from which it is worth a warning; noise makes 1.1 now and then."""


class ErrorEstimator(ManagedNode):
    """Passes blocks to the pipeline's estimator as they come and publishes what it gives.

    It goes on without a stream that falls silent or is doubted, as long as a head is left (of a stage without heads
    the command), and says so, at once in the log and each second in the diagnostics. Samples that are
    older than `max_age` at their arrival are dropped: after a restart, the middleware delivers some of the past. The
    service `~/reset` makes it believe all streams again, until they are contradicted anew.
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
            (SHORTEST_GAP_NS / NANOSECONDS, LONGEST_GAP_NS / NANOSECONDS),
        ),
        Setting(
            "disagreement_limit",
            _DEFAULTS.disagreement_limit,
            "contradiction among the heads, in standard deviations, from which nothing is published",
            (1.0, 1e6),
        ),
        Setting(
            "check_turns",
            _DEFAULTS.check_turns,
            "part of a turn against which the stage's description is held before it counts as verified; 0.0 for none",
            (0.0, 1.0),
        ),
        Setting(
            "heights",
            [],
            "heights above the ring at which radial error motion is published as well, m",
            (-HIGHEST, HIGHEST),
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
                max_age_ns=round(self.setting("max_age") * NANOSECONDS),
                check_turns=self.setting("check_turns"),
            ),
        )
        if slower := describe_kernel():
            self.get_logger().info(slower)
        self._said: dict[str, str] = {}
        self._samples, self._pose = self.wire.topic("error_motion_samples"), self.wire.topic("error_motion_pose")
        self._figures_topic = self.wire.topic("error_motion_figures")
        self._sample_publisher, self._pose_publisher = self.publish_on(self._samples), self.publish_on(self._pose)
        self._figures_publisher = self.publish_on(self._figures_topic)
        self._open_heights()
        self._pose_pace, self._figures_pace = Pace(_POSE_PERIOD), Pace(_FIGURES_PERIOD)
        self._reported = (0, 0, 0)
        self._unjoined = Counter[str]()
        self._error = ""
        self._observable = np.zeros(len(COMPONENTS), np.bool_)
        now_ns, patience = self.now_ns(), self.setting("patience")
        self._output = StreamWatch(self._samples.name, patience, _SILENT_AFTER, now_ns, outgoing=True)
        self._inputs = {}
        for stream in self._estimator.inputs:
            topic = self._topic(stream)
            self._inputs[stream] = StreamWatch(topic.name, patience, 1.0, now_ns)
            self.listen_to_bytes(topic, self._receiver(stream))
        self.after_messages(self._estimate)
        self.serve(Trigger, "~/reset", self._reset)

    def _open_heights(self) -> None:
        """Publishers of radial error motion at heights, which are silent while nobody names any."""
        self._heights = [float(height) for height in self.setting("heights")]
        self._at_heights = self.wire.topic("error_motion_heights_samples")
        self._heights_figures = self.wire.topic("error_motion_heights_figures")
        self._heights_publisher = self.publish_on(self._at_heights)
        self._heights_figures_publisher = self.publish_on(self._heights_figures)

    def conditions(self, now_ns: int) -> list[Condition]:
        """Each stream that comes in, and the estimate."""
        for name, stream in self._estimator.status.streams.items():
            self._inputs[name].refused_samples = stream.admission.refused
        return [*(watch.report(now_ns) for watch in self._inputs.values()), self._estimate_condition(now_ns)]

    def _topic(self, stream: str) -> Topic:
        """Topic of a stream by the estimator's name for it: `head_a`, `autocollimator`, `axial_probe_top`."""
        return self.wire.of_stream(stream)

    def _receiver(self, stream: str) -> Callable[[bytes, int], None]:
        watch, topic = self._inputs[stream], self._topic(stream).name

        def receive(data: bytes, received_ns: int) -> None:
            block = decoder.decode(data)
            try:
                if self.listening.is_shared(topic):
                    self._estimator.belief.streams.distrust(stream, "several publishers share its topic")
                    raise InputError(self.listening.publishers_of(topic))
                self._estimator.accept(stream, block, received_ns)
            except InputError as error:
                watch.refuse(str(error))
                raise
            watch.observe(block, received_ns)

        # single samples that are not finite cost only themselves
        decoder = BlockDecoder(finite=False)
        return receive

    def _estimate(self) -> None:
        """What of all streams came together is reckoned with once."""
        for estimate in self._estimator.advance():
            self._publish(estimate)
        self._say_doubts()

    def news(self, now_ns: int) -> Hashable:
        """What begins or ends to be missing or doubted, or to be without redundancy."""
        silent = [watch.what for watch in (self._output, *self._inputs.values()) if watch.is_stale(now_ns)]
        heads = self._estimator.belief.heads
        return (*silent, self._estimator.status.absent, *sorted(self._said)), heads.lost, heads.unsettled

    def _say_doubts(self) -> None:
        """Log what begins or ceases to be doubted."""
        doubts = dict(self._estimator.reasons)
        for what in doubts.keys() - self._said.keys():
            self.get_logger().warning(f"{what} is not used: {doubts[what]}")
        for what in self._said.keys() - doubts.keys():
            self.get_logger().info(f"{what} is used again")
        self._said = doubts

    def _reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        doubts = ", ".join(what for what, _ in self._estimator.reasons)
        self._estimator.reset()
        self._said.clear()  # what is doubted again is said again
        response.success = True
        response.message = f"believed again: {doubts}" if doubts else "nothing was doubted"
        self.get_logger().info(f"reset: {response.message}")
        return response

    def _publish(self, estimate: ErrorMotion) -> None:
        block = block_from_error_motion(estimate, self._samples.columns)
        self._sample_publisher.publish(messages.block_bytes(block, self._samples.frame))
        self._output.observe(block, self.now_ns())
        self._observable = estimate.observable[-1]
        pose, figures = self._pose_pace.is_due(block.stamp_ns), self._figures_pace.is_due(block.stamp_ns)
        if self._heights:
            self._publish_heights(estimate, figures)
        if pose or figures:
            self._publish_for_people(estimate, pose, figures)

    def _publish_heights(self, estimate: ErrorMotion, figures: bool) -> None:
        block = radial_block(estimate, self._heights)
        self._heights_publisher.publish(messages.block_bytes(block, self._at_heights.frame))
        if figures:
            names, values, deviations = figures_of(block)
            stamp_ns, frame = int(block.times_ns[-1]), self._heights_figures.frame
            self._heights_figures_publisher.publish(
                messages.joint_state_message(stamp_ns, frame, names, values, efforts=deviations)
            )

    def _publish_for_people(self, estimate: ErrorMotion, pose: bool, figures: bool) -> None:
        """The latest of it."""
        components, observable = estimate.components[-1], estimate.observable[-1]
        stamp_ns = int(estimate.times_ns[-1])
        if figures:
            shown = np.where(observable, components, np.nan)
            self._figures_publisher.publish(messages.figures_message(stamp_ns, self._figures_topic.frame, shown))
        if pose:
            self._pose_publisher.publish(
                messages.pose_message(stamp_ns, self._pose.frame, components, estimate.covariance[-1], observable)
            )

    def _estimate_condition(self, now_ns: int) -> Condition:
        status, flow = self._estimator.status, self._output.report(now_ns)
        totals = (status.withheld, status.unobservable, status.saturated.total())
        withheld, unobservable, saturated = (now - before for now, before in zip(totals, self._reported, strict=True))
        self._reported = totals
        unjoined, self._unjoined = status.unjoined - self._unjoined, status.unjoined.copy()
        level, reasons = Level.OK, []
        for badness, reason in (
            (Level.ERROR, f"{withheld} estimates withheld: the heads contradict one another" if withheld else ""),
            (Level.ERROR, f"{unobservable} estimates impossible: {self._lacking()}" if unobservable else ""),
            (Level.ERROR, f"no estimate: {flow.message}" if flow.level == Level.ERROR else ""),
            (Level.WARN, f"{saturated} samples at the end of an instrument's range" if saturated else ""),
            *(
                (Level.WARN, f"{count} estimates without a value of {name}: samples are missing or too far apart")
                for name, count in unjoined.items()
            ),
            *self._doubts(flow.level == Level.ERROR),
            *((Level.WARN, self._too_far_apart([name])) for name in self._sparse(rotation=not unobservable)),
        ):
            if reason:
                level = max(level, badness)
                reasons.append(reason)
        message = "; ".join(reasons) or "complete"
        self._log_error(message if level == Level.ERROR else "")
        return Condition("estimate", level, message, self._figures(dict(flow.figures)))

    def _log_error(self, message: str) -> None:
        """Log why there is no estimate, or one that is doubted, where it is not what was logged last, and its end."""
        short = without_numbers(message)
        if short == self._error:
            return
        if short:
            self.get_logger().error(f"estimate: {message}")
        else:
            self.get_logger().info("estimate: as it should be again")
        self._error = short

    def _lacking(self) -> str:
        """Why the rotation is not known."""
        status = self._estimator.status
        sparse = [name for name in status.sparse if name not in self._sparse(rotation=False)]
        if sparse:
            return self._too_far_apart(sparse)
        if not self.stage.azimuths:
            return "no command, which alone tells the rotation"
        used = self._heads_used()
        if not used:
            return "no head is there" if len(self.stage.azimuths) > 1 else "the head is not there"
        heads = " and ".join(used)
        return f"{heads} alone do not tell rotation from displacement, and there is no command that is believed"

    def _heads_used(self) -> list[str]:
        """Streams of the heads that are there and believed."""
        away = (*self._estimator.status.absent, *dict(self._estimator.reasons))
        return [name for name in (f"head_{letter}" for letter in self.stage.azimuths) if name not in away]

    def _sparse(self, rotation: bool) -> list[str]:
        """Streams whose samples are too far apart; with those that tell the rotation, or without."""
        told_by = "head_" if self.stage.azimuths else COMMAND
        return [name for name in self._estimator.status.sparse if rotation or not name.startswith(told_by)]

    def _too_far_apart(self, names: Sequence[str]) -> str:
        """That samples of these streams are not joined, and why."""
        return self._estimator.status.too_far_apart(names, round(self.setting("max_gap") * NANOSECONDS))

    def _doubts(self, silent: bool) -> Iterator[tuple[Level, str]]:
        """What is missing or doubted while there are estimates."""
        status, belief = self._estimator.status, self._estimator.belief
        for what, why in self._estimator.reasons:
            yield (Level.ERROR if what in ("heads", "ring") else Level.WARN), f"{what}: {why}"
        yield Level.WARN, f"without {', '.join(status.absent)}" if status.absent else ""
        # What the stage has no sensor for is no fault: the topic's bit mask says it.
        possible = possible_components(self.stage)
        hidden = [name for bit, name in enumerate(COMPONENTS) if name in possible and not self._observable[bit]]
        yield Level.WARN, f"not observable: {', '.join(hidden)}" if hidden and not silent else ""
        yield Level.WARN, "" if possible else "the sensors of the stage determine no component of error motion"
        if used := [] if silent or is_mixed(self.stage) or belief.heads.tells_rotation else self._heads_used():
            heads = " and ".join(used)
            yield Level.WARN, f"the rotation is as sure as the ring is in place, for there is {heads} alone"
        if belief.heads.lost:
            yield Level.WARN, "redundancy is lost: a further fault of a head would show only as a step"
        if belief.heads.unsettled:
            yield (
                Level.WARN,
                "a head that was silent may have lost counts: no other would contradict it, and the ring is not where "
                "it was at this angle before",
            )
        if belief.command.untold:
            yield (
                Level.WARN,
                f"the heads were silent, and the speed is another now: positioning is uncertain by "
                f"{belief.command.untold * 1e6:.3g} µrad until a change of speed shows the drive's delay",
            )
        raised = self._estimator.sensor_conflict
        if raised > _TOLD_SCALE:
            yield (
                Level.WARN,
                f"the listed sensors contradict one another: their uncertainty is raised {raised:.1f} times",
            )
        if belief.heads.contradicted > _TOLD_SCALE:
            raised = belief.heads.contradicted
            yield Level.WARN, f"the heads contradict one another: their uncertainty is raised {raised:.1f} times"
        for what, size in belief.unresolved:
            yield (
                Level.WARN,
                (
                    f"{what} and error motion are not told apart: {size * 1e6:.3g} µm (or µrad) count as uncertainty; "
                    "rotary_error_monitor calibrate assembly tells"
                ),
            )
        if belief.ring.late_stands_out:
            yield (
                Level.WARN,
                f"the ring is displaced in proportion to the speed, as where stamps of heads are "
                f"{belief.ring.apart * 1e3:.3g} ms apart: {belief.ring.late * 1e6:.3g} µm count as uncertainty now",
            )
        if belief.verified < 1.0:
            yield Level.WARN, f"the description is held against the stage: {belief.verified:.0%} of a turn so far"

    def _figures(self, figures: dict[str, object]) -> dict[str, object]:
        status, belief = self._estimator.status, self._estimator.belief
        return figures | {
            "estimates": status.estimates,
            "withheld": status.withheld,
            "impossible": status.unobservable,
            "saturated_samples": status.saturated.total(),
            "clock_set_back": status.restarts,
            "whole_turns_taken_out": status.turns,
            "disagreement_sigma": status.disagreement,
            "head_uncertainty_scale": belief.verdict.head_scale,
            "tilt_uncertainty_scale": belief.verdict.tilt_scale,
            "sensor_conflict": self._estimator.sensor_conflict,
            "sensors_without_redundancy": ", ".join(unchecked_sensors(self.stage)) or "none",
            "rotation": "by the heads" if self.stage.azimuths else "by the command, which no sensor checks",
            "command_delay_ms": belief.command.delay * 1e3,
            "verified": belief.verified,
            "unresolved_radial_um": belief.verdict.unresolved * 1e6,
            "unresolved_tilt_urad": belief.verdict.unresolved_tilt * 1e6,
            "unseen_graduation_orders": " ".join(map(str, status.unseen_orders)),
        }


main = program(ErrorEstimator, "error_estimator")

if __name__ == "__main__":
    raise SystemExit(main())
