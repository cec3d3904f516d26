"""Root finding: the same optimum as variable projection, and what it cannot do."""

import pytest

from symid.errors import UsageError
from symid.identification.friction.problem import FrictionOptions, RootFindingOptions, build_problem
from symid.identification.friction.searches import search_by_projection, search_by_roots
from symid.ipopt import Ending
from symid.joint_models.friction_catalogue import get_law
from tests.frictions import build_cosines, draw_s1, draw_s2, draw_samples

OPTIONS = FrictionOptions()


@pytest.mark.parametrize("seed", range(5))
def test_the_best_root_is_the_optimum(seed):
    problem = build_problem(*draw_s1(seed), OPTIONS)
    search = search_by_roots(problem, RootFindingOptions())
    expected = search_by_projection(problem, OPTIONS.variable_projection)
    assert search.outcome is Ending.CONVERGED
    assert search.objective == pytest.approx(expected.objective, rel=1e-9)
    assert search.solves == search.evaluations > 80


def test_two_unknowns_and_two_directions_are_refused():
    with pytest.raises(UsageError, match="2 here") as refused:
        search_by_roots(build_problem(*draw_s2(), OPTIONS), RootFindingOptions())
    assert "both" in str(refused.value)
    assert {notice.code for notice in refused.value.notices} == {"usage.root-finding"}


def test_without_a_root_the_better_end_is_kept():
    law = get_law("stribeck")
    samples = draw_samples(law, (10.0, 20.0, 0.05, 20.0), abs(build_cosines(0.5)), noise=0.0)
    options = FrictionOptions(bounds=(("vs", (0.1, 0.2)),))
    search = search_by_roots(build_problem(samples, law, options), RootFindingOptions())
    assert search.outcome is Ending.STALLED
    assert search.shape[0] == pytest.approx(0.1)
