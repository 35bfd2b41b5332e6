"""What a list of statuses becomes: the line on top, the order, what is old, and how much of it is kept."""

from __future__ import annotations

import random

import pytest

from rotary_error_monitor.dashboard.health import (
    SILENT_AFTER,
    Health,
    NodeStatus,
    Severity,
    label_of,
    plain_node,
    verdict_of,
)
from rotary_error_monitor.description.wire import load_wire

LABELS = {topic.name.lstrip("/").replace("/", "."): label_of(topic) for topic in load_wire()}
HEAD = "stage.head_d.samples"


def heard(statuses, now=0.0, namespace=""):
    health = Health(namespace, LABELS)
    health.note(statuses, now)
    return health


def test_all_well_is_ok_and_nothing_heard_is_a_fault():
    assert verdict_of(heard([]).rows(0.0)).severity == Severity.FAULT
    verdict = verdict_of(heard([NodeStatus("error_estimator", "estimate", 0, "complete")]).rows(0.1))
    assert (verdict.severity, verdict.more) == (Severity.OK, 0)


@pytest.mark.parametrize(
    ("level", "severity"),
    [(0, Severity.OK), (1, Severity.ATTENTION), (2, Severity.FAULT), (3, Severity.ATTENTION), (77, Severity.FAULT)],
)
def test_levels_of_rep_107(level, severity):
    assert heard([NodeStatus("recorder", "recording", level, "")]).rows(0.0)[0].severity == severity


def test_a_dead_head_is_named_in_plain_words_and_before_what_follows_from_it():
    statuses = [
        NodeStatus("compensation", "correction", 2, "held: no error motion for 0.5 s on /stage/error_motion/samples"),
        NodeStatus("error_estimator", "estimate", 1, "without head_d; redundancy is lost"),
        NodeStatus("error_estimator", HEAD, 2, "stale: the last sample is 1.2 s old"),
        NodeStatus("recorder", "recording", 0, "recording"),
    ]
    for seed in range(20):
        random.Random(seed).shuffle(statuses)
        rows = heard(statuses).rows(0.0)
        verdict = verdict_of(rows)
        assert verdict.severity == Severity.FAULT
        assert verdict.reason == "head d gives no samples: the last one is 1.2 s old"
        assert verdict.more == 1
        assert [row.what for row in rows] == [
            "estimator: head d",
            "compensation: correction",
            "estimator: estimate",
            "recorder: recording",
        ]


@pytest.mark.parametrize(
    ("status", "reason"),
    [
        (NodeStatus("error_estimator", "estimate", 1, "without head_d"), "estimator: without head_d"),
        (NodeStatus("error_estimator", HEAD, 2, "nothing has arrived yet"), "head d: nothing has arrived yet"),
        (NodeStatus("lvdt", "state", 1, "inactive"), "lvdt: inactive"),
    ],
)
def test_a_reason_names_the_stream_or_the_node(status, reason):
    assert verdict_of(heard([status]).rows(0.0)).reason == reason


def test_a_latch_is_said_as_it_is():
    verdict = verdict_of(heard([NodeStatus("compensation", "correction", 2, "held: error limit latched: X")]).rows(0.0))
    assert verdict.reason == "corrections are held: error limit latched: X"


@pytest.mark.parametrize(
    ("node", "severity", "reason"),
    [
        ("encoder_head_d", Severity.FAULT, "head d is silent for 3 s"),
        ("compensation", Severity.FAULT, "compensation is silent for 3 s"),
        ("recorder", Severity.ATTENTION, "recorder is silent for 3 s"),
        ("somebody_elses", Severity.ATTENTION, "somebody elses is silent for 3 s"),
    ],
)
def test_a_node_that_falls_silent_is_one_stale_row(node, severity, reason):
    statuses = [NodeStatus(node, "state", 0, "active"), NodeStatus(node, "other", 0, "well")]
    health = heard(statuses, now=-1.0)
    health.note(statuses, 0.0)
    assert {row.stale for row in health.rows(SILENT_AFTER - 0.1)} == {False}
    (row,) = health.rows(3.0)
    assert (row.severity, row.stale, row.reason) == (severity, True, reason)
    assert health.find(node, "state", 3.0) is None
    health.note([NodeStatus(node, "state", 0, "active")], 4.0)
    assert [row.stale for row in health.rows(4.1)] == [False], "what it no longer says is gone"
    assert health.rows(4.0 + SILENT_AFTER + 0.1)[0].stale, "the interruption does not make it slow"


def test_who_reports_seldom_is_not_silent_between_two_reports():
    health = Health("", {})
    for beat in range(4):
        health.note([NodeStatus("chiller", "", 0, "well")], 10.0 * beat)
    assert not health.rows(39.0)[0].stale
    assert health.rows(56.0)[0].stale


def test_a_dead_head_stays_and_an_ended_tool_goes():
    health = heard([NodeStatus("encoder_head_a", "state", 0, ""), NodeStatus("metrics", "server", 0, "serving")])
    assert len(health.rows(30.0)) == 2
    assert [row.what for row in health.rows(86_400.0)] == ["head a"]


def test_another_namespace_is_left_out():
    statuses = [
        NodeStatus("right.recorder", "recording", 2, "full"),
        NodeStatus("left.recorder", "recording", 0, "recording"),
    ]
    health = heard(statuses, namespace="left")
    assert [row.what for row in health.rows(0.0)] == ["recorder: recording"]
    assert health.find("recorder", "recording", 0.0) == statuses[1]
    assert len(heard(statuses).rows(0.0)) == 2


def test_memory_is_bounded_whatever_names_come():
    health = Health("", {})
    for number in range(5000):
        health.note([NodeStatus(f"node_{number}", f"part_{part}", 2, "x" * 10_000) for part in range(3)], number * 1e-4)
        health.note([NodeStatus("one", f"part_{number}", 0, "")], number * 1e-4)
    rows = health.rows(0.5)
    assert len(rows) <= 200 * 3 + 100
    assert max(len(row.message) for row in rows) < 250


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("encoder_head_a", "head a"),
        ("error_estimator", "estimator"),
        ("listed_sensor_top", "sensor top"),
        ("left.gap_monitor", "left: gap monitor"),
    ],
)
def test_names_of_nodes_in_plain_words(name, words):
    assert plain_node(name) == words
