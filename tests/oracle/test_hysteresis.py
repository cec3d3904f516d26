"""Plays, stops, knees and their inverse against exact identities, quadrature and other carriers.

The numbers V1 to V14 are those of the matrix that the model was specified by.
"""

import itertools
from dataclasses import replace
from fractions import Fraction

import hypothesis.strategies as st
import mpmath
import numpy as np
import pytest
import sympy
from hypothesis import given, settings

from symid.errors import RobotError
from symid.joint_models import build_float_carrier, hysteresis, run_element
from symid.joint_models.carriers import OperatorCarrier
from symid.joint_models.prandtl_ishlinskii import (
    PlayPath,
    compute_hysteresis_torque,
    compute_plays,
    compute_spring_work,
    compute_stop_basis,
    compute_work_columns,
    invert_hysteresis,
    read_spring_terms,
)
from tests.refusals import raises

FLOATS = build_float_carrier()
HARDENING = (hysteresis.Knee(threshold=-3.0, slope=0.5), hysteresis.Knee(threshold=3.0, slope=0.5))


def stops(*pairs):
    return tuple(hysteresis.Stop(threshold=threshold, stiffness=stiffness) for threshold, stiffness in pairs)


def knees(*pairs):
    return tuple(hysteresis.Knee(threshold=threshold, slope=slope) for threshold, slope in pairs)


SHOULDER = hysteresis.Elasticity(
    stiffness=380.0, stops=stops((0.002, 120.0), (0.005, 60.0), (0.010, 40.0)), knees=HARDENING
)
SOFT = hysteresis.Elasticity(stiffness=380.0, stops=SHOULDER.stops)
UNEVEN = hysteresis.Elasticity(
    stiffness=50.0, stops=SHOULDER.stops, knees=knees((-2.0, 0.7), (-0.4, -0.3), (0.6, 0.2), (1.5, -0.4))
)
CUBIC = hysteresis.Elasticity(stiffness=380.0, cubic=1e5, stops=SHOULDER.stops)
SPRINGS = pytest.mark.parametrize("elasticity", [SHOULDER, SOFT, UNEVEN], ids=["mpi", "stops", "uneven"])


def assert_near(found, expected, tolerance):
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance)


def wander(seed=0, count=3000, size=0.02):
    """Return a torsion with many reversals that reaches `size`."""
    walk = np.cumsum(np.random.default_rng(seed).normal(size=count))
    walk -= walk[0]
    return walk * size / np.abs(walk).max()


def find_legal_memory(thresholds, seed):
    """Return plays that a history leaves: those at the end of a random path."""
    path = np.random.default_rng(seed).uniform(-2, 2, 5) * max(thresholds, default=1.0)
    return compute_plays(path, thresholds)[-1]


@st.composite
def play_models(draw):
    """Draw models that rise, with weights of both signs."""
    count = draw(st.integers(0, 6))
    gaps = draw(st.lists(st.floats(0.05, 2.0), min_size=count, max_size=count))
    slopes = draw(st.lists(st.floats(0.2, 3.0), min_size=count + 1, max_size=count + 1))
    weights = (slopes[0], *np.diff(slopes).tolist())
    return hysteresis.Plays(weights=weights, thresholds=tuple(np.cumsum(gaps).tolist()))


def add_plays(model, values, memory=None):
    """Return w_0 x + sum_i w_i P_i[x]."""
    plays = compute_plays(values, np.array(model.thresholds), memory)
    return model.weights[0] * values + plays @ model.weights[1:]


def invert_model(model, memory):
    """Return the inverse of a sum of plays, and its memory."""
    image = hysteresis.invert_plays_memory(FLOATS, model, memory)
    return hysteresis.invert_plays(FLOATS, model), np.array(image)


@given(play_models(), st.integers(0, 1000))
def test_v1_v2_the_inverse_of_plays_undoes_them_and_its_inverse_is_the_model(model, seed):
    values, radii = np.random.default_rng(seed).uniform(-5, 5, 60), np.array(model.thresholds)
    memory = find_legal_memory(radii, seed)
    inverse, image = invert_model(model, memory)
    assert_near(add_plays(inverse, add_plays(model, values, memory), image), values, 2e-13)
    again, back = invert_model(inverse, image)
    np.testing.assert_allclose(again.weights, model.weights, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(again.thresholds, model.thresholds, rtol=1e-12)
    assert_near(back, memory, 1e-12)


def find_radii(elasticity):
    return np.array([stop.threshold for stop in elasticity.stops])


def find_balance(elasticity, phi, memory=None):
    """Return work, and what of it is not stored, which is lost: it never falls."""
    work = compute_spring_work(elasticity, phi, memory)
    begun = np.append(0.0, np.zeros(len(elasticity.stops)) if memory is None else memory)
    stored = run_element(elasticity, phi, start=begun).stored
    lost = work - (stored - stored[0])
    assert np.diff(lost).min() >= -1e-13 * (1.0 + lost[-1])
    return work, lost


@st.composite
def springs(draw):
    """Draw passive springs with stops and with knees on either side that go on rising."""
    count = draw(st.integers(0, 4))
    gaps = draw(st.lists(st.floats(0.01, 0.5), min_size=count, max_size=count))
    weights = draw(st.lists(st.floats(0.0, 3.0), min_size=count, max_size=count))
    bends = []
    for side in (-1.0, 1.0):
        number = draw(st.integers(0, 2))
        places = side * np.cumsum(draw(st.lists(st.floats(0.05, 1.0), min_size=number, max_size=number)))
        slopes = np.diff([1.0, *draw(st.lists(st.floats(0.2, 2.5), min_size=number, max_size=number))])
        bends += knees(*zip(places.tolist(), slopes.tolist(), strict=True))
    return hysteresis.Elasticity(
        stiffness=draw(st.floats(0.2, 5.0)),
        stops=stops(*zip(np.cumsum(gaps).tolist(), weights, strict=True)),
        knees=tuple(sorted(bends)),
    )


@given(springs(), st.integers(0, 1000))
def test_v3_and_v6_for_any_spring(elasticity, seed):
    memory = find_legal_memory(find_radii(elasticity), seed)
    phi = np.random.default_rng(seed).uniform(-1.5, 1.5, 50)
    torque = compute_hysteresis_torque(elasticity, phi, memory=memory)
    assert_near(invert_hysteresis(elasticity, torque, memory), phi, 1e-13)
    find_balance(elasticity, phi, memory)


def test_v4_the_scale_of_the_outer_function_does_not_matter():
    phi = wander(3)
    torque = compute_hysteresis_torque(SHOULDER, phi)
    for factor in (0.25, 3.0, 17.0):
        scaled = hysteresis.Elasticity(
            stiffness=SHOULDER.stiffness * factor,
            stops=stops(*((stop.threshold, stop.stiffness * factor) for stop in SHOULDER.stops)),
            knees=knees(*((knee.threshold * factor, knee.slope / factor) for knee in HARDENING)),
        )
        # Kuhnen's form with the slope apart, written down anew.
        inner = compute_hysteresis_torque(replace(scaled, knees=()), phi)
        outer = inner / factor
        for knee in scaled.knees:
            beyond = np.maximum if knee.threshold > 0 else np.minimum
            outer += knee.slope * beyond(inner - knee.threshold, 0.0)
        np.testing.assert_allclose(outer, torque, rtol=1e-13, atol=1e-13)


def test_v5_plays_and_stops_are_the_same_model():
    model, phi = hysteresis.gather_plays(FLOATS, read_spring_terms(SOFT)), wander(5)
    assert_near(add_plays(model, phi), compute_hysteresis_torque(SOFT, phi), 1e-14)
    basis = compute_stop_basis(phi, np.array(model.thresholds))
    weights = [SOFT.stiffness, *(stop.stiffness for stop in SOFT.stops)]
    assert_near(basis @ weights, compute_hysteresis_torque(SOFT, phi), 1e-14)


@pytest.mark.parametrize(
    "kept", [slice(None), slice(3, None, 7), slice(1, 90, 2), slice(5, 5), slice(-1, None)]
)
@pytest.mark.parametrize("memory", [None, (0.2, -0.1)])
@pytest.mark.parametrize("length", [1, 2, 400])
def test_plays_of_some_samples_are_those_of_all(kept, memory, length):
    """Sample after sample, through the definition of a play."""
    radii, phi = (
        np.array([0.3, 0.8]),
        np.repeat(np.cumsum(np.random.default_rng(4).normal(size=200)), 2)[:length],
    )
    plays, expected = np.zeros(2) if memory is None else np.array(memory), []
    for value in phi:
        plays = np.clip(plays, value - radii, value + radii)
        expected.append(plays)
    np.testing.assert_array_equal(
        PlayPath.build(phi, kept).follow(radii, memory)[1], np.array(expected)[kept]
    )
    if memory is None:
        basis = np.column_stack([phi, phi[:, None] - np.array(expected)])[kept]
        np.testing.assert_array_equal(compute_stop_basis(phi, radii, kept), basis)


def integrate(torque_of, inputs, fine=4000):
    """Return the integral of an output along straight pieces of its input, by the trapezoidal rule."""
    path = np.concatenate([np.linspace(a, b, fine, endpoint=False) for a, b in itertools.pairwise(inputs)])
    path = np.append(path, inputs[-1])
    output = torque_of(path)
    steps = 0.5 * (output[1:] + output[:-1]) * np.diff(path)
    total = np.concatenate([[0.0], np.cumsum(steps)])[::fine]
    stieltjes = 0.5 * (path[1:] + path[:-1]) * np.diff(output)
    return total, np.concatenate([[0.0], np.cumsum(stieltjes)])[::fine]


@pytest.mark.parametrize(
    "elasticity", [SHOULDER, SOFT, UNEVEN, CUBIC], ids=["mpi", "stops", "uneven", "cubic"]
)
def test_v6_work_is_energy_stored_and_lost(elasticity):
    radii, phi = find_radii(elasticity), wander(7, 30)
    memory = find_legal_memory(radii, 7)
    work, lost = find_balance(elasticity, phi, memory)
    assert lost[-1] > 0.005
    if not elasticity.knees:
        # Each stop loses its level times the way of its play.
        ways = np.abs(np.diff(compute_plays(phi, radii, memory), axis=0)).sum(axis=0)
        levels = [stop.threshold * stop.stiffness for stop in elasticity.stops]
        assert lost[-1] == pytest.approx(ways @ levels, abs=1e-14)
    reference, _ = integrate(lambda x: compute_hysteresis_torque(elasticity, x, memory=memory), phi)
    assert_near(work, reference, 1e-6 * np.abs(work).max())
    if elasticity is SOFT:
        columns = compute_work_columns(phi, radii, memory)
        assert_near(columns @ [380.0, 120.0, 60.0, 40.0], work, 1e-13)


def test_v6_for_a_compliance():
    model = hysteresis.Plays(weights=(1.0, 0.3, 0.2), thresholds=(0.5, 1.2))
    torque, memory = wander(8, 30, 3.0), np.array([0.2, 0.5])
    weights, radii = np.array(model.weights), np.array(model.thresholds)
    plays = compute_plays(torque, radii, memory)
    # Stored: sum of w_i P_i^2 / 2. Lost: sum of w_i r_i int |dP_i|.
    stored = 0.5 * np.column_stack([torque, plays]) ** 2 @ weights
    ways = np.abs(np.diff(plays, axis=0, prepend=plays[:1]))
    lost = np.cumsum(ways @ (weights[1:] * radii))
    _, work = integrate(lambda x: add_plays(model, x, memory), torque)
    assert_near(stored - stored[0] + lost, work, 1e-7 * np.abs(work).max())
    assert np.all(np.diff(lost) >= 0)


def test_v7_positive_play_weights_create_energy():
    radii, amplitude = np.array([0.5, 1.0]), 2.0
    cycle = amplitude * np.array([1.0, 0.0, -1.0, 0.0, 1.0])
    settled, loss = np.concatenate([[0.0], cycle, cycle[1:]]), {}
    ways = np.abs(np.diff(compute_plays(settled, radii)[-5:], axis=0)).sum(axis=0)
    for sign in (1.0, -1.0):
        model = hysteresis.Plays(weights=(2.0, sign * 0.42, sign * 0.21), thresholds=tuple(radii.tolist()))
        work, _ = integrate(lambda x, model=model: add_plays(model, x), settled)
        loss[sign] = work[-1] - work[-5]
        assert loss[sign] == pytest.approx(-sum(np.array(model.weights[1:]) * radii * ways), rel=1e-6)
    assert loss[1.0] < 0 < loss[-1.0]
    assert loss[-1.0] == pytest.approx(4.0 * np.array([0.42, 0.21]) @ (radii * (amplitude - radii)), rel=1e-6)


def find_first_torque(elasticity, phi):
    """Return k0 A + sum_i k_i min(r_i, A), odd in A: v of a virgin spring on its way to A."""
    held = [stop.stiffness * np.clip(phi, -stop.threshold, stop.threshold) for stop in elasticity.stops]
    return elasticity.stiffness * phi + sum(held)


@SPRINGS
def test_v8_branches_wiping_out_and_rate(elasticity):
    amplitude = 0.013

    def bend(inner):
        """Return S(v): a spring of stiffness one without stops."""
        return compute_hysteresis_torque(replace(elasticity, stiffness=1.0, stops=()), inner)

    up, down = np.linspace(0, amplitude, 50), np.linspace(amplitude, -amplitude, 80)
    for side in (1.0, -1.0):
        torque = compute_hysteresis_torque(elasticity, side * np.concatenate([up, down]))
        first, top = find_first_torque(elasticity, side * up), find_first_torque(elasticity, side * amplitude)
        assert_near(torque[:50], bend(first), 1e-14)
        # Masing: v = v(A) - 2 v((A - phi) / 2).
        back = top - 2.0 * find_first_torque(elasticity, 0.5 * side * (amplitude - down))
        assert_near(torque[50:], bend(back), 2e-14)
    paths = ([0.0, 0.012, -0.005, 0.013], [0.0, 0.012, -0.005, 0.009, 0.001, 0.008, 0.013])
    plain, inner = (compute_hysteresis_torque(elasticity, np.array(path)) for path in paths)
    assert plain[-1] == inner[-1]
    phi = wander(11)
    repeated = compute_hysteresis_torque(elasticity, np.repeat(phi, 3))
    np.testing.assert_array_equal(repeated[::3], compute_hysteresis_torque(elasticity, phi))


@settings(max_examples=100)
@given(
    st.integers(1, 400),
    st.integers(0, 5),
    st.integers(0, 1000),
    st.sampled_from(["noise", "wave", "steps", "gap"]),
)
def test_plays_of_blocks_are_those_of_single_steps(count, size, seed, kind):
    generator = np.random.default_rng(seed)
    values, radii = generator.normal(size=count), np.sort(generator.uniform(0, 2, size))
    if kind != "noise":
        values = 3.0 * np.sin(generator.uniform(0.01, 1.0) * np.arange(count))
    if kind == "steps":
        values = np.round(values)
    if kind == "gap":
        values[generator.integers(count)] = np.nan
    state = memory = generator.normal(size=size)
    plays = compute_plays(values, radii, memory)
    for value, found in zip(values, plays, strict=True):
        state = np.maximum(value - radii, np.minimum(value + radii, state))
        np.testing.assert_array_equal(found, state)


def test_no_samples_no_plays_and_damping_where_the_rate_is_given():
    assert compute_plays(np.empty(0), np.array([1.0])).shape == (0, 1)
    assert compute_plays(np.ones(3), np.empty(0)).shape == (3, 0)
    linear = hysteresis.Elasticity(stiffness=7.0)
    np.testing.assert_array_equal(compute_hysteresis_torque(linear, np.array([1.0, -2.0])), [7.0, -14.0])
    np.testing.assert_array_equal(invert_hysteresis(linear, np.array([7.0, -14.0])), [1.0, -2.0])
    assert compute_spring_work(linear, np.array([1.0, -2.0])).tolist() == [0.0, 10.5]
    damped = hysteresis.Elasticity(stiffness=10.0, damping=0.5, cubic=2.0)
    phi, dphi = np.array([0.1, 0.2]), np.array([1.0, -1.0])
    plain = 10 * phi + 2 * phi**3
    np.testing.assert_allclose(compute_hysteresis_torque(damped, phi, dphi), plain + 0.5 * dphi)
    np.testing.assert_allclose(compute_hysteresis_torque(damped, phi), plain)


MPMATH = OperatorCarrier(zero=mpmath.mpf(0), one=mpmath.mpf(1), maximum=max, minimum=min)
EXACT = OperatorCarrier(zero=Fraction(0), one=Fraction(1), maximum=max, minimum=min)
SYMPY = OperatorCarrier(zero=sympy.Integer(0), one=sympy.Integer(1), maximum=sympy.Max, minimum=sympy.Min)


def lift(terms, number):
    """Return the terms of a spring with every number turned by `number`."""
    names = ("stops", "above", "below")
    pairs = {name: tuple(tuple(map(number, pair)) for pair in getattr(terms, name)) for name in names}
    return hysteresis.SpringTerms(stiffness=number(terms.stiffness), **pairs)


@pytest.mark.parametrize(
    ("carrier", "number"),
    [(MPMATH, mpmath.mpf), (EXACT, Fraction), (SYMPY, sympy.Rational)],
    ids=["mpmath", "fractions", "sympy"],
)
@SPRINGS
def test_other_carriers_give_the_same(elasticity, carrier, number):
    phi, memory = wander(13, 40), find_legal_memory(find_radii(elasticity), 4)
    spring = lift(read_spring_terms(elasticity), number)
    inverse, plays = (
        hysteresis.invert_spring(carrier, spring),
        tuple(number(float(entry)) for entry in memory),
    )
    radii, stiffness = zip(*spring.stops, strict=True)
    first = carrier.add(spring.stiffness, sum(stiffness, carrier.zero))
    model = hysteresis.Plays(weights=(first, *(-k for k in stiffness)), thresholds=radii)
    state, torques, torsions = hysteresis.invert_plays_memory(carrier, model, plays), [], []
    for value in phi:
        torque, plays = hysteresis.advance_spring(carrier, spring, number(float(value)), plays)
        torsion, state = hysteresis.advance_inverse_spring(carrier, inverse, torque, state)
        torques.append(float(torque))
        torsions.append(float(torsion))
        assert carrier is not EXACT or torsion == Fraction(float(value))
    assert_near(compute_hysteresis_torque(elasticity, phi, memory=memory), torques, 1e-14)
    assert_near(torsions, phi, 1e-15)
    model = hysteresis.gather_plays(FLOATS, read_spring_terms(elasticity))
    ends = compute_plays(phi, find_radii(elasticity), memory)[-1].tolist()
    found = hysteresis.invert_plays_memory(FLOATS, model, ends)
    assert_near(found, [float(entry) for entry in state], 1e-14)


def test_what_is_refused():
    cubic = hysteresis.Elasticity(stiffness=1.0, cubic=1.0, knees=HARDENING)
    for find in (compute_spring_work, invert_hysteresis):
        with raises(RobotError, "robot.cubic-spring", match="cubic spring"):
            find(cubic, np.zeros(2))
    with raises(RobotError, "robot.unknown-stiffness", match="unknown"):
        compute_hysteresis_torque(
            hysteresis.Elasticity(stiffness=1.0, stops=(hysteresis.Stop(threshold=1.0),)), np.zeros(2)
        )
    with raises(RobotError, *["robot.impossible-memory"] * 2, match=r"plays 1 and 2 are 0.01 .* 0.003"):
        invert_hysteresis(SOFT, np.zeros(2), np.array([0.0, 0.01, 0.0]))
    with raises(RobotError, "robot.impossible-memory", match="1 plays; there are 3"):
        invert_hysteresis(SOFT, np.zeros(2), np.zeros(1))
    falls = hysteresis.Elasticity(stiffness=1.0, stops=stops((0.1, -2.0)))
    with raises(RobotError, "robot.invalid-elasticity", match="does not rise"):
        invert_hysteresis(falls, np.zeros(2))
