"""Options of elastic identification, and what is wrong with wrong ones."""

import pytest

from symid.errors import UsageError
from symid.identification.elastic.options import ElasticOptions, check_grids
from symid.ipopt import Ending


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "guess"}, "method 'guess': there is no such method; allowed are automatic"),
        ({"scheme": "no-cost"}, "scheme 'no-cost': there is no such scheme"),
        ({"window": 0.0}, "window 0: must be a positive number"),
        ({"rate": float("inf")}, "rate inf: must be a positive number"),
        ({"tolerance": -1.0}, "tolerance -1"),
        ({"cutoff": -1.0}, "cutoff -1: must be a frequency in Hz"),
        ({"stops": -1}, "stops -1: must be 0 or more"),
        ({"iterations": 0}, "iterations 0: must be 1 or more"),
        ({"thresholds": ((0.2, 0.1),)}, "thresholds .*must be positive and increase"),
        ({"thresholds": ((0.0,),)}, "thresholds .*must be positive and increase"),
        ({"knee_torques": ((0.0,),)}, "knee_torques .*must differ from 0"),
        ({"knee_torques": ((3.0, -3.0),)}, "knee_torques .*increase"),
    ],
)
def test_wrong_options_are_refused_with_what_is_allowed(options, message):
    with pytest.raises(UsageError, match=message) as caught:
        ElasticOptions(**options)
    assert caught.value.notices[0].code == "usage.elastic-option"


def test_all_mistakes_are_told_at_once():
    with pytest.raises(UsageError) as caught:
        ElasticOptions(method="guess", window=-1.0, stops=-2)
    assert len(caught.value.notices) == 3


def test_grids_must_be_there_for_every_joint():
    check_grids(ElasticOptions(thresholds=((0.1,), ())), 2)
    with pytest.raises(UsageError, match="knee_torques are given for 1 joints; the robot has 2"):
        check_grids(ElasticOptions(knee_torques=((1.0,),)), 2)


def test_every_outcome_explains_itself_and_says_whether_it_can_be_used():
    assert all(len(outcome.value) > 10 for outcome in Ending)
    unusable = {outcome for outcome in Ending if not outcome.usable}
    assert unusable == {Ending.INFEASIBLE, Ending.DIVERGED, Ending.FAILED}
