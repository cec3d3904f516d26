"""Friction with a memory: one definition over all carriers, its step, its equations, what it refuses."""

import casadi
import mpmath
import numpy as np
import pytest
import sympy
from hypothesis import given, strategies as st

from symid.errors import UsageError
from symid.joint_models import (
    advance_memory,
    build_float_carrier,
    build_memory_values,
    build_numpy_carrier,
    derive_equations,
    get_law,
    is_passive,
    simulate_dynamic_friction,
    write_dynamic_latex,
)
from symid.joint_models.carriers import build_symbol_carrier
from tests.friction_forms import build_carrier
from tests.refusals import raises
from tests.state_laws import (
    LAWS,
    count_deflections,
    find_level,
    find_rate,
    find_torque,
    give_values,
    print_values,
    take_step,
)

FLOATS = build_float_carrier()
BRISTLES = ("dahl", "lugre", "lugre+offset")


def build(name, **changed):
    return build_memory_values(get_law(name), print_values(name) | changed)


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("velocity", [-0.5, -0.003, 0.0, 0.01, 2.0])
def test_all_carriers_agree_with_the_equations(name, velocity):
    values, period = build(name), 1e-3
    states = [2e-4 * (-1.0) ** k for k in range(count_deflections(name))]
    torque, after = take_step(give_values(name), velocity, period, states)
    functions = {"maximum": max, "minimum": min}
    graphs = {"absolute": casadi.fabs, "maximum": casadi.fmax, "minimum": casadi.fmin}
    for carrier, lift in (
        (FLOATS, float),
        (build_numpy_carrier(), lambda value: np.full(3, value)),
        (build_carrier(mpmath, mpmath.mpf, absolute=mpmath.fabs, **functions), mpmath.mpf),
        (build_carrier(casadi, casadi.SX, **graphs), casadi.SX),
        (build_symbol_carrier(), sympy.Float),
    ):
        lifted = {key: lift(value) for key, value in values.items()}
        way, bent = lift(velocity * period), list(map(lift, states))
        force, moved = advance_memory(carrier, lifted, lift(velocity), way, bent)
        for found, wanted in zip((force, *moved), (torque, *after), strict=True):
            numbers = found if isinstance(found, np.ndarray) else float(found)
            np.testing.assert_allclose(numbers, wanted, rtol=1e-12, atol=1e-18)


@pytest.mark.parametrize("name", BRISTLES)
def test_the_symbols_give_the_numbers_and_the_step_solves_the_rate(name):
    equations, p, v, z, h = derive_equations(get_law(name)), give_values(name), -0.013, 3e-4, 2e-3
    places = {symbol: print_values(name)[symbol.name] for symbol in equations.values}
    at = {**places, equations.velocity: v, equations.state: z, equations.period: h}
    level = find_level(p, v)
    for expression, wanted in (
        (equations.level, level),
        (equations.rate, find_rate(p, v, z)),
        (equations.torque, find_torque(p, v, [z])),
        (equations.steady, -level + p["Fv"] * v + p.get("offset", 0.0)),
        (equations.state_after, take_step(p, v, h, [z])[1][0]),
    ):
        assert float(expression.subs(at)) == pytest.approx(wanted, rel=1e-12)
    # Derivative of the step by its period, in symbols: nothing else was used to derive it.
    rate = equations.rate.subs(equations.state, equations.state_after)
    gap = sympy.diff(equations.state_after, equations.period) - rate
    for v, z in ((0.3, 1e-4), (-0.02, 5e-4), (0.001, -2e-4)):
        at = {**places, equations.velocity: v, equations.state: z, equations.period: 0.004}
        assert abs(float(gap.subs(at))) < 1e-13 * abs(v)
    assert equations.state_after.subs(equations.period, 0).equals(equations.state)
    lines, memory = write_dynamic_latex(get_law(name)), get_law(name).memory
    assert all(entry.latex in "".join(lines) for entry in (*memory, *get_law(name).physical))
    for line, start in zip(lines, ("g = ", r"\dot z = v - ", r"\tau_f = ", "z_+ = "), strict=True):
        assert line.startswith(start)
    assert (r"\sigma_1 \dot z" in lines[2]) == (len(memory) > 1)


steps = st.tuples(
    st.floats(-3.0, 3.0).filter(lambda v: v == 0 or abs(v) > 1e-9), st.floats(0.0, 10.0), st.floats(-1.0, 1.0)
)


@pytest.mark.parametrize("name", LAWS)
@given(step=steps, share=st.floats(0.0, 1.0))
def test_a_step_is_its_parts_is_odd_and_stays_bounded(name, step, share):
    values, p, (velocity, period, part) = build(name), give_values(name), step
    # Elements follow their level at once.
    level = find_level(p, velocity if "share" in p else 0.0)
    bounds = np.atleast_1d(np.multiply(p.get("share", 1.0), level) / (p.get("sigma0") or p["stiffness"]))

    def move(speed, time, states):
        return np.array(advance_memory(FLOATS, values, speed, speed * time, states)[1])

    states = part * bounds
    whole = move(velocity, period, states)
    both = move(velocity, (1.0 - share) * period, move(velocity, share * period, states))
    assert np.all(np.abs(whole - both) <= 1e-13 * bounds)
    assert np.array_equal(move(-velocity, period, -states), -whole)
    assert np.all(np.abs(whole) <= bounds * (1.0 + 1e-15))


@pytest.mark.parametrize("name", LAWS)
def test_a_run_is_its_steps_and_ends_at_the_static_law(name):
    p, states = give_values(name), [1e-4] * count_deflections(name)
    velocity = np.append(0.1 * np.sin(np.linspace(0.0, 30.0, 200)), [0.0, -0.02])
    period = np.append(np.full(201, 1e-3), 1e6)
    torque, deflections = simulate_dynamic_friction(build(name), velocity, velocity * period, states)
    for k, (v, h) in enumerate(zip(velocity.tolist(), period.tolist(), strict=True)):
        wanted, states = take_step(p, v, h, states)
        assert torque[k] == pytest.approx(wanted, rel=1e-11, abs=1e-11)
        np.testing.assert_allclose(deflections[k], states, rtol=1e-12, atol=1e-17)
    np.testing.assert_array_equal(deflections[-2], deflections[-3])
    assert torque[-1] == pytest.approx(-find_level(p, -0.02) - 0.02 * p["Fv"] + p.get("offset", 0.0))
    straight, _ = simulate_dynamic_friction(build(name), velocity[:1], velocity[:1])
    assert straight[0] == p.get("offset", 0.0)


@pytest.mark.parametrize(("static", "viscous"), [(15.0, 40.0), (10.0, 0.0), (5.0, 80.0)])
def test_passivity_is_known_where_viscous_friction_covers_the_fall(static, viscous):
    """A static level below Coulomb friction counts as much: (max - min) / min = 1."""
    level = {"fC": 10.0, "sigma1": 80.0, "fS": static}
    assert is_passive(build("lugre", **level, fV=viscous))
    if viscous:
        assert is_passive(build("lugre", **level, fV=viscous - 0.1)) is None
    assert is_passive(build("dahl", fV=0.0))


def test_what_cannot_be_used_is_refused():
    wrong = {"sigma0": -1.0, "vs": 0.0, "gamma": 5.0, "fV": float("nan")}
    with raises(UsageError, *["joint.friction-values"] * 4, match=r"sigma0 .* above 0, got -1") as caught:
        build("lugre", **wrong)
    texts = [notice.text for notice in caught.value.notices]
    assert all(any(f" {name} (" in text for text in texts) for name in wrong)
    assert any("at least 0.5 and at most 4, got 5" in text for text in texts)
    for name, change, match in (
        ("dahl", {"fS": 1.0}, "takes sigma0, fC, fV, got .*fS"),
        ("maxwell-slip", {"stiffness4": 1.0}, "takes stiffness1, .*share4"),
        ("maxwell-slip", {"share1": 0.4}, "sum 1, got 0.9"),
    ):
        with raises(UsageError, "joint.friction-values", match=match):
            build(name, **change)
    for use in (derive_equations, write_dynamic_latex, lambda law: build_memory_values(law, {"fC": 1.0})):
        with raises(UsageError, "joint.no-bristles", match="'coulomb' .*: dahl, lugre"):
            use(get_law("coulomb"))
    for velocity in ([0.0, np.nan], [0.0]):
        with raises(UsageError, "joint.friction-path", match="one length"):
            simulate_dynamic_friction(build("dahl"), np.array(velocity), np.zeros(2))
