"""Dynamics and hysteresis identified apart: the procedures that the two-step method is compared with.

ElasticProblem -> ElasticFit. A reconstruction of published procedures from what is known of them, no copy.

First the dynamics: filtered motor and link equations in base parameters, plain least squares, on motions of
all joints together. Then each joint's hysteresis, on slow motions of that joint alone: its torque from the
motor equation with the friction found before, its torsion by one of two ways.

    motor side     phi = theta - q, q from the link equation with the base parameters found before:
                   phi <- phi + G' (G G' + mu 1)^-1 (link(theta - phi) - tau_J),  G = d gravity / dq
    link encoder   phi = theta - q, both measured

On the motor side gravity tells the torsion only through its gradient G; where that is small the fixed point
keeps the torsion of the linear spring that fits best elsewhere.

Supported: recordings of both kinds, told apart by which joints move; one kind only, which then serves both.
Not supported: joints without gravity on the motor side.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from symid.arrays import FloatArray
from symid.data.filters import differentiate, low_pass
from symid.elastic.consistency import solve_consistent
from symid.elastic.elimination import find_elimination_rows
from symid.elastic.filtered import filter_smooth
from symid.elastic.fit import ElasticFit
from symid.elastic.hysteresis import fit_spring_of
from symid.elastic.problem import ElasticProblem, build_fit, find_threshold_grid
from symid.elastic.signals import ElasticSignals
from symid.elastic.spring_fit import SpringData, prepare_spring_data
from symid.elastic.spring_weights import build_elasticity
from symid.errors import Notice

__all__ = ["find_virtual_torsion", "fit_independent", "split_recordings"]

_MOVING = 0.1
"""Of the fastest joint's RMS speed; slower joints count as held."""
_DRIVEN = 0.5
"""Of a joint's largest RMS speed over all recordings; slower ones do not serve its hysteresis."""
_ROUNDS = 8
_DAMPING = 0.1
"""mu relative to the largest squared singular value of G."""
_SLOW = 0.5
"""Hz; slow motions are below, the pendulums of arms above."""
_STEEP = 0.5
"""Of the largest |G_jj| at which the torsion of joint j is trusted for its linear spring."""


def split_recordings(signals: Sequence[ElasticSignals]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the recordings in which all joints move, and the others; all twice where a kind is missing."""
    together = []
    for number, part in enumerate(signals):
        speed = np.sqrt(np.mean(part.dtheta**2, axis=0))
        if np.all(speed > _MOVING * speed.max()):
            together.append(number)
    everything = tuple(range(len(signals)))
    apart = tuple(number for number in everything if number not in together)
    return tuple(together) or everything, apart or everything


def fit_independent(problem: ElasticProblem, *, encoder: bool = False) -> ElasticFit:
    """Return the dynamics of the first procedure and the hysteresis of the second.

    Args:
        problem: all recordings.
        encoder: take the torsion from the link encoder too, in place of motor-side samples alone.
    """
    together, apart = split_recordings(problem.signals)
    beta, joints, _ = problem.sizes
    chi = solve_consistent(problem.library.card, *find_elimination_rows(problem, together))
    torsions = {
        number: problem.signals[number].phi if encoder else find_virtual_torsion(problem, number, chi)
        for number in apart
    }
    speeds = {number: np.sqrt(np.mean(problem.signals[number].dtheta ** 2, axis=0)) for number in apart}
    springs = []
    for joint in range(joints):
        most = max(speed[joint] for speed in speeds.values())
        used = [number for number in apart if speeds[number][joint] >= _DRIVEN * most]
        data = _prepare_data(problem, joint, used, torsions)
        target = np.concatenate(
            [problem.filtered[number].find_motor_side(chi[beta:])[:, joint] for number in used]
        )
        springs.append(fit_spring_of(problem.options, data, joint, target))
    fit = build_fit(problem, "independent", chi, tuple(map(build_elasticity, springs)))
    return replace(fit, notices=_say_one_kind(together, apart))


def find_virtual_torsion(problem: ElasticProblem, number: int, chi: FloatArray) -> FloatArray:
    """Return the torsion (N, n) of recording `number` from motor-side samples and chi alone.

    First where gravity's gradient is large; the linear spring that this gives stands in elsewhere.
    """
    signals, rate = problem.signals[number], problem.options.rate
    beta, joints, _ = problem.sizes
    keep = problem.filtered[number].keep
    step = keep.step
    theta = signals.theta[::step]
    period = signals.period * step
    torque = _find_motor_torque(problem, number, chi)[::step]
    gradient = _find_gravity_gradient(problem, theta, chi[:beta])
    root = gradient.transpose(0, 2, 1)
    product = gradient @ root
    damping = _DAMPING * float(np.linalg.norm(gradient, ord=2, axis=(1, 2)).max()) ** 2
    gain = root @ np.linalg.inv(product + damping * np.eye(joints))
    phi = np.zeros_like(theta)
    for prior in (False, True):
        if prior:
            phi = _find_linear_torsion(phi, torque, gradient)
        for _ in range(_ROUNDS):
            link = _find_link_torque(problem, theta - phi, period, rate, chi[:beta])
            # Above a pendulum's frequency inertia outweighs gravity, and the fixed point would run away.
            error = low_pass(link - torque, period=period, cutoff=_SLOW, order=2)
            phi = phi + np.einsum("kij,kj->ki", gain, error)
    grid = np.arange(len(theta)) * step
    full = np.arange(len(signals.time))
    return np.column_stack([np.interp(full, grid, phi[:, joint]) for joint in range(joints)])


def _find_linear_torsion(phi: FloatArray, torque: FloatArray, gradient: FloatArray) -> FloatArray:
    """Return the torsion of the linear springs that fit `phi` best where gravity's gradient is large."""
    result = np.empty_like(phi)
    for joint in range(phi.shape[1]):
        slope = np.abs(gradient[:, joint, joint])
        steep = slope >= _STEEP * slope.max()
        moved = float(torque[steep, joint] @ torque[steep, joint])
        compliance = max(0.0, float(phi[steep, joint] @ torque[steep, joint]) / max(moved, 1e-300))
        result[:, joint] = compliance * torque[:, joint]
    return result


def _find_motor_torque(problem: ElasticProblem, number: int, chi: FloatArray) -> FloatArray:
    """Return F[tau_J] (N, n) by the motor equation at all samples of a recording."""
    signals, rate = problem.signals[number], problem.options.rate
    beta, joints, _ = problem.sizes
    period = signals.period
    speed = signals.dtheta - signals.dtheta[0]
    inertia = rate * (speed - filter_smooth(speed, rate, period)) * chi[beta : beta + joints]
    torque: FloatArray = filter_smooth(_centre(signals), rate, period) - inertia
    if problem.library.card.friction:
        (friction,) = problem.library.evaluate("friction_regressor", signals.dtheta)
        torque -= filter_smooth(friction @ chi[beta + joints :], rate, period)
    return torque


def _centre(signals: ElasticSignals) -> FloatArray:
    """Return the torque about each sample: a held one is the mean of those that meet there."""
    tau = signals.tau
    return tau if signals.hold == "first" else np.vstack([tau[:1], (tau[1:] + tau[:-1]) / 2.0])


def _find_link_torque(
    problem: ElasticProblem, q: FloatArray, period: float, rate: float, beta: FloatArray
) -> FloatArray:
    """Return F[tau_J] (N, n) by the link equation along q."""
    dq = differentiate(q, period)
    (momentum,) = problem.library.evaluate("momentum_regressor", q, dq)
    (lagrange,) = problem.library.evaluate("lagrange_regressor", q, dq)
    inner = momentum @ beta
    inner = inner - inner[0]
    value: FloatArray = rate * (inner - filter_smooth(inner, rate, period)) - filter_smooth(
        lagrange @ beta, rate, period
    )
    return value


def _find_gravity_gradient(problem: ElasticProblem, q: FloatArray, beta: FloatArray) -> FloatArray:
    """Return d g / dq (N, n, n) by central differences of the torque at rest."""
    still, turn = np.zeros_like(q), 1e-4
    columns = []
    for joint in range(q.shape[1]):
        ends = []
        for side in (turn, -turn):
            moved = q.copy()
            moved[:, joint] += side
            (regressor,) = problem.library.evaluate("lagrange_regressor", moved, still)
            ends.append(-regressor @ beta)
        columns.append((ends[0] - ends[1]) / (2.0 * turn))
    return np.stack(columns, axis=2)


def _prepare_data(
    problem: ElasticProblem, joint: int, used: Sequence[int], torsions: dict[int, FloatArray]
) -> SpringData:
    parts = [np.ascontiguousarray(torsions[number][:, joint]) for number in used]
    options = problem.options
    if options.thresholds is not None:
        grid = problem.thresholds[joint]
    else:
        grid = find_threshold_grid(max(float(np.abs(phi).max()) for phi in parts), options.stops)
    return prepare_spring_data(
        parts,
        [problem.filtered[number].keep for number in used],
        grid,
        options.rate,
        [problem.signals[number].period for number in used],
    )


def _say_one_kind(together: tuple[int, ...], apart: tuple[int, ...]) -> tuple[Notice, ...]:
    if set(together) != set(apart):
        return ()
    text = (
        "the independent procedures want motions of all joints together for the dynamics and slow motions of "
        "one joint at a time for the hysteresis; there is one kind only, and it served both"
    )
    return (Notice(code="elastic.one-kind", text=text),)
