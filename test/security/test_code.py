"""What runs code says so, and cannot be set from outside: who may set a node's parameters shall not run programs."""

from __future__ import annotations

import logging

import pytest

from rotary_error_monitor.cli import main
from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.nodes.gap_monitor import GapMonitor
from rotary_error_monitor.nodes.linuxcnc_bridge import LinuxcncBridge
from rotary_error_monitor.resources import share
from rotary_error_monitor.testing import Cell

OIL_FILM = share() / "doc" / "examples" / "oil_film.py"


def test_loading_a_file_of_effects_is_logged_with_its_name(caplog):
    with caplog.at_level(logging.WARNING):
        load_effects(StageEffect)
        assert caplog.messages == []
        load_effects(StageEffect, [OIL_FILM])
    assert caplog.messages == [f"{OIL_FILM}: effects of your own run as code, with all that you may do"]


def test_the_command_and_the_document_say_that_effects_are_code(capsys):
    with pytest.raises(SystemExit):
        main(["diagnose", "--help"])
    assert "it runs as code" in " ".join(capsys.readouterr().out.split())
    assert "**The file runs as code**" in (share() / "doc" / "effects.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("node_class", "name", "parameters"),
    [
        (
            LinuxcncBridge,
            "linuxcnc_bridge",
            {"enter": "touch", "python": "/bin/sh", "home": "/tmp", "security": "environment"},
        ),
        (GapMonitor, "gap_monitor", {"effects": str(OIL_FILM), "security": "environment"}),
    ],
)
def test_what_runs_programs_is_given_at_the_start_alone(node_class, name, parameters):
    """Also while the node is not configured, when other parameters may be set."""
    with Cell() as cell:
        cell.run(node_class, name, autostart=False)
        for parameter, value in parameters.items():
            assert not cell.set_parameter(name, parameter, value)
        assert cell.set_parameter(name, "stage", "")
