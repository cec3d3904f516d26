"""Ipopt behind NumPy functions: optima in closed form, scaling, constraints, and how it can end."""

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import casadi
import numpy as np
import pytest

from symid.ipopt import (
    IPOPT_STATUSES,
    Constraints,
    Ending,
    GraphProblem,
    IpoptOptions,
    SmoothProblem,
    describe_ipopt_status,
    keep_last,
    minimise,
    minimise_graph,
)

MATRIX = np.array([[2.0, 0.3, -0.1], [0.3, 1.0, 0.2], [-0.1, 0.2, 3.0]])
AIM = np.array([1.0, -2.0, 0.5])
OPTIONS = IpoptOptions(tolerance=1e-10, iterations=100)


def build(lower=-np.inf, upper=np.inf, *, exact=True, constraints=None):
    """(x - AIM)' M (x - AIM) / 2 between bounds."""
    return SmoothProblem(
        value=lambda x: float((x - AIM) @ MATRIX @ (x - AIM)) / 2.0,
        gradient=lambda x: MATRIX @ (x - AIM),
        hessian=(lambda _: MATRIX) if exact else None,
        lower=np.full(3, lower),
        upper=np.full(3, upper),
        constraints=constraints,
    )


@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize("scales", [None, np.array([1.0, 1e3, 1e-3])])
def test_the_optimum_between_bounds_is_that_of_the_closed_form(exact, scales):
    run = minimise(build(exact=exact), np.zeros(3), OPTIONS, scales)
    np.testing.assert_allclose(run.x, AIM, atol=1e-6)
    assert (run.outcome, run.status) == (Ending.CONVERGED, "Solve_Succeeded")
    held = minimise(build(-1.0, exact=exact), np.zeros(3), OPTIONS, scales).x
    # The second unknown stands on its bound; the others meet their rows of M (x - AIM) = 0.
    free = np.linalg.solve(MATRIX[np.ix_([0, 2], [0, 2])], -MATRIX[[0, 2], 1])
    np.testing.assert_allclose(held, [1.0 + free[0], -1.0, 0.5 + free[1]], atol=1e-6)


@pytest.mark.parametrize("scales", [None, np.array([2.0, 1e2, 1e-2])])
def test_constraints_hold_at_the_optimum(scales):
    """|x| <= 1: at the optimum the gradient is opposite to x."""
    ball = Constraints(
        value=lambda x: np.array([x @ x]),
        jacobian=lambda x: 2.0 * x[None, :],
        pattern=np.ones((1, 3), dtype=bool),
        lower=np.array([-np.inf]),
        upper=np.array([1.0]),
    )
    problem = build(exact=False, constraints=ball)
    run = minimise(problem, np.full(3, 0.1), OPTIONS, scales)
    assert run.outcome is Ending.CONVERGED
    assert np.linalg.norm(run.x) == pytest.approx(1.0, abs=1e-6)
    gradient = problem.gradient(run.x)
    np.testing.assert_allclose(gradient / np.linalg.norm(gradient), -run.x, atol=1e-5)


@pytest.mark.parametrize("scales", [np.ones(3), np.array([2.0, 1e2, 1e-2])])
def test_expressions_have_the_optimum_of_functions(scales):
    """|x| <= 1 again, with second derivatives; and bounds alone."""
    x = casadi.MX.sym("x", 3)
    cost = casadi.mtimes([(x - casadi.DM(AIM)).T, casadi.DM(MATRIX), x - casadi.DM(AIM)]) / 2.0
    wide, none = np.full(3, np.inf), np.zeros(0)
    ball = GraphProblem(
        unknowns=x,
        objective=cost,
        constraints=casadi.sumsqr(x),
        lower=-wide,
        upper=wide,
        floor=np.array([-np.inf]),
        ceiling=np.array([1.0]),
    )
    run = minimise_graph(ball, np.full(3, 0.1), OPTIONS, scales)
    assert (run.outcome, run.status) == (Ending.CONVERGED, "Solve_Succeeded")
    gradient = MATRIX @ (run.x - AIM)
    np.testing.assert_allclose(gradient / np.linalg.norm(gradient), -run.x, atol=1e-6)
    box = replace(ball, constraints=casadi.MX(0, 1), lower=np.full(3, -1.0), floor=none, ceiling=none)
    expected = minimise(build(-1.0), np.zeros(3), OPTIONS).x
    np.testing.assert_allclose(minimise_graph(box, np.zeros(3), OPTIONS, scales).x, expected, atol=1e-6)


def test_ends_that_are_no_optimum_are_told_and_the_last_point_is_kept():
    assert minimise(build(), np.zeros(3), IpoptOptions(tolerance=1e-10, iterations=0)).outcome is Ending.LIMIT
    broken = SmoothProblem(
        value=lambda _: float("nan"), gradient=lambda x: x, lower=np.zeros(3), upper=np.ones(3)
    )
    run = minimise(broken, np.full(3, 0.5), OPTIONS)
    assert run.outcome is Ending.FAILED
    assert np.all(np.isfinite(run.x))
    assert "Invalid_Number_Detected" in run.reason
    calls = []
    double = keep_last(lambda x: calls.append(x.copy()) or 2.0 * x)
    for x in (AIM, AIM.copy(), -AIM, AIM):
        np.testing.assert_array_equal(double(x), 2.0 * x)
    assert len(calls) == 3


def test_the_statuses_are_those_of_the_header_that_comes_with_ipopt():
    header = Path(casadi.__file__).parent / "include" / "coin-or" / "IpReturnCodes_inc.h"
    enumeration = header.read_text().partition("enum ApplicationReturnStatus")[2].partition("}")[0]
    names = {name.lower() for name in re.findall(r"^\s*(\w+)\s*=\s*-?\d+", enumeration, re.MULTILINE)}
    assert len(names) == 20
    # Words of the header, as the interface writes them: "Maximum_WallTime_Exceeded".
    assert {name.lower() for name in IPOPT_STATUSES} == names


def test_only_success_converges():
    outcomes = {status: outcome for status, (outcome, _) in IPOPT_STATUSES.items()}
    assert [status for status, end in outcomes.items() if end is Ending.CONVERGED] == ["Solve_Succeeded"]
    others = set(Ending) - {Ending.SOLVED, Ending.STAGNATED, Ending.SOME_REFUSED}
    assert set(outcomes.values()) == others
    for status in IPOPT_STATUSES:
        assert status in describe_ipopt_status(status)[1]
    for status in ("Infeasible_Problem_Detected", "Diverging_Iterates", "Invalid_Option", "no such status"):
        assert not describe_ipopt_status(status)[0].usable
    outcome, reason = describe_ipopt_status("Something_Else")
    assert outcome is Ending.FAILED
    assert "Something_Else" in reason


def test_casadi_and_sympy_are_not_loaded_before_they_are_needed():
    code = (
        "import sys, symid.ipopt, symid.identification.elastic.methods\n"
        "import symid.identification.hysteresis.spring_fit\n"
        "sys.exit(any(name in sys.modules for name in ('casadi', 'sympy')))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
