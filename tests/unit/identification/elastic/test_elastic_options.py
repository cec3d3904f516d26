"""Options of elastic identification, and what is wrong with wrong ones."""

import pytest

from symid.errors import UsageError
from symid.identification.elastic.options import ElasticOptions, NlpOptions, check_grids
from symid.ipopt import Ending


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "guess"}, "^method 'guess':.* automatic, two-step"),
        ({"scheme": "no-cost"}, "^scheme 'no-cost':.* two-cost, same-cost"),
        ({"window": 0.0}, r"^window 0:.*\(unit s\)"),
        ({"rate": float("inf")}, r"^rate inf:.*\(unit rad/s\)"),
        ({"tolerance": -1.0}, "^tolerance -1:"),
        ({"cutoff": -1.0}, "^cutoff -1:.* Hz"),
        ({"stops": -1}, "^stops -1:.* 0 "),
        ({"stops": 2.5}, "^stops 2.5:"),
        ({"iterations": 0}, "^iterations 0:.* 1 "),
        ({"thresholds": ((0.2, 0.1),)}, r"^thresholds \(0.2, 0.1\):"),
        ({"thresholds": ((0.0,),)}, r"^thresholds \(0.0,\):"),
        ({"thresholds": ((0.1, 0.1),)}, r"^thresholds \(0.1, 0.1\):"),
        ({"knee_torques": ((0.0,),)}, r"^knee_torques \(0.0,\):"),
        ({"knee_torques": ((3.0, -3.0),)}, r"^knee_torques \(3.0, -3.0\):"),
    ],
)
def test_wrong_options_are_refused_with_what_is_allowed(options, message):
    with pytest.raises(UsageError, match=message) as caught:
        ElasticOptions(**options)
    assert [notice.code for notice in caught.value.notices] == ["usage.elastic-option"]


def test_all_mistakes_are_told_at_once_and_grids_must_be_there_for_every_joint():
    with pytest.raises(UsageError) as caught:
        ElasticOptions(method="guess", window=-1.0, stops=-2)
    assert len(caught.value.notices) == 3
    check_grids(ElasticOptions(thresholds=((0.1,), ())), 2)
    with pytest.raises(UsageError, match=r"^knee_torques .*1 .*2$") as caught:
        check_grids(ElasticOptions(knee_torques=((1.0,),)), 2)
    assert [notice.code for notice in caught.value.notices] == ["usage.elastic-option"]


def test_every_outcome_explains_itself_and_says_whether_it_can_be_used():
    assert all(outcome.value != outcome.name for outcome in Ending)
    unusable = {outcome for outcome in Ending if not outcome.usable}
    assert unusable == {Ending.INFEASIBLE, Ending.DIVERGED, Ending.FAILED}


def test_all_mistakes_of_the_nlp_are_reported_together():
    with pytest.raises(UsageError) as refused:
        NlpOptions(
            rows=("energy", "energy", "power"),
            hessian="bfgs",
            speeds=(1.0, 0.1),
            slopes=(1.5, 3.0),
            weight_limit=0.0,
            smoothing=-1.0,
            rounds=-1,
            iterations=0,
        )
    notices = refused.value.notices
    assert {notice.code for notice in notices} == {"usage.nlp-option"}
    assert NlpOptions().rows == ("energy", "momentum")
    names = ("hessian", "weight_limit", "rounds", "iterations", "rows", "speeds", "slopes", "smoothing")
    assert tuple(notice.text.split()[0] for notice in notices) == names


@pytest.mark.parametrize(
    ("given", "word"),
    [
        ({"rounds": 1.5}, "rounds"),
        ({"rounds": float("nan")}, "rounds"),
        ({"iterations": 2.5}, "iterations"),
        ({"rows": "energy"}, "rows"),
        ({"rows": ()}, "rows"),
        ({"rows": ("energy", "energy")}, "rows"),
        ({"rows": ("power",)}, "rows"),
    ],
)
def test_a_mistake_of_the_nlp_is_said_in_one_line(given, word):
    with pytest.raises(UsageError) as refused:
        NlpOptions(**given)
    (notice,) = refused.value.notices
    assert notice.code == "usage.nlp-option"
    assert notice.text.startswith(word)
