"""Which of the sets that were weighed is taken."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from rotary_error_monitor.gap import judgement
from rotary_error_monitor.gap.posterior import Posterior


@pytest.fixture
def weighed(monkeypatch):
    """Function that gives sets of as many causes as log odds, each with its evidence among sets as large."""
    evidence = {}
    monkeypatch.setattr(judgement, "dispersion", lambda fit: 1.0)
    monkeypatch.setattr(judgement, "_log_weight", lambda step, posterior, scatter: evidence[id(posterior)])

    def make(*rows):
        found = []
        for log_odds, weight in rows:
            fit = SimpleNamespace(causes=("cause",) * len(log_odds))
            found.append(Posterior(fit, (), log_odds, False, False, 0.0))
            evidence[id(found[-1])] = weight
        return [(None, posterior) for posterior in found]

    return make


def taken(tried):
    return judgement._likeliest(tried)[1].log_odds


def test_a_cause_is_not_passed_over_for_a_larger_set_that_nobody_believes(weighed):
    assert taken(weighed(((2.0,), -90.0), ((6.0, -1.0), -10.0))) == (2.0,)


def test_the_larger_set_is_taken_where_each_of_its_causes_is_likelier_than_not(weighed):
    assert taken(weighed(((2.0,), -10.0), ((3.0, 1.0), -90.0))) == (3.0, 1.0)


def test_of_sets_as_large_the_likeliest_is_taken(weighed):
    assert taken(weighed(((2.0,), -10.0), ((1.0,), -5.0), ((-1.0,), -20.0))) == (1.0,)


def test_what_is_likelier_than_the_likeliest_set_is_likelier_than_the_others(weighed):
    assert taken(weighed(((1.0,), -37.0), ((-4.0,), 0.0))) == (-4.0,)


def test_a_smaller_set_stands_where_the_likeliest_of_the_larger_ones_does_not(weighed):
    assert taken(weighed(((1.0,), -90.0), ((3.0, 1.0), -30.0), ((3.0, -1.0), 0.0))) == (1.0,)


def test_where_none_is_likelier_than_something_unknown_the_best_is_told(weighed):
    assert taken(weighed(((-3.0,), 0.0), ((-3.0, -2.0), -10.0))) == (-3.0,)
