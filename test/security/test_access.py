"""Who may do what, read off the contract: one node speaks where something moves, heads speak for themselves."""

from __future__ import annotations

import pytest

from rotary_error_monitor.description.wire import load_services, load_wire
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.security.access import OPERATOR, Access, cell_accesses


def accesses(**options) -> dict[str, Access]:
    return {access.node: access for access in cell_accesses(load_wire(("a", "b")), load_services(), **options)}


def who(kind: str, name: str) -> set[str]:
    return {node for node, access in accesses().items() if name in getattr(access, kind)}


def test_corrections_come_from_the_compensation_alone():
    assert who("publish", "/machine/axis_corrections") == {"compensation"}
    assert "linuxcnc_bridge" in who("subscribe", "/machine/axis_corrections")


@pytest.mark.parametrize(
    "service",
    [
        "/compensation/change_state",
        "/compensation/reset",
        "/error_estimator/reset",
        "/linuxcnc_bridge/clear_offsets",
        "/recorder/change_state",
    ],
)
def test_a_person_alone_may_call_what_releases_corrections_or_ends_a_recording(service):
    assert who("request", service) == {OPERATOR}
    assert who("reply", service) == {service.split("/")[1]}


def test_the_page_may_ask_for_what_was_granted_alone():
    granted = ["/compensation/reset", "/recorder/change_state"]
    assert accesses()["dashboard"].request == ()
    assert list(accesses(call={"dashboard": granted})["dashboard"].request) == granted
    assert [topic for topic in accesses()["dashboard"].publish if topic.startswith(("/stage", "/machine"))] == []


def test_a_head_speaks_for_itself_alone():
    assert who("publish", "/stage/head_a/samples") == {"encoder_head_a", "stage_follower"}
    assert who("publish", "/stage/head_b/samples") == {"encoder_head_b", "stage_follower"}
    assert "encoder_head" not in accesses()


def test_a_listed_sensor_speaks_for_itself_alone():
    """Also where it has the name of a head."""
    wire = load_wire(("a", "b"), sensors=("axial_probe_a", "radial_probe_low"))
    given = {access.node: access for access in cell_accesses(wire, load_services())}
    topics = {"axial_probe_a", "radial_probe_low", "head_a"}
    speakers = {
        stream: {node for node, each in given.items() if f"/stage/{stream}/samples" in each.publish}
        for stream in topics
    }
    assert speakers == {
        "axial_probe_a": {"listed_sensor_a"},
        "radial_probe_low": {"listed_sensor_low"},
        "head_a": {"encoder_head_a", "stage_follower"},
    }
    assert {node for node in given if node.startswith(("encoder_head", "listed_sensor"))} == {
        "encoder_head_a", "encoder_head_b", "listed_sensor_a", "listed_sensor_low",
    }  # fmt: skip
    assert "/stage/axial_probe_a/samples" in given["recorder"].subscribe
    assert not any(node.startswith("listed_sensor") for node in accesses())


def test_nobody_may_do_everything():
    for access in accesses().values():
        for names in (access.publish, access.subscribe, access.reply, access.request):
            assert not any(name.startswith("/*") for name in names)
            assert len(set(names)) == len(names) and all(name.startswith("/") for name in names)


def test_the_operator_publishes_nothing_of_the_contract():
    assert set(accesses()[OPERATOR].publish).isdisjoint(load_wire(("a", "b")).names)


def test_a_driver_is_heard_only_where_it_is_named():
    assert who("subscribe", "/joint_states") == set()
    given = accesses(listen={"encoder_head_a": ["/joint_states"]})
    assert [node for node, access in given.items() if "/joint_states" in access.subscribe] == ["encoder_head_a"]


def test_a_service_of_a_person_is_called_by_a_node_only_where_that_is_named():
    given = accesses(call={"opcua_server": ["/compensation/reset"]})
    callers = [node for node, access in given.items() if "/compensation/reset" in access.request]
    assert callers == ["opcua_server", OPERATOR]
    with pytest.raises(InputError, match="service 'reset' of opcua_server is not absolute"):
        accesses(call={"opcua_server": ["reset"]})


@pytest.mark.parametrize(
    ("listen", "why"),
    [
        ({"head_a": ["/x"]}, r"no node is called 'head_a'; the cell has autocollimator"),
        ({"lvdt": ["x"]}, "'x' of lvdt"),
    ],
)
def test_wrong_names_are_refused(listen, why):
    with pytest.raises(InputError, match=why):
        accesses(listen=listen)
