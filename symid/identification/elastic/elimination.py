"""Dynamics without the springs: motor and link equations added, so that the joint torque cancels.

    elimination  [Y_link | Y_motor] chi = F[tau]
    momentum     Delta(Yp beta) - int YL beta dt + IA Delta(dtheta) + int Yf f dt = int tau dt
    band         d/dt G[Yp] beta - G[YL] beta + IA d/dt G[dtheta] + G[Yf] f = G[tau],  G a zero-phase low-pass
    independent  dynamics from motions of all joints together; then the hysteresis of each joint from slow
                 motions of that joint alone: its torque from the motor equation, its torsion by the link
                 encoder or, on the motor side,
                 phi <- phi + G' (G G' + mu 1)^-1 (link(theta - phi) - tau_J),  G = d gravity / dq

The hysteresis is fitted afterwards on the joint torque that these dynamics leave. `independent` is a
reconstruction of published procedures, no copy.

Supported: both encoders; friction that is linear in its parameters; recordings of one kind only, which
then serve both steps of `independent`.
Not supported: encoder noise as large as torque noise within the band; the motor side without gravity.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, FrozenArrays
from symid.codegen import Library, ModelCard
from symid.errors import Notice
from symid.identification.elastic.estimate import MethodFit, build_method_fit
from symid.identification.elastic.problem import ElasticProblem, build_spring_data, fit_joint_spring
from symid.identification.elastic.regression import (
    ElasticSignals,
    build_equations,
    build_filtered_rows,
    center_held,
    filter_derivative,
    solve_with_signs,
)
from symid.identification.elastic.uncertainty import compute_covariance
from symid.identification.hysteresis import build_elasticity, filter_smooth
from symid.identification.regression import choose_windows, integrate_windows
from symid.logs import differentiate, low_pass


def fit_elimination(problem: ElasticProblem) -> MethodFit:
    """Return dynamics by elimination of the joint torque, and the springs that it then shows."""
    chi = solve_with_signs(problem.library.card, *problem.stack_filtered())
    springs = problem.fit_springs(problem.compute_motor_side(chi))
    return build_method_fit("elimination", chi, problem.sizes, springs)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BandRows(FrozenArrays):
    """Equations design @ chi = torque of all recordings.

    Args:
        design: (m, p + n + pf); torque: (m,) N m or N.
        group: (m,) which recording and joint; joints of one recording stand together.
        time: (m,) s since the start of the recording, as a part of its length.
    """

    design: FloatArray
    torque: FloatArray
    group: NDArray[np.intp]
    time: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BandFit:
    """chi (p + n + pf,) with its covariance, and the scatter of every group, N m or N.

    Parameters that the rows do not identify have infinite variances.
    """

    chi: FloatArray
    covariance: FloatArray
    scatter: FloatArray


def fit_band(card: ModelCard, rows: BandRows, rounds: int = 3) -> BandFit:
    """Return the weighted least-squares fit, weights 1 / scatter of each group, found in a few rounds."""
    design, torque, group = rows.design, rows.torque, rows.group
    floor = 1e-9 * max(float(np.sqrt(np.mean(torque**2))), 1e-300)
    weights = np.ones(len(torque))
    for _ in range(rounds):
        chi = solve_with_signs(card, design * weights[:, None], torque * weights)
        errors = torque - design @ chi
        members = np.maximum(np.bincount(group), 1)
        scatter = np.maximum(np.sqrt(np.bincount(group, errors**2) / members), floor)
        weights = 1.0 / scatter[group]
    return BandFit(chi=chi, covariance=compute_covariance(design * weights[:, None]), scatter=scatter)


def fit_momentum(problem: ElasticProblem) -> MethodFit:
    """Return dynamics from momenta, and the springs that remain; raise UsageError if windows do not fit."""
    length = problem.options.window
    parts = [_integrate_equations(problem.library, signals, length) for signals in problem.signals]
    design, impulse = (np.concatenate(part) for part in zip(*parts, strict=True))
    rows = BandRows(
        design=design.reshape(-1, design.shape[2]),
        torque=impulse.reshape(-1),
        group=np.tile(np.arange(impulse.shape[1]), len(impulse)),
        time=np.zeros(impulse.size),
    )
    chi = fit_band(problem.library.card, rows, rounds=2).chi
    springs = problem.fit_springs(problem.compute_motor_side(chi))
    return build_method_fit("momentum", chi, problem.sizes, springs)


def _integrate_equations(
    library: Library, signals: ElasticSignals, length: float
) -> tuple[FloatArray, FloatArray]:
    """Return design (m, n, p + n + pf) and impulses (m, n) in N m s or N s of windows of `length` s."""
    first = signals.settled
    windows = choose_windows(len(signals.time) - first, signals.period, length)
    design = build_equations(
        library,
        signals,
        lambda values: np.diff(values[first:][windows.ends], axis=0),
        lambda values: integrate_windows(values[first:], windows),
    )
    if signals.hold != "zero":
        return design, integrate_windows(signals.tau[first:], windows)
    # The integral of a held torque is exact.
    held = signals.tau[first:][: windows.count * windows.intervals]
    return design, windows.period * held.reshape(windows.count, windows.intervals, -1).sum(axis=1)


_EDGE = 20.0
"""Hz; the band in which arms move, and in which white noise of the torque outweighs that of encoders."""
_LEAST_RATIO = 25.0
"""Of the sample rate to the band's edge."""
_ORDER = 4
_CUT = 2.0
"""Periods of the band's edge that are cut at both ends."""
_STATES = 5.0
"""Of the cut-off of the states to the band's edge."""


def _choose_edge(period: float) -> float:
    return min(_EDGE, 1.0 / (_LEAST_RATIO * period))


def get_wide_cutoff(period: float) -> float:
    """Return the cut-off of the states in Hz, for a sample period in s."""
    return min(_STATES * _choose_edge(period), 0.4 / period)


def build_band_rows(library: Library, signals: Sequence[ElasticSignals]) -> BandRows:
    """Return the equations of all recordings; their signals should pass `get_wide_cutoff`, or no filter.

    Every column is made of hardly filtered states and then filtered exactly as the torque is, so that kinks
    of friction stay in place. Rows are taken at twice the edge of the band: noise is nearly independent.
    """
    parts = [_filter_equations(library, part) for part in signals]
    design, torque, time = (np.concatenate(part) for part in zip(*parts, strict=True))
    joints = library.card.size
    owner = np.repeat(np.arange(len(parts)), [len(part[2]) for part in parts])
    return BandRows(
        design=design.reshape(-1, design.shape[2]),
        torque=torque.reshape(-1),
        group=(owner[:, None] * joints + np.arange(joints)).reshape(-1),
        time=np.repeat(time, joints),
    )


def _filter_equations(library: Library, signals: ElasticSignals) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return design (m, n, p + n + pf), torque (m, n) and time (m,) from 0 to 1 of one recording."""
    period, edge = signals.period, _choose_edge(signals.period)
    cut = int(np.ceil(_CUT / (edge * period)))
    keep = slice(cut, len(signals.time) - cut, max(1, round(0.5 / (edge * period))))

    def low(values: FloatArray) -> FloatArray:
        return low_pass(values, period=period, cutoff=edge, order=_ORDER)

    design = build_equations(
        library,
        signals,
        lambda values: differentiate(low(values), period)[keep],
        lambda values: low(values)[keep],
    )
    time = np.arange(len(signals.time))[keep] / len(signals.time)
    torque = center_held(signals.tau) if signals.hold == "zero" else signals.tau
    return design, low(torque)[keep], time


_MOVING = 0.1
"""Of the fastest joint's RMS speed; slower joints count as held."""
_DRIVEN = 0.5
"""Of a joint's largest RMS speed over all recordings; slower ones do not serve its hysteresis."""
_TORSION_ROUNDS = 8
_DAMPING = 0.1
"""mu relative to the largest squared singular value of G."""
_SLOW = 0.5
"""Hz; slow motions are below, the pendulums of arms above."""
_STEEP = 0.5
"""Of the largest |G_jj| at which the torsion of joint j is trusted for its linear spring."""


def split_recordings(signals: Sequence[ElasticSignals]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the recordings in which all joints move, and the others; all twice where a kind is missing."""
    speeds = [np.sqrt(np.mean(part.dtheta**2, axis=0)) for part in signals]
    everything = tuple(range(len(signals)))
    together = tuple(i for i in everything if np.all(speeds[i] > _MOVING * speeds[i].max()))
    apart = tuple(i for i in everything if i not in together)
    return together or everything, apart or everything


def fit_independent(problem: ElasticProblem, *, encoder: bool = False) -> MethodFit:
    """Return the dynamics of the first procedure and the hysteresis of the second.

    With `encoder` the torsion is taken from the link encoder too, in place of motor-side samples alone.
    """
    together, apart = split_recordings(problem.signals)
    chi = solve_with_signs(problem.library.card, *problem.stack_filtered(together))
    torsions = {
        number: problem.signals[number].phi if encoder else estimate_virtual_torsion(problem, number, chi)
        for number in apart
    }
    speeds = [np.sqrt(np.mean(part.dtheta**2, axis=0)) for part in problem.signals]
    springs = []
    for joint in range(problem.sizes[1]):
        most = max(speeds[number][joint] for number in apart)
        used = [number for number in apart if speeds[number][joint] >= _DRIVEN * most]
        signals, rows = [problem.signals[i] for i in used], [problem.filtered[i] for i in used]
        parts = [np.ascontiguousarray(torsions[number][:, joint]) for number in used]
        data = build_spring_data(problem.options, joint, parts, signals, rows)
        target = np.concatenate([part.compute_motor_side(chi)[:, joint] for part in rows])
        springs.append(build_elasticity(fit_joint_spring(problem.options, data, joint, target)))
    fit = build_method_fit("independent", chi, problem.sizes, tuple(springs))
    if set(together) != set(apart):
        return fit
    text = (
        "the method independent needs motions of all joints together for the dynamics and slow motions of "
        "one joint at a time for the hysteresis; these logs are of one kind, which was used for both"
    )
    return replace(fit, notices=(Notice(code="elastic.one-kind", text=text),))


def estimate_virtual_torsion(problem: ElasticProblem, number: int, chi: FloatArray) -> FloatArray:
    """Return the torsion (N, n) of recording `number` from motor-side samples and chi alone.

    First where gravity's gradient is large; the linear spring that this gives stands in elsewhere.
    """
    library, signals, rate = problem.library, problem.signals[number], problem.options.rate
    beta = chi[: problem.sizes[0]]
    rows = build_filtered_rows(library, replace(signals, settled=0), rate)
    step = rows.keep.step
    theta, period, torque = signals.theta[::step], signals.period * step, rows.compute_motor_side(chi)
    gradient = _compute_gravity_gradient(library, theta, beta)
    root = gradient.transpose(0, 2, 1)
    damping = _DAMPING * float(np.linalg.norm(gradient, ord=2, axis=(1, 2)).max()) ** 2
    gain = root @ np.linalg.inv(gradient @ root + damping * np.eye(problem.sizes[1]))
    phi = np.zeros_like(theta)
    for prior in (False, True):
        if prior:
            for joint in range(phi.shape[1]):
                # The linear spring that fits best where gravity's gradient is large.
                slope = np.abs(gradient[:, joint, joint])
                steep = slope >= _STEEP * slope.max()
                moved = float(torque[steep, joint] @ torque[steep, joint])
                compliance = max(0.0, float(phi[steep, joint] @ torque[steep, joint]) / max(moved, 1e-300))
                phi[:, joint] = compliance * torque[:, joint]
        for _ in range(_TORSION_ROUNDS):
            q = theta - phi
            dq = differentiate(q, period)
            (momentum,) = library.evaluate("momentum_regressor", q, dq)
            (lagrange,) = library.evaluate("lagrange_regressor", q, dq)
            link = filter_derivative(momentum @ beta, rate, period)
            link -= filter_smooth(lagrange @ beta, rate, period)
            # Above a pendulum's frequency inertia outweighs gravity, and the fixed point would run away.
            error = low_pass(link - torque, period=period, cutoff=_SLOW, order=2)
            phi = phi + np.einsum("kij,kj->ki", gain, error)
    full, grid = np.arange(len(signals.time)), np.arange(len(theta)) * step
    return np.column_stack([np.interp(full, grid, torsion) for torsion in phi.T])


def _compute_gravity_gradient(library: Library, q: FloatArray, beta: FloatArray) -> FloatArray:
    """Return d g / dq (N, n, n) by central differences of the torque at rest."""
    turn, rest, columns = 1e-4, np.zeros_like(q), []
    for shift in turn * np.eye(q.shape[1]):
        (ahead,) = library.evaluate("lagrange_regressor", q + shift, rest)
        (behind,) = library.evaluate("lagrange_regressor", q - shift, rest)
        columns.append((behind @ beta - ahead @ beta) / (2.0 * turn))
    return np.stack(columns, axis=2)
