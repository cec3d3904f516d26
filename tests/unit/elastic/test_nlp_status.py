"""Every way in which Ipopt can end has a meaning; none is success by default."""

import re
from pathlib import Path

import casadi

from symid.elastic.fit import ElasticOutcome
from symid.elastic.nlp_status import LINEAR_SOLVER, find_outcome
from symid.estimators.ipopt_status import IPOPT_STATUSES


def test_the_statuses_are_those_of_the_header_that_comes_with_ipopt():
    header = Path(casadi.__file__).parent / "include" / "coin-or" / "IpReturnCodes_inc.h"
    enumeration = header.read_text().partition("enum ApplicationReturnStatus")[2].partition("}")[0]
    names = {name.lower() for name in re.findall(r"^\s*(\w+)\s*=\s*-?\d+", enumeration, re.MULTILINE)}
    assert len(names) == 20
    # Words of the header, as the interface writes them: "Maximum_WallTime_Exceeded".
    assert {name.lower() for name in IPOPT_STATUSES} == names


def test_only_success_converges():
    outcomes = {name: find_outcome(name, LINEAR_SOLVER)[0] for name in IPOPT_STATUSES}
    converged = [name for name, outcome in outcomes.items() if outcome is ElasticOutcome.CONVERGED]
    assert converged == ["Solve_Succeeded"]
    assert set(outcomes.values()) >= {
        ElasticOutcome.ACCEPTABLE,
        ElasticOutcome.LIMIT,
        ElasticOutcome.INFEASIBLE,
        ElasticOutcome.DIVERGED,
        ElasticOutcome.STALLED,
        ElasticOutcome.FAILED,
    }


def test_an_unknown_status_and_an_unknown_linear_solver_are_failures():
    assert find_outcome("Solve_Succeeded", LINEAR_SOLVER)[0] is ElasticOutcome.CONVERGED
    outcome, reason = find_outcome("Something_Else", LINEAR_SOLVER)
    assert outcome is ElasticOutcome.FAILED
    assert "Something_Else" in reason
    for solver in ("spral", ""):
        outcome, reason = find_outcome("Solve_Succeeded", solver)
        assert outcome is ElasticOutcome.FAILED
        assert "linear solver" in reason
    assert "not available" in find_outcome("Invalid_Option", "")[1]
