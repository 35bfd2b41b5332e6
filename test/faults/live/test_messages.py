"""A second program speaks on topics of a running cell, in messages of every wrong kind, or cannot be heard."""

from __future__ import annotations

import itertools

import pytest
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from received_blocks import block_of
from sensor_msgs.msg import Imu, JointState

from faults.documenting import Row, shows
from faults.live import stranger
from faults.live.cell import DISCOVERY, SAID_WITHIN, SETTLING_NS
from faults.live.other_programs import check
from rotary_error_monitor.nodes import messages

TRUST = 2.0
"""Time, s, after the last message of a second publisher in which a stream is believed again: the order of their numbers
tells for a second that two spoke, and a doubted stream must agree for half a second."""

TRANSFER = 3.0
"""What a block of 16 MB may take to come, s: it does not fit into the middleware's buffers."""
STREAMS = [("head_samples", head) for head in "abcd"] + [("autocollimator_samples", None), ("command_samples", None)]
KINDS = (
    stranger.plausible,
    stranger.wrong_fields,
    stranger.wrong_types,
    stranger.big_endian,
    stranger.empty,
    stranger.a_million,
)


def begin(live, say, topic):
    """Let a stranger speak once it is heard by who listens in the cell; when that was (ns)."""
    publisher = say.publisher
    # the harness hears error motion and corrections too, and corrections go to compensation and controller
    others = {"error_motion_samples": 2, "axis_corrections": 3}.get(topic.key, 1)
    live.wait(lambda: publisher.get_subscription_count() >= others, f"someone to listen to {topic.name}")
    return live.clock()


def speak_until(live, say, condition, what, pause=0.025):
    """Say it again after each pause (s) until the condition holds."""
    due_ns = 0

    def step():
        nonlocal due_ns
        if live.clock() >= due_ns:
            say()
            due_ns = live.clock() + round(pause * 1e9)
        return condition()

    live.wait(step, what)


@pytest.mark.few(3)
@shows(
    Row(
        group="messages",
        fault="a second publisher on the topic of a head, the autocollimator or the command, with blocks that could be "
        "right, have wrong columns, types or byte order, no samples, or a million",
        seen="by the order of the messages' numbers, once each of two has spoken after the other: within 0.1 s (a "
        "block of 16 MB takes 1 s to 3 s to come); each that is no sample block is refused and counted by its reason",
        done="the stream is not used, for nothing tells whose block is whose",
        published="what the other streams give; without the command corrections go on with the described positioning. "
        "While blocks of 16 MB come one after another (66 in 10 s measured), estimates are up to 4.7 s old and "
        "corrections are held meanwhile; nothing wrong is published",
        recovery="within 2 s of the last of its messages; after that flood of 16 MB blocks all "
        "streams are back within 14 s, and the estimator keeps the memory that it took, 640 MB in place of 100",
    )
)
@pytest.mark.parametrize("make", KINDS, ids=[each.__name__ for each in KINDS])
def test_a_second_publisher_of_an_input(live, chance, make):
    key, head = chance.choice(STREAMS)
    topic = live.wire.topic(key, head)
    with stranger.stranger(live.cell) as node, live.lost() as lost:
        say = stranger.Speaker(node, topic, make)
        begin_ns = begin(live, say, topic)
        name = f"error_estimator: publishers of {topic.name}"
        # one block of 16 MB is enough: many would keep the middleware from bringing anything else
        pause = 2 * TRANSFER if make is stranger.a_million else 0.025
        words = "several publishers share", "/stranger", "/mock" if "command" in key else key.split("_")[0]
        speak_until(live, say, lambda: live.has_said(name, begin_ns, *words), "a word of two", pause)
        said = live.wait_for_word(name, begin_ns, *words)
        transfer = TRANSFER if make is stranger.a_million else 0.0
        check("said", said.stamp_ns - begin_ns, SAID_WITHIN + transfer, lost())
        end_ns = live.clock()
    with live.lost() as lost:
        well_ns = live.wait_until_all_is_well(end_ns)
        check("right again", well_ns - end_ns, TRUST + transfer, lost())
    live.judge(begin_ns + SETTLING_NS)


@shows(
    Row(
        group="messages",
        fault="a second publisher of error motion, of joint states or of corrections",
        seen="by the order of the messages' numbers",
        done="corrections are held, by the compensation and, of corrections, by the controller too",
        published="no correction; error motion goes on",
        recovery="2 s after the last of its messages; for corrections also once the other has left the graph",
    )
)
@pytest.mark.parametrize("key", ["error_motion_samples", "machine_joint_states", "axis_corrections"])
def test_a_second_publisher_of_what_moves_the_axes(live, key):
    topic = live.wire.topic(key)

    def joints(_):
        return messages.joint_state_message(live.clock(), topic.frame, list("XYZAC"), [0.0] * 5, [0.0] * 5)

    with stranger.stranger(live.cell) as node, live.lost() as lost:
        say = stranger.Speaker(node, topic, stranger.plausible if topic.is_sample_block else joints)
        begin_ns = begin(live, say, topic)
        name = "compensation: correction"
        speak_until(live, say, lambda: live.has_said(name, begin_ns, "held:", "several publishers"), "a word of two")
        said = live.wait_for_word(name, begin_ns, "several publishers")
        check("said", said.stamp_ns - begin_ns, SAID_WITHIN, lost())
        held_ns = live.clock()
        for _ in range(20):
            say()
            live.let_run(0.025)
        end_ns = live.clock()
        own = [stamp for stamp, values in live.heard.corrections if held_ns < stamp < end_ns and any(values.values())]
        assert not own, "corrections go out all the same"
    with live.lost() as lost:
        live.wait_until_all_is_well(end_ns)
        live.wait_for_word(name, end_ns, "", least=0)
        assert (live.clock() - end_ns) * 1e-9 < lost().allowed(2 * TRUST + DISCOVERY)
    live.heard.corrections[:] = [each for each in live.heard.corrections if any(each[1].values())]
    live.judge(begin_ns + SETTLING_NS)


@shows(
    Row(
        group="messages",
        fault="a publisher of best effort where reliable ones are heard, or of another message type, on a topic of the "
        "cell",
        seen="in the graph, once a second",
        done="nothing: the middleware joins the two not at all; who it is and why it is not heard is said",
        published="all as before",
        recovery="not needed",
    )
)
@pytest.mark.parametrize("how", ["best effort", "type"])
def test_a_publisher_that_is_not_heard(live, chance, how):
    key, head = chance.choice(STREAMS)
    topic = live.wire.topic(key, head)
    begin_ns = live.clock()
    with stranger.stranger(live.cell) as node, live.lost() as lost:
        if how == "type":
            say = stranger.Speaker(node, topic, lambda _: Imu())
        else:
            qos = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
            say = stranger.Speaker(node, topic, stranger.plausible, qos)
        name = f"error_estimator: publishers of {topic.name}"
        words = "not heard: ERROR: Best effort publisher" if how == "best effort" else "which is not heard"
        speak_until(live, say, lambda: live.has_said(name, begin_ns, words, "/stranger"), "a word of it")
        assert (live.clock() - begin_ns) * 1e-9 < lost().allowed(SAID_WITHIN + DISCOVERY)
        for _ in range(20):
            say()
            live.let_run(0.025)
        assert not live.has_said(name, begin_ns, "several publishers"), "who is not heard disturbs nobody"
    live.wait_until_all_is_well(live.clock())
    live.judge(begin_ns)


WRONG = {
    "error_estimator": [("period", 5.0), ("period", float("nan")), ("period", "fast"), ("max_age", 2.0)],
    "compensation": [("age_limit", -1.0), ("linear.error", float("inf")), ("machine", "no_such"), ("joint_lag", 0.2)],
    "mock_controller": [("mock.seed", -1), ("mock.speeds", [float("nan")]), ("block_period", 9.0)],
    "encoder_head_b": [("source", "nowhere"), ("head", "a"), ("poll_rate", "often")],
    "autocollimator": [("iio.sensitivity", float("nan")), ("use_sim_time", True)],
}


@shows(
    Row(
        group="processes",
        fault="a parameter is set while the node is active: out of range, not finite, of the wrong type, unknown, or "
        "one that would be right",
        seen="by who sets it: refused with the reason",
        done="nothing; parameters are read when the node configures",
        published="all as before",
        recovery="not needed",
    )
)
def test_parameters_at_run_time(live):
    begin_ns = live.clock()
    for node, wrong in WRONG.items():
        names = [name for name, _ in wrong]
        before = live.cell.call(GetParameters, f"/{node}/get_parameters", names=names).values
        asked = [*wrong, ("no_such_parameter", 1)]
        wanted = [Parameter(name, value=value).to_parameter_msg() for name, value in asked]
        results = live.cell.call(SetParameters, f"/{node}/set_parameters", parameters=wanted).results
        for (name, value), result in zip(asked, results, strict=True):
            assert not result.successful, (node, name, value)
            assert name in result.reason or "undeclared" in result.reason or "type" in result.reason.lower(), (
                node,
                name,
                value,
                result.reason,
            )
        assert live.cell.call(GetParameters, f"/{node}/get_parameters", names=names).values == before
    end_ns = live.clock()
    live.wait_until_all_is_well(end_ns)
    gaps = [b - a for (a, _), (b, _) in itertools.pairwise(live.heard.corrections)]
    assert gaps
    live.judge(begin_ns)


@shows(
    Row(
        group="corrections",
        fault="a correction passes its error limit",
        seen="by the compensation, at the tick; said at once, as error, with axis and size",
        done="it latches and holds until `~/reset` is called, and again where the reset comes too early",
        published="no correction beyond the limit, none while it is latched; offsets go on; what was in effect beyond "
        "a limit that is lowered goes back at the rate limit",
        recovery="at the rate limit from the last correction, within 1 s of the reset",
    )
)
@pytest.mark.parametrize(
    ("share", "words"),
    [((0.0, 0.9), "error limit latched until ~/reset is called"), ((1.1, 9.0), "what cannot be in effect")],
    ids=["below", "beyond"],
)
def test_a_limit_is_reached_latched_and_reset(live, share, words):
    """What is in effect as it begins is below the limit, and passes it, or is beyond it already."""
    from std_srvs.srv import Trigger

    live.let_run(4.0)
    sizes = [max(abs(values[axis]) for axis in "XYZ") for _, values in live.heard.corrections]
    limit = 0.5 * (min(sizes) + max(sizes))  # the machine moves on: it is passed again soon

    def is_there():
        return share[0] * limit < max(abs(live.heard.corrections[-1][1][axis]) for axis in "XYZ") < share[1] * limit

    live.wait(is_there, "corrections of that size")
    live.kill("compensation")
    in_effect = live.heard.corrections[-1]
    # corrections went on until it was killed: the limit is beside what is in effect, not what was when it was chosen
    size = max(abs(in_effect[1][axis]) for axis in "XYZ")
    limit = max(limit, size / share[1]) if share[0] == 0.0 else min(limit, size / share[0])
    live.start("compensation", **{"linear.warning": 0.5 * limit, "linear.error": limit})
    begin_ns = live.active_ns("compensation")
    said = live.wait_for_word("compensation: correction", begin_ns, words)
    assert "reset" in said.message
    live.let_run(0.5)
    held_ns = live.newest_ns()
    assert held_ns < said.stamp_ns + SETTLING_NS

    def is_released():
        live.cell.call(Trigger, "/compensation/reset")
        asked_ns = live.clock()
        live.wait(
            lambda: live.corrected_ns(asked_ns) is not None or live.has_said("compensation: correction", asked_ns, ""),
            "what comes of the reset",
        )
        return live.corrected_ns(asked_ns) is not None

    live.wait(is_released, "corrections after a reset")
    given = [in_effect, *((stamp, values) for stamp, values in live.heard.corrections if stamp > begin_ns)]
    growing = [(stamp, axis) for (_, before), (stamp, values) in itertools.pairwise(given) for axis in "XYZ"
               if abs(values[axis]) > max(limit, abs(before[axis]))]  # fmt: skip
    assert not growing
    live.judge(begin_ns)
    live.kill("compensation")
    live.start("compensation")
    live.active_ns("compensation")


def test_every_kind_of_wrong_message_is_wrong():
    """What the stranger says is no sample block, but for the one that could be right."""
    from rotary_error_monitor.codec.cdr_blocks import BlockDecoder
    from rotary_error_monitor.description.wire import load_wire
    from rotary_error_monitor.errors import InputError

    topic = load_wire().topic("head_samples", "a")
    block = BlockDecoder().decode(stranger.plausible(topic))
    assert block.names == ("t", *topic.columns)
    assert len(BlockDecoder().decode(stranger.a_million(topic)).rows) == stranger.MILLION
    for make in (stranger.big_endian, stranger.empty, stranger.wrong_types):
        with pytest.raises(InputError):
            block_of(make(topic))
    assert isinstance(messages.joint_state_message(1, "", ["X"], [0.0], [0.0]), JointState)
