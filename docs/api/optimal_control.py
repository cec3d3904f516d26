"""Swing a two-link arm from hanging to upright with as little effort as possible.

Direct multiple shooting: the torque is constant in each of 50 intervals, states at their ends are unknowns,
and Runge-Kutta steps through the exact forward dynamics join them. Ipopt has exact derivatives of all of it.
"""

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

import symid

INTERVALS, DURATION = 50, 2.0
STEP = DURATION / INTERVALS
LIMIT = np.array([12.0, 6.0])  # N m; holding the outstretched arm level would take 16 N m at the shoulder
START, END = np.array([-np.pi / 2, 0.0]), np.array([np.pi / 2, 0.0])  # rad, hanging and upright

robot = symid.load("two_link")
speed = np.array([joint.limits.velocity for joint in robot.joints])  # rad/s
dynamics = robot.casadi("forward_dynamics", constant=True)


def find_rate(state: ca.MX, torque: ca.MX) -> ca.MX:
    """Return the time derivative of (q, dq) under a torque."""
    return ca.vertcat(state[2:], dynamics(state[:2], state[2:], torque))


def step(state: ca.MX, torque: ca.MX) -> ca.MX:
    """Return the state an interval later: four steps of the Runge-Kutta method of fourth order."""
    h = STEP / 4
    for _ in range(4):
        k1 = find_rate(state, torque)
        k2 = find_rate(state + h / 2 * k1, torque)
        k3 = find_rate(state + h / 2 * k2, torque)
        k4 = find_rate(state + h * k3, torque)
        state += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return state


opti = ca.Opti()
states, torques = opti.variable(4, INTERVALS + 1), opti.variable(2, INTERVALS)
effort = STEP * ca.sumsqr(torques)
opti.minimize(effort)
for k in range(INTERVALS):
    opti.subject_to(states[:, k + 1] == step(states[:, k], torques[:, k]))
    opti.subject_to(opti.bounded(-LIMIT, torques[:, k], LIMIT))
    opti.subject_to(opti.bounded(-speed, states[2:, k], speed))
opti.subject_to(states[:, 0] == np.r_[START, 0.0, 0.0])
opti.subject_to(states[:, -1] == np.r_[END, 0.0, 0.0])
opti.set_initial(states[:2, :], np.linspace(START, END, INTERVALS + 1).T)
opti.solver("ipopt", {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"})
solution = opti.solve()
plan = solution.value(torques).T
print(f"effort {solution.value(effort):.1f} N^2 m^2 s, largest torques {abs(plan).max(axis=0).round(2)} N m")

# The same torques on the compiled C code, integrated by another method with tight tolerances.
lib = robot.compile()
move = lib.forward_dynamics.bind()
reached = np.r_[START, 0.0, 0.0]
for torque in plan:
    reached = solve_ivp(
        lambda _, x, tau=torque: np.r_[x[2:], move(x[:2], x[2:], tau, lib.beta)[0]],
        (0.0, STEP),
        reached,
        rtol=1e-10,
        atol=1e-10,
    ).y[:, -1]
gap = np.linalg.norm(reached[:2] - END)
print(f"with the C code the arm ends {1e3 * gap:.1f} mrad from upright")
