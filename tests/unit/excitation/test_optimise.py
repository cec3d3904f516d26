"""The search: feasible everywhere, better than its starts, the same every time, honest where it fails."""

from dataclasses import replace

import numpy as np
import pytest

from symid.codegen.cache import prepare_library
from symid.errors import IdentifiabilityError, SolverError, UsageError
from symid.excitation.optimise import draw_candidates, optimise_excitation
from symid.excitation.problem import Margin, build_problem, compute_condition, compute_margins
from symid.options import ExciteOptions
from symid.robot.description import Limits
from tests.refusals import raises

NAMES = ("shoulder", "elbow")
QUICK = {"candidates": 30, "starts": 2}
# Above the floor, 0.75 m under the shoulder; the arm is about 1 m long.
FLOOR = "[[plane]]\nnormal = [0, 1, 0]\noffset = {}\npoint = [0.4, 0.0, 0.0]\nsize = 0.05\n"


@pytest.fixture(scope="module", autouse=True)
def _brief():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("symid.excitation.optimise._ITERATIONS", 30)
        yield


def write_floor(folder, offset=-0.6):
    (folder / "floor.toml").write_text(FLOOR.format(offset))
    return folder / "floor.toml"


@pytest.fixture(scope="module")
def weak(robot):
    """The arm with drives that can hardly carry it."""
    torques = (12.0, 4.0)
    joints = tuple(
        replace(joint, limits=replace(joint.limits, torque=torque))
        for joint, torque in zip(robot.joints, torques, strict=True)
    )
    return replace(robot, joints=joints)


def search(robot, seed=0, **options):
    return optimise_excitation(robot, ExciteOptions(**QUICK | options), rng=np.random.default_rng(seed))


@pytest.fixture(scope="module")
def plain(robot):
    return search(robot)


def read_values(cards):
    return np.array([entry.value for entry in cards])


def test_candidates_keep_all_limits_and_come_sorted(weak, tmp_path):
    problem = build_problem(weak, ExciteOptions(workspace=write_floor(tmp_path)))
    candidates, conditions = draw_candidates(problem, 30, np.random.default_rng(1))
    assert np.all(np.diff(conditions) >= 0.0)
    assert len(candidates) == 30
    used = []
    for unknowns, condition in zip(candidates, conditions, strict=True):
        assert compute_condition(problem.compute_gram(unknowns)) == condition
        assert np.all(np.abs(problem.rows @ unknowns + problem.constants) <= 1.0)
        assert np.all(problem.compute_state_excess(unknowns) <= 0.0)
        used.append(max(margin.share or 0.0 for margin in compute_margins(problem, NAMES, unknowns)[0]))
    # As large as they can be: something is at its limit.
    assert np.median(used) > 0.9


def test_the_search_is_better_than_random_and_keeps_every_limit(robot, plain):
    assert plain.factor > 1.15
    assert plain.condition < plain.random_condition < plain.random_median
    assert plain.runs[0].condition <= plain.runs[0].start
    q, dq, ddq = plain.trajectory.evaluate(np.linspace(0.0, 10.0, 20001))
    for place, joint in enumerate(robot.joints):
        limits = (joint.limits.position[1], joint.limits.velocity, 10.0)
        peaks = [np.abs(part[:, place]).max() for part in (q, dq, ddq)]
        assert np.all(peaks <= 0.95 * np.array(limits) * (1 + 1e-6))
    np.testing.assert_allclose([dq[0], dq[-1], ddq[0], ddq[-1]], 0.0, atol=1e-8)
    assert all(margin.kept for margin in plain.margins)
    assert {margin.kind for margin in plain.margins} == {"position", "velocity", "acceleration", "torque"}
    assert [notice.code for notice in plain.notices] == ["excitation.assumed-limits"]
    assert "5 harmonics of 0.1 Hz" in plain.trajectory.source


def test_the_stated_condition_number_is_that_of_a_log(robot, plain):
    """Of the regressor as identification stacks it, scaled, at 1 kHz."""
    library = prepare_library(robot)
    states = plain.trajectory.evaluate(np.arange(1, 10000) * 1e-3)
    (links,) = library.evaluate("torque_regressor", *states)
    (friction,) = library.evaluate("friction_regressor", states[1])
    stack = np.concatenate([links, friction], axis=2).reshape(19998, -1)
    wanted = np.linalg.cond(stack / np.linalg.norm(stack, axis=0))
    assert plain.condition == pytest.approx(wanted, rel=1e-2)


def test_torque_limits_hold_everywhere(weak):
    found = search(weak)
    card = (library := prepare_library(weak)).card
    states = found.trajectory.evaluate(np.linspace(0.0, 10.0, 20001))
    (tau,) = library.evaluate("inverse_dynamics", *states, read_values(card.beta))
    (friction,) = library.evaluate("friction", states[1], read_values(card.friction))
    # Friction steps at zero velocity; there no trajectory of the search is judged.
    peaks = np.abs(tau + friction * np.abs(np.tanh(states[1] / [0.08, 0.1]))).max(axis=0)
    assert np.all(peaks <= 0.96 * np.array([12.0, 4.0]))
    # They are what limits it.
    assert peaks[0] > 0.9 * 12.0
    assert all(margin.kept for margin in found.margins)


def test_links_stay_where_they_may(robot, tmp_path):
    found = search(robot, workspace=write_floor(tmp_path))
    q, _, _ = found.trajectory.evaluate(np.linspace(0.0, 10.0, 5001))
    height = 0.5 * np.sin(q[:, 0]) + 0.4 * np.sin(q.sum(axis=1))
    clearance = height.min() + 0.6 - 0.05
    assert clearance >= -1e-6
    told = found.margins[-1]
    assert (told.kind, told.share, told.name) == ("space", None, "plane 1, elbow")
    assert told.value == pytest.approx(clearance, abs=1e-4)


def test_torsion_is_limited_under_a_stated_stiffness(robot):
    found = search(robot, torsion=0.05, stiffness=(400.0, 100.0))
    assert all(margin.kept for margin in found.margins)
    told = {margin.name: margin for margin in found.margins if margin.kind == "torsion"}
    assert set(told) == set(NAMES)
    library = prepare_library(robot)
    states = found.trajectory.evaluate(np.linspace(0, 10, 5001))
    (tau,) = library.evaluate("inverse_dynamics", *states, read_values(library.card.beta))
    torsion = np.abs(tau / [400.0, 100.0]).max(axis=0)
    assert np.all(torsion <= 0.95 * 0.05 * (1 + 1e-6))
    np.testing.assert_allclose([told[name].value for name in NAMES], torsion, rtol=1e-4)


def test_most_information_is_another_trajectory(robot, plain):
    most = search(robot, criterion="d-optimal")
    assert most.information > max(plain.information, most.random_information)
    assert most.condition > plain.condition
    assert search(robot, weight=1.0).information > plain.information


def test_seeds_starts_and_ends_are_kept(robot):
    first, second, other = (search(robot, seed, candidates=10, starts=1) for seed in (0, 0, 1))
    assert first.coefficients.tobytes() == second.coefficients.tobytes()
    assert first.coefficients.tobytes() != other.coefficients.tobytes()
    found = search(robot, start=(0.4, -0.9), harmonics=4, period=6.0)
    q, dq, _ = found.trajectory.evaluate(np.array([0.0, 6.0]))
    np.testing.assert_allclose(q, [[0.4, -0.9]] * 2, atol=1e-8)
    np.testing.assert_allclose(dq, 0.0, atol=1e-8)
    found = search(robot, moving=True)
    assert np.abs(found.trajectory.evaluate(np.zeros(1))[1]).max() > 0.1


def test_what_no_motion_can_do_is_refused(robot, tmp_path, monkeypatch):
    """Joints that can hardly move, slowly, and friction with four parameters of the sign alone."""
    limits = Limits(position=(-1e-9, 1e-9), velocity=1e-9, acceleration=1e-9)
    still = replace(robot, joints=tuple(replace(joint, limits=limits) for joint in robot.joints))
    with raises(IdentifiabilityError, "excitation.rank", match=r"5 harmonics.*: MX2, "):
        search(still)
    with raises(SolverError, "excitation.narrow", match="plane of plane"):
        search(robot, workspace=write_floor(tmp_path, 5.0))
    with raises(UsageError, "usage.excitation", match="--stiffness needs --torsion"):
        search(robot, stiffness=(400.0, 100.0))
    broken = Margin(kind="torque", name="elbow", value=2.0, limit=1.0, allowed=0.95)
    monkeypatch.setattr("symid.excitation.optimise.compute_margins", lambda *_: ((broken,), np.zeros(2)))
    with raises(SolverError, "excitation.between", match=r"\(torque of elbow\)"):
        search(robot, candidates=5, starts=1)
