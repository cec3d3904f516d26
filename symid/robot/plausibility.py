"""Bodies that a robot can hardly have, and which slip of the pen would explain them.

A tree of links with their ten parameters -> sentences on masses and inertias that do not fit, with
the likely correction: other units, another order of the entries, a sign, the parallel axis theorem.

Supported: masses in g; inertias in other units of mass and length; entries in another order; signs; inertias
about the link's origin in place of the centre of mass, where all links of a robot have them.
Not supported: lengths in mm, which readers see; signs of products of inertia that leave a possible body.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from math import hypot, log, sqrt
from statistics import median
from typing import NamedTuple

import numpy as np

from symid.robot.inertia import compute_standard_parameters, explain_impossible_inertia, split_body, to_tensor

_LARGEST_MASS = 1e5
"""In kg; the heaviest robots weigh some 1e4."""
_TYPICAL_RADIUS = 0.3
"""Of gyration, in parts of a link's size: a rod has 0.29 of its length."""
_SMALLEST_RADIUS = 0.02
"""The same; grams in place of kilograms make 0.3 about 0.01. Median over the links."""
_HEAVY = 30.0
"""A link heavier than so many times all others, and as compact as above, has its mass in g."""
_LEAST_LINKS = 3
"""So many links must show a habit of the whole file."""
_MOST_OF_IT = 0.5
"""Of a rod's inertia about its end 3/4 are m c^2; a habit of the file where the median is beyond this."""
_UNITS = {
    1e-9: "g mm^2",
    1e-6: "kg mm^2, or g mm^2 beside masses in g",
    1e-4: "kg cm^2, or g cm^2 beside masses in g",
}
_ORDERS = {
    "xx yy zz xy xz yz": (0, 3, 4, 1, 5, 2),
    "xx yy zz yz xz xy": (0, 5, 4, 1, 3, 2),
    "xx xy yy xz yz zz": (0, 1, 3, 2, 4, 5),
}
"""Where ixx ixy ixz iyy iyz izz stand in six numbers that were written in another order."""
_PRODUCTS = (1, 2, 4)


def _shift_tensor(mass: float, com: Sequence[float], sign: int) -> list[float]:
    """Return what the parallel axis theorem adds to a central tensor (6,), or takes off."""
    return [sign * entry for entry in compute_standard_parameters(mass, com, [0.0] * 6)[:6]]


def _is_possible(mass: float, central: Sequence[float]) -> bool:
    return not explain_impossible_inertia((*central, 0.0, 0.0, 0.0, mass))


def explain_correction(mass: float, com: Sequence[float], stated: Sequence[float]) -> str:
    """Return which slip would explain an impossible tensor (6,), with its values, or nothing."""
    signs = [abs(entry) if k not in _PRODUCTS else entry for k, entry in enumerate(stated)]
    trials: list[tuple[str, list[float]]] = []
    if signs != [*stated]:
        trials.append(("ixx, iyy and izz without the minus are possible", signs))
    trials += [
        (f"in the order {name} the six numbers are possible", [stated[k] for k in order])
        for name, order in _ORDERS.items()
    ]
    for turns in product((1, -1), repeat=3):
        turned = [*stated]
        for k, turn in zip(_PRODUCTS, turns, strict=True):
            turned[k] *= turn
        trials.append(("with another sign of a product of inertia they are possible", turned))
    added = [a + b for a, b in zip(stated, _shift_tensor(mass, com, 1), strict=True)]
    trials.append(
        ("they are those about the centre of mass less m c^2: the shift was subtracted twice", added)
    )
    for words, entries in trials:
        if _is_possible(mass, entries):
            return f"; {words} ({', '.join(f'{entry:.4g}' for entry in entries)})"
    return ""


class PlacedBody(NamedTuple):
    """A link: the one that carries it, how far (m) its origin is from that one's, and slides; ten parameters.

    These are about its own frame, None where they are unknown.
    """

    parent: str
    length: float
    slide: float
    inertial: Sequence[float] | None


def find_implausible(links: Mapping[str, PlacedBody]) -> Iterator[tuple[str, str]]:
    """Yield links whose mass or inertia does not fit the robot, with a sentence; "" stands for all links.

    `links` have names, and stand behind those that carry them.
    """
    # How far each link's origin is from the base, and the farthest of its joints and its centre from it.
    away, sizes = dict[str, float](), dict.fromkeys(links, 0.0)
    for name, link in links.items():
        away[name] = away.get(link.parent, 0.0) + link.length + link.slide
        if link.parent in sizes:
            sizes[link.parent] = max(sizes[link.parent], link.length)
    stated = {name: link.inertial for name, link in links.items()}
    bodies = {name: body for name, body in stated.items() if body is not None and body[9] > 0.0}
    for name, body in bodies.items():
        sizes[name] = max(sizes[name], hypot(*body[6:9]) / body[9])
    reach = max((away[name] + size for name, size in sizes.items()), default=0.0)
    found: dict[str, tuple[float, float]] = {}
    about_origin, shares = list[bool](), list[float]()
    for name, parameters in bodies.items():
        mass, com, central = split_body(parameters)
        if mass > _LARGEST_MASS:
            text = f"mass: {mass:.4g} kg is more than any robot's, and its torques are too large"
            yield name, text + ("; write kg, not grams" if mass / 1000 < _LARGEST_MASS else "; correct it")
            continue
        radius = sqrt(max(float(np.linalg.eigvalsh(to_tensor(central))[-1]), 0.0) / mass) if mass else 0.0
        if not radius or not reach:
            continue
        size = sizes[name] or reach
        if radius > reach:
            text = f"inertia: a radius of gyration of {radius:.3g} m, where the robot reaches {reach:.3g} m"
            misses = {unit: abs(log(radius * sqrt(unit) / (_TYPICAL_RADIUS * size))) for unit in _UNITS}
            unit = min(misses, key=misses.__getitem__)
            yield name, f"{text}, and {radius * sqrt(unit):.2g} m if it is in {_UNITS[unit]}; correct it"
            continue
        found[name] = (mass, radius / size)
        if any(com):
            less = [a + b for a, b in zip(central, _shift_tensor(mass, com, -1), strict=True)]
            about_origin.append(_is_possible(mass, central) and _is_possible(mass, less))
            shares.append(float(np.dot(com, com)) / radius**2)
    compact = [ratio for _, ratio in found.values()]
    if len(compact) >= _LEAST_LINKS and median(compact) < _SMALLEST_RADIUS:
        text = f"radii of gyration are {median(compact):.2g} of the links' sizes (median)"
        yield "", f"{text}, and 30 times as large if masses are in g; write kg"
        return
    for name, (mass, ratio) in found.items():
        others = sum(other for key, (other, _) in found.items() if key != name)
        if others and mass > _HEAVY * others and ratio < _SMALLEST_RADIUS * 2:
            text = f"mass: {mass:.4g} kg, and all other links together have {others:.3g} kg"
            yield name, f"{text}, so torques are wrong: write kg, not grams"
    if len(shares) >= _LEAST_LINKS and all(about_origin) and median(shares) > _MOST_OF_IT:
        text = "all inertias are so large that they may be those about the links' origins, which makes "
        yield "", f"{text}torques too large; write those about centres of mass (I - m c^2 is possible)"
