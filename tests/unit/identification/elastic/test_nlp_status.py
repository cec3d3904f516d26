"""Every way in which Ipopt can end has a meaning; none is success by default."""

import re
from pathlib import Path

import casadi

from symid.identification.elastic.estimate import MethodOutcome
from symid.identification.elastic.nlp import LINEAR_SOLVER, translate_status
from symid.ipopt import IPOPT_STATUSES


def test_the_statuses_are_those_of_the_header_that_comes_with_ipopt():
    header = Path(casadi.__file__).parent / "include" / "coin-or" / "IpReturnCodes_inc.h"
    enumeration = header.read_text().partition("enum ApplicationReturnStatus")[2].partition("}")[0]
    names = {name.lower() for name in re.findall(r"^\s*(\w+)\s*=\s*-?\d+", enumeration, re.MULTILINE)}
    assert len(names) == 20
    # Words of the header, as the interface writes them: "Maximum_WallTime_Exceeded".
    assert {name.lower() for name in IPOPT_STATUSES} == names


def test_only_success_converges():
    outcomes = {name: translate_status(name, LINEAR_SOLVER)[0] for name in IPOPT_STATUSES}
    converged = [name for name, outcome in outcomes.items() if outcome is MethodOutcome.CONVERGED]
    assert converged == ["Solve_Succeeded"]
    assert set(outcomes.values()) >= {
        MethodOutcome.ACCEPTABLE,
        MethodOutcome.LIMIT,
        MethodOutcome.INFEASIBLE,
        MethodOutcome.DIVERGED,
        MethodOutcome.STALLED,
        MethodOutcome.FAILED,
    }


def test_an_unknown_status_and_an_unknown_linear_solver_are_failures():
    assert translate_status("Solve_Succeeded", LINEAR_SOLVER)[0] is MethodOutcome.CONVERGED
    outcome, reason = translate_status("Something_Else", LINEAR_SOLVER)
    assert outcome is MethodOutcome.FAILED
    assert "Something_Else" in reason
    for solver in ("spral", ""):
        outcome, reason = translate_status("Solve_Succeeded", solver)
        assert outcome is MethodOutcome.FAILED
        assert "linear solver" in reason
    assert "not available" in translate_status("Invalid_Option", "")[1]
