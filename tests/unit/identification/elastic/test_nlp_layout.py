"""Unknowns of the hysteresis-plus-friction problem, and the scales of its rows."""

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
    list_weights,
)
from symid.identification.elastic.options import NlpOptions
from symid.joint_models.hysteresis import Elasticity, Knee, Stop


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
    np.testing.assert_allclose(layout.upper[7:], [1e4, 1e4, 1e4, 0, *[20.0] * 4])
    assert layout.size == 15
    # A joint whose file states no rotor has one nevertheless.
    layout = NlpLayout.build(SimpleNamespace(**{**vars(CARD), "rotors": ()}), [GRID], NlpOptions())
    assert layout.names == LAYOUT.names
    assert len(layout.lower) == len(layout.upper) == layout.size
    assert layout.lower[1] == 0.0


def test_slopes_become_changes_of_slope():
    (place,) = LAYOUT.springs
    x = np.zeros(LAYOUT.size)
    x[place.weights], x[place.slopes] = [80.0, 20.0, 1e-12, 0.0], [1.5, 1.25, 2.0, 2.0]
    spring = place.build_spring(x, 1e-9)
    assert spring.stops == (Stop(threshold=0.01, stiffness=20.0),)
    assert [(knee.threshold, knee.slope) for knee in spring.knees] == [(-3.0, -0.25), (-1.0, 0.5), (1.0, 1.0)]
    # A knee that is not reached changes nothing.
    x[place.slopes] = [1.5, 9.0, 7.0, 8.0]
    flat = LAYOUT.flatten_slopes(x, [LAYOUT.names[place.slopes.start + k] for k in (1, 2, 3)])
    np.testing.assert_array_equal(flat[place.slopes], [1.5, 1.5, 1.0, 1.0])


def test_odd_springs_share_their_slopes():
    grid = SpringGrid(thresholds=np.array([0.01]), knees=(-2.0, -1.0, 1.0, 2.0), stiffness=100.0, reach=0.04)
    layout = NlpLayout.build(CARD, [grid], NlpOptions(odd=True))
    assert layout.names[-2:] == ("slope beyond +-1 of joint 1", "slope beyond +-2 of joint 1")
    (place,), x = layout.springs, np.zeros(layout.size)
    x[place.weights], x[place.slopes] = [80.0, 20.0], [1.5, 2.5]
    knees = [(knee.threshold, knee.slope) for knee in place.build_spring(x, 0.0).knees]
    assert knees == [(-2, 1.0), (-1, 0.5), (1, 0.5), (2, 1.0)]


def test_a_start_is_the_spring_itself_or_shares_of_a_linear_one():
    knees = tuple(Knee(threshold=place, slope=slope) for place, slope in ((-1, 0.5), (1, 1.0), (2, 0.5)))
    spring = Elasticity(stiffness=70.0, stops=(Stop(threshold=0.02, stiffness=30.0),), knees=knees)
    x = LAYOUT.build_start(np.arange(5.0), [spring])
    np.testing.assert_array_equal(x[LAYOUT.springs[0].weights], [70.0, 0.0, 30.0, 0.0])
    np.testing.assert_array_equal(x[LAYOUT.springs[0].slopes], [1.5, 1.5, 2.0, 2.5])
    linear = list_weights(Elasticity(stiffness=100.0), GRID.thresholds)
    assert linear.sum() == pytest.approx(100.0)
    assert np.all(linear > 0.0)


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
        cost = ElasticNlpCost(recordings=(part,), layout=LAYOUT)
        cost = cost.weigh([block.values - block.matrix @ chi for block in cost.blocks], chi)
        found.append((cost.sigmas[0], *cost.invert_normal_equations(x)))
    for alone, both in zip(*found, strict=True):
        np.testing.assert_allclose(both, alone, rtol=1e-12, atol=0.0)
