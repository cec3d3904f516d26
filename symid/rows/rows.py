"""Rows: how measurements become equations that are linear in the parameters.

Input: a library of robot functions and filtered signals.
Output: `Rows`, a matrix A and values y with A x = y + noise, x = [beta; f].

    torque    [Y | Yf] x = tau                        every sample of every joint
    momentum  [Yp(tb) - Yp(ta) - int YL | int Yf] x = int tau       every window of every joint
    filtered  the same behind a low-pass of first order     one a window of every joint
    power     [dh/dt | dq' Yf] x = tau' dq            every sample
    energy    [h(tb) - h(ta) | int dq' Yf] x = int tau' dq          every window

Momentum is the Lagrangian form d(dT/ddq)/dt - dL/dq = tau integrated once; filtered is that of Slotine and Li
(1987); energy is the theorem of Gautier and Khalil (1988), h = hT + hV, and power its rate (Gautier 1997).
Only torque rows ask for accelerations. `row_parts` has the equations.

Supported: rigid robots, with friction that is linear in its parameters.
Not supported: elastic joints.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, freeze
from symid.codegen.functions import ModelCard
from symid.codegen.library import Library
from symid.data.recording import Signals
from symid.errors import Notice, UsageError
from symid.robot.log_map import Processing
from symid.rows.row_parts import (
    Part,
    build_energy_part,
    build_filtered_part,
    build_momentum_part,
    build_power_part,
    build_torque_part,
    cut_momentum_matrix,
    cut_torque_matrix,
    outline_momentum_part,
    outline_torque_part,
)

__all__ = [
    "ROW_KINDS",
    "SCALAR_KINDS",
    "WINDOW",
    "Rows",
    "build_rows",
    "cut_rows",
    "drop_groups",
    "find_pieces",
    "outline_rows",
    "select_rows",
    "stack_rows",
    "warn_of_energy",
]

ROW_KINDS = ("torque", "momentum", "filtered", "power", "energy")
SCALAR_KINDS = {"power": "W", "energy": "J"}
"""Kinds with one equation for all joints together, and its unit."""
WINDOW = 0.1
"""Length of a window in s, unless another is asked for."""

_ENERGY_LIMIT = 3
_MOST_SHARED = 0.95


def _make_empty() -> NDArray[np.intp]:
    return np.empty(0, dtype=np.intp)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, weakref_slot=True)
class Rows:
    """Equations `matrix @ x = values`, ordered group by group.

    Args:
        kind: one of `ROW_KINDS`.
        matrix: (m, p); values: (m,), in the unit of the row's group.
        group: (m,) index of the joint, 0 throughout for scalar equations.
        time: (m,) s, of the sample or the middle of the window.
        velocity: (m,) of the joint in rad/s or m/s; of a window its mean; 0 for scalar equations.
        names, units: of the p parameters.
        group_names, group_units, velocity_units: of the groups.
        independent: rows of independent noise that the rows are worth, as a fraction of them.
        run: (m,) which recording of the fit a row is of, from zero.
        weight: (m,) what the square of a row's residual counts for; one unless runs were weighed.
    """

    kind: str
    matrix: FloatArray
    values: FloatArray
    group: NDArray[np.intp]
    time: FloatArray
    velocity: FloatArray
    names: tuple[str, ...]
    units: tuple[str, ...]
    group_names: tuple[str, ...]
    group_units: tuple[str, ...]
    velocity_units: tuple[str, ...]
    independent: float = 1.0
    notices: tuple[Notice, ...] = ()
    run: NDArray[np.intp] = field(default_factory=_make_empty)
    weight: FloatArray = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only; rows without a run are of the first, and weigh one."""
        count = len(self.values)
        if len(self.weight) != count:
            object.__setattr__(self, "weight", np.ones(count))
        if len(self.run) != count:
            object.__setattr__(self, "run", np.zeros(count, dtype=np.intp))
        for name in ("matrix", "values", "time", "velocity", "weight"):
            object.__setattr__(self, name, freeze(getattr(self, name)))
        for name in ("group", "run"):
            places = np.array(getattr(self, name), dtype=np.intp)
            places.setflags(write=False)
            object.__setattr__(self, name, places)


def build_rows(
    kind: str,
    library: Library,
    signals: Signals,
    processing: Processing,
    *,
    window: float = WINDOW,
    overlap: float = 0.0,
) -> Rows:
    """Return the equations of one recording.

    Args:
        kind: one of `ROW_KINDS`.
        library: the functions of the robot.
        signals: filtered states and torques at full rate.
        processing: its decimation is applied alike to every column and to the torque of torque
            and power rows; the integrals of the other kinds thin out by themselves.
        window: length of the windows in s, for momentum, filtered and energy.
        overlap: part of a window that the next one shares, of momentum and energy; the nearest of
            0, 1/2, 2/3, 3/4 and so on is taken.

    Raises:
        UsageError: there is no such kind, the windows do not fit into the log, or the overlap is no part.
    """
    if kind not in ROW_KINDS:
        text = f"rows {kind!r}: there is no such kind; allowed are {', '.join(ROW_KINDS)}"
        raise UsageError(Notice(code="usage.unknown-rows", text=text))
    pieces = find_pieces(overlap)
    builders = {
        "torque": lambda: build_torque_part(library, signals, processing),
        "momentum": lambda: build_momentum_part(library, signals, window, pieces),
        "filtered": lambda: build_filtered_part(library, signals, window),
        "power": lambda: build_power_part(library, signals, processing),
        "energy": lambda: build_energy_part(library, signals, window, pieces),
    }
    return _assemble(kind, library.card, builders[kind]())


def outline_rows(
    kind: str,
    card: ModelCard,
    signals: Signals,
    processing: Processing,
    *,
    window: float = WINDOW,
    overlap: float = 0.0,
) -> Rows:
    """Return torque or momentum equations without their matrix; instead of it, their places in time (m, 1).

    Arguments as for `build_rows`; places are counted from zero, joint by joint.
    """
    part = (
        outline_torque_part(signals, processing)
        if kind == "torque"
        else outline_momentum_part(signals, window, find_pieces(overlap))
    )
    places = np.arange(len(part.values), dtype=np.float64)
    return _assemble(kind, card, part._replace(matrix=np.tile(places[:, None, None], (1, card.size, 1))))


def cut_rows(
    kind: str,
    library: Library,
    signals: Signals,
    processing: Processing,
    *,
    window: float = WINDOW,
    overlap: float = 0.0,
) -> Iterator[tuple[slice, FloatArray]]:
    """Yield the matrix (k, n, p) of torque or momentum equations by stretches of time, and their places.

    Arguments as for `build_rows`.
    """
    if kind == "torque":
        return cut_torque_matrix(library, signals, processing)
    return cut_momentum_matrix(library, signals, window, find_pieces(overlap))


def find_pieces(overlap: float) -> int:
    """Return how many windows begin within the length of one."""
    if not 0.0 <= overlap <= _MOST_SHARED:
        text = f"overlap {overlap:g}: must be a part of a window, from 0 to {_MOST_SHARED:g}"
        raise UsageError(Notice(code="usage.overlap", text=text))
    return max(1, round(1.0 / (1.0 - overlap)))


def _assemble(kind: str, card: ModelCard, part: Part) -> Rows:
    parameters = card.beta + card.friction
    scalar = kind in SCALAR_KINDS
    joints = () if scalar else card.joints
    groups = part.values.shape[1]
    factor = " s" if kind == "momentum" else ""
    return Rows(
        kind=kind,
        matrix=np.swapaxes(part.matrix, 0, 1).reshape(-1, part.matrix.shape[2]),
        values=part.values.T.ravel(),
        group=np.repeat(np.arange(groups), len(part.values)),
        time=np.tile(part.time, groups),
        velocity=part.velocity.T.ravel(),
        names=tuple(parameter.name for parameter in parameters),
        units=tuple(parameter.unit for parameter in parameters),
        group_names=("all joints",) if scalar else tuple(joint.name for joint in joints),
        group_units=(SCALAR_KINDS[kind],)
        if scalar
        else tuple(joint.torque_unit + factor for joint in joints),
        velocity_units=("",) if scalar else tuple(f"{joint.position_unit}/s" for joint in joints),
        independent=part.independent,
        notices=warn_of_energy(card.size, kind) if scalar else (),
    )


def warn_of_energy(joints: int, kind: str = "energy") -> tuple[Notice, ...]:
    """Return the warning that energy or power rows of so many joints deserve."""
    if joints <= _ENERGY_LIMIT:
        return ()
    text = (
        f"{kind} rows for {joints} joints: one scalar equation at a time adds up what every joint does, so "
        "that small parameters of the last links drown in the work of the first ones and the "
        f"matrix is nearly rank deficient beyond {_ENERGY_LIMIT} joints; torque or momentum rows "
        "keep the joints apart"
    )
    return (Notice(code="identify.energy-rank", text=text),)


def stack_rows(parts: Sequence[Rows], weights: Sequence[float] | None = None) -> Rows:
    """Return the equations of several recordings of one robot as one set, group by group.

    Args:
        parts: the equations of each recording.
        weights: what the squares of each recording's residuals count for, positive; one if None.
    """
    first = parts[0]
    sizes = [len(part.values) for part in parts]
    run = np.repeat(np.arange(len(parts)), sizes)
    weight = np.repeat(np.ones(len(parts)) if weights is None else np.asarray(weights, dtype=float), sizes)
    group = np.concatenate([part.group for part in parts])
    order = np.argsort(group, kind="stable")
    notices = tuple(dict.fromkeys(notice for part in parts for notice in part.notices))
    return replace(
        first,
        matrix=np.vstack([part.matrix for part in parts])[order],
        values=np.concatenate([part.values for part in parts])[order],
        group=group[order],
        time=np.concatenate([part.time for part in parts])[order],
        independent=sum(part.independent * len(part.values) for part in parts) / max(len(group), 1),
        velocity=np.concatenate([part.velocity for part in parts])[order],
        notices=notices,
        run=run[order],
        weight=weight[order],
    )


def drop_groups(rows: Rows, groups: Sequence[int]) -> Rows:
    """Return the equations without those of the given groups."""
    return select_rows(rows, ~np.isin(rows.group, list(groups)))


def select_rows(rows: Rows, keep: NDArray[np.bool_]) -> Rows:
    """Return the equations for which `keep` (m,) holds."""
    return replace(
        rows,
        matrix=rows.matrix[keep],
        values=rows.values[keep],
        group=rows.group[keep],
        time=rows.time[keep],
        velocity=rows.velocity[keep],
        run=rows.run[keep],
        weight=rows.weight[keep],
    )
