"""The one-shot problem as expressions: the optimum of the callbacks, and terms and constraints of a user."""

import re
from dataclasses import replace

import casadi
import numpy as np
import pytest

import symid
from symid.api.identification import OneShotProblem
from symid.errors import SolverError, UsageError
from symid.identification.elastic.methods import build_elastic_equations, fit_one_shot
from symid.identification.elastic.nlp import build_nlp_graph, compute_scales, optimise_nlp
from symid.identification.elastic.options import ElasticOptions, NlpOptions
from tests.refusals import raises

PLACES = {"thresholds": ((0.002, 0.005), (0.003,)), "knee_torques": ((-3.0, 3.0), (-1.2, 1.2))}
EXPRESSION = "usage.expression"
CASES = {
    "with knees": ("two_link_elastic", ElasticOptions()),
    "without knees": ("two_link_harmonic", ElasticOptions(knees=0, nlp=NlpOptions(rows=("filtered",)))),
}


def build(name, options):
    """Return the fit of callbacks, and the same problem as expressions."""
    robot = symid.load(name)
    log = robot.simulate("ta", scale=10, duration=4.0, seed=1).log
    work = build_elastic_equations(robot._prepare(robot.description), (log.recording,), options)
    found = fit_one_shot(work)
    graph = build_nlp_graph(found, work.wide, options.nlp)
    return found, OneShotProblem(robot=robot, graph=graph)


@pytest.fixture(scope="module")
def given():
    """Return fit and problem with stops and knees that are given, momentum rows alone."""
    return build("two_link_elastic", ElasticOptions(**PLACES, nlp=NlpOptions(rows=("momentum",))))


def begin_at(problem, x):
    """Return the problem with its search beginning at x."""
    entries = zip(problem.graph.variables.items(), x, strict=True)
    moved = {name: replace(entry, start=float(value)) for (name, entry), value in entries}
    return replace(problem, graph=replace(problem.graph, variables=moved))


def assert_same(solution, run, cost):
    """Compare all values, those near zero by their effect on the rows."""
    found, scales = np.array(list(solution.values.values())), compute_scales(cost, run.x)
    assert np.all(np.abs(found - run.x) <= 1e-6 * np.maximum(np.abs(run.x), scales))
    assert solution.objective == pytest.approx(run.objective, rel=1e-9)


@pytest.mark.parametrize("case", CASES)
def test_the_optimum_is_that_of_the_callbacks(case):
    found, problem = build(*CASES[case])
    assert any(spring.knees for spring in found.cost.layout.springs) is (case == "with knees")
    layout = found.cost.layout
    away = np.clip(1.05 * found.run.x, layout.lower, layout.upper)
    begun = begin_at(problem, away)
    assert found.cost.compute_value(found.cost.compute_state(away)) > 1.5 * found.run.objective
    solution = begun.solve()
    assert solution.converged
    assert_same(solution, found.run, found.cost)
    springs = zip(solution.springs.values(), found.fit.elasticity, strict=True)
    for mine, theirs in springs:
        assert mine.initial_stiffness == pytest.approx(theirs.initial_stiffness, rel=1e-6)


def test_value_and_gradient_for_all_rows():
    """Against the callbacks, whose gradient finite differences prove, with knees and Stribeck friction."""
    rows = ("energy", "filtered", "momentum")
    nlp = NlpOptions(rows=rows, stribeck=True, smoothing=0.01, rounds=0, iterations=1)
    found, problem = build("two_link_elastic", ElasticOptions(**PLACES, nlp=nlp))
    cost, layout = found.cost, found.cost.layout
    x = 1.02 * found.run.x
    x[layout.speed], x[layout.excess] = (0.2, 0.4), (0.3, 0.2)
    state, scales = cost.compute_state(x), compute_scales(cost, x)
    symbols = casadi.vertcat(*problem.variables.values())
    value = casadi.Function("value", [symbols], [problem.cost])
    gradient = casadi.Function("gradient", [symbols], [casadi.gradient(problem.cost, symbols)])
    slopes = np.array(gradient(x)).ravel() * scales
    assert float(value(x)) == pytest.approx(cost.compute_value(state), rel=1e-12)
    np.testing.assert_allclose(slopes, cost.compute_gradient(state) * scales, atol=1e-12 * max(abs(slopes)))


def test_a_constraint_is_met_and_the_optimum_is_that_of_the_same_bound(given):
    found, problem = given
    name = "k0 of joint 1"
    layout, free = found.cost.layout, problem.solve()
    limit = 0.98 * free[name]
    solution = problem.add_constraint(problem[name], upper=limit).solve()
    assert solution.active == (True,)
    assert solution[name] <= limit * (1.0 + 1e-9)
    assert solution.objective > free.objective
    upper = np.array(layout.upper)
    upper[layout.names.index(name)] = limit
    bounded = replace(found.cost, layout=replace(layout, upper=upper))
    run = optimise_nlp(bounded, found.run.x, compute_scales(bounded, found.run.x), NlpOptions())
    assert_same(solution, run, found.cost)
    loose = problem.add_constraint(problem[name], lower=limit, upper=2.0 * limit).solve()
    assert loose.active == (False,)
    assert_same(loose, found.run, found.cost)
    assert repr(problem).startswith("<OneShotProblem two_link_elastic: ")
    assert "k1 of joint 2" in str(problem)
    assert "active" in str(solution)
    assert solution.to_dict()["constraints"][0]["active"]
    entry = {"name": "IA1", "start": pytest.approx(0.25, rel=0.1), "lower": 0.0, "upper": np.inf}
    assert entry in problem.to_dict()["variables"]


@pytest.mark.parametrize(
    ("fixed", "joint", "side", "torque"),
    [
        ("k0 of joint 2", "elbow", "spring", lambda motion, value: value * motion.phi),
        ("k1 of joint 2", "elbow", "spring", lambda motion, k: k * (motion.phi - motion.play(0.003))),
        ("Fv1", "shoulder", "motor", lambda motion, value: value * motion.dtheta),
    ],
)
def test_an_added_torque_takes_the_place_of_the_same_one_inside(given, fixed, joint, side, torque):
    """With the model's own weight held at a part of its value, the added one is the rest."""
    _, problem = given
    # Knees of this joint would see the spring alone.
    slopes = [name for name in problem.variables if name.startswith("slope") and name.endswith("joint 2")]
    for name in slopes:
        problem = problem.add_constraint(problem[name], lower=1.0, upper=1.0)
    whole = problem.solve()
    part = 0.7 * whole[fixed]
    larger = problem.add_variable("added", lower=0.0).add_constraint(problem[fixed], lower=part, upper=part)
    solution = larger.add_torque(joint, lambda motion: torque(motion, larger["added"]), side=side).solve()
    assert solution.converged
    assert part + solution["added"] == pytest.approx(whole[fixed], rel=1e-5)
    assert solution.objective == pytest.approx(whole.objective, rel=1e-7)


def test_a_threshold_may_be_an_unknown(robots_folder, tmp_path):
    """One stop of the elbow is left out, and found again with its threshold."""
    text = (robots_folder / "two_link_elastic.toml").read_text(encoding="utf-8")
    file = tmp_path / "two_link_elastic.toml"
    file.write_text(re.sub(r"(?m)^(symmetric|knees) = .*\n", "", text), encoding="utf-8")
    thresholds = ((0.002, 0.005, 0.010), (0.008, 0.016))
    options = ElasticOptions(thresholds=thresholds, knees=0, nlp=NlpOptions(rows=("momentum",)))
    problem = build(file, options)[1].add_variable("r", start=0.004, lower=1e-3, upper=7e-3)
    free = problem.add_variable("k", start=10.0, lower=0.0)
    stop = free.add_torque("elbow", lambda motion: free["k"] * (motion.phi - motion.play(free["r"])))
    solution = stop.solve()
    assert solution.converged
    assert (solution["r"], solution["k"]) == (pytest.approx(0.003, rel=0.01), pytest.approx(30.0, rel=0.03))


def test_a_term_pulls_like_a_measurement(given):
    """A datasheet's inertia that counts far more than the log is met; one that counts little is not."""
    _, problem = given
    free = problem.solve()["IA1"]
    for deviation, near in ((1e-7, True), (1e3, False)):
        term = ((problem["IA1"] - 0.3) / deviation) ** 2 / (2.0 * problem.rows)
        found = problem.add_term(term).solve()["IA1"]
        assert found == pytest.approx(0.3 if near else free, rel=1e-5)


@pytest.mark.parametrize(
    ("make", "code", "said"),
    [
        (lambda p: p["k0 of join 1"], "usage.unknown-variable", ""),
        (lambda p: p.add_variable("IA1"), "usage.variable-name", ""),
        (lambda p: p.add_variable("kc", start=-1.0, lower=0.0), "usage.variable-bounds", ""),
        (lambda p: p.add_torque("elbw", lambda motion: motion.phi), "usage.unknown-joint", ""),
        (lambda p: p.add_torque("elbow", lambda motion: motion.phi, side="link"), "usage.torque-side", ""),
        (lambda p: p.add_constraint(p["IA1"]), "usage.constraint", ""),
        (lambda p: p.add_term(casadi.vertcat(p["IA1"], p["IA2"])), EXPRESSION, "2 x 1: must be a scalar"),
        (lambda p: p.add_constraint(casadi.MX.sym("other"), upper=1.0), EXPRESSION, "other; add them"),
        (lambda p: p.add_term("IA1"), EXPRESSION, "the term is str: expected"),
        (lambda p: p.add_torque("elbow", lambda _: p["IA1"]), EXPRESSION, "1 x 1: must be .* a number"),
    ],
)
def test_what_does_not_exist_or_is_no_term_is_refused(given, make, code, said):
    with raises(UsageError, code, match=said):
        make(given[1])


def test_a_search_that_fails_or_stops_says_so(given):
    _, problem = given
    torn = problem.add_constraint(problem["IA1"], upper=0.1).add_constraint(problem["IA1"], lower=0.2)
    with raises(SolverError, "solver.one-shot", match="Infeasible_Problem_Detected"):
        torn.solve()
    short = replace(problem.graph, options=NlpOptions(iterations=1))
    away = begin_at(replace(problem, graph=short), [1.3 * value for value in problem.solve().values.values()])
    stopped = away.solve()
    assert not stopped.converged
    assert "elastic.nlp-not-converged" in {notice.code for notice in stopped.notices}


def test_the_front_door_starts_at_the_fit():
    robot = symid.load("two_link_elastic")
    log = robot.simulate("ta", scale=10, duration=4.0, seed=1).log
    problem = robot.one_shot(log, options=symid.IdentifyOptions(**PLACES))
    fit = robot.identify(log, method="nlp", options=symid.IdentifyOptions(**PLACES))
    solution = problem.solve()
    for name in ("ZZR1", "IA2", "Fc1"):
        assert solution[name] == pytest.approx(fit[name].value, rel=1e-6)
    with pytest.raises(UsageError, match="has no elastic joints"):
        symid.load("two_link").one_shot(symid.load("two_link").simulate(duration=2.0, seed=1).log)
