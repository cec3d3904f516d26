"""Logs of any length: rows are made block by block, condensed, and forgotten.

Input: signals or rows, one block after the other. Output: `Condensed`, which `fit_condensed` takes.

Supported: torque rows of signals at full rate; rows of any kind with an equation for every joint, block by
block, such as those of the pieces of a log that does not fit into memory.
Not supported: residuals row by row.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.library import Library
from symid.data.recording import Signals
from symid.errors import Notice, UsageError
from symid.rows.condensation import BLOCK, Condensed, condense_weighted, extend_triangle
from symid.rows.rows import SCALAR_KINDS, Rows

__all__ = ["condense_parts", "condense_signals", "join_condensed"]


def condense_signals(library: Library, blocks: Iterable[Signals]) -> Condensed:
    """Return the torque equations of signals, at every sample, condensed.

    Args:
        library: the functions of the robot.
        blocks: states and torques, piece by piece; each is forgotten before the next is asked for.
    """
    card = library.card
    columns = len(card.beta) + len(card.friction) + 1
    factors, count = np.zeros((card.size, columns, columns)), 0
    stacks = _Stacks(library)
    for signals in blocks:
        for part in _cut(len(signals.time)):
            for joint, stack in enumerate(stacks.fill(signals, part)):
                factors[joint] = extend_triangle(factors[joint], [stack])
        count += len(signals.time)
    return Condensed(factors=factors, counts=np.full(card.size, count, dtype=np.intp))


def _cut(samples: int) -> Iterator[slice]:
    for start in range(0, samples, BLOCK):
        yield slice(start, min(samples, start + BLOCK))


class _Stacks:
    """[Y Yf tau] of a block of samples, joint by joint, in arrays that are used again and again."""

    def __init__(self, library: Library) -> None:
        card = library.card
        self.library, self.inertial = library, len(card.beta)
        self.rigid = np.empty((BLOCK, card.size, len(card.beta)))
        self.friction = np.empty((BLOCK, card.size, len(card.friction)))
        self.joined = np.empty((card.size, BLOCK, self.inertial + len(card.friction) + 1))

    def fill(self, signals: Signals, part: slice) -> FloatArray:
        """Return the equations (n, m, p + 1) of a part of the signals."""
        q, dq, ddq = signals.q[part], signals.dq[part], signals.ddq[part]
        size = len(q)
        (rigid,) = self.library.evaluate("torque_regressor", q, dq, ddq, out=(self.rigid[:size],))
        joined = self.joined[:, :size]
        joined[:, :, : self.inertial] = rigid.transpose(1, 0, 2)
        if self.library.card.friction:
            (friction,) = self.library.evaluate("friction_regressor", dq, out=(self.friction[:size],))
            joined[:, :, self.inertial : -1] = friction.transpose(1, 0, 2)
        joined[:, :, -1] = signals.tau[part].T
        return joined


def condense_parts(parts: Iterable[Rows]) -> Condensed:
    """Return rows that come part by part condensed; no part is kept.

    Args:
        parts: at least one, all of one kind and one robot.

    Raises:
        UsageError: the rows have one equation for all joints: their covariance asks for every residual.
    """
    found: Condensed | None = None
    for rows in parts:
        if rows.kind in SCALAR_KINDS:
            text = f"{rows.kind} rows cannot be condensed: their deviations ask for the residual of every row"
            raise UsageError(Notice(code="usage.streamed-rows", text=text))
        fresh = condense_weighted(rows, rows.weight)
        found = fresh if found is None else join_condensed(found, fresh)
    if found is None:
        raise UsageError(Notice(code="usage.streamed-rows", text="there are no rows to condense"))
    return found


def join_condensed(first: Condensed, second: Condensed) -> Condensed:
    """Return the equations of both; they are worth as many independent rows as both are together."""
    pairs = zip(first.factors, second.factors, strict=True)
    counts = first.counts + second.counts
    worth = first.independent * first.counts.sum() + second.independent * second.counts.sum()
    return replace(
        first,
        factors=np.array([extend_triangle(one, [other]) for one, other in pairs]),
        counts=counts,
        independent=float(worth / counts.sum()),
    )
