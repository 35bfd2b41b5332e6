"""The middleware takes the shipped profiles, which ask for lost messages soon."""

from __future__ import annotations

from pathlib import Path

from rotary_error_monitor.resources import config

PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"


def test_the_middleware_takes_the_shipped_profiles(cell, tmp_path, monkeypatch):
    """It says so where it does not, and goes on with its defaults."""
    monkeypatch.setenv(PROFILES, str(config("fastdds.xml")))
    good = cell.start("encoder_head", "encoder_head_a")
    bad = tmp_path / "bad.xml"
    bad.write_text(config("fastdds.xml").read_text(encoding="utf-8").replace("heartbeatPeriod", "period"), "utf-8")
    monkeypatch.setenv(PROFILES, str(bad))
    other = cell.start("encoder_head", "encoder_head_b", head="b")
    for name in "ab":
        cell.wait_for_status(f"encoder_head_{name}: state", "active")
    assert "XMLPARSER" in other.output
    assert "XMLPARSER" not in good.output


def test_a_process_can_be_started_by_another_command(cell):
    process = cell.start("encoder_head", "encoder_head_a", within=["nice", "-n", "5"])
    cell.wait_for_status("encoder_head_a: state", "active")
    stat = Path(f"/proc/{process.pid}/stat").read_text(encoding="ascii")
    assert int(stat.rpartition(")")[2].split()[16]) >= 5
    assert process.stop() == 0
