"""How sure results of elastic joints are said to be, and which rows near rest they are made of."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import binom

from symid.identification.elastic.elimination import (
    SHARES,
    BandRows,
    choose_sliding_rows,
    fit_band,
    measure_torque_noise,
)
from symid.identification.elastic.estimate import (
    MODEL_ERROR,
    MethodFit,
    measure_spring_spread,
)
from symid.identification.elastic.methods import (
    MethodCandidate,
    _widen,
    assign_parts,
    choose_candidate,
    find_contradiction,
)
from symid.identification.elastic.regression import build_spring_basis
from symid.identification.hysteresis import list_spring_numbers, move_spring
from symid.identification.judge import POLICY
from symid.joint_models import BoucWen, Elasticity, Knee, Stop, run_element
from symid.logs import Recording, low_pass

PERIOD = 1e-3
SIGMA = np.array([0.01, 0.02, 0.05])


def build_work():
    """Two base parameters and a rotor of one joint, identified without springs as 2, 1 and 0.5."""
    rows = BandRows(
        design=np.eye(3),
        torque=np.array([2.0, 1.0, 0.5]),
        group=np.zeros(3, dtype=np.intp),
        time=np.linspace(0.0, 1.0, 3),
        slide=np.zeros(3, dtype=np.intp),
    )
    beta = [SimpleNamespace(joint="a", unit="kg m")] * 2
    card = SimpleNamespace(beta=beta, joints=[SimpleNamespace(name="a")])
    return SimpleNamespace(
        rows=rows,
        band=SimpleNamespace(chi=np.array([2.0, 1.0, 0.5]), covariance=np.diag(SIGMA**2)),
        identifiable=np.ones(3, dtype=bool),
        problem=SimpleNamespace(sizes=(2, 1), library=SimpleNamespace(card=card), known=np.full(3, np.nan)),
    )


def build_fit(chi, covariance):
    chi = np.asarray(chi)
    return MethodFit(
        method="nlp", beta=chi[:2], rotor=chi[2:], friction=np.zeros(0), covariance=np.asarray(covariance)
    )


def test_noise_is_that_which_the_band_of_the_rows_lets_through():
    # A band of 20 Hz; the oracle is the filter itself.
    rng = np.random.default_rng(5)
    time = np.arange(60000) * PERIOD
    noise = np.array([0.3, 2.0]) * rng.standard_normal((len(time), 2))
    motion = 50.0 * np.sin(2.0 * np.pi * np.array([0.7, 3.1]) * time[:, None])
    resonance = 0.5 * np.sin(2.0 * np.pi * 90.0 * time)[:, None]
    # Friction changes its sign with the motion: its harmonics reach far above the band.
    friction = 5.0 * np.sign(np.cos(2.0 * np.pi * 3.1 * time))[:, None]
    tau = motion + resonance + friction + noise
    found = measure_torque_noise([Recording(time=time, position=np.zeros_like(tau), torque=tau)], 0.0)
    expected = np.std(low_pass(noise, period=PERIOD, cutoff=20.0, order=4), axis=0)
    assert found == pytest.approx(expected, rel=0.15)


def test_deviations_grow_with_the_distance_from_what_needs_no_springs():
    work, raw = build_work(), np.diag([1e-6, 4e-6, 9e-6])
    near = build_fit([2.001, 1.0, 0.5], raw)
    assert np.array_equal(_widen(work, near).covariance, raw)
    # Three deviations in every parameter: chi^2 = 27, nine a parameter.
    together = np.sqrt(SIGMA**2 + np.diag(raw))
    far = build_fit(np.array([2.0, 1.0, 0.5]) + 3.0 * together, raw)
    wide = _widen(work, far)
    assert wide.covariance == pytest.approx(9.0 * raw)
    # Deviations that a contradiction widened do not make it less of one.
    assert find_contradiction(work, wide) == find_contradiction(work, far)


def test_a_fit_that_says_how_far_it_may_be_off_contradicts_nothing():
    work = build_work()
    fit = build_fit(np.array([2.0, 1.0, 0.5]) + 6.0 * SIGMA, np.diag((6.0 * SIGMA) ** 2))
    assert find_contradiction(work, fit)[0] == ""
    assert np.array_equal(_widen(work, fit).covariance, fit.covariance)
    # What a fit does not identify cannot contradict.
    blind = build_fit([9.0, 1.0, 0.5], np.diag([np.inf, 1e-6, 1e-6]))
    assert find_contradiction(work, blind)[0] == ""
    # Nor what is no matter: a two-thousandth is far beyond these deviations.
    small = 1e-12 * np.eye(3)
    work.band = SimpleNamespace(chi=work.band.chi, covariance=small)
    assert find_contradiction(work, build_fit([2.001, 1.0, 0.5], small))[0] == ""
    text, ratio = find_contradiction(work, build_fit([2.1, 1.0, 0.5], small))
    assert "contradict" in text
    # A twentieth of what is 2, over a fiftieth.
    assert ratio == pytest.approx(2.5, rel=1e-3)


def test_a_biased_method_is_not_taken_and_among_equals_the_surest_is():
    """However sure the biased one says it is; each fold is predicted by a fit without it."""
    rng, truth = np.random.default_rng(3), np.array([2.0, -1.0])
    design, time = rng.normal(size=(4000, 2)), np.tile(np.arange(2000) / 2000.0, 2)
    rows = BandRows(
        design=design,
        torque=design @ truth + 0.5 * rng.normal(size=4000),
        group=np.repeat([0, 1], 2000),
        time=time,
        slide=np.zeros(4000, dtype=np.intp),
    )

    def choose(*fits):
        asked = []
        candidates = [
            MethodCandidate(lambda fold, chi=chi: asked.append(fold) or np.array(chi), spread)
            for chi, spread in fits
        ]
        found = choose_candidate(candidates, rows, np.array([0.5, 0.5]))
        assert asked == [*range(POLICY.folds)] * len(fits)
        return found

    best, errors, close = choose(([2.2, -1.0], 1e-6), (truth, 0.1))
    assert (best, close) == (1, 1)
    assert errors[1] == pytest.approx(1.0, abs=0.1)
    assert errors[0] - errors[1] == pytest.approx(0.04 / 0.25, rel=0.3)
    best, _, close = choose((truth, 0.1), (truth + 1e-3, 0.01))
    assert (best, close) == (1, 2)
    assert np.ptp(np.bincount(assign_parts(time, POLICY.folds), minlength=POLICY.folds)) <= 2


SLIDER = SimpleNamespace(beta=("a", "v", "s", "g"), size=0, friction=())
FRICTION = np.array([2.0, 1.0, 0.5, 3.0])
COUNT = 400


def build_rows(levels, seed, stick=0.0):
    """Rows of a joint in recordings of these RMS speeds, tau = 2 ddq + dq + 0.5 sign dq + 3 sin q + noise."""
    rng = np.random.default_rng(seed)
    designs, speeds, torques = [], [], []
    for level in levels:
        phase = np.linspace(0.0, 40.0 * np.pi, COUNT)
        speed = level * np.sqrt(2.0) * np.cos(phase + rng.uniform(0.0, 6.0))
        place, bend = np.sin(1.0 + 0.1 * np.cumsum(speed)), -3.0 * level * np.sqrt(2.0) * np.sin(phase)
        designs.append(np.column_stack([bend, speed, np.sign(speed), place]))
        rest = stick * np.sign(speed) * np.exp(-((speed / 0.2) ** 2))
        torques.append(designs[-1] @ FRICTION + rest + 0.1 * rng.standard_normal(COUNT))
        speeds.append(speed)
    speed = np.concatenate(speeds)
    rms = np.sqrt(np.mean(speed**2))
    return BandRows(
        design=np.concatenate(designs),
        torque=np.concatenate(torques),
        group=np.repeat(np.arange(len(levels)), COUNT),
        time=np.tile(np.linspace(0.0, 1.0, COUNT), len(levels)),
        slide=sum((np.abs(speed) > share * rms).astype(np.intp) for share in SHARES),
    )


@pytest.mark.parametrize("levels", [(1.0,), (1.0, 1.0), (0.3, 1.0), (1.0, 0.3), (0.1, 1.0), (0.3, 1.0, 1.0)])
def test_rows_of_a_slow_recording_stay_where_friction_is_that_of_the_file(levels):
    shares = [choose_sliding_rows(SLIDER, build_rows(levels, seed))[1] for seed in range(40)]
    # The rate of false alarms is the stated one at most.
    assert np.count_nonzero(shares) <= binom.ppf(0.99, len(shares), POLICY.caution), shares


@pytest.mark.parametrize("levels", [(1.0,), (0.5, 1.0), (1.0, 0.5)])
def test_rows_near_rest_go_where_friction_there_is_another(levels):
    rows, share = choose_sliding_rows(SLIDER, build_rows(levels, 3, stick=1.0))
    # At 0.3 rad/s a tenth of it is left, which many rows still show in noise as large.
    assert 0.1 <= share <= SHARES[-1]
    assert rows.slide.min() == 1 + SHARES.index(share)


@pytest.mark.parametrize("held", [0.05, -0.08, 0.12])
def test_what_a_motor_at_rest_holds_by_friction_is_no_number(held):
    """At rest any friction is there: with it the load is wrong by `held`, without it as right as before."""
    moving = build_rows((1.0, 1.0), 5)
    design = np.zeros((COUNT, len(FRICTION)))
    design[:, 3] = np.sin(np.linspace(0.7, 0.701, COUNT))
    # The load at one pose takes all of it up, and the little that is left would make these rows count most.
    rest = BandRows(
        design=design,
        torque=design @ FRICTION + held + 1e-3 * np.random.default_rng(6).standard_normal(COUNT),
        group=np.full(COUNT, 2),
        time=np.linspace(0.0, 1.0, COUNT),
        slide=np.zeros(COUNT, dtype=np.intp),
    )
    both = BandRows(*(np.concatenate(pair) for pair in zip(moving, rest, strict=True)))
    rows, share = choose_sliding_rows(SLIDER, both)
    assert share == 0.0
    assert set(rows.group.tolist()) == {0, 1}
    found = fit_band(SLIDER, rows)
    assert np.all(np.abs(found.chi - FRICTION) < 4.0 * np.sqrt(np.diag(found.covariance)))
    whole = fit_band(SLIDER, both)
    assert abs(whole.chi[3] - FRICTION[3]) > 10.0 * np.sqrt(whole.covariance[3, 3])
    # A load that nothing else shows keeps its rows.
    blind = moving._replace(design=moving.design * np.array([1.0, 1.0, 1.0, 0.0]))
    both = BandRows(*(np.concatenate(pair) for pair in zip(blind, rest, strict=True)))
    assert set(choose_sliding_rows(SLIDER, both)[0].group.tolist()) == {0, 1, 2}


@pytest.mark.parametrize("stiffer", [0.1, 0.35, -0.4])
def test_a_spring_of_many_stops_has_two_sides(stiffer):
    """So that a spring that is stiffer on one side is no wave of an encoder."""
    torque = 400.0 * PHI * np.where(PHI > 0.0, 1.0 + stiffer, 1.0)
    basis = build_spring_basis(PHI, slice(None), TIME[1] - TIME[0])
    left = torque - basis @ np.linalg.lstsq(basis, torque, rcond=None)[0]
    assert np.linalg.norm(left) < 1e-9 * np.linalg.norm(torque)


TIME = np.linspace(0.0, 12.0, 1200)
PHI = 0.01 * (np.sin(2.0 * np.pi * 0.5 * TIME) + 0.6 * np.sin(2.0 * np.pi * 1.3 * TIME + 1.0))
LEVER = np.cos(0.9 * TIME)


def follow(spring):
    return run_element(spring, PHI, TIME).output


def measure_spread(spring, variance):
    """Return the spread of a spring's torque and slope; `variance` of the only parameter of the links."""
    zero = [np.zeros(len(PHI))]
    return measure_spring_spread(
        spring,
        lambda moved: [follow(moved)],
        [PHI[:, None]],
        zero,
        np.array([[variance]]),
        shown=np.array([[variance]]),
    )


def test_deviations_of_torque_and_slope_are_those_of_many_fits():
    # The torque of the links is the spring's; a parameter of theirs is known to 0.02, and noise is white.
    truth = Elasticity(stiffness=400.0, stops=(Stop(threshold=0.004, stiffness=150.0),))
    basis = np.stack(
        [PHI, follow(Elasticity(stiffness=1e-9, stops=(Stop(threshold=0.004, stiffness=1.0),)))], axis=1
    )
    rng = np.random.default_rng(2)
    draws = []
    for _ in range(2000):
        torque = basis @ [400.0, 150.0] + 0.02 * rng.standard_normal() * LEVER
        torque = torque + 0.1 * rng.standard_normal(len(TIME))
        draws.append(np.linalg.lstsq(basis, torque, rcond=None)[0])
    cases = np.cov(np.array(draws).T)
    slope = np.sqrt(np.sum(cases))
    torque = np.sqrt(np.mean(np.einsum("ij,jk,ik->i", basis, cases, basis)))
    errors, spread = 0.1 * rng.standard_normal(len(TIME)), np.array([[0.02**2]])
    # The threshold counts as well, so that the deviations are somewhat larger than with a known one.
    found = measure_spring_spread(
        truth, lambda spring: [follow(spring)], [LEVER[:, None]], [errors], spread, shown=spread
    )
    # A constant is a zero of an encoder, not of the spring.
    assert found == pytest.approx(
        measure_spring_spread(
            truth, lambda spring: [follow(spring)], [LEVER[:, None]], [errors + 0.5], spread, shown=spread
        )
    )
    assert torque < found[0] < 1.8 * torque
    assert 0.8 * slope < found[1] < 2.5 * slope
    # What follows the motion, and no value of the spring explains, is an error of its torque, too.
    lacking = 0.3 * np.cos(1.7 * TIME)
    more = measure_spring_spread(
        truth,
        lambda spring: [follow(spring)],
        [LEVER[:, None]],
        [errors + lacking],
        spread,
        shown=spread,
    )
    assert 0.6 * np.std(lacking) < more[0] < 1.5 * np.std(lacking)


@pytest.mark.parametrize("more", [0.0, 1e-4, 4.0])
def test_what_no_row_shows_of_the_links_is_of_the_slope_alone(more):
    """Columns that are off move parameters and stiffness, and hardly the torque, which was measured."""
    spring, zero = Elasticity(stiffness=500.0), [np.zeros(len(PHI))]
    found = measure_spring_spread(
        spring,
        lambda moved: [follow(moved)],
        [PHI[:, None]],
        zero,
        np.array([[1.0 + more]]),
        shown=np.array([[1.0]]),
    )
    size = np.sqrt(np.mean(PHI**2))
    slope = np.hypot(np.sqrt(1.0 + more), 500.0 * MODEL_ERROR)
    assert found == pytest.approx((size * np.hypot(1.0, 250.0 * MODEL_ERROR), slope))


@pytest.mark.parametrize(("torque", "added"), [(0.1, 0.008), (2.0, 0.0)])
def test_a_knee_near_zero_makes_the_slope_there_uncertain(torque, added):
    # tau = beta phi is followed by k phi: k has the relative deviation of beta, exactly; filtered reversals
    # add the part of the slope that no row shows.
    found = measure_spread(Elasticity(stiffness=500.0), 9.0)
    size = np.sqrt(np.mean(PHI**2)) * np.hypot(3.0, 250.0 * MODEL_ERROR)
    assert found == pytest.approx((size, np.hypot(3.0, 500.0 * MODEL_ERROR)))
    # The largest torque is 7.2 N m. Such knees are what noise makes of a stiffer beginning.
    knees = tuple(Knee(threshold=side * torque, slope=-0.008) for side in (-1.0, 1.0))
    found = measure_spread(Elasticity(stiffness=500.0, knees=knees), 0.0)
    assert found[1] == pytest.approx(500.0 * np.hypot(MODEL_ERROR, added), rel=1e-6)


def test_every_number_of_a_spring_moves_by_itself():
    spring = Elasticity(
        stiffness=300.0,
        cubic=2.0,
        damping=1.0,
        stops=(Stop(threshold=0.1, stiffness=50.0),),
        branches=(BoucWen(level=2.0, length=0.01, skew=0.2),),
    )
    numbers = list_spring_numbers(spring)
    assert [value for value, _ in numbers] == [300.0, 2.0, 1.0, 0.1, 50.0, 2.0, 0.01, 1.0, 0.5, 0.2]
    assert all(move_spring(spring, place, value) == spring for value, place in numbers)
    assert len({move_spring(spring, place, 1.01 * value) for value, place in numbers}) == len(numbers)
    knees = Elasticity(stiffness=300.0, knees=(Knee(threshold=2.0, slope=0.5),))
    assert [value for value, _ in list_spring_numbers(knees)] == [300.0, 2.0, 0.5]


def test_numbers_at_the_edge_of_what_springs_can_be_move_to_one_side():
    # Beyond its knee the slope is 1e-5, less than a step of the knee's change: only upwards is a spring left.
    edge, free = (
        measure_spread(Elasticity(stiffness=300.0, knees=(Knee(threshold=2.0, slope=slope),)), 9.0)
        for slope in (-0.99999, -0.9)
    )
    assert edge == pytest.approx(free, rel=0.2)
    assert edge[1] > 0.0
