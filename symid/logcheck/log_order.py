"""Joints in another order than the robot's: an exchange that explains the torque clearly better.

Input: `LogFit`. Output: `Exchange`s, which a notice names.

Pairs of torque columns, of position columns and of both are exchanged; the exchange with the smallest
residual on samples that the fit did not see is kept, and the search goes on from there as long as that falls
clearly.

Supported: any permutation that exchanges of pairs reach, each of them an improvement.
Not supported: joints at rest; robots of one joint.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.library import Library
from symid.errors import Notice
from symid.logcheck.log_fit import LogFit, evaluate_rows
from symid.robot.description import Robot

__all__ = ["Exchange", "describe_exchanges", "find_exchanges"]

_CLEARLY = 0.75
_ALIKE = 1.3
"""Times the smallest residual: exchanges below cannot be told apart."""
_SAMPLES = 500
_SMALL = 0.03
"""A relative residual as small as this leaves no room for a doubt in the order."""

_PIECES = 6
_RIDGE = 1e-4
"""Of the squared length of the columns."""

Order = tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Exchange:
    """Columns `first` and `second` (joints) of `what` exchanged: relative residual `before` and `after`."""

    what: str
    first: int
    second: int
    before: float
    after: float


def find_exchanges(fit: LogFit, library: Library) -> tuple[Exchange, ...]:
    """Return the exchanges of columns that explain the torque clearly better, in the order found."""
    step = max(1, len(fit.q) // _SAMPLES)
    states = tuple(part[::step] for part in (fit.q, fit.dq, fit.ddq, fit.tau))
    size = fit.q.shape[1]
    positions = torques = tuple(range(size))
    best = _find_residual(states, library, positions, torques)
    found: list[Exchange] = []
    while best > _SMALL and len(found) < size:
        trials = []
        for pair in combinations(fit.moving, 2):
            moved, turned = _swap(positions, pair), _swap(torques, pair)
            trials += [
                (_find_residual(states, library, positions, turned), "torque", pair, positions, turned),
                (_find_residual(states, library, moved, torques), "position", pair, moved, torques),
                (_find_residual(states, library, moved, turned), "position and torque", pair, moved, turned),
            ]
        if not trials:
            break
        residual, _, pair, moved, turned = min(trials, key=lambda trial: trial[0])
        if residual > _CLEARLY * best:
            break
        # To exchange torques or to exchange positions may look alike: joints are then only renamed.
        alike = [trial[1] for trial in trials if trial[2] == pair and trial[0] <= _ALIKE * residual]
        what = " or ".join(alike)
        found.append(Exchange(what=what, first=pair[0], second=pair[1], before=best, after=residual))
        best, positions, torques = residual, moved, turned
    return tuple(found)


def _swap(order: Order, pair: tuple[int, int]) -> Order:
    swapped = list(order)
    swapped[pair[0]], swapped[pair[1]] = order[pair[1]], order[pair[0]]
    return tuple(swapped)


def _find_residual(
    states: tuple[FloatArray, ...], library: Library, positions: Order, torques: Order
) -> float:
    """Return the mean over joints of |e| / |tau|, of samples that the fit did not see.

    One fit of all joints, each weighted alike, without each of some pieces of the log in turn; a small ridge
    keeps what the others do not tell at zero.
    """
    moved = (np.ascontiguousarray(part[:, list(positions)]) for part in states[:3])
    rows = evaluate_rows(library, *moved)
    tau = states[3][:, list(torques)]
    size = np.linalg.norm(tau, axis=0)
    weights = 1.0 / np.where(size > 0.0, size, 1.0)
    matrix, values = rows * weights[:, None], tau * weights
    lengths = np.sqrt(np.sum(matrix**2, axis=(0, 1)))
    matrix = matrix / np.where(lengths > 0.0, lengths, 1.0)
    pieces = np.array_split(np.arange(len(tau)), _PIECES)
    flat = [matrix[piece].reshape(-1, len(lengths)) for piece in pieces]
    grams = [part.T @ part for part in flat]
    sides = [part.T @ values[piece].ravel() for part, piece in zip(flat, pieces, strict=True)]
    gram, side = sum(grams) + _RIDGE * np.eye(len(lengths)), sum(sides)
    squares = np.zeros(len(size))
    for piece, own, right in zip(pieces, grams, sides, strict=True):
        solution = np.linalg.solve(gram - own, side - right)
        squares += np.sum((values[piece] - matrix[piece] @ solution) ** 2, axis=0)
    return float(np.mean(np.sqrt(squares)[size > 0.0])) if size.any() else 0.0


def describe_exchanges(exchanges: tuple[Exchange, ...], robot: Robot, file: str) -> tuple[Notice, ...]:
    """Return a notice that names the exchanges, if there are any."""
    if not exchanges:
        return ()
    names = [repr(joint.name) for joint in robot.axes]
    told = ", then ".join(
        f"{entry.what} of {names[entry.first]} and {names[entry.second]}" for entry in exchanges
    )
    before, after = 100 * exchanges[0].before, 100 * exchanges[-1].after
    text = (
        f"columns of joints look exchanged: {told}; with them in that order a quick fit leaves {after:.3g} % "
        f"of the torque in place of {before:.3g} %; check the order of the columns in the log and under [log]"
    )
    return (Notice(code="log.swapped-joints", text=text, file=file),)
