"""One joint after the other, from the last to the first.

Input: rows and what they can tell. Output: `Fit`.

The torque of a joint depends on the links that it carries and on no others. So the rows of the last joint
tell its own parameters alone; with these known, those of the joint before tell theirs, and so on to the base.
What the rows of one joint tell well is found once and kept: directions of the parameter space whose singular
value, in rows scaled to columns of length one, is above a thousandth of the largest. What they tell badly
waits for the joints before; what none tells well is found from all of them at last.

The covariance follows the errors through all steps: with B_j the map from the rows of joint j to x,

    e <- (1 - B_j A_j) e + B_j noise_j,      C <- (1 - B_j A_j) C (1 - B_j A_j)' + s_j^2 B_j B_j'

Supported: serial arms and trees, rows with an equation for every joint.
Not supported: the least variance: all joints at once (wls) know more. This is a check on them, and a method
for arms whose joints were recorded one by one.
"""

from typing import NamedTuple

import numpy as np

from symid.arrays import FloatArray
from symid.errors import Notice, UsageError
from symid.estimators.regression import Fit, find_group_weights, fit_wls
from symid.rows.condensation import condense_rows, stack_condensed
from symid.rows.identifiability import Identifiability
from symid.rows.rows import SCALAR_KINDS, Rows

__all__ = ["fit_sequential"]

_TOLD = 1e-3


def fit_sequential(rows: Rows, seen: Identifiability, freedom: str = "band") -> Fit:
    """Return the fit joint by joint; arguments as for `fit_ols`.

    Raises:
        UsageError: the rows have one equation for all joints.
    """
    if rows.kind in SCALAR_KINDS:
        text = f"{rows.kind} rows add up all joints: joint by joint takes torque, momentum or filtered rows"
        raise UsageError(Notice(code="usage.sequential-rows", text=text))
    condensed, together = condense_rows(rows), fit_wls(rows, seen, freedom)
    independent = condensed.independent if freedom == "band" else 1.0
    state = _State(np.zeros(len(rows.names)), np.zeros((len(rows.names), len(rows.names))), seen.basis)
    order: list[dict[str, object]] = []
    for joint in range(len(rows.group_names) - 1, -1, -1):
        if not condensed.counts[joint]:
            continue
        before = state.unknown.shape[1]
        state = _advance(state, condensed.factors[joint], independent * int(condensed.counts[joint]), _TOLD)
        order.append({"joint": rows.group_names[joint], "directions": before - state.unknown.shape[1]})
    if state.unknown.shape[1]:
        # What no joint tells well on its own.
        whole = stack_condensed(condensed, find_group_weights(rows, seen, freedom))
        order.append({"joint": "all together", "directions": state.unknown.shape[1]})
        state = _advance(state, whole, independent * len(rows.values), 0.0)
    return Fit(
        values=state.values,
        covariance=state.covariance,
        residuals=rows.values - rows.matrix @ state.values,
        spent=together.spent,
        condition=together.condition,
        weights=together.weights,
        report={"order": order},
    )


class _State(NamedTuple):
    """What is known so far: x (p,), its covariance (p, p), and the directions (p, k) still open."""

    values: FloatArray
    covariance: FloatArray
    unknown: FloatArray


def _advance(state: _State, triangle: FloatArray, count: float, least: float) -> _State:
    """Return the state after what a triangle [A y] of `count` independent rows tells well."""
    matrix, target = triangle[:, :-1], triangle[:, -1]
    left, singular, right = np.linalg.svd(matrix @ state.unknown)
    told = np.zeros(state.unknown.shape[1], dtype=bool)
    told[: len(singular)] = singular > least * singular[0]
    size = int(told.sum())
    step = state.unknown @ (right[told].T / singular[:size]) @ left[:, :size].T
    values = state.values + step @ (target - matrix @ state.values)
    square = float(np.sum((target - matrix @ values) ** 2))
    through = np.eye(len(values)) - step @ matrix
    covariance = through @ state.covariance @ through.T + square / (count - size) * (step @ step.T)
    return _State(values, covariance, state.unknown @ right[~told].T)
