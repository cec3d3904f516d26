"""A swing-up of the Panda by direct collocation, with CasADi's derivatives and with the generated ones.

    python benchmarks/swing_up.py [INTERVALS]

Needed besides symid: `pip install pin example-robot-data`, for the bodies. The arm hangs forward and low,
and must stand upright after DURATION seconds, with less torque at the shoulder than holding it level takes.
Trapezoidal collocation on forward dynamics, effort minimised by Ipopt with an approximated Hessian. Both
runs have the same problem, start and options; a third has exact second derivatives, which CasADi alone gives.
Times are processor time of the solver, without making the functions.
"""

import sys
import time
from pathlib import Path

import casadi as ca
import numpy as np
import pinocchio

import symid

PANDA = "share/example-robot-data/robots/panda_description/urdf/panda.urdf"

INTERVALS, DURATION = 40, 1.0
START = np.array([0.0, 1.7, 0.0, -0.4, 0.0, 0.8, 0.0])  # rad
END = np.array([0.0, 0.0, 0.0, -0.4, 0.0, 0.8, 0.0])
WEIGHT = 0.05  # of the velocities beside the torques, so that the arm goes the short way
SHARE = 0.8  # of the torque that holds the arm level


def find_limits(robot: symid.RobotModel) -> np.ndarray:
    """Return torque limits, N m: at the shoulder less than holding the arm level takes."""
    gravity = robot.casadi("gravity", constant=True)
    level = np.abs(np.array(gravity([0.0, np.pi / 2, 0.0, -0.1, 0.0, 0.1, 0.0]))).ravel()
    limits = np.array([joint.limits.torque or 87.0 for joint in robot.joints])
    limits[1] = SHARE * level[1]
    return limits


def solve(dynamics: ca.Function, limits: np.ndarray, intervals: int, *, exact: bool) -> dict[str, float]:
    """Return effort, iterations, largest torque at the shoulder and seconds of one run."""
    opti, step, n = ca.Opti(), DURATION / intervals, len(limits)
    q, dq, tau = (opti.variable(n, intervals + 1) for _ in range(3))
    ddq = dynamics.map(intervals + 1)(q, dq, tau)

    def join(values: ca.MX, rates: ca.MX) -> None:
        mean = (rates[:, 1:] + rates[:, :-1]) / 2
        opti.subject_to(ca.vec(values[:, 1:] - values[:, :-1] - step * mean) == 0)

    join(q, dq)
    join(dq, ddq)
    effort = step * (ca.sumsqr(tau / limits) + WEIGHT * ca.sumsqr(dq))
    opti.minimize(effort)
    for k in range(intervals + 1):
        opti.subject_to(opti.bounded(-limits, tau[:, k], limits))
    for where, value in ((0, START), (intervals, END)):
        opti.subject_to(q[:, where] == value)
        opti.subject_to(dq[:, where] == 0)
    opti.set_initial(q, np.linspace(START, END, intervals + 1).T)
    options = {"print_level": 0, "sb": "yes", "max_iter": 3000, "tol": 1e-8}
    if not exact:
        options |= {"hessian_approximation": "limited-memory", "limited_memory_max_history": 20}
    opti.solver("ipopt", {"print_time": False}, options)
    begin = time.process_time()
    solution = opti.solve()
    return {
        "effort": float(solution.value(effort)),
        "iterations": opti.stats()["iter_count"],
        "shoulder, N m": float(np.abs(solution.value(tau)[1]).max()),
        "s": time.process_time() - begin,
        "s in functions": sum(
            value for key, value in opti.stats().items() if key.startswith("t_proc_nlp") and value
        ),
    }


def main() -> None:
    """Print a line a run."""
    intervals = int(sys.argv[1]) if len(sys.argv) > 1 else INTERVALS
    prefix = next(path for path in Path(pinocchio.__file__).parents if path.name == "cmeel.prefix")
    robot = symid.load(prefix / PANDA, tip="panda_link7")
    limits = find_limits(robot)
    plain = robot.casadi("forward_dynamics", constant=True)
    generated = robot.casadi("forward_dynamics", constant=True, compiled=True)
    runs = (
        ("derivatives of CasADi", plain, False),
        ("generated derivatives in C", generated, False),
        ("CasADi, second ones too", plain, True),
    )
    for label, dynamics, exact in runs:
        found = solve(dynamics, limits, intervals, exact=exact)
        cells = "  ".join(f"{key} {value:.7g}" for key, value in found.items())
        print(f"{label:<28} {cells}", flush=True)


if __name__ == "__main__":
    main()
