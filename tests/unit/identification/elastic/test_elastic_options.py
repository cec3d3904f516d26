"""Options of elastic identification, and what is wrong with wrong ones."""

import pytest

from symid.errors import UsageError
from symid.identification.elastic.options import ElasticOptions, NlpOptions, check_grids
from symid.ipopt import Ending
from tests.refusals import raises

ELASTIC, NLP = (ElasticOptions, "usage.elastic-option"), (NlpOptions, "usage.nlp-option")


@pytest.mark.parametrize(
    ("kind", "options", "message"),
    [
        (ELASTIC, {"window": 0.0}, r"^window 0:.*\(unit s\)"),
        (ELASTIC, {"rate": float("inf")}, r"^rate inf:.*\(unit rad/s\)"),
        (ELASTIC, {"tolerance": -1.0}, "^tolerance -1:"),
        (ELASTIC, {"cutoff": -1.0}, "^cutoff -1:.* Hz"),
        (ELASTIC, {"stops": -1}, "^stops -1:.* 0 "),
        (ELASTIC, {"stops": 2.5}, "^stops 2.5:"),
        (ELASTIC, {"iterations": 0}, "^iterations 0:.* 1 "),
        (ELASTIC, {"thresholds": ((0.2, 0.1),)}, r"^thresholds \(0.2, 0.1\):"),
        (ELASTIC, {"thresholds": ((0.0,),)}, r"^thresholds \(0.0,\):"),
        (ELASTIC, {"thresholds": ((0.1, 0.1),)}, r"^thresholds \(0.1, 0.1\):"),
        (ELASTIC, {"knee_torques": ((0.0,),)}, r"^knee_torques \(0.0,\):"),
        (ELASTIC, {"knee_torques": ((3.0, -3.0),)}, r"^knee_torques \(3.0, -3.0\):"),
        (NLP, {"rounds": 1.5}, "^rounds"),
        (NLP, {"rounds": float("nan")}, "^rounds"),
        (NLP, {"iterations": 2.5}, "^iterations"),
        (NLP, {"rows": "energy"}, "^rows"),
        (NLP, {"rows": ()}, "^rows"),
        (NLP, {"rows": ("energy", "energy")}, "^rows"),
    ],
)
def test_wrong_options_are_refused_with_what_is_allowed(kind, options, message):
    make, code = kind
    with raises(UsageError, code, match=message):
        make(**options)


def test_all_mistakes_are_told_at_once_and_grids_must_be_there_for_every_joint():
    with raises(UsageError, *["usage.elastic-option"] * 3):
        ElasticOptions(tolerance=0.0, window=-1.0, stops=-2)
    check_grids(ElasticOptions(thresholds=((0.1,), ())), 2)
    with raises(UsageError, "usage.elastic-option", match=r"^knee_torques .*1 .*2$"):
        check_grids(ElasticOptions(knee_torques=((1.0,),)), 2)
    wrong = {"hessian": "bfgs", "least_stiffness": 0.0, "rounds": -1, "iterations": 0, "rows": ("power",)}
    wrong |= {"speeds": (1.0, 0.1), "slopes": (1.5, 3.0), "smoothing": -1.0}
    with raises(UsageError, *["usage.nlp-option"] * len(wrong)) as caught:
        NlpOptions(**wrong)
    assert [notice.text.split()[0] for notice in caught.value.notices] == list(wrong)


def test_every_outcome_explains_itself_and_says_whether_it_can_be_used():
    assert all(outcome.value != outcome.name for outcome in Ending)
    unusable = {outcome for outcome in Ending if not outcome.usable}
    assert unusable == {Ending.INFEASIBLE, Ending.DIVERGED, Ending.FAILED}
