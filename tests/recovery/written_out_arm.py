"""A planar arm with an elastic and a rigid joint, by equations written out here: no code of symid."""

import math

import numpy as np

import symid

ROBOT = """
name = "mixed"
convention = "modified"
gravity = [9.81, 0, 0]
[[joint]]
name = "shoulder"
kind = "revolute"
drive = { rotor_inertia = "unknown", rotor_inertia_side = "joint" }
friction = { model = "coulomb-viscous", smoothing = 0.01 }
elasticity = { stiffness = "unknown" }
[[joint]]
name = "elbow"
kind = "revolute"
a = 0.3
drive = { rotor_inertia = "unknown", rotor_inertia_side = "joint" }
friction = { model = "coulomb-viscous", smoothing = 0.01 }
"""
LINKS = {"ZZR1": 0.4, "MXR1": 1.0, "MY1": 0.0, "ZZ2": 0.07, "MX2": 0.3, "MY2": 0.0, "IA2": 0.06}
DYNAMICS = LINKS | {"IA1": 0.2}
TRUTH = DYNAMICS | {"Fv1": 0.9, "Fc1": 1.2, "Fv2": 0.4, "Fc2": 0.5}
LENGTH, GRAVITY, STIFFNESS = 0.3, 9.81, 700.0
LEVEL, REACH = 1.5, 2e-3
"""Of the loop: a Dahl spring of LEVEL N m that settles over REACH rad."""


def differentiate(state, torques):
    """Return the derivative of (theta1, q1, q2, their speeds, loop torque) under two motor torques."""
    theta, q1, q2, dtheta, dq1, dq2, loop = state.tolist()
    cosine, sine = math.cos(q2), math.sin(q2)
    m11 = TRUTH["ZZR1"] + TRUTH["ZZ2"] + 2.0 * LENGTH * TRUTH["MX2"] * cosine
    m12 = TRUTH["ZZ2"] + LENGTH * TRUTH["MX2"] * cosine
    m22 = TRUTH["ZZ2"] + TRUTH["IA2"]
    swing = LENGTH * TRUTH["MX2"] * sine
    outer = GRAVITY * TRUTH["MX2"] * math.sin(q1 + q2)
    inner = GRAVITY * TRUTH["MXR1"] * math.sin(q1) + outer
    spring = STIFFNESS * (theta - q1) + loop
    pairs = ((1, dtheta), (2, dq2))
    drag = [TRUTH[f"Fv{n}"] * v + TRUTH[f"Fc{n}"] * math.tanh(v / 0.01) for n, v in pairs]
    right1 = spring + swing * dq2 * (2.0 * dq1 + dq2) - inner
    right2 = torques[1] - drag[1] - swing * dq1 * dq1 - outer
    determinant = m11 * m22 - m12 * m12
    rate, pull = dtheta - dq1, torques[0] - drag[0] - spring
    bends = (m22 * right1 - m12 * right2) / determinant, (m11 * right2 - m12 * right1) / determinant
    return np.array(
        [dtheta, dq1, dq2, pull / TRUTH["IA1"], *bends, (LEVEL * rate - abs(rate) * loop) / REACH]
    )


def wave(time, joint):
    """Return the desired position of a motor."""
    terms = ((0.6, 0.43), (0.35, 0.95), (0.15, 2.3)) if joint else ((0.55, 0.31), (0.3, 0.77), (0.12, 1.9))
    return sum(size * math.sin(2.0 * math.pi * f * time + 0.7 * joint) for size, f in terms)


def simulate(duration, seed, steps=8):
    """Return time, motor and link positions, torques of a loop with held torques, and measured torques."""
    period, state, rows = 1e-3, np.zeros(7), []
    step = period / steps
    for tick in range(round(duration / period)):
        time, (theta, q1, q2, dtheta, _, dq2, _) = tick * period, state.tolist()
        torques = (900.0 * (wave(time, 0) - theta) - 25.0 * dtheta, 300.0 * (wave(time, 1) - q2) - 8.0 * dq2)
        rows.append((time, theta, q2, q1, q2, *torques))
        for _ in range(steps):
            k1 = differentiate(state, torques)
            k2 = differentiate(state + 0.5 * step * k1, torques)
            k3 = differentiate(state + 0.5 * step * k2, torques)
            k4 = differentiate(state + step * k3, torques)
            state = state + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    found, rng, count = np.array(rows), np.random.default_rng(seed), 2.0 * np.pi / 2**20
    motor, link = (np.round(found[:, part] / count) * count for part in (slice(1, 3), slice(3, 5)))
    torque = found[:, 5:]
    noisy = torque + rng.normal(scale=0.02 * np.std(torque, axis=0), size=torque.shape)
    return found[:, 0], motor, link, noisy


def build(robot, motion):
    time, motor, link, torque = motion
    return symid.build_log(robot, time=time, q=link, theta=motor, tau=torque)


def compute_spring_torque(motor, link):
    """Return torsion and torque of the shoulder's spring along positions, exact for steps of one speed."""
    phi = (motor - link)[:, 0]
    loop = np.zeros(len(phi))
    for k, change in enumerate(np.diff(phi)):
        goal = LEVEL if change > 0.0 else -LEVEL
        loop[k + 1] = goal + (loop[k] - goal) * math.exp(-abs(change) / REACH)
    return phi, STIFFNESS * phi + loop
