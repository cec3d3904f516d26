"""Mass, centre of mass and inertia of a link, and its ten standard parameters.

Input: numbers. Output: XX XY XZ YY YZ ZZ MX MY MZ M about the origin of a frame, where XY, XZ, YZ are entries
of the inertia tensor (XY = - integral of x y dm).

Supported: any frame on the link, the test whether a mass distribution exists.
Not supported: masses that are not positive.
"""

from collections.abc import Sequence

import numpy as np

from symid.arrays import FloatArray

__all__ = ["find_impossibility", "find_standard_parameters", "move_parameters"]

# A flat or thin link sits on the edge of what is possible; rounding of its decimals may cross it.
_TOLERANCE = 1e-6


def _to_tensor(entries: Sequence[float]) -> FloatArray:
    xx, xy, xz, yy, yz, zz = entries
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=np.float64)


def move_parameters(
    parameters: Sequence[float], rotation: FloatArray, translation: FloatArray
) -> tuple[float, ...]:
    """Return the ten parameters seen from another frame (theorem of Huygens and Steiner).

    I' = R I R^T + 2 (p.s) 1 - p s^T - s p^T + M (p.p 1 - p p^T),  s = R l,  l' = s + M p.

    Args:
        parameters: (10,) about the old frame's origin, in its axes.
        rotation: (3, 3) R, the old frame's axes in the new frame.
        translation: (3,) p, the old frame's origin in the new frame, m.
    """
    mass = float(parameters[9])
    p = np.asarray(translation, dtype=np.float64)
    s = rotation @ np.asarray(parameters[6:9], dtype=np.float64)
    tensor = rotation @ _to_tensor(parameters[:6]) @ rotation.T
    tensor = tensor + 2 * (p @ s) * np.eye(3) - np.outer(p, s) - np.outer(s, p)
    tensor = tensor + mass * ((p @ p) * np.eye(3) - np.outer(p, p))
    moments = s + mass * p
    entries = (*tensor[np.triu_indices(3)], *moments, mass)
    return tuple(float(entry) + 0.0 for entry in entries)


def find_standard_parameters(
    mass: float, com: Sequence[float], inertia: Sequence[float]
) -> tuple[float, ...]:
    """Return the ten parameters of a link with the given centre of mass.

    Args:
        mass: kg.
        com: (3,) centre of mass in the link's frame, m.
        inertia: (6,) xx xy xz yy yz zz about the centre of mass, along the frame's axes, kg m^2.
    """
    central = (*inertia, 0.0, 0.0, 0.0, mass)
    return move_parameters(central, np.eye(3), np.asarray(com, dtype=np.float64))


def find_impossibility(parameters: Sequence[float]) -> str:
    """Return what keeps the ten parameters from belonging to a body of positive mass, or nothing.

    The principal moments J about the centre of mass must be positive, or zero, and none may exceed the
    sum of the others; equivalently the second moments are a positive semi-definite matrix
    (Wensing, Kim and Slotine 2018, IEEE Robotics and Automation Letters 3(1)).
    """
    mass = parameters[9]
    com = np.asarray(parameters[6:9], dtype=np.float64) / mass
    about_com = move_parameters(parameters, np.eye(3), -com)
    moments = np.linalg.eigvalsh(_to_tensor(about_com[:6]))
    allowed = _TOLERANCE * max(float(np.abs(parameters[:6]).max()), 1e-300)
    low, middle, high = (float(moment) for moment in moments)
    listed = f"{low:.6g}, {middle:.6g} and {high:.6g} kg*m^2"
    if low < -allowed:
        return f"the principal moments about the centre of mass are {listed}, and none can be negative"
    if high > low + middle + allowed:
        text = "and none can exceed the sum of the others"
        return f"the principal moments about the centre of mass are {listed}, {text}"
    return ""
