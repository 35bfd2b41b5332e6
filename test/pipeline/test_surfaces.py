"""What the sensors of a stage's file take for error motion, all together."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pipeline.test_listed_sensors import AXIAL, FACE, SECOND, described, probe

from rotary_error_monitor.cli import main
from rotary_error_monitor.description.stage import StageDescription, load_stage
from rotary_error_monitor.metrology.encoder_heads import HeadLayout
from rotary_error_monitor.pipeline.surfaces import Surface, surfaces

THREE = {f"radial_probe_p{k}": probe("radial_probe", azimuth=2 * np.pi * k / 3, height=0.0) for k in range(3)}


def seen(stage: StageDescription) -> dict[str, Surface]:
    return {surface.name: surface for surface in surfaces(stage)}


def test_heads_alone_are_as_their_layout_says() -> None:
    stage = load_stage()
    found = seen(stage)
    assert set(found) == {"ring", "mirror"}
    hidden = HeadLayout(tuple(stage.azimuths.values())).hidden_orders(12)
    assert tuple(view.order for view in found["ring"].orders if view.is_hidden) == hidden
    assert all(view.is_hidden and view.components == ("eac", "ebc") for view in found["mirror"].orders)


def test_probes_contradict_what_heads_alone_take_for_radial_motion() -> None:
    """Noise of a probe over that of a head on the ring: what both weigh in the sum of squares that is left."""
    stage = described(THREE)
    ring, artefact = (seen(stage)[name].orders for name in ("ring", "artefact at height 0 m"))
    on_ring = stage.ring.disc_radius**2 * (stage.ring.noise**2 + stage.ring.resolution**2 / 12)
    at_probe = THREE["radial_probe_p0"].noise ** 2 + THREE["radial_probe_p0"].resolution ** 2 / 12
    by_heads, by_probes = 2.0 / on_ring, 1.5 / at_probe  # information on either axis
    for order in (1, 3, 5, 7):
        assert ring[order - 1].passing == pytest.approx(by_heads / (by_heads + by_probes), rel=1e-6)
    assert [ring[order - 1].is_hidden for order in (4, 8, 12)] == [True] * 3
    for order in (1, 2, 4, 5):
        assert artefact[order - 1].passing == pytest.approx(by_probes / (by_heads + by_probes), rel=1e-6)
    assert all(artefact[order - 1].is_seen for order in (3, 6, 9, 12))


def test_what_does_not_go_round_and_what_sees_another_thing_is_no_surface_of_theirs() -> None:
    below = {"axial_probe_below": replace(FACE["axial_probe_f0"], gain=-1.0)}
    found = seen(described(AXIAL | FACE | below | SECOND))
    assert set(found) == {"ring", "mirror", "face at radius 0.08 m", "face at radius 0.08 m, counted the other way"}
    assert found["mirror"].streams == ("autocollimator", "tilt_sensor_second")
    # an axial probe on the axis and the autocollimators tell all that three before a face take for motion
    assert not any(view.is_hidden for view in found["face at radius 0.08 m"].orders)
    (tilt,) = {view.passing for view in seen(described(SECOND))["mirror"].orders}
    assert tilt == 1.0, "both see the same mirror, turned by the roll of one"


def test_a_target_that_has_a_name_is_told_by_it() -> None:
    named = {stream: replace(each, target="ball") for stream, each in THREE.items()}
    assert seen(described(named))["ball, artefact at height 0 m"].streams == tuple(THREE)


def test_the_command_says_it_of_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    row = "{{kind: radial_probe, azimuth: {}, height: 0.0, noise: 0, resolution: 0, range: 0.01, uncertainty: 1.0e-8}}"
    lines = [f"    p{k}: {row.format(2 * np.pi * k / 3)}" for k in range(3)]
    path = tmp_path / "stage.yaml"
    path.write_text("\n".join(["stage:", "  sensors:", *lines]), encoding="utf-8")
    assert main(["check", "--stage", str(path)]) == 0
    said = capsys.readouterr().out
    assert "The sensors of the stage determine exc, eyc.\n" in said
    assert "artefact at height 0 m (radial_probe_p0, radial_probe_p1, radial_probe_p2):\n" in said
    assert "    pass for exc, eyc and show nowhere else: 1, 2, 4, 5, 7, 8, 10, 11\n" in said
    assert "    contradict every motion: 3, 6, 9, 12\n" in said
