"""Security that is asked for and not in effect is found, whatever lacks."""

from __future__ import annotations

import pytest

from rotary_error_monitor.security.access import Access
from rotary_error_monitor.security.effect import judge
from rotary_error_monitor.security.keystore import write_keystore
from rotary_error_monitor.security.layout import ENCLAVE_FILES

FAST = "rmw_fastrtps_cpp"
WISHES = {"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_STRATEGY": "Enforce"}


@pytest.fixture(scope="module")
def asked(tmp_path_factory):
    """An environment in which nothing lacks for the node `one`."""
    folder = tmp_path_factory.mktemp("keys")
    write_keystore(folder, [Access("one", (), ())], domain=0, days=30)
    return {**WISHES, "ROS_SECURITY_KEYSTORE": str(folder)}


def lacking(environment, enclave="/one", middleware=FAST, required=False):
    return "; ".join(judge(environment, enclave, middleware, required=required).lacking)


def test_nothing_is_said_where_nobody_asks():
    for environment in (
        {},
        {"ROS_SECURITY_ENABLE": "false", "ROS_SECURITY_KEYSTORE": "/x"},
        {"ROS_SECURITY_ENABLE": ""},
    ):
        assert judge(environment, "/", "any", required=False).asked == ""
        assert judge(environment, "/", "any", required=False).complaint == ""


def test_nothing_lacks_where_all_is_there(asked):
    assert judge(asked, "/one", FAST, required=True).lacking == ()
    assert judge(asked, "/one", FAST, required=False).enforced


@pytest.mark.parametrize("value", ["1", "True", "TRUE", "yes", "on"])
def test_a_word_that_ros_takes_for_a_no_is_named(asked, value):
    assert f"ROS_SECURITY_ENABLE is '{value}', which ROS takes for a no" in lacking(
        {**asked, "ROS_SECURITY_ENABLE": value}
    )


@pytest.mark.parametrize(
    ("value", "enforced"), [("enforce", True), ("ENFORCE", True), ("Permissive", False), ("", False)]
)
def test_a_strategy_that_lets_nodes_without_keys_start_is_named(asked, value, enforced):
    security = judge({**asked, "ROS_SECURITY_STRATEGY": value}, "/one", FAST, required=False)
    assert "nodes without keys start as well" in security.complaint
    assert security.enforced == enforced  # whoever writes enforce does not mean Permissive


@pytest.mark.parametrize("name", ["ROS_SECURITY_STRATEGY", "ROS_SECURITY_KEYSTORE"])
def test_one_variable_alone_asks_for_it(asked, name):
    assert "ROS_SECURITY_ENABLE is ''" in lacking({name: asked[name]})


def test_a_parameter_asks_for_it_too():
    security = judge({}, "/one", FAST, required=True)
    assert security.enforced and "parameter security:=required" in security.complaint
    assert judge({"ROS_SECURITY_ENABLE": "false"}, "/one", FAST, required=True).lacking


def test_keys_that_are_not_there_are_named(asked, tmp_path):
    keystore = "ROS_SECURITY_KEYSTORE"
    assert "ROS_SECURITY_KEYSTORE is not set" in lacking(WISHES)
    assert f"{tmp_path} is no keystore" in lacking({**asked, keystore: str(tmp_path)})
    assert "has no enclave /two" in lacking(asked, "/two")
    assert "in no enclave of its own" in lacking(asked, "/")


@pytest.mark.parametrize("name", ENCLAVE_FILES)
def test_a_file_that_an_enclave_lacks_is_named(name, tmp_path):
    write_keystore(tmp_path, [Access("one", (), ())], domain=0, days=30)
    (tmp_path / "enclaves" / "one" / name).unlink()
    assert f"lacks {name}" in lacking({**WISHES, "ROS_SECURITY_KEYSTORE": str(tmp_path)})


def test_a_middleware_of_which_nothing_is_known_is_named(asked):
    assert "of rmw_zenoh_cpp it is not known" in lacking(asked, middleware="rmw_zenoh_cpp")
