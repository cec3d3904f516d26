"""Friction laws with a state: tables of robot files, a pendulum, and their equations written anew."""

import math

import numpy as np

ARM = """
name = "arm"
convention = "modified"
gravity = [0, -9.81, 0]
[[joint]]
name = "a"
kind = "revolute"
[joint.link]
mass = 2.0
com = [0.2, 0.0, 0.0]
inertia = {{ xx = 0.01, yy = 0.02, zz = 0.03 }}
[joint.friction]
{friction}
"""
"""Robot file of a pendulum, whose friction is to be filled in."""
STATES = {
    "dahl": {"sigma0": 2e4},
    "lugre": {"sigma0": 1e4, "sigma1": 30.0},
    "maxwell-slip": {"stiffness": [3e3, 1e3, 400.0], "share": [0.5, 0.3, 0.2]},
    "generalised-maxwell-slip": {"stiffness": [3e3, 1e3], "share": [0.6, 0.4]},
}
STEADY = {"Fv": 1.1, "Fc": 2.0}
BEND = {"Fe": 0.7, "vs": 0.1, "gamma": 1.4}
LAWS = (*STATES, "lugre+offset")


def give_values(name):
    """Return the values of a law as robot files name them."""
    plain = name.removesuffix("+offset")
    offset = {"offset": 0.2} if name != plain else {}
    bend = BEND if plain in {"lugre", "generalised-maxwell-slip"} else {}
    fe = {"Fe": bend["Fe"]} if bend else {}
    return {**STEADY, **fe, **offset, **{k: v for k, v in bend.items() if k != "Fe"}, **STATES[plain]}


def write_table(name, **changed):
    """Return the friction table of a law in TOML."""
    pairs = (give_values(name) | changed).items()
    return "\n".join([f'model = "{name}"', *(f"{key} = {value}" for key, value in pairs)])


def print_values(name):
    """Return the values of a law under the names that papers print, elements numbered."""
    p = give_values(name)
    found = {"fC": p.pop("Fc"), "fV": p.pop("Fv")}
    found |= {"fS": found["fC"] + p.pop("Fe")} if "Fe" in p else {}
    for key, value in p.items():
        numbered = enumerate(value, start=1) if isinstance(value, list) else [("", value)]
        found |= {f"{key}{number}": each for number, each in numbered}
    return found


def find_level(p, v):
    """Return g(v), N m."""
    bend = p.get("Fe", 0.0)
    return p["Fc"] + (bend * math.exp(-((abs(v) / p["vs"]) ** p["gamma"])) if bend else 0.0)


def find_rate(p, v, z):
    """Return dz/dt of bristles."""
    return v - p["sigma0"] * abs(v) / find_level(p, v) * z


def find_torque(p, v, z):
    """Return friction at deflections z, a list."""
    torque = p["Fv"] * v + p.get("offset", 0.0)
    if "sigma0" in p:
        return torque + p["sigma0"] * z[0] + p.get("sigma1", 0.0) * find_rate(p, v, z[0])
    return torque + sum(k * bent for k, bent in zip(p["stiffness"], z, strict=True))


def take_step(p, v, h, z):
    """Return friction and deflections after h at v, from z: the solution while v is held."""
    level = find_level(p, v)
    if "sigma0" in p:
        rate = p["sigma0"] * abs(v) / level
        rest = np.sign(v) * level / p["sigma0"]
        after = [rest + (z[0] - rest) * math.exp(-rate * h)]
    else:
        most = [share * level / k for k, share in zip(p["stiffness"], p["share"], strict=True)]
        after = [min(max(bent + v * h, -end), end) for bent, end in zip(z, most, strict=True)]
    return find_torque(p, v, after), after


def count_deflections(name):
    """Return how many numbers a law remembers."""
    return len(STATES[name.removesuffix("+offset")].get("stiffness", [0.0]))
