"""A node of which security is asked says at its start what lacks, and does not start where it is enforced."""

from __future__ import annotations

import pytest
from faults.documenting import Row, shows

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes.encoder_head import EncoderHead
from rotary_error_monitor.nodes.protection import check_environment, explained
from rotary_error_monitor.security.access import Access
from rotary_error_monitor.security.keystore import write_keystore
from rotary_error_monitor.testing import Cell

VARIABLES = ("ROS_SECURITY_ENABLE", "ROS_SECURITY_STRATEGY", "ROS_SECURITY_KEYSTORE", "ROS_SECURITY_ENCLAVE_OVERRIDE")
NAME = "encoder_head_a"


@pytest.fixture(autouse=True)
def _nothing_asked(monkeypatch):
    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def keystore(tmp_path):
    write_keystore(tmp_path / "keys", [Access(NAME, (), ())], domain=0, days=30)
    return tmp_path / "keys"


def refusal(cell: Cell, *ros_args: str, **parameters: object) -> str:
    """What a node that does not start says."""
    process = cell.start("encoder_head", NAME, ros_args, **parameters, source="mock")
    assert process.wait(30) == 2, process.output
    assert "Traceback" not in process.output
    return process.output


def test_nothing_is_said_of_security_where_nobody_asks(cell):
    node = cell.run(EncoderHead, NAME, source="mock")
    assert not [status.name for status in node.diagnose().status if "security" in status.name]


@shows(
    Row(
        "processes",
        "Security is enforced and absent",
        "exit code 2: what asks for it, and everything that lacks",
        "the node does not start",
        "nothing",
        "a right keystore and environment, and another start",
    )
)
@pytest.mark.parametrize(
    ("enclave", "values", "why"),
    [
        ("/nobody", ("true", "Enforce"), "has no enclave /nobody"),
        ("", ("true", "Enforce"), "in no enclave of its own"),
        (f"/{NAME}", ("true", "enforce"), "ROS_SECURITY_STRATEGY is 'enforce'"),
        (f"/{NAME}", ("1", "Enforce"), "ROS_SECURITY_ENABLE is '1'"),
    ],
)
def test_a_node_does_not_start_where_security_is_enforced_and_lacks(cell, keystore, monkeypatch, enclave, values, why):
    for name, value in zip(VARIABLES, (*values, str(keystore)), strict=False):
        monkeypatch.setenv(name, value)
    assert why in refusal(cell, *(("--enclave", enclave) if enclave else ()))


def test_a_node_without_any_keystore_does_not_start(cell, monkeypatch):
    monkeypatch.setenv("ROS_SECURITY_ENABLE", "true")
    monkeypatch.setenv("ROS_SECURITY_STRATEGY", "Enforce")
    assert "ROS_SECURITY_KEYSTORE is not set" in refusal(cell)


def test_a_parameter_asks_for_security_as_well(cell):
    assert "parameter security:=required" in refusal(cell, security="required")
    with pytest.raises(InputError, match=r"parameter security:=required.*ROS_SECURITY_ENABLE is ''"):
        cell.run(EncoderHead, NAME, security="required", source="mock")


@shows(
    Row(
        "processes",
        "Security is asked for and absent, where it is not enforced",
        "`security`: ERROR, what asks for it and what lacks; in the log",
        "the node starts without",
        "everything, unprotected",
        "a right keystore and environment, and another start",
    )
)
@pytest.mark.parametrize(
    ("values", "why"),
    [
        (("true", "Permissive"), "has no enclave /nobody"),  # rcl itself goes on without a word
        (("1", "Permissive"), "ROS_SECURITY_ENABLE is '1', which ROS takes for a no"),
        (("", ""), "ROS_SECURITY_ENABLE is ''"),
    ],
)
def test_a_node_that_starts_without_the_security_it_was_asked_for_says_so(cell, keystore, monkeypatch, values, why):
    for name, value in zip(VARIABLES, (*values, str(keystore)), strict=False):
        monkeypatch.setenv(name, value)
    process = cell.start("encoder_head", NAME, ["--enclave", "/nobody"], source="mock")
    status = cell.wait_for_status(f"{NAME}: security", why)
    assert status.level == b"\x02"
    assert "[ERROR]" in process.output and "security is asked for" in process.output


def test_keys_that_the_middleware_cannot_use_end_the_node_or_are_in_effect(cell, keystore, monkeypatch):
    """With the plugins it starts, and says that security is in effect; without, as in the wheels, it does not."""
    for name, value in zip(VARIABLES, ("true", "Enforce", str(keystore)), strict=False):
        monkeypatch.setenv(name, value)
    process = cell.start("encoder_head", NAME, ["--enclave", f"/{NAME}"], autostart=False, source="mock")
    process.expected = True
    cell.wait_until(
        lambda: process.exit_code is not None or "waiting to be configured" in process.output, "its start or its end"
    )
    if process.exit_code is None:
        return
    assert process.wait() == 2
    assert "security is asked for" in process.output
    assert "built without its security plugins" in process.output


def test_an_error_of_rcl_is_told_as_it_is_where_nobody_asked():
    error = RuntimeError("failed to parse arguments")
    assert explained(error) is error


@pytest.mark.parametrize(
    ("args", "named"),
    [
        ([], "in no enclave of its own"),
        (["--ros-args", "--enclave", "/two"], "no enclave /two"),
        (["--ros-args", "-p", "x:=1", "-e", "/two", "--", "-e", "/three"], "no enclave /two"),
        (["-e", "/two"], "in no enclave of its own"),  # not for ROS
        (["--ros-args", "-e"], "in no enclave of its own"),  # rcl refuses it as well
    ],
)
def test_the_enclave_is_the_one_of_the_command_line(keystore, monkeypatch, args, named):
    for name, value in zip(VARIABLES, ("true", "Enforce", str(keystore)), strict=False):
        monkeypatch.setenv(name, value)
    with pytest.raises(InputError, match=named):
        check_environment(args)
    monkeypatch.setenv("ROS_SECURITY_ENCLAVE_OVERRIDE", f"/{NAME}")
    check_environment(args)
