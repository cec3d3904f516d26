"""Joints that stick: rows at standstill that leave far more than those in motion.

Input: rows and their fit, the library. Output: a notice that says how to leave these rows out.

A joint that sticks holds any torque up to its break-away, which no function of velocity explains. In a fit
that keeps such rows they pull at all parameters, and in a weighted one they make their joint look noisy.

Supported: torque, momentum and filtered rows of joints with friction.
Not supported: rows of all joints together.
"""

import numpy as np

from symid.codegen.library import Library
from symid.errors import Notice
from symid.estimators.regression import Fit
from symid.rows.rows import SCALAR_KINDS, Rows

__all__ = ["warn_of_sticking"]

_SLOW = 0.02
"""Of the top speed, below which a joint may stick."""
_TOP = 0.99
"""Quantile of the speed that is called the top one."""
_RATIO = 2.0
_FEWEST = 30


def warn_of_sticking(rows: Rows, fit: Fit, library: Library) -> tuple[Notice, ...]:
    """Return a notice where joints leave more than twice as much at standstill as in motion.

    Args:
        rows: the equations; their velocities are those of joints, or means over windows.
        fit: its residuals.
        library: whose card says which joints have friction.
    """
    if rows.kind in SCALAR_KINDS:
        return ()
    braked = {joint.name for joint in library.card.joints if joint.friction != "none"}
    found = [
        (name, *told)
        for index, name in enumerate(rows.group_names)
        if name in braked and (told := _compare(rows, fit, index)) is not None
    ]
    if not found:
        return ()
    joints = ", ".join(f"{name} ({ratio:.1f} times)" for name, ratio, _ in found)
    speed = min(slow for _, _, slow in found)
    text = (
        f"rows slower than {100.0 * _SLOW:g} % of the top speed leave more than faster ones: {joints}; "
        "joints that stick hold torques that no friction model explains, and pull at all parameters; leave "
        f"such rows out with --set processing.standstill={speed:.2g} (rad/s or m/s, of all joints)"
    )
    return (Notice(code="identify.sticking", text=text),)


def _compare(rows: Rows, fit: Fit, group: int) -> tuple[float, float] | None:
    """Return how much more a joint leaves at standstill, and the speed below which; None if it does not."""
    members = rows.group == group
    speed, residual = np.abs(rows.velocity[members]), fit.residuals[members]
    if len(speed) < 2 * _FEWEST:
        return None
    limit = _SLOW * float(np.quantile(speed, _TOP))
    slow = speed < limit
    if min(int(slow.sum()), int((~slow).sum())) < _FEWEST:
        return None
    still, moving = (float(np.sqrt(np.mean(residual[part] ** 2))) for part in (slow, ~slow))
    return (still / moving, limit) if still > _RATIO * moving > 0.0 else None
