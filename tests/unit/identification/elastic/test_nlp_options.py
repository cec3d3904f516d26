"""Options of the hysteresis-plus-friction problem: all that is wrong is said at once."""

import pytest

from symid.errors import UsageError
from symid.identification.elastic.options import NlpOptions


def test_all_mistakes_are_reported_together():
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
    names = ("hessian", "weight_limit", "rounds", "iterations", "rows", "speeds", "slopes", "smoothing")
    assert tuple(notice.text.split()[0] for notice in notices) == names


def test_the_defaults_are_allowed():
    assert NlpOptions().rows == ("energy", "momentum")


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
def test_a_mistake_is_said_in_one_line(given, word):
    with pytest.raises(UsageError) as refused:
        NlpOptions(**given)
    (notice,) = refused.value.notices
    assert notice.code == "usage.nlp-option"
    assert notice.text.startswith(word)
