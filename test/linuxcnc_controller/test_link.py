"""The link on a controller that behaves as LinuxCNC does."""

import math

import numpy as np
import pytest

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.linuxcnc_controller.beat import Beat
from rotary_error_monitor.linuxcnc_controller.clock import Moment, present
from rotary_error_monitor.linuxcnc_controller.kinematics import RotaryTableKinematics, TrivialKinematics
from rotary_error_monitor.linuxcnc_controller.link import CLEARING, UNKNOWN_KINEMATICS, Link, start
from rotary_error_monitor.linuxcnc_controller.observer import start as start_observer
from rotary_error_monitor.linuxcnc_controller.offsets import WAITING
from rotary_error_monitor.linuxcnc_controller.pins import MachinePins, Units
from rotary_error_monitor.linuxcnc_controller.protocol import ClearRequest, CorrectionRequest, HaltRequest, LinkSettings

POSE = (0.01, 0.02, 0.03, math.radians(30), math.radians(90))
CORRECTION = {"X": 10e-6, "Y": -20e-6, "Z": 7e-6, "A": 1e-4, "C": -2e-4}
NANOMETRE = 1e-9
PERIOD_NS = 4_000_000


class Bench:
    """A link and its controller, and a clock for both."""

    def __init__(self, controller, settings=None):
        self.controller = controller
        self.pins = MachinePins(controller, controller.names, Units())
        self.link = Link(self.pins, settings or LinkSettings())
        self.now_ns = 1_000_000_000_000
        self.set_by_ns = 0

    @property
    def now(self):
        return Moment(self.now_ns + self.set_by_ns, self.now_ns)

    def look(self, times=1, periods=4):
        for _ in range(times):
            self.now_ns += PERIOD_NS
            self.controller.tick(periods)
            state = self.link.look(lambda: self.now)
        return state

    def correct(self, corrections=CORRECTION):
        positions = tuple(corrections.get(name, 0.0) for name in self.controller.names)
        self.link.handle(CorrectionRequest(positions), self.now)

    def run(self, times=200, corrections=CORRECTION):
        for _ in range(times):
            self.correct(corrections)
            state = self.look()
        return state

    def errors(self, corrections=CORRECTION):
        nominal = self.controller.kinematics.to_joints(self.controller.axes)
        wanted = [corrections.get(name, 0.0) for name in self.controller.names]
        moved = zip(self.controller.joints, nominal, wanted, strict=True)
        return [abs(joint - start - correction) for joint, start, correction in moved]


@pytest.fixture
def bench(controller):
    controller.move(*POSE)
    return Bench(controller)


def test_joints_move_by_the_corrections_while_the_positions_leave_them_out(bench):
    state = bench.run()
    assert max(bench.errors()) < NANOMETRE
    assert state.positions == pytest.approx(bench.controller.kinematics.to_joints(POSE), abs=1e-15)
    assert (state.trouble, state.valid, state.lag) == ("", True, pytest.approx(0.0, abs=NANOMETRE))
    assert state.effect == pytest.approx(list(CORRECTION.values()), abs=NANOMETRE)
    assert (state.to_go, state.slowed) == ((0.0,) * 5, False)


def test_what_is_in_effect_is_told_on_the_way_there(bench):
    """And before the first correction: here what a predecessor left."""
    bench.controller.speed = 1e-4
    assert bench.look().effect == pytest.approx([0.0] * 5, abs=1e-15)
    far = {"X": 4e-4, "C": -4e-3}
    seen = [bench.run(1, far) for _ in range(60)]
    assert any(state.slowed for state in seen)
    for state in seen:
        nominal = bench.controller.kinematics.to_joints(bench.controller.axes)
        assert state.positions == pytest.approx(nominal, abs=1e-15)
    effects = [state.effect[0] for state in seen]
    assert effects == sorted(effects)
    assert 1e-5 < effects[-1] < 4e-4
    assert effects[-1] + seen[-1].to_go[0] == pytest.approx(4e-4, abs=2 * 2e-3 * 0.004)
    again = Bench(bench.controller)
    assert again.look().effect == pytest.approx(bench.look().effect, abs=1e-12)


def test_held_corrections_turn_with_the_table(bench):
    bench.run()
    bench.controller.move(-0.03, 0.02, 0.01, math.radians(-40), math.radians(200))
    state = bench.look(200)
    assert state.trouble == ""
    assert state.effect == pytest.approx(list(CORRECTION.values()), abs=NANOMETRE)
    assert max(bench.errors()) < NANOMETRE


def test_machine_off_holds_and_machine_on_begins_anew(bench):
    bench.run()
    bench.controller.switch(False)
    state = bench.look(5)
    assert (state.trouble, state.valid) == ("the machine is off", False)
    bench.correct({"X": 30e-6})
    assert bench.look(5).trouble == "the machine is off"
    bench.controller.switch(True)
    state = bench.look(20)
    assert (state.trouble, state.valid) == (WAITING, True)
    assert state.effect == pytest.approx([0.0] * 5, abs=1e-15), "what was asked for before is forgotten"
    bench.run()
    assert max(bench.errors()) < NANOMETRE
    bench.controller.move(*POSE)
    bench.run()
    assert max(bench.errors()) < NANOMETRE


class Elsewhere:
    """Joints that are where no kinematics puts them."""

    def __init__(self, kinematics):
        self.kinematics = kinematics

    def to_joints(self, axes):
        return tuple(joint + 1e-4 for joint in self.kinematics.to_joints(axes))


@pytest.mark.parametrize(
    ("fault", "reason"), [("on", "is off"), ("homed", "is not homed"), ("teleop", "is in joint mode")]
)
def test_a_machine_that_is_off_is_told_as_off_wherever_its_joints_are(bench, fault, reason):
    """And what it does to its offsets meanwhile is nobody's hand: LinuxCNC itself zeroes them."""
    bench.run()
    controller = bench.controller
    kinematics = controller.kinematics
    setattr(controller, fault, False)
    controller.kinematics = Elsewhere(kinematics)
    state = bench.look(5)
    assert (state.trouble, state.valid) == (f"the machine {reason}", False)
    controller.requested, controller.applied = [0.0] * 5, [0.0] * 5
    bench.look(20)
    setattr(controller, fault, True)
    assert bench.look(5).trouble == UNKNOWN_KINEMATICS
    controller.kinematics = kinematics
    state = bench.run()
    assert (state.trouble, state.takeovers) == ("", 0)
    assert max(bench.errors()) < NANOMETRE


def test_nothing_is_queued_in_joint_mode(bench):
    bench.run()
    bench.controller.teleop = False
    before = list(bench.controller.requested)
    state = bench.run(corrections={"X": -40e-6})
    assert state.trouble == "the machine is in joint mode"
    assert state.valid
    assert bench.controller.requested == before
    bench.controller.teleop = True
    bench.run(400)
    assert max(bench.errors()) < NANOMETRE


def test_soft_limits_that_clip_are_told(bench):
    bench.controller.move(0.25 - 5e-6, 0, 0, 0, 0)
    state = bench.run(corrections={"X": 10e-6})
    assert state.limited
    assert state.lag == pytest.approx(5e-6, abs=NANOMETRE)


def test_a_bridge_that_starts_again_neither_jumps_nor_adds(bench):
    bench.run()
    again = Bench(bench.controller)
    assert again.look(20).offsets == pytest.approx(bench.controller.applied, abs=1e-12)
    again.run()
    assert max(again.errors()) < NANOMETRE


def test_offsets_are_cleared_on_request_and_the_next_correction_is_followed(bench):
    bench.run()
    bench.link.handle(ClearRequest(), bench.now)
    assert bench.look().trouble == CLEARING
    state = bench.look(100)
    assert state.offsets == pytest.approx([0.0] * 5, abs=1e-12)
    assert state.trouble == WAITING
    bench.run()
    assert max(bench.errors()) < NANOMETRE


def test_counts_at_the_end_of_their_pins_begin_anew_when_the_offsets_are_cleared(bench):
    """As the link says where they are there: counts that a predecessor took through leave no way on."""
    end = 2**31 - 1000
    for index, letter in enumerate("xyzac"):
        bench.controller.pins[f"axis.{letter}.eoffset-counts"] = bench.controller.taken[index] = end
    assert "end of their 32 bits: clear the external offsets" in bench.run(20).trouble
    bench.link.handle(ClearRequest(), bench.now)
    assert bench.look(100).trouble == WAITING
    state = bench.run()
    assert state.trouble == ""
    assert max(bench.errors()) < NANOMETRE


def test_counts_that_do_not_reach_the_largest_correction_are_refused():
    with pytest.raises(InputError, match=r"count 1e-11; expected more than 2\.328\d*e-11, so that .* 0\.05 .* 32 bits"):
        LinkSettings(count=1e-11, largest_rotary=0.05)
    assert LinkSettings(count=1e-11, largest_rotary=0.02).count == 1e-11


def test_a_halt_stops_on_the_way(bench):
    bench.run(30, {"X": 4e-4})
    bench.link.handle(HaltRequest(), bench.now)
    bench.look(100)
    before = bench.look().effect
    assert bench.look(100).effect == pytest.approx(before, abs=1e-15)
    assert 1e-5 < before[0] < 3e-4


def test_corrections_that_no_gate_believed_end_the_link(bench):
    with pytest.raises(InputError, match=r"target \(1e\+300, 0\.0, 0\.0, 0\.0, 0\.0\); expected at most"):
        bench.correct({"X": 1e300})


@pytest.mark.parametrize("step_ns", [-(10**13), -50_000_000, 10**13])
def test_a_system_clock_that_is_set_moves_nothing(bench, step_ns):
    bench.run()
    before = bench.look().effect
    bench.set_by_ns = step_ns
    state = bench.look()
    assert state.stamp_ns == bench.now_ns + step_ns
    assert state.effect == pytest.approx(before, abs=1e-15)
    bench.run(corrections={"X": 50e-6})
    assert max(bench.errors({"X": 50e-6})) < NANOMETRE


def test_a_servo_thread_that_stands_is_noticed_within_half_a_second(bench):
    bench.look()
    with pytest.raises(InputError, match=r"servo thread has stood still for 0\.4"):
        bench.look(120, periods=0)
    assert bench.now_ns - 1_000_000_000_000 < 0.5e9


def test_a_pause_of_the_link_itself_is_not_taken_for_one_of_the_servo_thread(bench):
    bench.look()
    bench.now_ns += 2_000_000_000
    assert bench.look(periods=0).valid


@pytest.mark.parametrize("within", ["a look", "its wait"])
@pytest.mark.parametrize("stood_ns", [400_000_000, 9_000_000_000])
def test_what_waited_while_the_link_itself_stood_is_not_followed(bench, stood_ns, within):
    """The pipe to it keeps what came first and has no room for the newest: seconds old, it would be walked to."""
    bench.run()

    def stand():
        bench.controller.between_looks = lambda: None
        bench.now_ns += stood_ns

    if within == "a look":
        bench.controller.between_looks = stand
        bench.look()
    else:
        stand()
    for share in (10.0, 20.0, 40.0):
        bench.correct({name: share * value for name, value in CORRECTION.items()})
    for _ in range(3):
        bench.look()
        assert max(bench.errors()) < NANOMETRE
    moved = {name: 2.0 * value for name, value in CORRECTION.items()}
    bench.run(corrections=moved)
    assert max(bench.errors(moved)) < NANOMETRE, "the next one is followed"


def test_a_link_that_stood_on_its_way_to_a_correction_stays_where_it_is_until_the_next(bench):
    far = {"X": 4e-4}
    bench.run(10, far)
    bench.now_ns += 2_000_000_000
    bench.correct(far)
    states = [bench.look() for _ in range(50)]
    assert 1e-5 < states[-1].effect[0] < 1e-4
    assert states[-1].effect == pytest.approx(states[5].effect, abs=NANOMETRE)
    bench.run(corrections=far)
    assert max(bench.errors(far)) < NANOMETRE


def test_a_link_that_is_late_for_each_look_follows_all_the_same(bench):
    """On a computer that is far too busy: what came meanwhile is no older than it takes the link to be called hung."""
    for _ in range(200):
        bench.now_ns += 200_000_000
        state = bench.run(1)
    assert state.trouble == ""
    assert max(bench.errors()) < NANOMETRE


def test_kinematics_switched_while_it_runs_are_followed(bench):
    bench.controller.kinematics = TrivialKinematics()
    bench.controller.show()
    state = bench.run(corrections={"X": 10e-6})
    assert state.positions == pytest.approx(POSE)
    assert max(bench.errors({"X": 10e-6})) < NANOMETRE


def test_with_unknown_kinematics_nothing_is_corrected_or_published(bench):
    bench.controller.kinematics = RotaryTableKinematics((0.1, 0.0, 0.0), (0.0, 0.0))
    bench.controller.show()
    state = bench.run(10)
    assert (state.trouble, state.valid, state.positions) == (UNKNOWN_KINEMATICS, False, ())
    assert bench.controller.requested == [0.0] * 5


def test_a_standing_joint_has_no_velocity_though_a_correction_moves_it(bench):
    bench.controller.velocities = [1e-6, 0.02, 0.0, 0.0, 0.0]
    bench.look()
    bench.controller.move(0.01, 0.02, 0.03, math.radians(30), math.radians(91))
    state = bench.look()
    assert state.velocities[1] == pytest.approx(0.02)
    assert bench.look().velocities[1] == 0.0


def test_a_look_is_taken_again_when_a_servo_period_falls_into_it(bench):
    def meddle():
        bench.controller.between_looks = lambda: None
        bench.controller.move(0.02, 0.02, 0.03, math.radians(30), math.radians(90))
        bench.now_ns += 7_000_000  # another process had the processor

    bench.controller.between_looks = meddle
    state = bench.link.look(lambda: bench.now)
    assert state.positions == pytest.approx(bench.controller.kinematics.to_joints(bench.controller.axes), abs=1e-15)
    assert state.stamp_ns == bench.now.stamp_ns, "the stamp is from before the machine was where it is said to be"


def test_pins_that_something_else_drives_are_named(controller):
    controller.driven.add("axis.y.eoffset-scale")
    with pytest.raises(InputError, match=r"HAL pin axis\.y\.eoffset-scale cannot be set .*connected to nothing"):
        Bench(controller)


def test_a_gantry_with_more_joints_than_axes_is_refused(controller):
    with pytest.raises(InputError, match="5 joints for the axes X Y, not one for each"):
        MachinePins(controller, "XY", Units())


def test_inches_are_understood(make_controller):
    controller = make_controller("XYZ", table=False)
    pins = MachinePins(controller, "XYZ", Units(per_metre=1000 / 25.4))
    controller.pins["axis.x.pos-cmd"] = 1.0
    assert pins.read(present).axes[0] == pytest.approx(0.0254)


def test_programs_take_their_settings_by_name(controller):
    pins = MachinePins(controller, controller.names, Units())
    link, period = start({"period": 0.002}, pins)
    assert period == 0.002
    observer, period = start_observer({"period": 0.01}, pins)
    assert period == 0.01
    controller.move(*POSE)
    now = lambda: Moment(7, 0)  # noqa: E731
    observer.handle(ClearRequest(), now())
    seen = observer.look(now)
    assert seen.stamp_ns == 7
    assert seen.axes == pytest.approx(POSE)
    assert seen.joints == pytest.approx(link.look(present).positions)


class Beats:
    """Beats at the time of the bench, each with a servo period; some late, some missing, some overtaken by the next."""

    def __init__(self, bench, kinds):
        self.bench, self.kinds = bench, iter(kinds)

    def wait(self, clock):
        kind = next(self.kinds)
        if kind == "none":
            return None
        self.bench.controller.tick()
        beat = Beat(clock(), self.bench.pins.pulse(), kind != "late")
        self.bench.now_ns += 90_000
        if kind == "overtaken":
            self.bench.controller.tick()
        return beat


@pytest.mark.parametrize(
    ("kinds", "is_exact"),
    [
        (["on time"], True),
        (["late", "on time"], True),
        (["overtaken", "late", "on time"], True),
        (["late", "late", "overtaken"], False),
        (["late", "none"], False),
    ],
)
def test_a_look_at_one_servo_period_is_stamped_with_its_beginning(bench, kinds, is_exact):
    bench.controller.velocities = [0.0, 0.0, 0.0, 0.0, 0.3]
    bench.run()
    link = Link(bench.pins, LinkSettings(), Beats(bench, kinds))
    state = link.look(lambda: bench.now)
    assert state.is_exact is is_exact
    assert state.stamp_ns == bench.now.stamp_ns - (90_000 if is_exact else 0)
    assert state.commands == pytest.approx(bench.controller.joints, abs=1e-15), "with corrections"
    assert np.subtract(state.commands, state.positions) == pytest.approx([*CORRECTION.values()], abs=NANOMETRE)
    assert state.speeds == pytest.approx((0.0, 0.0, 0.0, 0.0, 0.3))
