"""What SECURITY.md names is there, and its figures are those of the code."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from rotary_error_monitor import files
from rotary_error_monitor.bags import unpacking
from rotary_error_monitor.cli import main
from rotary_error_monitor.description import yaml_files
from rotary_error_monitor.description.wire import load_services

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "SECURITY.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "name", sorted(set(re.findall(r"`((?:test|config|doc|rotary_error_monitor|msg_defs)/[\w./]*)`", TEXT)))
)
def test_what_is_named_is_there(name):
    assert (ROOT / name).exists()


def test_limits_are_those_of_the_code():
    assert f"{yaml_files.MOST_BYTES >> 20} MiB, {yaml_files.MOST_NODES:,} nodes" in TEXT
    assert f"{yaml_files.DEEPEST} deep, numbers of {yaml_files.LONGEST_NUMBER} characters" in TEXT
    assert f"unpacked | {files.MOST_BYTES >> 20} MiB |" in TEXT
    assert f"chunk of a bag | {unpacking.MOST_AT_ONCE >> 20} MiB |" in TEXT
    assert f"{unpacking.MOST_AT_ONCE >> 20} MiB and {unpacking.MOST_EXPANSION} times its size" in TEXT


def test_every_service_of_the_contract_is_spoken_of():
    for service in load_services():
        assert all(f"/{server}{service.name[1:]}" in TEXT for server in service.servers)


def test_its_commands_work(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    commands = re.findall(r"^rotary_error_monitor (.*)$", TEXT, re.MULTILINE)
    assert len(commands) == 2
    for command in commands:
        assert main(command.split()) == 0
    assert capsys.readouterr().out
