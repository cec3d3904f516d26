"""States for the recursion over arrays of doubles: what tests check formulas and code against."""

import numpy as np

from symid.dynamics.algebra import RobotState


def build_float_state(q, dq, ddq):
    """Return the coordinates from arrays (n, ...) in rad or m and their derivatives."""
    return RobotState(
        sine=tuple(np.sin(q)),
        cosine=tuple(np.cos(q)),
        position=tuple(q),
        velocity=tuple(dq),
        acceleration=tuple(ddq),
    )
