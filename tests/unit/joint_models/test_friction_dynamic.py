"""Friction with a memory: one definition over all carriers, its step, its derivatives, what it refuses."""

import casadi
import mpmath
import numpy as np
import pytest
import sympy
from hypothesis import given, strategies as st

from benchmarks.friction_rig import compute_largest_level
from symid.errors import UsageError
from symid.joint_models.carriers import build_float_carrier, build_numpy_carrier, build_symbol_carrier
from symid.joint_models.dynamic_friction import (
    DYNAMIC_LAWS,
    FrictionPath,
    build_held_path,
    check_dynamic_values,
    compute_bristle_rate,
    compute_bristle_step,
    compute_dynamic_torque,
    compute_steady_torque,
    derive_equations,
    get_dynamic_law,
    is_passive,
    simulate_dynamic_friction,
    write_dynamic_latex,
)
from tests.friction_forms import build_carrier
from tests.refusals import raises

VALUES = {"dahl": (2e4, 7.0), "lugre": (1e4, 80.0, 10.0, 15.0, 0.02, 1.7, 4.0)}
FLOATS = build_float_carrier()
LAWS = pytest.mark.parametrize("name", sorted(DYNAMIC_LAWS))


def build_other_carriers():
    """Return carriers of high precision and of CasADi, and how their numbers are made."""
    precise = build_carrier(mpmath, mpmath.mpf, absolute=mpmath.fabs, maximum=max, minimum=min)
    graphs = build_carrier(casadi, casadi.SX, absolute=casadi.fabs, maximum=casadi.fmax, minimum=casadi.fmin)
    return (precise, mpmath.mpf), (graphs, casadi.SX), (build_symbol_carrier(), sympy.Float)


@LAWS
@pytest.mark.parametrize("velocity", [-0.5, -0.003, 0.0, 0.01, 2.0])
def test_all_carriers_agree(name, velocity):
    law, values, state, period = get_dynamic_law(name), VALUES[name], 2e-4, 1e-3
    alone = compute_bristle_step(FLOATS, law, (velocity, period), state, values)
    arrays = compute_bristle_step(
        build_numpy_carrier(), law, (np.full(3, velocity), period), np.full(3, state), values
    )
    for one, many in zip(alone, arrays, strict=True):
        np.testing.assert_allclose(many, one, rtol=1e-14)
    for carrier, lift in build_other_carriers():
        numbers = [lift(value) for value in values]
        found = compute_bristle_step(carrier, law, (lift(velocity), lift(period)), lift(state), numbers)
        np.testing.assert_allclose([float(value) for value in found], alone, rtol=1e-13)


@LAWS
def test_the_symbols_give_the_numbers_and_the_step_solves_the_rate(name):
    law, values = get_dynamic_law(name), VALUES[name]
    equations, at = derive_equations(law), (-0.013, 3e-4, values)
    places = dict(zip(equations.values, values, strict=True))
    given = {**places, equations.velocity: -0.013, equations.state: 3e-4, equations.period: 2e-3}
    pairs = {
        equations.level: law.level(FLOATS, -0.013, values),
        equations.rate: compute_bristle_rate(FLOATS, law, *at),
        equations.torque: compute_dynamic_torque(FLOATS, law, *at),
        equations.steady: compute_steady_torque(FLOATS, law, -0.013, values),
    }
    step = compute_bristle_step(FLOATS, law, (-0.013, 2e-3), 3e-4, values)
    pairs |= dict(zip((equations.state_after, equations.torque_after), step, strict=True))
    for expression, value in pairs.items():
        assert float(expression.subs(given)) == pytest.approx(value, rel=1e-13)
    # Derivative of the step by its period, in symbols: nothing else was used to derive it.
    rate = equations.rate.subs(equations.state, equations.state_after)
    gap = sympy.diff(equations.state_after, equations.period) - rate
    for velocity, state in ((0.3, 1e-4), (-0.02, 5e-4), (0.001, -2e-4)):
        at = {**places, equations.velocity: velocity, equations.state: state, equations.period: 0.004}
        assert abs(float(gap.subs(at))) < 1e-13 * abs(velocity)
    assert equations.state_after.subs(equations.period, 0).equals(equations.state)


@LAWS
def test_latex_has_every_parameter(name):
    law = get_dynamic_law(name)
    lines = write_dynamic_latex(law)
    assert all(parameter.latex in "".join(lines) for parameter in law.parameters)
    assert r"\sigma_0 z" in lines[2]
    for line, start in zip(lines, ("g = ", r"\dot z = v - ", r"\tau_f = ", "z_+ = "), strict=True):
        assert line.startswith(start)


steps = st.tuples(
    st.floats(-3.0, 3.0).filter(lambda v: v == 0 or abs(v) > 1e-9), st.floats(0.0, 10.0), st.floats(-1.0, 1.0)
)


@LAWS
@given(step=steps, share=st.floats(0.0, 1.0))
def test_a_step_is_its_parts_is_odd_and_stays_bounded(name, step, share):
    law, values = get_dynamic_law(name), VALUES[name]
    velocity, period, part = step
    bound = compute_largest_level(law, values) / values[0]
    state = part * bound
    whole, _ = compute_bristle_step(FLOATS, law, (velocity, period), state, values)
    half, _ = compute_bristle_step(FLOATS, law, (velocity, share * period), state, values)
    both, _ = compute_bristle_step(FLOATS, law, (velocity, (1.0 - share) * period), half, values)
    assert abs(whole - both) <= 1e-13 * bound
    mirrored, _ = compute_bristle_step(FLOATS, law, (-velocity, period), -state, values)
    assert mirrored == -whole
    assert abs(whole) <= bound * (1.0 + 1e-15)


@LAWS
def test_a_run_is_its_steps_from_straight_bristles_on(name):
    law, values = get_dynamic_law(name), VALUES[name]
    state, torque = compute_bristle_step(FLOATS, law, (0.0, 1e6), 1e-4, values)
    assert state == 1e-4
    assert torque == pytest.approx(values[0] * 1e-4, rel=1e-15)
    velocity = 0.1 * np.sin(np.linspace(0.0, 30.0, 400))
    path = build_held_path(velocity, 1e-3)
    run = simulate_dynamic_friction(law, values, path, state=1e-4)
    for k, held in enumerate(velocity.tolist()):
        state, torque = compute_bristle_step(FLOATS, law, (held, 1e-3), state, values)
        assert run.state[k] == pytest.approx(state, rel=1e-12, abs=1e-17)
        assert run.torque[k] == pytest.approx(torque, rel=1e-11, abs=1e-11)
    parts = {name: np.tile(getattr(path, name), 2) for name in ("held", "velocity", "period", "start")}
    alone, joined = (
        simulate_dynamic_friction(law, values, each).torque for each in (path, FrictionPath(**parts))
    )
    np.testing.assert_array_equal(joined, np.tile(alone, 2))


def test_passivity_of_lugre_is_known_where_viscous_friction_covers_the_fall():
    law = get_dynamic_law("lugre")
    assert is_passive(law, (1e4, 80.0, 10.0, 15.0, 0.02, 2.0, 40.0))
    assert is_passive(law, (1e4, 80.0, 10.0, 15.0, 0.02, 2.0, 39.9)) is None
    assert is_passive(law, (1e4, 80.0, 10.0, 10.0, 0.02, 2.0, 0.0))
    assert is_passive(get_dynamic_law("dahl"), (1e4, 10.0))
    # A static level below Coulomb friction counts as much: (max - min) / min = 1.
    assert is_passive(law, (1e4, 80.0, 10.0, 5.0, 0.02, 2.0, 80.0))
    assert is_passive(law, (1e4, 80.0, 10.0, 5.0, 0.02, 2.0, 79.9)) is None


def test_unknown_laws_and_values_out_of_bounds_are_refused():
    law = get_dynamic_law("lugre")
    with raises(UsageError, *["joint.friction-values"] * 4, match=r"sigma0 .* above 0, got -1") as caught:
        check_dynamic_values(law, (-1.0, 0.0, 1.0, 1.0, 0.0, 5.0, float("nan")))
    texts = [notice.text for notice in caught.value.notices]
    assert all(name in text for name, text in zip(("sigma0", "vs", "gamma", "fV"), texts, strict=True))
    assert all(number in texts[2] for number in (" 0.5 ", " 4, ", "got 5"))
    with raises(UsageError, "joint.friction-values", match=r" 2 .*sigma0, fC.*got 3"):
        check_dynamic_values(get_dynamic_law("dahl"), (1.0, 1.0, 1.0))
    for wrong, hint in (("lugree", r"'lugree'.* 'lugre'\?"), ("zzz", r"'zzz'.* dahl, lugre")):
        with raises(UsageError, "joint.no-dynamic-friction", match=hint):
            get_dynamic_law(wrong)


@pytest.mark.parametrize(
    "change", [{"period": [-1.0, 1.0]}, {"velocity": [0.0]}, {"held": [0.0, np.nan]}], ids=str
)
def test_a_path_that_is_none_is_refused(change):
    fields = {"held": [0.0, 1.0], "velocity": [0.0, 1.0], "period": [0.0, 1.0], "start": [1.0, 0.0]}
    with raises(UsageError, "joint.friction-path", match="one length"):
        FrictionPath(**{**fields, **change})
