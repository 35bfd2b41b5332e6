"""What the twin keeps between predictions never shows in them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotary_error_monitor.cases.making import make_stage_case
from rotary_error_monitor.description.harmonics import AngularHarmonic
from rotary_error_monitor.effects.effect import Cause, Role
from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.twin.recording import record_stage
from rotary_error_monitor.twin.stage import twin_of

EFFECTS = {effect.name: effect for effect in load_effects(StageEffect)}
MOVING = {"following_error": "", "encoder_latency": "", "drive_cyclic_error": "order_7", "head_latency": "head_b"}


@pytest.fixture(scope="module")
def recorded():
    case = make_stage_case(7, "null", duration=6.0)
    blocks = {stream: list(found) for stream, found in case.blocks.items()}
    return case.twin, record_stage(blocks, sorted(case.twin.encoder.azimuths))


def cause(name, size):
    effect, place = EFFECTS[name], MOVING.get(name, "")
    values = effect.start(place)
    linear = effect.indices(Role.LINEAR)
    values[linear] = size * effect.scales()[linear]
    return Cause(effect, place, values)


@pytest.mark.parametrize("name", MOVING)
def test_a_moved_rotor_is_kept_for_the_same_move_only(recorded, name):
    stage, recording = recorded
    kept, beside = twin_of(stage, recording), cause("unbalance", 2.0)
    for causes in ([cause(name, 1.0)], [cause(name, 1.0), beside], [cause(name, -3.0)], [], [cause(name, 1.0)]):
        fresh = twin_of(stage, recording).predict(causes)
        for stream, values in kept.predict(causes).items():
            np.testing.assert_array_equal(values, fresh[stream])


def test_a_moved_rotor_is_seen_by_another_description(recorded):
    stage, recording = recorded
    other = replace(stage, mirror=replace(stage.mirror, tilt=(3e-4, -1e-4)))
    kept, moving = twin_of(stage, recording), [cause("following_error", 2.0)]
    kept.predict(moving)
    fresh = twin_of(other, recording).predict(moving)["autocollimator"]
    np.testing.assert_allclose(kept.predict(moving, stage=other)["autocollimator"], fresh, atol=1e-15)
    assert np.abs(fresh - kept.predict(moving)["autocollimator"]).max() > 1e-5


def test_which_effects_move_the_rotor():
    assert {name for name, effect in EFFECTS.items() if effect.moves_rotor} >= set(MOVING)
    assert not EFFECTS["unbalance"].moves_rotor and not EFFECTS["mirror_wobble"].moves_rotor


def test_waves_of_more_orders_than_are_kept(recorded):
    """Orders are added to those of a kept table one by one, and the sum is that of all."""
    stage, recording = recorded
    state = twin_of(stage, recording).state("autocollimator")
    draw = np.random.default_rng(3)
    orders = (1, 2, 5, 9, 14)
    wanted = {order: tuple(draw.normal(size=4)) for order in orders}
    direct = np.zeros((len(state.theta), 2))
    for order, (xc, xs, yc, ys) in wanted.items():
        cos, sin = np.cos(order * state.theta), np.sin(order * state.theta)
        direct += np.stack([xc * cos + xs * sin, yc * cos + ys * sin], axis=1)
    state.planar({order: wanted[order] for order in orders[:3]})
    for extra in range(20, 30):  # fills what is kept
        state.planar({extra: (1.0, 0.0, 0.0, 0.0)})
    np.testing.assert_allclose(state.planar(wanted), direct, atol=1e-12)
    np.testing.assert_allclose(state.planar({}), np.zeros((len(state.theta), 2)))
    np.testing.assert_allclose(state.turned((2.0, 1.0))[:, 1], 2 * np.sin(state.theta) + np.cos(state.theta))


@pytest.mark.parametrize("order", [2, 9, 16])
def test_a_graduation_is_read_where_the_sight_line_cuts_the_eccentric_ring(order):
    """Against the plant, which cuts a ring in space: with 130 µrad on a ring that is 26 µm off centre."""
    case = make_stage_case(7, "null", duration=6.0)
    blocks = {stream: list(found) for stream, found in case.blocks.items()}
    recording = record_stage(blocks, sorted(case.twin.encoder.azimuths))

    def shown(*graduation):
        encoder = replace(case.twin.encoder, eccentricity=(2e-5, -1.6e-5), graduation=graduation)
        plant = replace(case.plant, description=replace(case.plant.description, encoder=encoder), jitter=0.0)
        twin = twin_of(replace(case.twin, encoder=encoder), recording)
        return twin.predict(streams=["head_a"])["head_a"], plant.signal("head_a", twin.times["head_a"])

    told, true = (
        after - before for after, before in zip(shown(AngularHarmonic(order, 5e-5, -1.2e-4)), shown(), strict=True)
    )
    assert np.abs(true).max() > 1.2e-4
    assert np.abs(told - true).max() < 3e-9
