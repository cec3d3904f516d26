"""Structure in the residual: which term the model misses, and where it acts.

Input: parameters, the library of their model, recordings. Output: `Finding`, notices.

For every joint, families of functions that a robot may have and its model has not are tried on the residual,
one family at a time: functions of position, of velocity, of the load, of acceleration, of the other joints'
motion, of time. What the model's own columns at that joint can make up for is taken out of residual and
functions first (e', C'), so that only what is new counts; how much the columns themselves explain is told as
"other values". The measure is the part of the residual's square that a family explains of stretches of time
it was not fitted to, so that a family of many functions is no better for it:

    share = 1 - sum over blocks b of |e'_b - C'_b k(without b)|^2 / |e'|^2

Supported: torque residuals of one log or several, of the fit or held out.
Not supported: terms of several joints at once; two families together.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen.library import Library
from symid.data.recording import Recording
from symid.errors import Notice
from symid.residuals.joint_residuals import BLOCKS, LARGEST, JointResidual, find_joint_residuals
from symid.residuals.residual_families import FAMILIES, OTHER_VALUES
from symid.robot.log_map import Processing

__all__ = [
    "Finding",
    "JointProfiles",
    "Profile",
    "find_profile",
    "find_profiles",
    "find_structure",
    "warn_of_structure",
]

_LEAST_PERCENT = 5.0
_LEAST_GAIN = 0.03
"""Part of the whole residual's square below which a family is not worth a word."""
_NEW = 1e-6
"""Squared part of a function that the model's columns must leave for it to count as new."""
_TINY = 1e-300


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """A family of functions that explains part of a joint's residual.

    Args:
        joint: name; family: key of `FAMILIES`.
        share_percent: on stretches not fitted, of the square of what the model's own columns leave of the
            residual; of all of it for "other values".
        rms: root mean square of what it explains, in `unit`.
    """

    joint: str
    family: str
    share_percent: float
    rms: float
    unit: str

    @property
    def advice(self) -> str:
        """Return what the family means, and what to do."""
        return FAMILIES[self.family].advice


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Profile:
    """A residual against another quantity: mean and deviation over equal numbers of samples."""

    centre: FloatArray
    mean: FloatArray
    deviation: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointProfiles:
    """The residual of a joint, in `unit`, against its position, its velocity and the torque foretold."""

    joint: str
    unit: str
    position_unit: str
    position: Profile
    velocity: Profile
    load: Profile


def find_structure(
    values: FloatArray,
    library: Library,
    recordings: Sequence[Recording],
    processing: Processing,
    *,
    weights: Sequence[float] | None = None,
    least_percent: float = _LEAST_PERCENT,
    largest: float = LARGEST,
) -> tuple[Finding, ...]:
    """Return the families that explain at least `least_percent` of a joint's residual, joint by joint.

    Args:
        values: (p,) base parameters and friction, in the order of the library's card.
        library: the functions of the robot.
        recordings: logs, of the fit or held out.
        processing: filter and decimation.
        weights: what the squares of each log's residuals count for; one if None.
        least_percent: of the residual's square.
        largest: bytes of a joint's equations; of longer logs, one in some of them is looked at.
    """
    found: list[Finding] = []
    residuals = find_joint_residuals(
        values, library, recordings, processing, weights=weights, largest=largest
    )
    for card, residual in residuals:
        found += [
            Finding(
                joint=card.name,
                family=name,
                share_percent=100.0 * share,
                rms=float(np.sqrt(gain / len(residual.error))),
                unit=card.torque_unit,
            )
            for name, share, gain in _try_families(residual)
            if 100.0 * share >= least_percent
        ]
    return tuple(found)


def find_profiles(
    values: FloatArray, library: Library, recordings: Sequence[Recording], processing: Processing
) -> tuple[JointProfiles, ...]:
    """Return the residual of every joint that moves against position, velocity and load.

    Arguments as for `find_structure`.
    """
    found = []
    for card, residual in find_joint_residuals(values, library, recordings, processing):
        table = residual.thin_out(lambda motion: [motion.q, motion.dq, motion.load])
        position, velocity, load = (find_profile(column, residual.plain) for column in table.T)
        found.append(
            JointProfiles(
                joint=card.name,
                unit=card.torque_unit,
                position_unit=card.position_unit,
                position=position,
                velocity=velocity,
                load=load,
            )
        )
    return tuple(found)


def _try_families(residual: JointResidual) -> list[tuple[str, float, float]]:
    """Return (family, share, squares explained), the most first."""
    size = float(residual.error @ residual.error)
    if not size:
        return []
    new = residual.error - residual.span @ (residual.span.T @ residual.error)
    gain = _find_gain(residual.span, residual.error, residual.blocks)
    found = [(OTHER_VALUES, gain / size, gain)]
    for name, family in FAMILIES.items():
        functions = residual.thin_out(family.build)
        if not functions.shape[1]:
            continue
        functions *= residual.roots[:, None]
        gain = _find_gain(_find_new(functions, residual.span), new, residual.blocks)
        if gain > _LEAST_GAIN * size:
            found.append((name, gain / float(new @ new), gain))
    return sorted(found, key=lambda entry: -entry[2])


def _find_new(functions: FloatArray, span: FloatArray) -> FloatArray:
    """Return what the model's columns cannot make up for, an orthogonal set scaled to length one."""
    lengths = np.linalg.norm(functions, axis=0)
    scaled = functions[:, lengths > _TINY] / lengths[lengths > _TINY]
    left, singular, _ = np.linalg.svd(scaled - span @ (span.T @ scaled), full_matrices=False)
    return np.asarray(left[:, singular**2 > _NEW])


def _find_gain(functions: FloatArray, error: FloatArray, blocks: NDArray[np.intp]) -> float:
    """Return the part of |error|^2 that the functions explain of blocks they were not fitted to."""
    if not functions.shape[1]:
        return 0.0
    table = np.column_stack([functions, error])
    # A triangle has the squares of its block, at a fraction of the size.
    triangles = [np.asarray(np.linalg.qr(table[blocks == block], mode="r")) for block in range(BLOCKS)]
    left = 0.0
    for held in range(BLOCKS):
        others = np.vstack([triangles[block] for block in range(BLOCKS) if block != held])
        factors = np.linalg.lstsq(others[:, :-1], others[:, -1], rcond=1e-10)[0]
        rest = triangles[held][:, -1] - triangles[held][:, :-1] @ factors
        left += float(rest @ rest)
    return max(0.0, float(error @ error) - left)


def find_profile(x: FloatArray, error: FloatArray, bins: int = 24) -> Profile:
    """Return mean and deviation of `error` (N,) over `bins` groups of equal size, ordered by `x` (N,)."""
    groups = [group for group in np.array_split(np.argsort(x, kind="stable"), bins) if len(group)]
    return Profile(
        centre=np.array([x[group].mean() for group in groups]),
        mean=np.array([error[group].mean() for group in groups]),
        deviation=np.array([error[group].std() for group in groups]),
    )


def warn_of_structure(
    values: FloatArray,
    library: Library,
    recordings: Sequence[Recording],
    processing: Processing,
    weights: Sequence[float] | None = None,
) -> tuple[Notice, ...]:
    """Return a notice for every joint whose residual a missing term explains, naming the likeliest.

    Arguments as for `find_structure`.
    """
    first: dict[str, Finding] = {}
    found = find_structure(values, library, recordings, processing, weights=weights)
    # A term that is missing says more than values that do not fit, which may be its doing.
    for finding in sorted(found, key=lambda entry: entry.family == OTHER_VALUES):
        first.setdefault(finding.joint, finding)
    return tuple(
        Notice(
            code="identify.structure",
            text=f"joint {finding.joint!r}: {finding.share_percent:.3g} % of the square of "
            f"{'the residual' if finding.family == OTHER_VALUES else 'what the model cannot explain'} "
            f"({finding.rms:.3g} {finding.unit}) follows {finding.family}: {finding.advice}",
        )
        for finding in first.values()
    )
