"""The search: feasible everywhere, better than its starts, the same every time, honest where it fails."""

from dataclasses import replace

import numpy as np
import pytest

from symid.codegen.cache import prepare_library
from symid.errors import IdentifiabilityError, SolverError, UsageError
from symid.excitation.limits import LimitOptions, WorkspacePoint, WorkspaceRegion
from symid.excitation.optimise import ExcitationOptions, draw_candidates, optimise_excitation
from symid.excitation.problem import Margin, ProblemOptions, build_problem, compute_margins
from symid.excitation.trajectories import SeriesOptions
from symid.joint_models import FrictionValues
from symid.robot.description import Limits
from tests.refusals import raises

NAMES = ("shoulder", "elbow")
QUICK = ExcitationOptions(candidates=30, starts=2, refined=1, iterations=30)
# Above the floor, 0.75 m under the shoulder; the arm is about 1 m long.
FLOOR = WorkspaceRegion(
    kind="plane",
    anchor=(0.0, 1.0, 0.0),
    extent=-0.6,
    points=(WorkspacePoint(joint=1, place=(0.4, 0.0, 0.0), size=0.05),),
    label="plane 1",
)


@pytest.fixture(scope="module")
def weak(robot):
    """The arm with drives that can hardly carry it."""
    torques = (12.0, 4.0)
    joints = tuple(
        replace(joint, limits=replace(joint.limits, torque=torque))
        for joint, torque in zip(robot.joints, torques, strict=True)
    )
    return replace(robot, joints=joints)


def search(robot, options=QUICK, seed=0):
    return optimise_excitation(robot, options, rng=np.random.default_rng(seed))


@pytest.fixture(scope="module")
def plain(robot):
    return search(robot)


def with_problem(**parts):
    return replace(QUICK, problem=ProblemOptions(**parts))


def test_candidates_keep_all_limits_and_come_sorted(weak):
    problem = build_problem(weak, ProblemOptions(limits=LimitOptions(workspace=(FLOOR,))))
    candidates, conditions = draw_candidates(problem, 30, np.random.default_rng(1))
    assert np.all(np.diff(conditions) >= 0.0)
    assert len(candidates) == 30
    used = []
    for unknowns, condition in zip(candidates, conditions, strict=True):
        assert problem.compute_condition(unknowns) == condition
        assert np.all(np.abs(problem.rows @ unknowns + problem.constants) <= 1.0)
        assert np.all(problem.compute_state_excess(unknowns) <= 0.0)
        used.append(max(margin.share or 0.0 for margin in compute_margins(problem, NAMES, unknowns)[0]))
    # As large as they can be: something is at its limit.
    assert np.median(used) > 0.9


def test_the_search_is_better_than_random_and_keeps_every_limit(robot, plain):
    found = plain
    assert found.factor > 1.15
    assert found.condition < found.random_condition < found.random_median
    assert found.runs[0].condition <= found.runs[0].start
    trajectory = found.trajectory
    q, dq, ddq = trajectory.evaluate(np.linspace(0.0, 10.0, 20001))
    for place, joint in enumerate(robot.joints):
        assert np.abs(q[:, place]).max() <= 0.95 * joint.limits.position[1] * (1 + 1e-6)
        assert np.abs(dq[:, place]).max() <= 0.95 * joint.limits.velocity * (1 + 1e-6)
        assert np.abs(ddq[:, place]).max() <= 0.95 * 10.0 * (1 + 1e-6)
    np.testing.assert_allclose([dq[0], dq[-1], ddq[0], ddq[-1]], 0.0, atol=1e-8)
    assert all(margin.kept for margin in found.margins)
    assert {margin.kind for margin in found.margins} == {"position", "velocity", "acceleration", "torque"}
    assert [notice.code for notice in found.notices] == ["excitation.assumed-limits"]
    assert "5 harmonics of 0.1 Hz" in trajectory.source


def test_the_stated_condition_number_is_that_of_a_log(robot, plain):
    """Of the regressor as identification stacks it, scaled, at 1 kHz."""
    found = plain
    library = prepare_library(robot)
    states = found.trajectory.evaluate(np.arange(1, 10000) * 1e-3)
    stack = np.concatenate(
        [
            library.evaluate("torque_regressor", *states)[0],
            library.evaluate("friction_regressor", states[1])[0],
        ],
        axis=2,
    ).reshape(19998, -1)
    wanted = np.linalg.cond(stack / np.linalg.norm(stack, axis=0))
    assert found.condition == pytest.approx(wanted, rel=1e-2)


def test_torque_limits_hold_everywhere(weak):
    found = search(weak)
    library = prepare_library(weak)
    beta = np.array([entry.value for entry in library.card.beta])
    friction = np.array([entry.value for entry in library.card.friction])
    states = found.trajectory.evaluate(np.linspace(0.0, 10.0, 20001))
    # Friction steps at zero velocity; there no trajectory of the search is judged.
    tau = library.evaluate("inverse_dynamics", *states, beta)[0]
    tau = tau + library.evaluate("friction", states[1], friction)[0] * np.abs(
        np.tanh(states[1] / [0.08, 0.1])
    )
    peaks = np.abs(tau).max(axis=0)
    assert np.all(peaks <= 0.96 * np.array([12.0, 4.0]))
    # They are what limits it.
    assert peaks[0] > 0.9 * 12.0
    assert all(margin.kept for margin in found.margins)


def test_links_stay_where_they_may(robot):
    found = search(robot, with_problem(limits=LimitOptions(workspace=(FLOOR,))))
    q, _, _ = found.trajectory.evaluate(np.linspace(0.0, 10.0, 5001))
    height = 0.5 * np.sin(q[:, 0]) + 0.4 * np.sin(q.sum(axis=1))
    clearance = height.min() + 0.6 - 0.05
    assert clearance >= -1e-6
    told = found.margins[-1]
    assert (told.kind, told.share, told.name) == ("space", None, "plane 1, elbow")
    assert told.value == pytest.approx(clearance, abs=1e-4)


def test_torsion_is_limited_under_a_stated_stiffness(robot):
    limits = LimitOptions(torsion=0.05, stiffness=(400.0, 100.0))
    found = search(robot, with_problem(limits=limits))
    assert all(margin.kept for margin in found.margins)
    told = {margin.name: margin for margin in found.margins if margin.kind == "torsion"}
    assert set(told) == set(NAMES)
    library = prepare_library(robot)
    beta = np.array([entry.value for entry in library.card.beta])
    (tau,) = library.evaluate("inverse_dynamics", *found.trajectory.evaluate(np.linspace(0, 10, 5001)), beta)
    torsion = np.abs(tau / [400.0, 100.0]).max(axis=0)
    assert np.all(torsion <= 0.95 * 0.05 * (1 + 1e-6))
    np.testing.assert_allclose([told[name].value for name in NAMES], torsion, rtol=1e-4)


def test_most_information_is_another_trajectory(robot, plain):
    most = search(robot, replace(QUICK, criterion="d-optimal"))
    assert most.information > plain.information
    assert most.information > most.random_information
    assert most.condition > plain.condition
    more = search(robot, replace(QUICK, weight=1.0))
    assert more.information > plain.information


def test_seeds_starts_and_ends_are_kept(robot):
    short = replace(QUICK, candidates=10, starts=1, iterations=10)
    first, second, other = (search(robot, short, seed) for seed in (0, 0, 1))
    assert first.coefficients.tobytes() == second.coefficients.tobytes()
    assert first.coefficients.tobytes() != other.coefficients.tobytes()
    found = search(robot, with_problem(series=SeriesOptions(start=(0.4, -0.9), harmonics=4, period=6.0)))
    q, dq, _ = found.trajectory.evaluate(np.array([0.0, 6.0]))
    np.testing.assert_allclose(q, [[0.4, -0.9]] * 2, atol=1e-8)
    np.testing.assert_allclose(dq, 0.0, atol=1e-8)
    found = search(robot, with_problem(series=SeriesOptions(rest=False)))
    assert np.abs(found.trajectory.evaluate(np.zeros(1))[1]).max() > 0.1


def test_what_no_motion_can_do_is_refused(robot, monkeypatch):
    """Joints that can hardly move, slowly, and friction with four parameters of the sign alone."""
    limits = Limits(position=(-1e-9, 1e-9), velocity=1e-9, acceleration=1e-9)
    still = replace(robot, joints=tuple(replace(joint, limits=limits) for joint in robot.joints))
    with raises(IdentifiabilityError, "excitation.rank", match=r"5 harmonics.*: MX2, "):
        search(still)
    region = replace(FLOOR, extent=5.0)
    with raises(SolverError, "excitation.narrow", match="plane of plane"):
        search(robot, with_problem(limits=LimitOptions(workspace=(region,))))
    broken = Margin(kind="torque", name="elbow", value=2.0, limit=1.0, allowed=0.95)
    monkeypatch.setattr("symid.excitation.optimise.compute_margins", lambda *_: ((broken,), np.zeros(2)))
    with raises(SolverError, "excitation.between", match=r"\(torque of elbow\)"):
        search(robot, replace(QUICK, candidates=5, starts=1, iterations=3))


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (ExcitationOptions(criterion="a-optimal"), "criterion: .*'a-optimal'"),
        (ExcitationOptions(starts=0), "starts: .* got 0"),
        (ExcitationOptions(candidates=3, starts=4), "4 starts .* got 3"),
        (ExcitationOptions(weight=-1.0), "weight: .* got -1"),
        (ExcitationOptions(problem=ProblemOptions(limits=LimitOptions(share=1.5))), "share: .* got 1.5"),
    ],
)
def test_options_out_of_range(robot, options, says):
    with raises(UsageError, "usage.excitation", match=says):
        search(robot, options)


def test_what_is_told_of_margins_and_progress(robot):
    within = Margin(kind="velocity", name="a", value=1.9, limit=2.0, allowed=0.95)
    beyond = Margin(kind="velocity", name="a", value=1.91, limit=2.0, allowed=0.95)
    clear = Margin(kind="space", name="a", value=0.01, limit=0.0, allowed=1.0)
    assert (within.share, within.kept, beyond.kept) == (0.95, True, False)
    assert (clear.share, clear.kept, replace(clear, value=-0.01).kept) == (None, True, False)
    told = []
    bare = replace(robot, joints=tuple(replace(joint, friction=FrictionValues()) for joint in robot.joints))
    options = replace(QUICK, candidates=10, starts=1, iterations=5)
    optimise_excitation(bare, options, rng=np.random.default_rng(0), progress=told.append)
    assert told[0] == "deriving the regressor of two_link"
    assert any(text.startswith("round 3") for text in told)
