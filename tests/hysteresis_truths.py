"""Recordings of elements, from integrators that are not symid's: uneven, noisy, quantised."""

from itertools import accumulate

import numpy as np
from scipy.integrate import solve_ivp


def make_input(seed, amplitude=1.0, count=2400):
    """Return time (s) and a sweep whose amplitude goes up and down, at uneven times."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.5, 1.5, count)) * 6e-3
    swell = 0.15 + 0.85 * np.sin(np.pi * t / t[-1]) ** 2
    return t, amplitude * swell * (np.sin(2.1 * t) + 0.25 * np.sin(5.3 * t + 1.0)) / 1.25


def slide(x, stiffness, threshold):
    """Return springs behind sliders, one sample after the other."""
    deflection, total = np.zeros(len(stiffness)), []
    for way in np.diff(x, prepend=0.0):
        deflection = np.clip(deflection + way, -np.array(threshold), threshold)
        total.append(float(deflection @ np.array(stiffness)))
    return np.array(total)


def solve_path(t, x, rate):
    """Return z of dz/dx = rate(z, sign(dx)) along the input, by an ODE solver between samples."""
    z, found = 0.0, [0.0]
    for way in np.diff(x):
        sign = np.sign(way)
        done = solve_ivp(
            lambda _, s, sign=sign: rate(s, sign) * sign, (0, abs(way)), [z], rtol=1e-7, atol=1e-9
        )
        z = float(done.y[0, -1])
        found.append(z)
    return np.array(found)


def make_stops(_t, x):
    """Four springs behind sliders."""
    return 0.8 * x + slide(x, [2.0, 1.5, 0.7], [0.05, 0.2, 0.5])


def make_signed(_t, x):
    """Plays of either sign: a loop that turns its sense."""
    return 4.0 * x - slide(x, [1.0], [0.1]) + slide(x, [0.8], [0.4])


def make_hardening(t, x):
    """Stops behind an outer function that is steeper far from zero, and not odd."""
    v = make_stops(t, x)
    return v + 0.8 * np.maximum(v - 0.8, 0.0) + 0.5 * np.minimum(v + 0.6, 0.0)


def make_gap(_t, x):
    """A slider behind a spring that has a gap."""
    bent = slide(x, [1.0], [0.25])
    return 10.0 * np.sign(bent) * np.maximum(np.abs(bent) - 0.08, 0.0)


def make_bouc_wen(t, x):
    """Bouc and Wen as they wrote it: A = 1, gamma = 2, beta = 6, n = 1.4."""
    z = solve_path(t, x, lambda z, sign: 1.0 - np.abs(z) ** 1.4 * (2.0 + 6.0 * np.sign(z * sign)))
    return 0.7 * x + 3.0 * z


def make_dahl(t, x):
    """Dahl's friction beside a spring."""
    z = solve_path(t, x, lambda z, sign: 1.0 - 12.0 * z * sign)
    return 0.5 * x + 9.0 * z


def make_sided(t, x):
    """A spring three times as stiff for one sign, beside Dahl's friction."""
    return np.where(x > 0.0, 2.4, 0.8) * x + make_dahl(t, x) / 18.0


def make_one_sided(_t, x):
    """One-sided plays of a pressure-like input that is never negative."""
    plays, found = np.zeros(3), []
    for place in x + 1.5:
        plays = np.maximum(place - np.array([0.2, 0.6, 1.2]), np.minimum(place, plays))
        found.append(0.6 * place + float(plays @ np.array([0.5, 0.4, 0.3])))
    return np.array(found)


def make_preisach(_t, x):
    """Relays one by one, on a fine triangle, with a density that is not symmetric."""
    places = np.linspace(-1.4, 1.4, 300)
    up, down = (part.ravel() for part in np.meshgrid(places, places))
    kept = up >= down
    up, down = up[kept], down[kept]
    weights = np.exp(-((up - down) ** 2) / 0.5 - (up + down - 0.3) ** 2)
    weights *= 4.0 / weights.sum()
    relays, found = np.where(up + down > 0.0, -1.0, 1.0), []
    for place in x:
        relays = np.where(place >= up, 1.0, np.where(place <= down, -1.0, relays))
        found.append(float(relays @ weights))
    return np.array(found)


def make_skewed(t, x):
    """Bouc-Wen with the asymmetry of Wang and Wen: beta 5, gamma 2, phi 1.5."""

    def rate(z, sign):
        return 1.0 - np.abs(z) ** 1.2 * (2.0 + 5.0 * np.sign(z * sign) + 1.5 * (np.sign(sign) + np.sign(z)))

    return 0.5 * x + 3.0 * solve_path(t, x, rate)


def find_velocity(t, x):
    """Return the velocity, smooth: friction of a real machine sees no steps of it."""
    return np.gradient(x, t)


def make_lugre(t, x):
    """LuGre with Stribeck friction: a stiff equation in time."""
    v = find_velocity(t, x)

    def rate(time, z, speed=None):
        speed = np.interp(time, t, v) if speed is None else speed
        return speed - 60.0 * np.abs(speed) / (2.0 + np.exp(-((speed / 0.5) ** 2))) * z

    z = solve(rate, t)
    return 1.5 * x + 60.0 * z + 0.5 * rate(t, z, v)


def solve(rate, t):
    """Return z of dz/dt = rate(t, z) from zero, at times."""
    settings = {"t_eval": t, "method": "LSODA", "rtol": 1e-8, "atol": 1e-10, "max_step": 0.01}
    return solve_ivp(rate, (t[0], t[-1]), [0.0], **settings).y[0]


def make_attracted(t, x):
    """Generalised Maxwell-slip of Lampaert, Al-Bender and Swevers: what slips is attracted to its level."""
    v = find_velocity(t, x)
    stiffness, share, fine = np.array([60.0, 25.0, 8.0]), np.array([0.4, 0.35, 0.25]), 10
    force, sticks, found = np.zeros(3), np.ones(3, dtype=bool), [0.0]
    for k in range(1, len(t)):
        step = (t[k] - t[k - 1]) / fine
        for part in range(fine):
            speed = v[k - 1] + (v[k] - v[k - 1]) * (part + 0.5) / fine
            level = 2.0 + 0.8 * np.exp(-((speed / 0.6) ** 2))
            pull = np.sign(speed) * 40.0 * (share - np.sign(speed) * force / level)
            force = force + step * np.where(sticks, stiffness * speed, pull)
            # What slips sticks again where the motion turns back.
            sticks = (sticks & (np.abs(force) < share * level)) | (force * speed < 0.0)
        found.append(float(force.sum()))
    return 1.2 * x + np.array(found)


def make_viscous(t, x):
    """Stops beside a damper."""
    return make_stops(t, x) + 0.25 * find_velocity(t, x)


def make_lost_motion(t, x):
    """Stops behind a gap in the input, in which nothing moves."""
    behind = accumulate(x, lambda before, place: min(max(before, place - 0.06), place + 0.06), initial=0.0)
    return make_stops(t, np.array(list(behind)[1:]))


def make_relaxing(t, x):
    """Stops beside a spring behind a damper, whose force dies out in 0.4 s."""
    v = find_velocity(t, x)
    return make_stops(t, x) + solve(lambda time, force: 3.0 * np.interp(time, t, v) - force / 0.4, t)


TRUTHS = {
    "prandtl-ishlinskii": make_stops,
    "signed": make_signed,
    "modified-prandtl-ishlinskii": make_hardening,
    "nonlinear-stops": make_gap,
    "bouc-wen": make_bouc_wen,
    "dahl": make_dahl,
    "one-sided": make_one_sided,
    "krasnoselskii-pokrovskii": make_preisach,
    "asymmetric": make_skewed,
    "lugre": make_lugre,
    "maxwell-slip": make_attracted,
    "viscous": make_viscous,
}
"""Twelve elements."""
FURTHER = {"backlash": make_lost_motion, "relaxation": make_relaxing}
"""Elements with a part that any of them may have."""


def measure(t, x, truth, seed):
    """Return input and output as sensors give them: 1 % noise, 12 bits."""
    y = truth(t, x)
    y = y + 0.01 * np.std(y) * np.random.default_rng(seed).normal(size=len(y))
    steps = [np.ptp(part) / 4096 for part in (x, y)]
    return [np.round(part / step) * step for part, step in zip((x, y), steps, strict=True)]
