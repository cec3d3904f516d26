"""Whole elements: one step over every carrier, energy, inverse, what is refused."""

import casadi
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from symid.errors import RobotError
from symid.joint_models import (
    Elasticity,
    Stop,
    advance_element,
    build_casadi_carrier,
    build_float_carrier,
    describe_inverse,
    find_least_slope,
    invert_element,
    is_passive_element,
    list_element_values,
    needs_time,
    run_element,
    start_states,
)
from tests.elements import ELEMENTS, STOPS
from tests.refusals import raises

NAMES = tuple(ELEMENTS)
INVERTIBLE = tuple(name for name in NAMES if not describe_inverse(ELEMENTS[name]))


def make_path(seed, count=400):
    rng = np.random.default_rng(seed)
    return np.cumsum(rng.normal(size=count)) * 0.04, np.cumsum(rng.uniform(0.5, 1.5, count)) * 1e-2


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("side", [-1.0, 0.0, 1.0])
def test_a_run_is_its_steps(name, side):
    element, (x, t) = ELEMENTS[name], make_path(1)
    begun = start_states(element, 0.1, side)
    run = run_element(element, x, t, start=begun)
    states, values = begun, list_element_values(element)
    for k in range(len(x)):
        period = t[k] - t[k - 1] if k else t[1] - t[0]
        step = advance_element(build_float_carrier(), element, values, (x[k], period), states)
        states = step.states
        assert step.output == pytest.approx(run.output[k], abs=1e-12)
        assert step.stored == pytest.approx(run.stored[k], abs=1e-12)
    np.testing.assert_allclose(run.states, states, atol=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_casadi_takes_the_same_step(name):
    element, values = ELEMENTS[name], list_element_values(ELEMENTS[name])
    begun = start_states(element, 0.0)
    states, given_ = casadi.SX.sym("s", len(begun)), casadi.SX.sym("u", 2)
    symbols = {key: casadi.SX(value) for key, value in values.items()}
    held = (given_[0], given_[1])
    step = advance_element(build_casadi_carrier(), element, symbols, held, casadi.vertsplit(states))
    function = casadi.Function("step", [states, given_], [step.output, casadi.vertcat(*step.states)])
    x, t = make_path(2, 60)
    run = run_element(element, x, t, start=begun)
    for k in range(len(x)):
        output, begun = function(begun, [x[k], t[k] - t[k - 1] if k else t[1] - t[0]])
        assert float(output) == pytest.approx(run.output[k], abs=1e-12)


@given(st.integers(0, 10**6), st.sampled_from([n for n in NAMES if is_passive_element(ELEMENTS[n])]))
@settings(max_examples=40, deadline=None)
def test_no_motion_gets_work_out_of_a_passive_element(seed, name):
    element, (x, t) = ELEMENTS[name], make_path(seed, 60)
    # Many samples a stroke, so that straight lines between outputs hardly err.
    places = np.linspace(0, 59, 59 * 40 + 1)
    fine, time = np.interp(places, np.arange(60), x), np.interp(places, np.arange(60), t)
    run = run_element(element, fine, time, start="fresh")
    assert np.min(run.stored) >= -1e-12
    force = run.output - element.offset
    work = np.concatenate([[0.0], np.cumsum(np.diff(fine) * (force[1:] + force[:-1]) / 2)])
    lost = work - (run.stored - run.stored[0])
    assert np.min(lost) >= -0.02 * np.max(np.abs(work))
    assert lost[-1] > 0.0


def test_what_elements_are_is_known():
    assert not is_passive_element(Elasticity(stiffness=3.0, stops=(Stop(threshold=0.1, stiffness=-1.0),)))
    assert not is_passive_element(ELEMENTS["gap"])
    assert set(INVERTIBLE) == set(NAMES) - {"gap", "lugre", "falling", "attracted"}
    assert find_least_slope(ELEMENTS["stops"]) == 3.0
    assert find_least_slope(ELEMENTS["knees"]) == pytest.approx(3.0 * 0.7)
    rising = run_element(ELEMENTS["slip"], np.linspace(0, 0.5, 2001)).output
    assert np.min(np.diff(rising)) / (0.5 / 2000) == pytest.approx(find_least_slope(ELEMENTS["slip"]))
    assert needs_time(ELEMENTS["lugre"])
    assert not needs_time(ELEMENTS["relays"])
    with raises(RobotError, "robot.element-time", match="give the time"):
        run_element(ELEMENTS["lugre"], np.zeros(3))


@pytest.mark.parametrize("name", INVERTIBLE)
def test_the_inverse_returns_the_input(name):
    element, (x, t) = ELEMENTS[name], make_path(7, 150)
    output = run_element(element, x, t).output
    np.testing.assert_allclose(invert_element(element, output, t), x, atol=1e-9)


@pytest.mark.parametrize(
    ("element", "reason"),
    [
        (ELEMENTS["gap"], "within the backlash"),
        (ELEMENTS["falling"], "falls with the speed"),
        (Elasticity(stiffness=0.0, stops=STOPS), "levels off"),
        (Elasticity(stiffness=1.0, cubic=-1.0), "softens"),
        (Elasticity(stiffness=1.0, damping=-1.0), "damping is negative"),
    ],
)
def test_what_has_no_inverse_is_refused_with_the_reason(element, reason):
    with raises(RobotError, "robot.no-inverse", match=reason):
        invert_element(element, np.zeros(3), np.arange(3.0))
