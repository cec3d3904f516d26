"""The one-shot cost: its unknowns, step means of knees against fine sampling, sums against loops."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from symid.identification.elastic.nlp_cost import (
    ElasticNlpCost,
    NlpLayout,
    NlpRecording,
    RowBlock,
    SpringGrid,
    build_filter_sums,
    build_knee_steps,
    build_window_sums,
)
from symid.identification.elastic.options import NlpOptions
from symid.identification.hysteresis import filter_smooth
from symid.joint_models.hysteresis import Elasticity
from symid.joint_models.prandtl_ishlinskii import compute_stop_basis

KNEES = ((-0.8, 1), (-0.3, 0), (0.25, 2), (0.8, 1))
WEIGHTS = np.array([0.6, 0.4, 0.5])


TIME = np.linspace(0.0, 9.0, 400)
BASIS = compute_stop_basis(np.sin(3.0 * TIME) * np.cos(0.7 * TIME), np.array([0.1, 0.4]))


def find(weights):
    return build_knee_steps(BASIS, weights, KNEES)


def test_means_are_those_of_the_dead_zones_along_each_step():
    torque = BASIS @ WEIGHTS
    fine = torque[:-1, None] + np.diff(torque)[:, None] * ((np.arange(2000) + 0.5) / 2000.0)
    expected = np.zeros((len(fine), 3))
    for knee, slot in KNEES:
        zone = np.maximum(fine - knee, 0.0) if knee > 0 else np.minimum(fine - knee, 0.0)
        expected[:, slot] += zone.mean(axis=1)
    np.testing.assert_allclose(find(WEIGHTS).means, expected, atol=1e-8)
    assert sum(len(steps) for _, steps, *_ in find(WEIGHTS).crossings) > 20
    # A spring without knees has no steps.
    steps = build_knee_steps(BASIS, WEIGHTS, ())
    assert steps.means.shape == (399, 0)
    assert not steps.compute_slopes(np.zeros(0)).any()


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_one_crossing_by_hand(side):
    basis = side * np.array([[-1.0], [3.0]])
    found = build_knee_steps(basis, np.ones(1), ((side * 1.0, 0),))
    # Half of the step lies beyond the knee and reaches 2: the mean is 2 * 0.5 / 2.
    assert found.means[0] == pytest.approx([side * 0.5])
    ((_, _, place, bend),) = found.crossings
    assert (place[0], bend[0]) == (pytest.approx(0.5), pytest.approx(side * 0.25))
    assert (found.starts[0, 0], found.ends[0, 0]) == (pytest.approx(0.125), pytest.approx(0.375))


RATE, PERIOD, COUNT = 60.0, 1e-3, 997


def check_adjoint(sums, rng):
    steps, rows = rng.normal(size=COUNT), rng.normal(size=len(sums.add(np.zeros(COUNT))))
    assert sums.add(steps) @ rows == pytest.approx(steps @ sums.spread(rows), rel=1e-12)


def test_the_filter_is_that_of_held_signals_and_spreads_as_its_adjoint():
    rng, kept = np.random.default_rng(0), slice(130, None, 7)
    steps = rng.normal(size=(COUNT, 3))
    sums = build_filter_sums(kept, COUNT, float(np.exp(-RATE * PERIOD)))
    whole = filter_smooth(np.vstack([steps, steps[-1:]]), RATE, PERIOD, held=True)
    np.testing.assert_allclose(sums.add(steps), whole[kept], rtol=1e-12, atol=1e-14)
    check_adjoint(sums, rng)


def test_windows_are_weighted_sums_and_spread_as_their_adjoint():
    rng, ends = np.random.default_rng(1), slice(40, 40 + 30 * 31 + 1, 31)
    weights, steps = rng.normal(size=COUNT), rng.normal(size=(COUNT, 2))
    sums = build_window_sums(ends, weights)
    expected = [weights[k : k + 31] @ steps[k : k + 31] for k in range(40, 40 + 30 * 31, 31)]
    np.testing.assert_allclose(sums.add(steps), expected, rtol=1e-12)
    check_adjoint(sums, rng)
    counted = np.arange(30) % 3 > 0
    np.testing.assert_allclose(sums.mask(counted).add(steps), sums.add(steps) * counted[:, None], rtol=1e-12)


def name(*names):
    return tuple(SimpleNamespace(name=entry) for entry in names)


CARD = SimpleNamespace(
    beta=name("ZZ1"),
    rotors=name("IA1"),
    friction=name("Fv1", "Fc1", "offset1"),
    size=1,
    joints=(SimpleNamespace(name="a", number=1, kind="revolute"),),
    yielding=(True,),
)
GRID = SpringGrid(
    thresholds=np.array([0.01, 0.02, 0.05]), knees=(-3.0, -1.0, 1.0, 2.0), stiffness=100.0, reach=0.04
)

LAYOUT = NlpLayout.build(CARD, [GRID], NlpOptions())


def test_names_bounds_and_places():
    layout = NlpLayout.build(CARD, [GRID], NlpOptions(stribeck=True, speeds=(0.01, 1.0)))
    assert layout.names[:7] == ("ZZ1", "IA1", "Fv1", "Fc1", "offset1", "Fs1", "vs1")
    assert layout.names[7:11] == ("k0 of joint 1", "k1 of joint 1", "k2 of joint 1", "k3 of joint 1")
    assert layout.names[11:13] == ("slope beyond -1 of joint 1", "slope beyond -3 of joint 1")
    np.testing.assert_array_equal(layout.lower[:7], [-np.inf, 0, 0, 0, -np.inf, 0, 0.01])
    np.testing.assert_allclose(layout.lower[7:], [0.1, 0, 0, 0, *[0.05] * 4])
    # The last stop is beyond the largest torsion: it cannot be told from k0, and has no weight.
    np.testing.assert_allclose(layout.upper[7:], [np.inf, np.inf, np.inf, 0, *[20.0] * 4])
    assert layout.size == 15


@pytest.mark.parametrize("trace", [1e-163, 1e-150, 1e-30])
def test_what_filters_leave_of_a_constant_is_no_information(trace):
    rng = np.random.default_rng(0)
    moving, still = (scale * rng.normal(size=(200, 5)) for scale in (1.0, trace))
    chi = np.arange(1.0, 6.0)
    blocks = tuple(
        RowBlock(matrix=rows, values=rows @ chi + 0.01 * scale * rng.normal(size=200), sign=-1.0, springs=())
        for rows, scale in ((moving, 1.0), (still, trace))
    )
    torsion = np.zeros((200, 1))
    one = NlpRecording(blocks=blocks[:1], bases=(np.zeros((200, 4)),), phi=torsion, speed=torsion)
    x, found = LAYOUT.build_start(chi, [Elasticity(stiffness=100.0)]), []
    for part in (one, replace(one, blocks=blocks)):
        cost = ElasticNlpCost(recordings=(part,), layout=LAYOUT, smoothing=0.0)
        cost = cost.weigh([block.values - block.matrix @ chi for block in cost.blocks], chi)
        found.append((cost.sigmas[0], *cost.invert_normal_equations(x)))
    for alone, both in zip(*found, strict=True):
        np.testing.assert_allclose(both, alone, rtol=1e-12, atol=0.0)
