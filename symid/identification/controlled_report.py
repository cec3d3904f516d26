"""What simulated runs of a controlled robot were made with, and how near they came to the real ones.

Input: a fit of such runs, controllers, recordings. Output: entries of `settings.fit`, notices.

Where the simulated robot is further from the measured positions than a tenth of what the controller leaves
between these and its reference, the controller is another one.

Supported: several recordings; the controller's numbers are listed once, what came from a log for each.
Not supported: saying which gain is the wrong one.
"""

from collections.abc import Sequence

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.library import Library
from symid.data.recording import Recording
from symid.data.signals import decimate_columns
from symid.errors import Notice
from symid.formats.controller import list_controller
from symid.identification.controlled_runs import ControlledFit
from symid.identification.servo import ServoLoop, find_demand
from symid.robot.controller import Controller
from symid.robot.log_map import Processing

__all__ = [
    "describe_controller",
    "describe_tracking",
    "find_controller_residual",
    "warn_of_tracking",
]

_FAR = 0.1
"""Simulated positions may be this part of the tracking error away from the measured ones."""


def describe_tracking(library: Library, found: ControlledFit) -> dict[str, object]:
    """Return how many simulations it took, and how far positions are apart, joint by joint."""
    joints = library.card.joints
    return {
        "iterations": found.iterations,
        "changes": list(found.changes),
        "tracking": [
            {
                "joint": joint.name,
                "unit": joint.position_unit,
                "simulated_from_measured": gap,
                "reference_from_measured": lag,
            }
            for joint, gap, lag in zip(joints, found.tracking.tolist(), found.lag.tolist(), strict=True)
        ],
    }


def describe_controller(
    controller: Controller, loops: Sequence[ServoLoop], recordings: Sequence[Recording]
) -> dict[str, object]:
    """Return what the controller was: as stated, and what came from the logs; gains in SI units."""
    stated = list_controller(controller)
    numbers = {key: list(map(float, stated[key])) for key in ("stiffness", "damping")}
    logged = all(recording.reference_velocity is not None for recording in recordings)
    return {
        **stated,
        **numbers,
        "velocity_filter": controller.velocity_filter,
        "offset": [loop.offset.tolist() for loop in loops],
        "offset_from": "log" if controller.offset is None else "robot file",
        "reference_velocity": (
            "none" if controller.velocity == "measured" else "logged" if logged else "differentiated"
        ),
        "torque_limit": [entry if np.isfinite(entry) else None for entry in loops[0].limit.tolist()],
    }


def find_controller_residual(
    loops: Sequence[ServoLoop], recordings: Sequence[Recording], processing: Processing
) -> list[float]:
    """Return (n,) percent of the logged torque that the controller does not ask for at measured positions."""
    missing: list[FloatArray] = []
    whole: list[FloatArray] = []
    for loop, recording in zip(loops, recordings, strict=True):
        gap = recording.torque - find_demand(loop, recording)
        missing.append(decimate_columns(gap, processing.decimation))
        whole.append(decimate_columns(recording.torque, processing.decimation))
    size = np.linalg.norm(np.vstack(whole), axis=0)
    share = 100.0 * np.linalg.norm(np.vstack(missing), axis=0) / np.where(size > 0.0, size, 1.0)
    percents: list[float] = share.tolist()
    return percents


def warn_of_tracking(found: ControlledFit, unexplained: Sequence[float], price: str) -> tuple[Notice, ...]:
    """Return a notice where the simulation follows its reference in another way than the log does.

    Args:
        found: the fit.
        unexplained: (n,) percent of the torque, of `find_controller_residual`.
        price: what follows for the parameters.
    """
    joints = [
        index
        for index, (gap, lag) in enumerate(zip(found.tracking.tolist(), found.lag.tolist(), strict=True))
        if gap > _FAR * lag
    ]
    if not joints:
        return ()
    told = ", ".join(
        f"{found.rows.group_names[index]!r} {found.tracking[index]:.2g} "
        f"{found.rows.velocity_units[index].removesuffix('/s')} ({found.lag[index]:.2g})"
        for index in joints
    )
    missed = ", ".join(f"{unexplained[index]:.3g} %" for index in joints)
    text = (
        "the simulated robot is far from the measured positions, beside how far these are from their "
        f"reference (in brackets): {told}; model and controller do not track as the log does, and {price}; "
        f"at the measured positions the controller as stated misses {missed} of the logged torque; check "
        "its gains, velocity and filter, integral parts, feed-forward, and the side of the gear"
    )
    return (Notice(code="identify.tracking", text=text),)
