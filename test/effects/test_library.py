"""Effects are found because they are defined, in the package and in files of users."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.effects.effect import order_location, order_of, place_of
from rotary_error_monitor.effects.library import effect_named, load_effects
from rotary_error_monitor.effects.machine_effect import MachineEffect
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.kinds.mount.effects import MountEffect
from rotary_error_monitor.kinds.quadrature.effects import QuadratureEffect

OWN = '''
from rotary_error_monitor.effects.effect import Parameter
from rotary_error_monitor.effects.rotor import StageEffect


class HeadOffset(StageEffect):
    """All heads read a constant too much."""

    name = "{name}"
    parameters = (Parameter("offset", "rad", 1e-6),)
    acts_on = ("head",)

    def measured(self, values, location, state, ideal):
        return ideal + values[0]
'''


def test_a_users_file_adds_an_effect(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(OWN.format(name="head_offset"))
    names = [effect.name for effect in load_effects(StageEffect, [file])]
    assert "head_offset" in names and names == sorted(names)
    assert "head_offset" not in [effect.name for effect in load_effects(StageEffect)]
    assert "head_offset" not in [effect.name for effect in load_effects(MachineEffect, [file])]


def test_a_name_that_is_taken_is_refused(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(OWN.format(name="disc_scale"))
    with pytest.raises(InputError, match=r"mine\.py: effect 'disc_scale' is already known"):
        load_effects(StageEffect, [file])


@pytest.mark.parametrize(
    ("content", "message"),
    [(None, "no Python file"), ("import nothing_like_this", "ModuleNotFoundError"), ("x = 1", "defines no effect")],
)
def test_a_file_without_effects_is_an_error(tmp_path, content, message):
    file = tmp_path / "mine.py"
    if content is not None:
        file.write_text(content)
    with pytest.raises(InputError, match=message):
        load_effects(StageEffect, [file])


@pytest.mark.parametrize(
    ("searched", "parameter", "problem"),
    [
        ("Searched.MOMENT", "offset", "is searched by MOMENT, but has no time"),
        ("Searched.MOMENT", "time", "begins at a moment of one head: list heads in 'locations'"),
        ("Searched.WAVE", "offset", "is searched by WAVE, but has no order"),
        ("Searched.WAVE", "period", "is searched by WAVE, but has no order"),
        ("Searched.ORDER", "order", "is searched by <Searched.ORDER: .*; expected Searched.MOMENT, Searched.WAVE"),
        ("'moment'", "time", "is searched by 'moment'; expected Searched.MOMENT, Searched.WAVE"),
    ],
)
def test_an_effect_has_the_parameter_that_is_searched(tmp_path, searched, parameter, problem):
    file = tmp_path / "mine.py"
    content = OWN.format(name="head_offset").replace("import Parameter", "import Parameter, Searched")
    content = content.replace('"offset"', f'"{parameter}"')
    file.write_text(content.replace('acts_on = ("head",)', f"searched = {searched}"))
    with pytest.raises(InputError, match=f"effect 'head_offset' {problem}"):
        load_effects(StageEffect, [file])


def test_an_unknown_effect_is_named_with_the_known_ones():
    effects = load_effects(StageEffect)
    assert effect_named("unbalance", effects).name == "unbalance"
    with pytest.raises(InputError, match=r"no effect is called 'wobble'; known are .*disc_scale"):
        effect_named("wobble", effects)


def test_parameters_that_do_not_fit_are_an_error():
    effect = effect_named("disc_eccentricity", load_effects(StageEffect))
    with pytest.raises(InputError, match="expected \\['shift'\\]"):
        effect.values_from({"shft": [0, 0]})
    with pytest.raises(InputError, match="expected 2 finite number"):
        effect.values_from({"shift": [1e-6]})


@pytest.mark.parametrize("wrong", ["", "much", None, [], [1e-6] * 7, [[1e-6]], {"a": 1}, float("nan"), 10**400])
@pytest.mark.parametrize("kind", [MachineEffect, MountEffect, QuadratureEffect, StageEffect])
def test_a_parameter_that_is_no_number_is_an_error(kind, wrong):
    for effect in load_effects(kind):
        start = effect.start("order_2")
        for parameter, place in zip(effect.parameters, effect.slices().values(), strict=True):
            start[place] = np.clip(start[place], *parameter.range)
        told = {name: each.value for name, each in effect.report(start, np.zeros((len(start),) * 2)).items()}
        assert effect.values_from(told) == pytest.approx(start), "as they were"
        for name in told:
            with pytest.raises(InputError, match=f"{effect.name}: {name} = .*; expected . finite number"):
                effect.values_from(told | {name: wrong})


def test_a_family_may_have_places():
    for place in ("", "axial_probe_top"):
        location = order_location(12, place)
        assert (order_of(location), place_of(location)) == (12, place)
    assert place_of("head_a") == "head_a"


@pytest.mark.parametrize("location", ["order_", "order_x", "5", "head_a", "head_a.order_", "order_5.head_a"])
def test_a_location_that_names_no_order_is_an_error(location):
    with pytest.raises(InputError, match="order_K"):
        order_of(location)


def test_chances_of_orders_add_up():
    families = [effect for effect in load_effects(StageEffect) if effect.orders]
    assert len(families) >= 5
    for effect in families:
        chances = np.exp([effect.log_prior_of(order) for order in range(effect.lowest, effect.orders + 1)])
        assert chances.sum() == pytest.approx(1.0)
        assert np.all(np.diff(chances) < 0) if effect.falling else np.all(chances == chances[0])
