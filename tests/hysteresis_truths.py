"""Recordings of elements, from integrators that are not symid's: uneven, noisy, quantised."""

import numpy as np
from scipy.integrate import solve_ivp


def make_input(seed, amplitude=1.0, count=4000):
    """Return time (s) and a sweep whose amplitude goes up and down, at uneven times."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.5, 1.5, count)) * 6e-3
    swell = 0.15 + 0.85 * np.sin(np.pi * t / t[-1]) ** 2
    return t, amplitude * swell * (np.sin(2.1 * t) + 0.25 * np.sin(5.3 * t + 1.0)) / 1.25


def slide(x, stiffness, threshold):
    """Return springs behind sliders, one sample after the other."""
    deflection, before, total = np.zeros(len(stiffness)), 0.0, []
    for place in x:
        deflection = np.clip(deflection + place - before, -np.array(threshold), threshold)
        before = place
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


def make_stops(t, x):
    """Four springs behind sliders."""
    del t
    return 0.8 * x + slide(x, [2.0, 1.5, 0.7], [0.05, 0.2, 0.5])


def make_signed(t, x):
    """Plays of either sign: a loop that turns its sense."""
    del t
    return 4.0 * x - slide(x, [1.0], [0.1]) + slide(x, [0.8], [0.4])


def make_hardening(t, x):
    """Stops behind an outer function that is steeper far from zero, and not odd."""
    v = make_stops(t, x)
    return v + 0.8 * np.maximum(v - 0.8, 0.0) + 0.5 * np.minimum(v + 0.6, 0.0)


def make_gap(t, x):
    """A slider behind a spring that has a gap."""
    del t
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


TRUTHS = {
    "prandtl-ishlinskii": make_stops,
    "signed": make_signed,
    "modified-prandtl-ishlinskii": make_hardening,
    "nonlinear-stops": make_gap,
    "bouc-wen": make_bouc_wen,
    "dahl": make_dahl,
}


def measure(t, x, truth, seed):
    """Return input and output as sensors give them: 1 % noise, 12 bits."""
    y = truth(t, x)
    y = y + 0.01 * np.std(y) * np.random.default_rng(seed).normal(size=len(y))
    steps = [np.ptp(part) / 4096 for part in (x, y)]
    return [np.round(part / step) * step for part, step in zip((x, y), steps, strict=True)]
