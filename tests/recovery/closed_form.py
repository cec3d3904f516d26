"""Two robots written out by hand in NumPy, with the interface of a library: an independent oracle.

One axis: a mass on a vertical slide, with the offset doing the work of gravity. Two links: a
vertical 2R arm, length L of the first link, gravity G along -y,

    T = ZZR1 dq1^2 / 2 + ZZ2 w^2 / 2 + L dq1 w (MX2 cos q2 - MY2 sin q2),   w = dq1 + dq2
    V = G (MXR1 sin q1 + MY1 cos q1 + MX2 sin(q1 + q2) + MY2 cos(q1 + q2))
"""

from dataclasses import dataclass

import numpy as np

from symid.codegen.functions import JointCard, ModelCard, ParameterCard, list_specs
from symid.logs.recording import Recording, Signals

L, G = 0.5, 9.81
ONE_AXIS_TRUTH = np.array([95.0, 203.0, 20.0, -3.0])
TWO_LINK_TRUTH = np.array([1.1, 2.3, 0.2, 0.35, 0.6, -0.1, 1.5, 0.8, 0.3, 0.7, 0.4, -0.2])


@dataclass(frozen=True)
class ClosedForm:
    """A library whose functions are the methods of this module's classes."""

    card: ModelCard
    functions: dict
    backend: str = "numpy"
    notices: tuple = ()
    tangents: None = None

    def evaluate(self, name, *inputs, out=None):
        found = self.functions[name](*inputs)
        if out is None:
            return found
        for target, values in zip(out, found, strict=True):
            target[...] = values
        return tuple(out)


def find_friction(dq):
    """Return Yf (N, n, 3n) of viscous, Coulomb, offset."""
    count, n = dq.shape
    out = np.zeros((count, n, 3 * n))
    for j in range(n):
        out[:, j, 3 * j : 3 * j + 3] = np.column_stack([dq[:, j], np.sign(dq[:, j]), np.ones(count)])
    return (out,)


def build_one_axis(truth=ONE_AXIS_TRUTH):
    def column(values):
        return values[:, :, None]

    functions = {
        "torque_regressor": lambda *state: (column(state[2]),),
        "momentum_regressor": lambda *state: (column(state[1]),),
        "lagrange_regressor": lambda q, _: (np.zeros((*q.shape, 1)),),
        "energy_regressor": lambda q, dq: (dq**2 / 2, np.zeros((len(q), 1))),
        "friction_regressor": find_friction,
    }
    card = _build_card("one_axis", ("M1",), ("kg",), kind="prismatic", joints=1, truth=truth)
    return ClosedForm(card=card, functions=functions)


def build_two_link(truth=TWO_LINK_TRUTH):
    names = ("ZZR1", "MXR1", "MY1", "ZZ2", "MX2", "MY2")
    units = ("kg m^2", "kg m", "kg m", "kg m^2", "kg m", "kg m")
    functions = {
        "torque_regressor": find_two_link_torque,
        "momentum_regressor": find_two_link_momentum,
        "lagrange_regressor": find_two_link_lagrange,
        "energy_regressor": find_two_link_energy,
        "friction_regressor": find_friction,
    }
    return ClosedForm(
        card=_build_card("two_link", names, units, kind="revolute", joints=2, truth=truth),
        functions=functions,
    )


def find_two_link_energy(q, dq):
    q1, q12 = q[:, 0], q[:, 0] + q[:, 1]
    dq1, w = dq[:, 0], dq[:, 0] + dq[:, 1]
    c2, s2, zero = np.cos(q[:, 1]), np.sin(q[:, 1]), np.zeros(len(q))
    kinetic = [dq1**2 / 2, zero, zero, w**2 / 2, L * dq1 * w * c2, -L * dq1 * w * s2]
    potential = [zero, G * np.sin(q1), G * np.cos(q1), zero, G * np.sin(q12), G * np.cos(q12)]
    return np.column_stack(kinetic), np.column_stack(potential)


def find_two_link_momentum(q, dq):
    dq1, dq2 = dq.T
    c2, s2, zero = np.cos(q[:, 1]), np.sin(q[:, 1]), np.zeros(len(q))
    first = [dq1, zero, zero, dq1 + dq2, L * c2 * (2 * dq1 + dq2), -L * s2 * (2 * dq1 + dq2)]
    second = [zero, zero, zero, dq1 + dq2, L * c2 * dq1, -L * s2 * dq1]
    return (np.stack([np.column_stack(first), np.column_stack(second)], axis=1),)


def find_two_link_lagrange(q, dq):
    q1, q12 = q[:, 0], q[:, 0] + q[:, 1]
    dq1, w = dq[:, 0], dq[:, 0] + dq[:, 1]
    c2, s2, zero = np.cos(q[:, 1]), np.sin(q[:, 1]), np.zeros(len(q))
    first = [zero, -G * np.cos(q1), G * np.sin(q1), zero, -G * np.cos(q12), G * np.sin(q12)]
    second = [zero] * 4 + [-L * s2 * dq1 * w - G * np.cos(q12), -L * c2 * dq1 * w + G * np.sin(q12)]
    return (np.stack([np.column_stack(first), np.column_stack(second)], axis=1),)


def find_two_link_torque(q, dq, ddq):
    q1, q12 = q[:, 0], q[:, 0] + q[:, 1]
    (dq1, dq2), (a1, a2) = dq.T, ddq.T
    c2, s2, zero = np.cos(q[:, 1]), np.sin(q[:, 1]), np.zeros(len(q))
    mix = dq2 * (2 * dq1 + dq2)
    first = [
        a1,
        G * np.cos(q1),
        -G * np.sin(q1),
        a1 + a2,
        L * c2 * (2 * a1 + a2) - L * s2 * mix + G * np.cos(q12),
        -L * s2 * (2 * a1 + a2) - L * c2 * mix - G * np.sin(q12),
    ]
    second = [zero] * 3 + [
        a1 + a2,
        L * c2 * a1 + L * s2 * dq1**2 + G * np.cos(q12),
        -L * s2 * a1 + L * c2 * dq1**2 - G * np.sin(q12),
    ]
    return (np.stack([np.column_stack(first), np.column_stack(second)], axis=1),)


def sample_states(joints, samples, period, seed=0, scale=1.0):
    """Return exact q, dq, ddq (samples, joints) of a sum of five sines a joint, and the times."""
    rng = np.random.default_rng(seed)
    time = period * np.arange(samples)
    amplitude = scale * rng.uniform(0.2, 0.5, (5, joints))
    omega = 2 * np.pi * np.array([0.1, 0.2, 0.3, 0.5, 0.7])[:, None] * rng.uniform(0.9, 1.1, (5, joints))
    phase = rng.uniform(0, 2 * np.pi, (5, joints))
    angle = omega[None] * time[:, None, None] + phase
    q = np.sum(amplitude * np.sin(angle), axis=1)
    dq = np.sum(amplitude * omega * np.cos(angle), axis=1)
    ddq = -np.sum(amplitude * omega**2 * np.sin(angle), axis=1)
    return time, q, dq, ddq


def build_signals(library, truth, *, samples=5001, period=1e-3, seed=0, noise=None):
    """Return exact states and the torque of the true parameters; `noise` (joints,) std of the torque."""
    time, q, dq, ddq = sample_states(library.card.size, samples, period, seed)
    regressor = np.concatenate([find_rigid(library, q, dq, ddq), find_friction(dq)[0]], axis=2)
    tau = regressor @ truth
    if noise is not None:
        tau = tau + np.random.default_rng(seed + 1000).normal(size=tau.shape) * np.asarray(noise)
    return Signals(time=time, q=q, dq=dq, ddq=ddq, tau=tau, period=period)


def find_rigid(library, q, dq, ddq):
    return library.evaluate("torque_regressor", q, dq, ddq)[0]


def build_recording(library, truth, source="made", **options):
    signals = build_signals(library, truth, **options)
    return Recording(time=signals.time, position=signals.q, torque=signals.tau, source=source)


def _build_card(robot, names, units, *, kind, joints, truth):
    torque = "N" if kind == "prismatic" else "N m"
    beta = tuple(
        ParameterCard(
            name=name, expression=name, unit=unit, reason="closed form", joint="joint1", value=value
        )
        for name, unit, value in zip(names, units, map(float, truth), strict=False)
    )
    friction = tuple(
        ParameterCard(
            name=f"{name}{j + 1}",
            expression=f"{name}{j + 1}",
            unit=f"{torque} s" if name == "Fv" else torque,
            reason="friction",
            joint=f"joint{j + 1}",
            value=float(truth[len(names) + 3 * j + k]),
        )
        for j in range(joints)
        for k, name in enumerate(("Fv", "Fc", "offset"))
    )
    cards = tuple(
        JointCard(number=j + 1, name=f"joint{j + 1}", kind=kind, friction="coulomb-viscous-offset")
        for j in range(joints)
    )
    return ModelCard(
        robot=robot,
        signature=f"{robot}-signature",
        joints=cards,
        beta=beta,
        friction=friction,
        functions=list_specs({"n": joints, "l": joints, "b": len(beta), "p": len(friction)}),
    )
