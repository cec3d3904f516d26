"""Dynamics without the springs, from momenta: motor and link equations added and integrated over windows.

ElasticSignals, Library -> momentum rows -> ElasticFit.

    Delta(Yp beta) - int YL beta dt + IA Delta(dtheta) + int Yf f dt = int tau dt

The joint torque cancels, whatever the springs are; joints stay apart, unlike in energy rows, and no
acceleration is needed.

Supported: any number of joints; windows of one length.
Not supported: weights other than the scatter of each joint.
"""

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.library import Library
from symid.elastic.consistency import solve_consistent
from symid.elastic.fit import ElasticFit
from symid.elastic.hysteresis import fit_springs
from symid.elastic.problem import ElasticProblem, build_fit
from symid.elastic.signals import ElasticSignals
from symid.elastic.spring_weights import build_elasticity
from symid.rows.quadrature import Windows, find_windows, integrate_windows

__all__ = ["build_momentum_rows", "fit_momentum"]

_ROUNDS = 2


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
    windows = find_windows(len(signals.time) - signals.settled, signals.period, length)
    used = slice(signals.settled, None)
    q, dq, dtheta = signals.q[used], signals.dq[used], signals.dtheta[used]
    (momentum,) = library.evaluate("momentum_regressor", q[windows.ends], dq[windows.ends])
    (lagrange,) = library.evaluate("lagrange_regressor", q, dq)
    turned = np.diff(dtheta[windows.ends], axis=0)
    columns = [
        np.diff(momentum, axis=0) - integrate_windows(lagrange, windows),
        turned[:, :, None] * np.eye(library.card.size),
    ]
    if library.card.friction:
        (friction,) = library.evaluate("friction_regressor", dtheta)
        columns.append(integrate_windows(friction, windows))
    return np.concatenate(columns, axis=2), _find_impulse(signals, windows)


def _find_impulse(signals: ElasticSignals, windows: Windows) -> FloatArray:
    """Return the integral of the torque over every window; exact where it holds between samples."""
    tau = signals.tau[signals.settled :]
    if signals.hold != "zero":
        return integrate_windows(tau, windows)
    inner = tau[: windows.count * windows.intervals].reshape(windows.count, windows.intervals, -1)
    held: FloatArray = windows.period * inner.sum(axis=1)
    return held


def fit_momentum(problem: ElasticProblem) -> ElasticFit:
    """Return dynamics from momenta, and the springs that the motor equation then shows."""
    options = problem.options
    parts = [build_momentum_rows(problem.library, part, options.window) for part in problem.signals]
    design = np.concatenate([part[0] for part in parts])
    impulse = np.concatenate([part[1] for part in parts])
    floor = 1e-9 * float(np.sqrt(np.mean(impulse**2)))
    weights = np.ones(impulse.shape[1])
    for _ in range(_ROUNDS):
        weighted = (design * weights[:, None]).reshape(-1, design.shape[2])
        chi = solve_consistent(problem.library.card, weighted, (impulse * weights).reshape(-1))
        scatter = np.sqrt(np.mean((impulse - design @ chi) ** 2, axis=0))
        weights = 1.0 / np.maximum(scatter, floor)
    springs = fit_springs(problem, problem.torque - problem.motor @ chi[problem.sizes[0] :])
    return build_fit(problem, "momentum", chi, tuple(map(build_elasticity, springs)))
