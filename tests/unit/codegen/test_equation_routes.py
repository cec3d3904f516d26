"""Factors of mass matrices: their products and sums in trees, and what they solve."""

from itertools import chain

from hypothesis import given, strategies as st

from symid.codegen.equation_routes import _Factors
from symid.codegen.programs import ExpressionTable

PARENTS = st.integers(1, 12).flatmap(
    lambda n: st.tuples(*(st.integers(-1, k - 1) for k in range(n))).map(list)
)
"""Of every joint the one that carries it, -1 for the base."""


def list_carriers(parents, joint):
    """Return the joints that carry a joint."""
    parent = parents[joint]
    return [] if parent < 0 else [parent, *list_carriers(parents, parent)]


def build_matrix(table, parents):
    """Return a matrix of inputs, zero where neither joint carries the other."""
    matrix = [[table.constant(0.0)] * len(parents) for _ in parents]
    for i in range(len(parents)):
        for j in (i, *list_carriers(parents, i)):
            matrix[i][j] = matrix[j][i] = table.input(0, len(parents) * i + j)
    return matrix


@given(parents=PARENTS)
def test_branches_of_a_tree_cost_nothing_to_each_other(parents):
    table = ExpressionTable()
    factors = _Factors(table, build_matrix(table, parents))
    lower = [row[:joint] for joint, row in enumerate(factors.lower)]
    depths = [len(list_carriers(parents, joint)) for joint in range(len(parents))]
    count = table.count(chain(factors.inverses, *lower))
    # Of each joint: n of L, then the triangle of what its column takes from those that carry it.
    assert count.add == sum(d * (d + 1) // 2 for d in depths)
    assert count.mul == len(parents) + sum(d + d * (d + 1) // 2 for d in depths)
    zero = table.constant(0.0)
    for joint, row in enumerate(lower):
        assert {k for k, value in enumerate(row) if value != zero} == set(list_carriers(parents, joint))
