"""What changed between two sets of base values, and by how many standard deviations.

Input: base values of the same robot with and without a payload. Output: `Change`, the surest first.

Supported: base parameters beyond what a payload explains; friction.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.parameters.base import BaseParameters
from symid.parameters.payload_equations import BaseValues, System, find_whitening, select_values

__all__ = ["Change", "list_friction_changes", "list_unexplained"]

_CHANGED = 4.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """A parameter that changed: from, to, and by how many standard deviations."""

    name: str
    before: float
    after: float
    deviations: float


def _list_changes(loaded: BaseValues, empty: BaseValues, shares: FloatArray) -> tuple[Change, ...]:
    rows: Sequence[tuple[str, float, float, float]] = list(
        zip(loaded.names, empty.values.tolist(), loaded.values.tolist(), shares.tolist(), strict=True)
    )
    changes = [
        Change(name=name, before=before, after=after, deviations=share)
        for name, before, after, share in rows
        if abs(share) > _CHANGED
    ]
    return tuple(sorted(changes, key=lambda change: -abs(change.deviations)))


def list_unexplained(
    system: System, left: FloatArray, loaded: BaseValues, empty: BaseValues
) -> tuple[Change, ...]:
    """Return base parameters whose change the payload does not explain; `left` (m,) are its rows."""
    names = [name for name in system.names if name in loaded.names]
    after, before = select_values(loaded, names), select_values(empty, names)
    covariance = after.covariance + before.covariance
    # What is left, back in units of the parameters, over their own deviations.
    remaining = np.linalg.solve(find_whitening(covariance), left[: len(names)])
    return _list_changes(after, before, remaining / np.sqrt(np.diag(covariance)))


def list_friction_changes(base: BaseParameters, loaded: BaseValues, empty: BaseValues) -> tuple[Change, ...]:
    """Return friction parameters that changed."""
    names = [
        entry.name for entry in base.friction if entry.name in loaded.names and entry.name in empty.names
    ]
    after, before = select_values(loaded, names), select_values(empty, names)
    deviations = np.sqrt(np.diag(after.covariance) + np.diag(before.covariance))
    sure = np.isfinite(deviations) & (deviations > 0)
    shares = np.where(sure, (after.values - before.values) / np.where(sure, deviations, 1.0), 0.0)
    return _list_changes(after, before, shares)
