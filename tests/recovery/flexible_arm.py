"""A two-link arm that carries a mass on a spring, which no model of two rigid links has; written out by hand.

Joints move as told; the spring's deflection is integrated here (fourth order of Runge and Kutta). The torque
of links and payload, which a sensor behind each gear feels, follows from the motion of three points:

    p1 = c1 e^(i q1),  p2 = l1 e^(i q1) + c2 e^(i (q1 + q2)),  p3 = l1 e^(i q1) + (l2 + i s) e^(i (q1 + q2))
"""

from functools import cache

import numpy as np

from symid.logs.recording import Recording

LENGTHS, CENTRES = (0.5, 0.4), (0.25, 0.2)
MASSES, INERTIAS = (4.0, 2.5), (0.08, 0.03)
PAYLOAD, SPRING, DAMPING = 3.0, 3.0 * (2 * np.pi * 2.2) ** 2, 4.0
ROTORS = np.array([0.6, 0.25])
GRAVITY, RATE = 9.81, 500.0
FRICTION = {"first": (1.1, 1.5, 0.6, 0.08), "second": (0.7, 0.4, 0.09)}
ROBOT = """
name = "two_link"
convention = "modified"
gravity = [0, -9.81, 0]
[[joint]]
name = "shoulder"
kind = "revolute"
[[joint]]
name = "elbow"
kind = "revolute"
a = 0.5
"""


def move(time, seed):
    """Return q, dq, ddq (N, 2): fast and slow in turns of 20 s."""
    rng = np.random.default_rng(seed)
    phase, w = rng.uniform(0, 2 * np.pi, (4, 2)), 2 * np.pi / 20.0
    size, slope = 0.525 + 0.475 * np.cos(w * time), -0.475 * w * np.sin(w * time)
    bend = -0.475 * w * w * np.cos(w * time)
    q, dq, ddq = np.zeros((3, len(time), 2))
    for k, rate in enumerate((0.11, 0.17, 0.31, 0.43)):
        omega = 2 * np.pi * rate * rng.uniform(0.95, 1.05, 2)
        angle, a = np.outer(time, omega) + phase[k], 0.35 / (1 + k) * np.array([1.0, 1.2])
        x, v, c = np.sin(angle), omega * np.cos(angle), -(omega**2) * np.sin(angle)
        q += a * size[:, None] * x
        dq += a * (size[:, None] * v + slope[:, None] * x)
        ddq += a * (size[:, None] * c + 2 * slope[:, None] * v + bend[:, None] * x)
    return q, dq, ddq


def _find_acceleration(q, dq, ddq, *spring):
    """Return the accelerations (N,) of the three points, complex."""
    s, ds, dds = spring
    first, both = np.exp(1j * q[:, 0]), np.exp(1j * (q[:, 0] + q[:, 1]))
    w, dw = dq.sum(axis=1), ddq.sum(axis=1)
    turn = (1j * ddq[:, 0] - dq[:, 0] ** 2) * first
    arm = LENGTHS[1] + 1j * s
    last = (1j * dw - w**2) * arm - 2 * w * ds + 1j * dds
    return (
        CENTRES[0] * turn,
        LENGTHS[0] * turn + CENTRES[1] * (1j * dw - w**2) * both,
        LENGTHS[0] * turn + last * both,
    )


def _integrate(time, q, dq, ddq):
    """Return the deflection s of the spring, its rate and its second derivative (N,).

    Across the last link d^2s/dt^2 = push + (w^2 - k / m) s - (d / m) ds/dt; the Coriolis force is along it.
    """
    step, zero = float(time[1] - time[0]), np.zeros(len(time))
    still = _find_acceleration(q, dq, ddq, zero, zero, zero)[2]
    side = 1j * np.exp(1j * q.sum(axis=1))
    push = (-((still + 1j * GRAVITY) * np.conj(side)).real).tolist()
    pull = (dq.sum(axis=1) ** 2 - SPRING / PAYLOAD).tolist()

    def find_second(k, s, ds):
        return push[k] + pull[k] * s - DAMPING / PAYLOAD * ds

    # Two samples of the motion are one step, so that its middle is known.
    s, ds = float(-GRAVITY * np.cos(q[0].sum()) * PAYLOAD / SPRING), 0.0
    found = [(s, ds)]
    for k in range(0, len(time) - 2, 2):
        places = [(ds, find_second(k, s, ds))]
        for after, share in ((1, step), (1, step), (2, 2 * step)):
            speed, second = places[-1]
            one, two = s + share * speed, ds + share * second
            places.append((two, find_second(k + after, one, two)))
        s, ds = (
            x + step / 3 * (one + 2 * two + 2 * three + four)
            for x, one, two, three, four in zip((s, ds), *places, strict=True)
        )
        found.append((s, ds))
    s, ds = np.array(found).T
    return s, ds, np.array([find_second(2 * k, *pair) for k, pair in enumerate(found)])


def _find_load(q, dq, ddq, spring):
    """Return the torques (N, 2) of links and payload."""
    first, both = np.exp(1j * q[:, 0]), np.exp(1j * (q[:, 0] + q[:, 1]))
    outer = [arm * both for arm in (CENTRES[1], LENGTHS[1] + 1j * spring[0])]
    lengths = [(CENTRES[0] * first, 0.0), *((LENGTHS[0] * first + part, part) for part in outer)]
    turn = INERTIAS[1] * ddq.sum(axis=1)
    load = np.column_stack([INERTIAS[0] * ddq[:, 0] + turn, turn])
    points = zip((*MASSES, PAYLOAD), _find_acceleration(q, dq, ddq, *spring), lengths, strict=True)
    for mass, second, slopes in points:
        force = mass * (second + 1j * GRAVITY)
        load += np.column_stack([(force * np.conj(1j * slope)).real for slope in slopes])
    return load


def find_friction(dq, load):
    """Return the torques (N, 2) of a Stribeck curve, and of friction that grows with the load."""
    viscous, dry, more, slow = FRICTION["first"]
    v = dq[:, 0]
    first = viscous * v + (dry + more * np.exp(-((v / slow) ** 2))) * np.sign(v)
    viscous, dry, part = FRICTION["second"]
    second = viscous * dq[:, 1] + (dry + part * np.abs(load[:, 1])) * np.sign(dq[:, 1])
    return np.column_stack([first, second])


def find_plain_friction(dq, _load):
    return np.array([1.5, 0.7]) * dq + np.array([1.8, 0.4]) * np.sign(dq)


@cache
def _simulate(seed, duration):
    """Return times (N,), the motion of the joints and the torques (N, 2) of links and payload."""
    fine = np.arange(2 * round(duration * RATE) + 1) / (2 * RATE)
    motion = move(fine, seed)
    spring = _integrate(fine, *motion)
    joints = [values[::2] for values in motion]
    return fine[::2], joints, _find_load(*joints, spring)


def record(seed, *, duration=60.0, noise=0.02, gain=1.0, offset=0.0, friction=find_friction):
    """Return a log with motor torques and measured loads; sensors have a gain, an offset and noise (N m)."""
    rng = np.random.default_rng(100 + seed)
    time, (q, dq, ddq), load = _simulate(seed, duration)
    tau = load + ROTORS * ddq + friction(dq, load)
    step = 2 * np.pi / 2**20
    return Recording(
        time=time,
        position=np.round(q / step) * step,
        torque=tau + noise * rng.normal(size=tau.shape),
        load=load / gain + offset + noise * rng.normal(size=tau.shape),
        source=f"seed {seed}",
    )
