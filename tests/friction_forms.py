"""Every static friction law by its own formula, written anew, with values that suit it."""

import math
import re

import numpy as np

from symid.joint_models.carriers import OperatorCarrier
from symid.joint_models.friction_catalogue import FRICTION_LAWS, get_law

VELOCITIES = np.array([-2.0, -0.3, -0.05, -0.011, -0.004, 0.0, 1e-6, 0.002, 0.01, 0.0301, 0.2, 1.7])
VALUES = {"fC": 11.0, "fS": 23.0, "vs": 0.028, "gamma": 1.7, "fV": 28.0, "dq0": 0.01, "dqs": 0.02}
VALUES |= {"fP": -3.3, "g2": 90.0, "g3": 12.0, "g5": 130.0, "delta": 0.6, "fL": 0.03, "fLS": 0.05}
VALUES |= {"fCT": -0.08, "fVT": -0.3, "fVL": 60.0, "TV": 22.0}
"""By the names that papers print; others get numbers of their own."""
VARIANTS = (
    *("coulomb+offset", "asymmetric+offset", "tustin+offset", "stribeck+offset", "lorentzian+offset"),
    *("stribeck-1.6", "stribeck-1.6+offset", "stribeck-exponent+offset", "stribeck-0.7"),
    *("stribeck-1+cubic", "stribeck-1.6+cubic", "stribeck-exponent+cubic", "stribeck+cubic+offset"),
    *("improved-stribeck-1.6", "improved-stribeck+offset", "improved-stribeck-h2-exponent"),
    *("improved-stribeck-h3-1", "improved-stribeck-h3-exponent", "improved-stribeck-h4-1.6"),
    *("improved-stribeck-h4-exponent", "asymmetric-stribeck-0.7", "asymmetric-stribeck-exponent"),
    *("asymmetric-stribeck-1+offset", "asymmetric-stribeck-both-1.6", "asymmetric-stribeck-both-exponent"),
    *("polynomial-2", "polynomial-3", "polynomial-3,2", "polynomial-4", "polynomial-5,2+offset"),
    *("cubic+offset", "power-law+offset", "makkar+offset", "load-dependent+offset"),
    *("load-dependent-stribeck-1", "load-dependent-stribeck-exponent", "load-dependent-stribeck+offset"),
    *("position-dependent-3", "position-dependent-1,3x100.5", "position-torque-2x0.5+offset"),
    *("temperature+offset", "temperature-viscous+offset"),
)
"""Laws beside the catalogue's entries: with an offset, an exponent, other orders."""
EVERY_LAW = (*FRICTION_LAWS, *VARIANTS)
OLD_NAMES = {
    "viscous_coulomb": "coulomb-viscous",
    "viscous_coulomb_offset": "coulomb-viscous-offset",
    "asymmetric": "asymmetric",
    "stribeck": "stribeck",
    "stribeck_offset": "stribeck+offset",
    "improved_stribeck": "improved-stribeck",
    "asymmetric_stribeck": "asymmetric-stribeck",
    "cubic": "cubic",
    "stribeck_cubic": "stribeck+cubic",
    "power_law": "power-law",
    "makkar": "makkar",
}
"""Laws by the names that earlier robot files have for them."""


def prepare(law, velocities=VELOCITIES):
    """Return inputs and physical values that suit a law; every value is another one."""
    count = len(velocities)
    inputs = {
        "velocity": np.asarray(velocities, dtype=float),
        "load": np.linspace(-20, 31, count),
        "position": np.linspace(-3, 5, count),
        "temperature": np.linspace(12, 75, count),
    }
    values = [VALUES.get(p.name, 1.0 + 0.37 * k) for k, p in enumerate(law.physical)]
    return {name: inputs[name] for name in law.inputs}, values


def build_carrier(library, number, **others):
    """Return a carrier of the numbers of a library; `others` are functions of other names there."""
    functions = {name: getattr(library, name) for name in ("exp", "tanh", "sin", "cos", "sign")}
    return OperatorCarrier(zero=number(0), one=number(1), **functions, **others)


def curve(p, speed):
    """Return Stribeck's curve at speed >= 0."""
    return p["fC"] + (p["fS"] - p["fC"]) * fall(p, speed) + p["fV"] * speed


def fall(p, v):
    return math.exp(-((abs(v) / p["vs"]) ** p.get("gamma", 2.0)))


def improved(p, v, reading=1):
    """Readings H1 and H2, by case."""
    edge, bias = p["dq0"], p["fP"]
    if abs(v) >= edge:
        return (bias if reading == 1 else 0.0) + curve(p, abs(v)) * np.sign(v)
    return bias + (np.sign(v) * curve(p, edge) - (0.0 if reading == 1 else bias)) * abs(v) / edge


def side(p, v, name):
    return p[name + ("p" if v > 0 else "n")]


def loaded(p, v, load):
    kinetic, static = p["fC"] + p["fL"] * abs(load), p["fS"] + p["fLS"] * abs(load)
    return (kinetic + (static - kinetic) * fall(p, v) + p["fV"] * abs(v)) * np.sign(v)


def waves(p, angle, gear=1.0):
    """Return the sum of all A and B of `p`."""
    parts = {"A": math.cos, "B": math.sin}
    found = [re.fullmatch(r"([AB])(\d+)", name) for name in p]
    return sum(p[m[0]] * parts[m[1]](int(m[2]) * gear * angle) for m in found if m)


def makkar(p, v):
    bump = p["fM"] * (math.tanh(p["g2"] * v) - math.tanh(p["g3"] * v))
    return bump + p["fC"] * math.tanh(p["g5"] * v) + p["fV"] * v


def polynomial(p, v):
    """Return the terms beyond the first order."""
    orders = [int(name[2:]) for name in p if re.fullmatch(r"fV\d", name)]
    return sum(p[f"fV{order}"] * abs(v) ** order * np.sign(v) for order in orders)


def plain(p, v):
    return p["fC"] * np.sign(v) + p["fV"] * v


def asymmetric(p, v, bump=0.0):
    return (side(p, v, "fC") + bump + side(p, v, "fV") * abs(v)) * np.sign(v)


# The torque of each law from its physical parameters p, at v and the other inputs x.
FORMS = {
    "coulomb": lambda p, v, _: p["fC"] * np.sign(v),
    "coulomb-viscous": lambda p, v, _: plain(p, v),
    "coulomb-viscous-offset": lambda p, v, _: plain(p, v) + p["offset"],
    "asymmetric": lambda p, v, _: asymmetric(p, v),
    "tustin": lambda p, v, _: curve({**p, "gamma": 1.0}, abs(v)) * np.sign(v),
    **dict.fromkeys(("stribeck", "stribeck-exponent"), lambda p, v, _: curve(p, abs(v)) * np.sign(v)),
    "stribeck+cubic": lambda p, v, _: curve(p, abs(v)) * np.sign(v) + polynomial(p, v),
    "lorentzian": lambda p, v, _: plain(p, v) + (p["fS"] - p["fC"]) / (1 + (v / p["vs"]) ** 2) * np.sign(v),
    **dict.fromkeys(("improved-stribeck", "improved-stribeck-exponent"), lambda p, v, _: improved(p, v)),
    "improved-stribeck-h2": lambda p, v, _: improved(p, v, 2),
    "improved-stribeck-h3": lambda p, v, _: p["fP"] + curve(p, abs(v)) * np.sign(v),
    "improved-stribeck-h4": lambda p, v, _: p["fP"] + curve(p, abs(v - p["dqs"])) * np.sign(v - p["dqs"]),
    "asymmetric-stribeck": lambda p, v, _: asymmetric(p, v, p["fE"] * fall(p, v)),
    "asymmetric-stribeck-both": lambda p, v, _: asymmetric(
        p, v, (side(p, v, "fS") - side(p, v, "fC")) * fall(p, v)
    ),
    "cubic": lambda p, v, _: plain(p, v) + polynomial(p, v),
    "power-law": lambda p, v, _: (p["fC"] + p["fD"] * abs(v) ** p["delta"]) * np.sign(v),
    "makkar": lambda p, v, _: makkar(p, v),
    "load-dependent": lambda p, v, x: plain(p, v) + p["fL"] * abs(x["load"]) * np.sign(v),
    "load-dependent-stribeck": lambda p, v, x: loaded(p, v, x["load"]),
    "position-dependent": lambda p, v, x: plain(p, v) + waves(p, x["position"], x["gear"]) * np.sign(v),
    "position-torque": lambda p, v, x: plain(p, v) + waves(p, x["position"], x["gear"]),
    "temperature": lambda p, v, x: (
        (p["fC"] + p["fCT"] * (x["temperature"] - 40)) * np.sign(v)
        + (p["fV"] + p["fVT"] * (x["temperature"] - 40)) * v
    ),
    "temperature-viscous": lambda p, v, x: (
        p["fC"] * np.sign(v) + (p["fV"] + p["fVL"] * math.exp(-x["temperature"] / p["TV"])) * v
    ),
}


def find_torque(name, p, v, **x):
    """Return the torque of a law, or of one of the `VARIANTS`, for one sample, by its own formula."""
    if name.endswith("+offset"):
        return find_torque(name.removesuffix("+offset"), p, v, **x) + p["offset"]
    if waving := re.fullmatch(r"(position-\w+)-[\d,]+(?:x([\d.]+))?", name):
        return find_torque(waving[1], p, v, **x, gear=float(waving[2] or 1.0))
    if name.startswith("polynomial-"):
        return find_torque("cubic", p, v, **x)
    if raised := re.fullmatch(r"([a-z-]*stribeck(?:-both|-h\d)?)-(exponent|[\d.]+)(\+cubic)?", name):
        exponent = {} if raised[2] == "exponent" else {"gamma": float(raised[2])}
        return find_torque(raised[1] + (raised[3] or ""), {**p, **exponent}, v, **x)
    return float(FORMS[name](p, v, {"gear": 1.0, **x}))


def find_linear_torque(name, linear, shape, v, **x):
    """Return the same from linear parameters and shape values."""
    law = get_law(name)
    printed = law.to_physical(linear, shape)
    named = {entry.name: value for entry, value in zip(law.physical, printed, strict=True)}
    return find_torque(name, named, v, **x)


def give_shape(name, scale=1.0):
    """Return shape values that suit a law, at speeds `scale` times as fast."""
    powers = {"rad/s": 1, "s/rad": -1}
    return tuple(VALUES[entry.name] * scale ** powers.get(entry.unit, 0) for entry in get_law(name).shape)
