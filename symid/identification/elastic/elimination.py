"""Dynamics without the springs: motor and link equations added, so that the joint torque cancels.

    elimination  [Y_link | Y_motor] chi = F[tau]
    momentum     Delta(Yp beta) - int YL beta dt + IA Delta(dtheta) + int Yf f dt = int tau dt
    band         d/dt G[Yp] beta - G[YL] beta + IA d/dt G[dtheta] + G[Yf] f = G[tau],  G a zero-phase low-pass
    independent  dynamics from motions of all joints together; then the hysteresis of each joint from slow
                 motions of that joint alone: its torque from the motor equation, its torsion by the link
                 encoder or, on the motor side,
                 phi <- phi + G' (G G' + mu 1)^-1 (link(theta - phi) - tau_J),  G = d gravity / dq

n linear equations a sample, whatever the springs are; the hysteresis is fitted afterwards on the joint
torque that these dynamics leave. In a band every column is made of hardly filtered states and then
filtered exactly as the torque is, so that kinks of friction stay where they are; rows are taken at twice
the edge of the band, where noise is nearly independent, and weighted by the scatter of each joint in each
recording. `independent` is a reconstruction of published procedures from what is known of them, no copy.

Supported: both encoders; friction that is linear in its parameters; recordings of one kind only, which
then serve both steps of `independent`.
Not supported: noise of the encoders as large as that of the torque within the band; joints without
gravity on the motor side.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, FrozenArrays
from symid.codegen import Library, ModelCard
from symid.errors import Notice
from symid.identification.elastic.estimate import MethodFit
from symid.identification.elastic.problem import (
    ElasticProblem,
    build_method_fit,
    build_threshold_grid,
    fit_joint_spring,
    fit_springs,
)
from symid.identification.elastic.regression import (
    ElasticSignals,
    build_equations,
    center_held,
    filter_derivative,
    filter_smooth,
    solve_with_signs,
)
from symid.identification.elastic.spring_fit import SpringData, prepare_spring_data
from symid.identification.elastic.uncertainty import compute_covariance
from symid.identification.hysteresis import build_elasticity
from symid.identification.regression import choose_windows, integrate_windows
from symid.logs import differentiate, low_pass


def fit_elimination(problem: ElasticProblem) -> MethodFit:
    """Return dynamics by elimination of the joint torque, and the springs that it then shows."""
    chi = solve_with_signs(problem.library.card, *build_elimination_rows(problem))
    return build_method_fit(problem, "elimination", chi, fit_springs(problem, problem.find_motor_side(chi)))


def build_elimination_rows(
    problem: ElasticProblem, recordings: Sequence[int] | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return design (m, p + n + pf) and torque (m,) of the given recordings, of all by default."""
    numbers = range(len(problem.filtered)) if recordings is None else recordings
    rows = [problem.filtered[number] for number in numbers]
    design = np.concatenate([part.elimination for part in rows])
    torque = np.concatenate([part.torque for part in rows])
    return design.reshape(-1, design.shape[2]), torque.reshape(-1)


_MOMENTUM_ROUNDS = 2


def build_momentum_rows(
    library: Library, signals: ElasticSignals, length: float
) -> tuple[FloatArray, FloatArray]:
    """Return design (m, n, p + n + pf) and right side (m, n) in N m s or N s.

    Args:
        library: functions of the robot.
        signals: states and torque of one recording.
        length: of the windows in s.

    Raises:
        UsageError: a window does not fit.
    """
    windows = choose_windows(len(signals.time) - signals.settled, signals.period, length)

    def integrate(values: FloatArray) -> FloatArray:
        return integrate_windows(values[signals.settled :], windows)

    motor, link = build_equations(
        library,
        signals,
        lambda values: np.diff(values[signals.settled :][windows.ends], axis=0),
        integrate,
    )
    design = np.concatenate([link, motor], axis=2)
    if signals.hold != "zero":
        return design, integrate(signals.tau)
    # The integral of a held torque is exact.
    held = signals.tau[signals.settled :][: windows.count * windows.intervals]
    impulse: FloatArray = windows.period * held.reshape(windows.count, windows.intervals, -1).sum(axis=1)
    return design, impulse


def fit_momentum(problem: ElasticProblem) -> MethodFit:
    """Return dynamics from momenta, and the springs that the motor equation then shows."""
    options = problem.options
    parts = [build_momentum_rows(problem.library, part, options.window) for part in problem.signals]
    design = np.concatenate([part[0] for part in parts])
    impulse = np.concatenate([part[1] for part in parts])
    floor = 1e-9 * float(np.sqrt(np.mean(impulse**2)))
    weights = np.ones(impulse.shape[1])
    for _ in range(_MOMENTUM_ROUNDS):
        weighted = (design * weights[:, None]).reshape(-1, design.shape[2])
        chi = solve_with_signs(problem.library.card, weighted, (impulse * weights).reshape(-1))
        scatter = np.sqrt(np.mean((impulse - design @ chi) ** 2, axis=0))
        weights = 1.0 / np.maximum(scatter, floor)
    return build_method_fit(problem, "momentum", chi, fit_springs(problem, problem.find_motor_side(chi)))


_EDGE = 20.0
"""Hz; the band in which arms move, and in which white noise of the torque outweighs that of encoders."""
_LEAST_RATIO = 25.0
"""Of the sample rate to the band's edge."""
_ORDER = 4
_CUT = 2.0
"""Periods of the band's edge that are cut at both ends."""
_STATES = 5.0
"""Of the cut-off of the states to the band's edge."""
_WEIGHT_ROUNDS = 3


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

    Parameters that the rows do not tell have infinite variances.
    """

    chi: FloatArray
    covariance: FloatArray
    scatter: FloatArray


def get_wide_cutoff(period: float) -> float:
    """Return the cut-off of the states in Hz, for a sample period in s."""
    return min(_STATES * _choose_edge(period), 0.4 / period)


def build_band_rows(library: Library, signals: Sequence[ElasticSignals]) -> BandRows:
    """Return the equations of all recordings; their signals should pass `get_wide_cutoff`, or no filter."""
    designs, torques, groups, times = [], [], [], []
    for number, part in enumerate(signals):
        design, torque, time = _build_one(library, part)
        joints = torque.shape[1]
        designs.append(design.reshape(-1, design.shape[2]))
        torques.append(torque.reshape(-1))
        groups.append(np.tile(np.arange(joints), len(torque)) + joints * number)
        times.append(np.repeat(time, joints))
    return BandRows(
        design=np.vstack(designs),
        torque=np.concatenate(torques),
        group=np.concatenate(groups),
        time=np.concatenate(times),
    )


def fit_band(card: ModelCard, rows: BandRows, use: NDArray[np.bool_] | None = None) -> BandFit:
    """Return the weighted least-squares fit, weights 1 / scatter of each group, found in a few rounds.

    Args:
        card: names the parameters.
        rows: the equations.
        use: (m,) rows to fit; None for all.
    """
    chosen = np.ones(len(rows.torque), dtype=bool) if use is None else use
    design, torque, group = rows.design[chosen], rows.torque[chosen], rows.group[chosen]
    count = int(rows.group.max()) + 1
    floor = 1e-9 * max(float(np.sqrt(np.mean(torque**2))), 1e-300)
    weights = np.ones(len(torque))
    scatter = np.ones(count)
    for _ in range(_WEIGHT_ROUNDS):
        chi = solve_with_signs(card, design * weights[:, None], torque * weights)
        errors = torque - design @ chi
        total = np.bincount(group, errors**2, minlength=count)
        members = np.maximum(np.bincount(group, minlength=count), 1)
        scatter = np.maximum(np.sqrt(total / members), floor)
        weights = 1.0 / scatter[group]
    return BandFit(chi=chi, covariance=compute_covariance(design * weights[:, None]), scatter=scatter)


def _choose_edge(period: float) -> float:
    return min(_EDGE, 1.0 / (_LEAST_RATIO * period))


def _build_one(library: Library, signals: ElasticSignals) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return design (m, n, p + n + pf), torque (m, n) and time (m,) from 0 to 1 of one recording."""
    period = signals.period
    edge = _choose_edge(period)

    cut = int(np.ceil(_CUT / (edge * period)))
    keep = slice(cut, len(signals.time) - cut, max(1, round(0.5 / (edge * period))))

    def low(values: FloatArray) -> FloatArray:
        return low_pass(values, period=period, cutoff=edge, order=_ORDER)

    motor, link = build_equations(
        library,
        signals,
        lambda values: differentiate(low(values), period)[keep],
        lambda values: low(values)[keep],
    )
    tau = center_held(signals.tau) if signals.hold == "zero" else signals.tau
    time = np.arange(len(signals.time))[keep] / len(signals.time)
    return np.concatenate([link, motor], axis=2), low(tau)[keep], time


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
    together = []
    for number, part in enumerate(signals):
        speed = np.sqrt(np.mean(part.dtheta**2, axis=0))
        if np.all(speed > _MOVING * speed.max()):
            together.append(number)
    everything = tuple(range(len(signals)))
    apart = tuple(number for number in everything if number not in together)
    return tuple(together) or everything, apart or everything


def fit_independent(problem: ElasticProblem, *, encoder: bool = False) -> MethodFit:
    """Return the dynamics of the first procedure and the hysteresis of the second.

    Args:
        problem: all recordings.
        encoder: take the torsion from the link encoder too, in place of motor-side samples alone.
    """
    together, apart = split_recordings(problem.signals)
    beta, joints, _ = problem.sizes
    chi = solve_with_signs(problem.library.card, *build_elimination_rows(problem, together))
    torsions = {
        number: problem.signals[number].phi if encoder else estimate_virtual_torsion(problem, number, chi)
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
        springs.append(build_elasticity(fit_joint_spring(problem.options, data, joint, target)))
    notices: tuple[Notice, ...] = ()
    if set(together) == set(apart):
        text = (
            "the independent procedures want motions of all joints together for the dynamics and slow "
            "motions of one joint at a time for the hysteresis; there is one kind only, and it served both"
        )
        notices = (Notice(code="elastic.one-kind", text=text),)
    return build_method_fit(problem, "independent", chi, tuple(springs), notices=notices)


def estimate_virtual_torsion(problem: ElasticProblem, number: int, chi: FloatArray) -> FloatArray:
    """Return the torsion (N, n) of recording `number` from motor-side samples and chi alone.

    First where gravity's gradient is large; the linear spring that this gives stands in elsewhere.
    """
    signals, rate = problem.signals[number], problem.options.rate
    beta, joints, _ = problem.sizes
    keep = problem.filtered[number].keep
    step = keep.step
    theta = signals.theta[::step]
    period = signals.period * step
    torque = _compute_motor_torque(problem, signals, chi)[::step]
    gradient = _compute_gravity_gradient(problem, theta, chi[:beta])
    root = gradient.transpose(0, 2, 1)
    product = gradient @ root
    damping = _DAMPING * float(np.linalg.norm(gradient, ord=2, axis=(1, 2)).max()) ** 2
    gain = root @ np.linalg.inv(product + damping * np.eye(joints))
    phi = np.zeros_like(theta)
    for prior in (False, True):
        if prior:
            phi = _estimate_linear_torsion(phi, torque, gradient)
        for _ in range(_TORSION_ROUNDS):
            link = _compute_link_torque(problem, theta - phi, period, rate, chi[:beta])
            # Above a pendulum's frequency inertia outweighs gravity, and the fixed point would run away.
            error = low_pass(link - torque, period=period, cutoff=_SLOW, order=2)
            phi = phi + np.einsum("kij,kj->ki", gain, error)
    grid = np.arange(len(theta)) * step
    full = np.arange(len(signals.time))
    return np.column_stack([np.interp(full, grid, phi[:, joint]) for joint in range(joints)])


def _estimate_linear_torsion(phi: FloatArray, torque: FloatArray, gradient: FloatArray) -> FloatArray:
    """Return the torsion of the linear springs that fit `phi` best where gravity's gradient is large."""
    result = np.empty_like(phi)
    for joint in range(phi.shape[1]):
        slope = np.abs(gradient[:, joint, joint])
        steep = slope >= _STEEP * slope.max()
        moved = float(torque[steep, joint] @ torque[steep, joint])
        compliance = max(0.0, float(phi[steep, joint] @ torque[steep, joint]) / max(moved, 1e-300))
        result[:, joint] = compliance * torque[:, joint]
    return result


def _compute_motor_torque(problem: ElasticProblem, signals: ElasticSignals, chi: FloatArray) -> FloatArray:
    """Return F[tau_J] (N, n) by the motor equation at all samples of a recording."""
    rate, period = problem.options.rate, signals.period
    beta, joints, _ = problem.sizes
    tau = center_held(signals.tau) if signals.hold == "zero" else signals.tau
    inertia = filter_derivative(signals.dtheta, rate, period) * chi[beta : beta + joints]
    torque: FloatArray = filter_smooth(tau, rate, period) - inertia
    if problem.library.card.friction:
        (friction,) = problem.library.evaluate("friction_regressor", signals.dtheta)
        torque -= filter_smooth(friction @ chi[beta + joints :], rate, period)
    return torque


def _compute_link_torque(
    problem: ElasticProblem, q: FloatArray, period: float, rate: float, beta: FloatArray
) -> FloatArray:
    """Return F[tau_J] (N, n) by the link equation along q."""
    dq = differentiate(q, period)
    (momentum,) = problem.library.evaluate("momentum_regressor", q, dq)
    (lagrange,) = problem.library.evaluate("lagrange_regressor", q, dq)
    return filter_derivative(momentum @ beta, rate, period) - filter_smooth(lagrange @ beta, rate, period)


def _compute_gravity_gradient(problem: ElasticProblem, q: FloatArray, beta: FloatArray) -> FloatArray:
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
        grid = build_threshold_grid(max(float(np.abs(phi).max()) for phi in parts), options.stops)
    return prepare_spring_data(
        parts,
        [problem.filtered[number].keep for number in used],
        grid,
        options.rate,
        [problem.signals[number].period for number in used],
    )
