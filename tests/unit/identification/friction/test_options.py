"""Options of the estimators: all that is wrong is said at once."""

import pytest

from symid.errors import UsageError
from symid.identification.friction.problem import (
    EvolutionOptions,
    FrictionNlpOptions,
    FrictionOptions,
    GeneticOptions,
    RootFindingOptions,
    VariableProjectionOptions,
)


def test_all_mistakes_are_reported_together():
    with pytest.raises(UsageError) as refused:
        FrictionOptions(
            bounds=(("vs", (1.0, 0.1)),),
            reach=0.0,
            variable_projection=VariableProjectionOptions(starts=0, solves=0, grid=((1,), (2, 2), (2, 2, 2))),
            root_finding=RootFindingOptions(points=2),
            nlp=FrictionNlpOptions(starts=0, iterations=0),
            genetic=GeneticOptions(population=1, width=0.0, generations=0),
            annealing=GeneticOptions(cooling=1.0, step=-1.0, tolerance=2.0),
            evolution=EvolutionOptions(population=1, generations=0),
        )
    notices = refused.value.notices
    assert {notice.code for notice in notices} == {"usage.friction-option"}
    words = ("bounds of vs", "reach", "starts", "solves", "grid", "points", "nlp.iterations", "genetic.width")
    for word in (*words, "cooling", "annealing.step", "annealing.tolerance", "evolution.population"):
        assert any(word in notice.text for notice in notices), word


def test_the_defaults_are_allowed():
    assert FrictionOptions().variable_projection.solves == 150
