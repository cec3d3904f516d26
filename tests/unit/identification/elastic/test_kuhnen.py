"""Kuhnen's convex identification: known springs come back, and another solver finds the same optimum."""

import casadi
import numpy as np
import pytest

from symid.errors import UsageError
from symid.identification.hysteresis.prandtl_ishlinskii_fit import fit_kuhnen
from symid.joint_models.hysteresis import Elasticity, Knee, Stop
from symid.joint_models.prandtl_ishlinskii import compute_hysteresis_torque, compute_plays

SPRING = Elasticity(
    stiffness=0.9,
    stops=(Stop(threshold=0.2, stiffness=0.5), Stop(threshold=0.6, stiffness=0.3)),
    knees=(
        Knee(threshold=-1.1, slope=0.6),
        Knee(threshold=-0.5, slope=-0.3),
        Knee(threshold=0.4, slope=0.5),
        Knee(threshold=0.9, slope=0.4),
    ),
)


def run(spring, *, noise=0.0):
    """Return torsion and torque of a decaying sweep with reversals at many places."""
    t = np.linspace(0.0, 30.0, 6001)
    torsion = 1.5 * (1.0 - 0.8 * t / 30.0) * np.sin(2.0 * t) * np.minimum(1.0, t)
    torque = compute_hysteresis_torque(spring, torsion)
    return torsion, torque + noise * np.random.default_rng(3).normal(size=t.size)


def place_knees(spring):
    """Return the torques behind the knees: S at the knees, from zero outwards."""
    torques = []
    for side in (-1.0, 1.0):
        slope, torque, last = 1.0, 0.0, 0.0
        for knee in sorted(
            (k for k in spring.knees if k.threshold * side > 0), key=lambda k: side * k.threshold
        ):
            torque += slope * (knee.threshold - last)
            last, slope = knee.threshold, slope + knee.slope
            torques.append(torque)
    return sorted(torques)


def list_weights(spring):
    return [spring.stiffness, *(stop.stiffness for stop in spring.stops)]


@pytest.mark.parametrize(("noise", "error"), [(0.0, 1e-12), (1e-4, 1e-4)])
@pytest.mark.parametrize("passive", [True, False])
def test_the_weights_come_back(noise, error, passive):
    torsion, torque = run(SPRING, noise=noise)
    fit = fit_kuhnen(torsion, torque, [0.2, 0.6], place_knees(SPRING), passive=passive)
    np.testing.assert_allclose(list_weights(fit.elasticity), list_weights(SPRING), atol=error)
    for found, true in zip(fit.elasticity.knees, SPRING.knees, strict=True):
        assert found.threshold == pytest.approx(true.threshold, abs=error)
        # A slope is seen over a part of the record only.
        assert found.slope == pytest.approx(true.slope, abs=5.0 * error)
    assert fit.residual <= 2.0 * noise + 1e-12
    assert fit.active == ()


def test_weights_of_both_signs_come_back_where_passive_ones_cannot():
    spring = Elasticity(
        stiffness=1.0, stops=(Stop(threshold=0.2, stiffness=0.5), Stop(threshold=0.6, stiffness=-0.3))
    )
    torsion, torque = run(spring)
    fit = fit_kuhnen(torsion, torque, [0.2, 0.6], passive=False)
    np.testing.assert_allclose(list_weights(fit.elasticity), [1.0, 0.5, -0.3], atol=1e-12)
    bound = fit_kuhnen(torsion, torque, [0.2, 0.6])
    assert bound.active == ("stop at 0.6",)
    assert bound.residual > 1e-3
    assert [stop.threshold for stop in bound.elasticity.stops] == [0.2]


def test_another_solver_finds_the_same_optimum_in_the_weights_of_the_plays():
    """The problem as Kuhnen writes it: weights of plays and dead zones, sums bounded, w'_0 = 1."""
    torsion, torque = run(SPRING, noise=0.3)
    radii, knees, least = [0.2, 0.6], [-1.0, 0.7], 1e-3
    fit = fit_kuhnen(torsion, torque, radii, knees, passive=False, least=least)
    plays = np.column_stack([torsion, compute_plays(torsion, np.array(radii))])
    zones = np.column_stack([np.minimum(torque - knees[0], 0.0), np.maximum(torque - knees[1], 0.0)])
    matrix = np.hstack([plays, -zones])
    whole = np.abs(torque).max() / np.abs(torsion).max()
    sums = np.zeros((5, 5))
    sums[:3, :3] = np.tril(np.ones((3, 3)))
    sums[3, 3] = sums[4, 4] = 1.0
    low = np.array([least * whole] * 3 + [least - 1.0] * 2)
    problem = {"h": casadi.DM(matrix.T @ matrix).sparsity(), "a": casadi.DM(sums).sparsity()}
    solver = casadi.conic("qp", "qrqp", problem, {"print_iter": False, "print_header": False})
    answer = solver(h=matrix.T @ matrix, g=-matrix.T @ torque, a=sums, lba=low, uba=np.inf)
    w = np.asarray(answer["x"]).ravel()
    stops = [w[:3].sum(), -w[1], -w[2]]
    np.testing.assert_allclose(list_weights(fit.elasticity), stops, rtol=1e-6, atol=1e-7)
    changes = [knee.slope for knee in fit.elasticity.knees]
    np.testing.assert_allclose(changes, 1.0 / (1.0 + w[3:]) - 1.0, rtol=1e-6)


def test_what_is_no_grid_and_what_the_record_does_not_show_is_refused():
    torsion, torque = run(SPRING)
    with pytest.raises(UsageError) as refused:
        fit_kuhnen(torsion, torque, [0.6, 0.2], [0.0])
    assert [notice.code for notice in refused.value.notices] == ["usage.kuhnen-grid"] * 2
    assert [notice.text.split(":")[0] for notice in refused.value.notices] == [
        "thresholds [0.6, 0.2]",
        "knees [0.0]",
    ]
    nan = np.append(torsion, np.nan), np.append(torque, 0.0)
    for record, radii, knees, start in (
        ((torsion, torque), [0.2, 1.6], [], r"thresholds \[0.2, 1.6\]:.* 1.40589;"),
        ((torsion, torque), [0.2], [9.0], r"knees \[9.0\]:"),
        ((torsion, torque), [0.2], [-0.01, 0.5], r"knees \[-0.01\]: .* 3%"),
        ((torsion[:2], torque[:2]), [0.2, 0.6], [], r"torsion \(2,\) .* 3 "),
        (nan, [0.2], [], "torsion and torque: .* finite"),
    ):
        with pytest.raises(UsageError, match=f"^{start}") as refused:
            fit_kuhnen(*record, radii, knees)
        assert [notice.code for notice in refused.value.notices] == ["usage.kuhnen-grid"]
