"""The rigid part of a joint's torque, and friction of others: columns that stand beside its own friction.

Input: a library, filtered states. Output: `RigidColumns`, those of them that these motions tell apart.

Supported: J ddq + a sin q + b cos q, where it says the same as the regressor; drives that turn with several
joints.
Not supported: elastic joints.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.codegen.functions import JointCard
from symid.codegen.library import Library
from symid.data.recording import Signals
from symid.errors import Notice

__all__ = [
    "RigidColumns",
    "find_independent",
    "find_load",
    "find_other_columns",
    "find_rigid_columns",
    "reduce_columns",
    "warn_of_many",
]

_DEPENDENT = 1e-6
"""What is left of a column beyond those before it, relative to its length, below which it is dependent."""
_ZERO = 1e-10
"""Length of a column relative to the longest below which it counts as zero."""
_MANY = 6
"""Columns of a rigid part fitted along beyond which they take more of friction than is good."""
_LOADED = 0.5
"""Part of the squared torque beside friction that a rigid part leaves at most where it counts as a load."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigidColumns:
    """Columns (N, k) with the names and units of what multiplies them."""

    columns: FloatArray
    names: tuple[str, ...]
    units: tuple[str, ...]

    def keep(self, index: Sequence[int]) -> "RigidColumns":
        """Return the columns of these numbers."""
        return RigidColumns(
            columns=self.columns[:, list(index)],
            names=tuple(self.names[k] for k in index),
            units=tuple(self.units[k] for k in index),
        )


def find_rigid_columns(library: Library, parts: Sequence[Signals], joint: int) -> RigidColumns:
    """Return the joint's row of the torque regressor."""
    rows = [library.evaluate("torque_regressor", part.q, part.dq, part.ddq)[0][:, joint] for part in parts]
    beta = library.card.beta
    return RigidColumns(
        columns=np.vstack(rows),
        names=tuple(entry.name for entry in beta),
        units=tuple(entry.unit for entry in beta),
    )


def find_other_columns(library: Library, parts: Sequence[Signals], joint: int) -> RigidColumns:
    """Return columns of friction that is not the joint's own and acts on it nevertheless."""
    cards = library.card.friction
    own = library.card.joints[joint].name
    index = [k for k, entry in enumerate(cards) if entry.joint != own]
    if not index:
        count = sum(len(part.time) for part in parts)
        return RigidColumns(columns=np.empty((count, 0)), names=(), units=())
    rows = [library.evaluate("friction_regressor", part.dq)[0][:, joint] for part in parts]
    columns = RigidColumns(
        columns=np.vstack(rows)[:, index],
        names=tuple(cards[k].name for k in index),
        units=tuple(cards[k].unit for k in index),
    )
    return columns.keep(find_independent(columns.columns))


def reduce_columns(
    rigid: RigidColumns, angle: FloatArray, acceleration: FloatArray, card: JointCard
) -> tuple[RigidColumns, str]:
    """Return the columns that these motions tell apart, and a sentence on them."""
    physical = _name_physical(rigid.columns, angle, acceleration, card)
    chosen = rigid if physical is None else physical
    chosen = chosen.keep(find_independent(chosen.columns))
    return chosen, _describe_rigid(chosen.names, physical=physical is not None)


def find_independent(columns: FloatArray, limit: float = _DEPENDENT) -> list[int]:
    """Return which columns of (N, p) are no combination of those before them, in their order.

    Args:
        columns: any unit.
        limit: what must be left of a column beyond those before it, relative to its length.
    """
    lengths = np.linalg.norm(columns, axis=0)
    basis: list[FloatArray] = []
    kept = []
    # What rounding leaves of a column of zeros is no column.
    least = _ZERO * max(float(lengths.max(initial=0.0)), float(np.finfo(float).tiny))
    for k, length in enumerate(lengths):
        if length <= least:
            continue
        rest = columns[:, k] / length
        for _ in range(2):  # once more takes out what rounding left
            for direction in basis:
                rest = rest - direction * (direction @ rest)
        size = float(np.linalg.norm(rest))
        if size > limit:
            basis.append(rest / size)
            kept.append(k)
    return kept


def _name_physical(
    rigid: FloatArray, angle: FloatArray, acceleration: FloatArray, card: JointCard
) -> RigidColumns | None:
    """Return J ddq, a sin q, b cos q where they span what the regressor's columns span, else None."""
    turning = card.kind != "prismatic"
    candidates = [("J", acceleration, "kg m^2" if turning else "kg")]
    if turning:
        candidates += [("a", np.sin(angle), "N m"), ("b", np.cos(angle), "N m")]
    independent = find_independent(rigid)
    base = rigid[:, independent]
    inside = [
        entry
        for entry in candidates
        if len(find_independent(np.column_stack([base, entry[1]]))) == len(independent)
    ]
    columns = np.column_stack([np.empty((len(angle), 0)), *(entry[1] for entry in inside)])
    if len(find_independent(columns)) != len(independent):
        return None
    names, units = (tuple(str(entry[place]) for entry in inside) for place in (0, 2))
    return RigidColumns(columns=columns, names=names, units=units)


def warn_of_many(joint: str, columns: int) -> tuple[Notice, ...]:
    """Return a notice where a rigid part has so many columns that it passes for friction."""
    if columns <= _MANY:
        return ()
    text = (
        f"joint {joint!r}: {columns} columns of a rigid part were fitted along, which can pass for friction; "
        "move one joint at a time, or identify the base parameters of all joints first and give them with "
        "--known"
    )
    return (Notice(code="friction.many-columns", text=text),)


def _describe_rigid(names: Sequence[str], *, physical: bool) -> str:
    """Return how the rigid part was treated."""
    if not names:
        return "no rigid part acts on this joint in these motions"
    if physical:
        terms = {"J": "J ddq", "a": "a sin q", "b": "b cos q"}
        return f"the rigid part {' + '.join(terms[name] for name in names)} was fitted along"
    return (
        f"a rigid part of {len(names)} columns was fitted along; each stands for those that these motions do "
        "not tell apart from it"
    )


def find_load(rigid: FloatArray, velocity: FloatArray, torque: FloatArray) -> FloatArray | None:
    """Return the torque of the links (N,), by a fit with plain Coulomb, viscous and constant friction.

    None where it explains too little of the torque to be known: noise would pass for a load.
    """
    if not rigid.shape[1]:
        return None
    friction = np.column_stack([velocity, np.sign(velocity), np.ones(len(velocity))])
    columns = np.hstack([rigid, friction])
    solution = np.linalg.lstsq(columns, torque, rcond=None)[0]
    alone = np.linalg.lstsq(friction, torque, rcond=None)[0]
    left, without = (
        float(np.sum((torque - matrix @ values) ** 2))
        for matrix, values in ((columns, solution), (friction, alone))
    )
    if left > _LOADED * without:
        return None
    return freeze(rigid @ solution[: rigid.shape[1]])
