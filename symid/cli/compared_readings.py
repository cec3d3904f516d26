"""Terms that groups of others may hold without naming them, tried on the values of both sides.

Input: our side, groups and values of the others. Output: readings with what was found of each.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from symid.cli.compared_side import OurSide

if TYPE_CHECKING:  # these load numpy and sympy
    from sympy import Expr

    from symid.arrays import FloatArray
    from symid.identification.comparison import StatedValues, TriedReading
    from symid.parameters.readings import OpenReading

__all__ = ["try_readings"]


_Found = list[tuple["OpenReading", "TriedReading"]]


def try_readings(
    ours: OurSide, rows: Sequence[tuple["Expr", ...]], change: "FloatArray", theirs: "StatedValues"
) -> tuple[tuple["OpenReading", "TriedReading"], ...]:
    """Return what terms that the groups do not name do to the agreement: of coupled drives, then any.

    Where a coupled drive explains a group, other terms are not asked for it; of those, only one that explains
    a group as no other term does is told.
    """
    from symid.identification.comparison import FAR, find_comparison, find_grouped_values
    from symid.parameters.readings import find_coupled_readings, find_kindred_readings

    found = ours.identified
    coupled, changed = _try_all(ours, change, theirs, find_coupled_readings(found.robot, found.base, rows))
    now = find_comparison(find_grouped_values(changed, ours.values), theirs)
    explained = {entry.group for entry, tried in coupled if tried.decisive}
    far = [k for k in now.list_farthest(FAR * now.scale, len(rows)) if k not in explained]
    kindred, _ = _try_all(ours, changed, theirs, find_kindred_readings(found.base, rows, far))
    return (*coupled, *(entry for entry in kindred if entry[1].decisive and not entry[1].rivals))


def _try_all(
    ours: OurSide, change: "FloatArray", theirs: "StatedValues", entries: Sequence["OpenReading"]
) -> tuple[_Found, "FloatArray"]:
    """Return what was found of each reading, and the matrix with those that are decisive."""
    from symid.identification.comparison import ReadingTrial, add_readings, find_readings

    usable = [entry for entry in entries if entry.name in ours.names]
    trials = [
        ReadingTrial(group=entry.group, column=ours.names.index(entry.name), factor=float(entry.factor))
        for entry in usable
    ]
    tried = find_readings(change, ours.values, theirs, trials)
    decisive = [trials[entry.trial] for entry in tried if entry.decisive]
    return [(usable[entry.trial], entry) for entry in tried], add_readings(change, decisive)
