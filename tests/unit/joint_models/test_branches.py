"""Branches of elements against closed forms, literal relays and ODE solvers."""

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from symid.errors import RobotError
from symid.joint_models import (
    AttractedSlip,
    BoucWen,
    BristleBranch,
    Elasticity,
    Relaxation,
    Relays,
    SlipSpring,
    run_element,
)
from tests.hysteresis_truths import make_attracted


def run(branch, x, t=None, **settings):
    return run_element(Elasticity(stiffness=0.0, branches=(branch,)), x, t, **settings).output


def test_bouc_wen_begins_as_an_exponential_or_a_hyperbolic_tangent():
    x = np.linspace(0, 0.2, 31)
    branch = BoucWen(level=3.0, length=0.02, loop=0.7)
    np.testing.assert_allclose(run(branch, x), 3.0 * (1.0 - np.exp(-50.0 * x)), rtol=1e-12)
    np.testing.assert_allclose(run(branch, -x), -3.0 * (1.0 - np.exp(-50.0 * x)), rtol=1e-12)
    x = np.linspace(0, 0.3, 601)
    branch = BoucWen(level=5.0, length=0.05, sharpness=2.0)
    np.testing.assert_allclose(run(branch, x), 5.0 * np.tanh(20.0 * x), atol=1e-5)


def solve_bouc_wen(branch, turns, count):
    """Bouc's equation dz/dx = 1 - |z|^n (gamma + beta sign(z dx)), with a skew, by an ODE solver."""
    x, u, state = [turns[0]], [0.0], 0.0
    for start, end in itertools.pairwise(turns):
        sign = np.sign(end - start)

        def rate(_, z, sign=sign):
            growing = z * sign > 0.0
            side = np.sign(z)
            factor = 1.0 + side * branch.skew if growing else 1.0 - 2.0 * branch.loop + side * branch.lean
            return (1.0 - factor * np.abs(z) ** branch.sharpness) / branch.length

        places = np.linspace(start, end, count)
        done = solve_ivp(rate, (start, end), [state], t_eval=places, rtol=1e-10, atol=1e-12, max_step=1e-3)
        state = done.y[0, -1]
        x += places[1:].tolist()
        u += done.y[0, 1:].tolist()
    return np.array(x), branch.level * np.array(u)


@pytest.mark.parametrize(
    ("sharpness", "skew", "lean"), [(1.0, 0.0, 0.0), (1.5, 0.4, 0.0), (3.0, -0.6, 0.0), (2.0, 0.3, -0.7)]
)
def test_bouc_wen_against_an_ode_solver(sharpness, skew, lean):
    branch = BoucWen(level=2.0, length=0.1, sharpness=sharpness, loop=0.9, skew=skew, lean=lean)
    errors = []
    for count in (41, 81):
        x, expected = solve_bouc_wen(branch, [0.0, 0.4, -0.3, 0.1, -0.5], count)
        errors.append(np.max(np.abs(run(branch, x) - expected)))
    assert errors[1] < 3e-3
    # Of second order; for n = 1 exact but where u changes its sign, wherever that is within a step.
    assert errors[1] < (0.5 if sharpness > 1.0 else 1.0) * errors[0]


def test_relays_with_ramps_against_relays_one_by_one():
    rng = np.random.default_rng(3)
    weights = rng.uniform(0, 1, 6)
    branch = Relays(low=-1.0, step=0.5, ramps=(0.1, 0.4, 0.2, 0.3), weights=tuple(weights))
    x = np.cumsum(rng.normal(size=400)) * 0.1

    def ramp(z):
        return min(max(z / 0.5, 0.0), 1.0)

    states, expected = {}, []
    for place in (0.0, *x):
        total = sum(d * ramp(place + 1.0 - 0.5 * k) for k, d in enumerate((0.1, 0.4, 0.2, 0.3)))
        pairs = [(i, j) for i in range(4) for j in range(i)]
        for (i, j), weight in zip(pairs, weights, strict=True):
            rising, falling = ramp(place + 1.0 - 0.5 * i), ramp(place + 1.0 - 0.5 * j)
            before = states.get((i, j), ramp(place + 1.0 - 0.25 * (i + j)))
            states[i, j] = max(rising, min(falling, before))
            total += weight * (ramp(place + 1.0 - 0.25 * (i + j)) - states[i, j])
        expected.append(total)
    np.testing.assert_allclose(run(branch, x), expected[1:], atol=1e-13)


def test_a_slip_spring_is_a_stop_that_slips_earlier_when_fast():
    rng = np.random.default_rng(5)
    x = np.cumsum(rng.normal(size=500)) * 0.05
    deflection, before, expected = 0.0, 0.0, []
    for place in x:
        deflection = max(-0.2, min(0.2, deflection + place - before))
        before = place
        expected.append(7.0 * deflection)
    branch = SlipSpring(deflections=(-0.2, 0.05, 0.2), forces=(-1.4, 0.35, 1.4))
    np.testing.assert_allclose(run(branch, x), expected, atol=1e-12)
    branch = SlipSpring(deflections=(-0.2, 0.2), forces=(-1.0, 1.0), falls=(0.0, 0.5))
    for speed in (0.1, 2.0):
        t = np.linspace(0, 1.0 / speed, 200)
        assert run(branch, speed * t, t)[-1] == pytest.approx(1.0 / (1.0 + 0.5 * speed))
        assert run(branch, -speed * t, t)[-1] == pytest.approx(-1.0)


def test_relaxation_dahl_and_maxwell_slip_against_closed_forms():
    # Input at constant speed: f = k T v (1 - exp(-t / T)).
    t = np.linspace(0, 0.5, 101)
    found = run(Relaxation(stiffness=40.0, time=0.08), 0.3 * t, t)
    np.testing.assert_allclose(found, 40.0 * 0.08 * 0.3 * (1.0 - np.exp(-t / 0.08)), atol=1e-13)
    values = (("Fc", 2.0), ("sigma0", 500.0))
    x = np.linspace(0, 0.05, 40)
    found = run(BristleBranch(law="dahl", values=values), x)
    np.testing.assert_allclose(found, 2.0 * (1.0 - np.exp(-250.0 * x)), rtol=1e-12)
    x = 0.1 * np.sin(np.linspace(0, 20, 800)) * np.linspace(0.2, 1, 800)
    values = (("Fc", 3.0), ("stiffness1", 60.0), ("stiffness2", 20.0), ("share1", 0.4), ("share2", 0.6))
    found = run(BristleBranch(law="maxwell-slip", values=values), x)
    total = np.zeros(2)
    for place, before, expected in zip(x[1:], x, found[1:], strict=False):
        total = np.clip(total + (place - before) * np.array([60.0, 20.0]), [-1.2, -1.8], [1.2, 1.8])
        assert total.sum() == pytest.approx(expected, abs=1e-12)


UNIT = {"deflections": (-1.0, 1.0), "forces": (0.0, 1.0)}
BOUC_WEN = {"level": 1.0, "length": 1.0}


@pytest.mark.parametrize(
    ("build", "numbers", "text"),
    [
        (SlipSpring, UNIT | {"deflections": (0.0, 1.0)}, "from minus its largest one"),
        (SlipSpring, UNIT | {"forces": (0.0,)}, "need 2 forces"),
        (SlipSpring, UNIT | {"forces": (0.0, np.nan)}, "must be finite"),
        (SlipSpring, UNIT | {"falls": (0.0, -1.0)}, "not be negative"),
        (
            Relays,
            {"low": 0.0, "step": 0.0, "ramps": (1.0,), "weights": ()},
            "step of relays must be positive",
        ),
        (Relays, {"low": 0.0, "step": 1.0, "ramps": (1.0, 1.0), "weights": ()}, "need 1 relays, got 0"),
        (BoucWen, BOUC_WEN | {"length": 0.0}, "length must be positive"),
        (BoucWen, BOUC_WEN | {"loop": 0.4}, "a loop gives work"),
        (BoucWen, BOUC_WEN | {"skew": 1.0}, "one side has no bound"),
        (BoucWen, BOUC_WEN | {"loop": 0.7, "lean": 0.5}, "a loop gives work"),
        (BristleBranch, {"law": "coulomb", "values": ()}, "known laws: dahl, lugre"),
        (BristleBranch, {"law": "dahl", "values": (("Fc", 1.0),)}, "sigma0 is missing"),
        (BristleBranch, {"law": "dahl", "values": (("Fc", 1.0), ("sigma0", -1.0))}, "must be positive"),
        (Relaxation, {"stiffness": 1.0, "time": 0.0}, "time must be positive"),
        (Elasticity, {"stiffness": 1.0, "backlash": -1.0}, "must not be negative"),
    ],
)
def test_impossible_numbers_are_refused(build, numbers, text):
    with pytest.raises(RobotError, match=text):
        build(**numbers)


def test_attracted_elements_against_another_integrator():
    # The truth takes tenfold finer steps and knows nothing of held velocities.
    stiffness, share = np.array([60.0, 25.0, 8.0]), np.array([0.4, 0.35, 0.25])
    numbers = {"thresholds": tuple(2.0 * share / stiffness), "stiffnesses": tuple(stiffness)}
    branch = AttractedSlip(**numbers, excess=0.4, speed=0.6, attraction=20.0)
    t = np.arange(0.0, 8.0, 6e-4)
    x = 0.6 * np.sin(2.1 * t) + 0.2 * np.sin(5.3 * t)
    y = make_attracted(t, x)
    found = run_element(Elasticity(stiffness=1.2, branches=(branch,)), x, t, start="fresh").output
    assert np.std(found - y) < 2e-3 * np.std(y)
