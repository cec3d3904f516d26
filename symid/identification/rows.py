"""Rows: how measurements become equations that are linear in the parameters.

Input: a library of robot functions and filtered signals.
Output: `Rows`, a matrix A and values y with A x = y + noise, x = [beta; f].

    torque    [Y | Yf] x = tau                        every sample of every joint
    momentum  [Yp(tb) - Yp(ta) - int YL | int Yf] x = int tau       every window of every joint
    energy    [h(tb) - h(ta) | int dq' Yf] x = int tau' dq          every window

Momentum is the Lagrangian form d(dT/ddq)/dt - dL/dq = tau integrated once; energy is the
theorem of Gautier and Khalil (1988), h = hT + hV. Neither asks for accelerations.

Supported: rigid robots, with friction that is linear in its parameters.
Not supported: elastic joints.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, freeze
from symid.codegen.functions import ModelCard
from symid.codegen.library import Library
from symid.data.filters import find_noise_band
from symid.data.recording import Signals
from symid.data.signals import decimate_columns
from symid.errors import Notice, UsageError
from symid.identification.quadrature import find_windows, integrate_windows
from symid.robot.log_map import Processing

__all__ = [
    "ROW_KINDS",
    "WINDOW",
    "Rows",
    "build_rows",
    "drop_groups",
    "select_rows",
    "stack_rows",
    "warn_of_energy",
]

ROW_KINDS = ("torque", "momentum", "energy")
WINDOW = 0.1
"""Length of a window in s, unless another is asked for."""

_ENERGY_LIMIT = 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rows:
    """Equations `matrix @ x = values`, ordered group by group.

    Args:
        kind: "torque", "momentum" or "energy".
        matrix: (m, p); values: (m,), in the unit of the row's group.
        group: (m,) index of the joint, 0 throughout for scalar equations.
        time: (m,) s, of the sample or the middle of the window.
        velocity: (m,) of the joint in rad/s or m/s; of a window its mean; 0 for scalar equations.
        names, units: of the p parameters.
        group_names, group_units, velocity_units: of the groups.
        independent: rows of independent noise that the rows are worth, as a fraction of them.
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

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("matrix", "values", "time", "velocity"):
            object.__setattr__(self, name, freeze(getattr(self, name)))
        group = np.array(self.group, dtype=np.intp)
        group.setflags(write=False)
        object.__setattr__(self, "group", group)


def build_rows(
    kind: str, library: Library, signals: Signals, processing: Processing, *, window: float = WINDOW
) -> Rows:
    """Return the equations of one recording.

    Args:
        kind: one of `ROW_KINDS`.
        library: the functions of the robot.
        signals: filtered states and torques at full rate.
        processing: its decimation is applied alike to every column and to the torque of torque
            rows; the integrals of the other kinds thin out by themselves.
        window: length of the windows in s, for momentum and energy.

    Raises:
        UsageError: there is no such kind, or the windows do not fit into the log.
    """
    match kind:
        case "torque":
            return _build_torque(library, signals, processing)
        case "momentum":
            return _build_momentum(library, signals, window)
        case "energy":
            return _build_energy(library, signals, window)
    text = f"rows {kind!r}: there is no such kind; allowed are {', '.join(ROW_KINDS)}"
    raise UsageError(Notice(code="usage.unknown-rows", text=text))


def _build_torque(library: Library, signals: Signals, processing: Processing) -> Rows:
    decimation = processing.decimation
    regressor = _evaluate_columns(library, signals)
    parts = []
    for j in range(library.card.size):
        extra = np.column_stack([signals.tau[:, j], signals.dq[:, j]])
        parts.append(decimate_columns(np.hstack([regressor[:, j], extra]), decimation))
    time = _find_kept_times(signals.time, len(parts[0]), decimation.factor)
    return _assemble(
        "torque",
        library.card,
        matrix=np.vstack([part[:, :-2] for part in parts]),
        values=np.concatenate([part[:, -2] for part in parts]),
        time=np.tile(time, len(parts)),
        velocity=np.concatenate([part[:, -1] for part in parts]),
        independent=find_noise_band(processing, signals.period),
    )


def _evaluate_columns(library: Library, signals: Signals) -> FloatArray:
    """Return [Y | Yf] at every sample: (N, n, p)."""
    (rigid,) = library.evaluate("torque_regressor", signals.q, signals.dq, signals.ddq)
    if not library.card.friction:
        return rigid
    (friction,) = library.evaluate("friction_regressor", signals.dq)
    return np.concatenate([rigid, friction], axis=2)


def _find_kept_times(time: FloatArray, kept: int, factor: int) -> FloatArray:
    """Return the times of the samples that a decimation by `factor` keeps: the last is among them."""
    first = len(time) - 1 - factor * (kept - 1)
    return time[first::factor]


def _build_momentum(library: Library, signals: Signals, length: float) -> Rows:
    windows = find_windows(len(signals.time), signals.period, length)
    ends = windows.ends
    (momentum,) = library.evaluate("momentum_regressor", signals.q[ends], signals.dq[ends])
    (lagrange,) = library.evaluate("lagrange_regressor", signals.q, signals.dq)
    columns = [np.diff(momentum, axis=0) - integrate_windows(lagrange, windows)]
    if library.card.friction:
        (friction,) = library.evaluate("friction_regressor", signals.dq)
        columns.append(integrate_windows(friction, windows))
    matrix = np.concatenate(columns, axis=2)
    span = windows.intervals * windows.period
    return _assemble(
        "momentum",
        library.card,
        matrix=_order_by_joint(matrix),
        values=integrate_windows(signals.tau, windows).T.ravel(),
        time=np.tile(_find_centres(signals.time[ends]), library.card.size),
        velocity=integrate_windows(signals.dq, windows).T.ravel() / span,
    )


def _build_energy(library: Library, signals: Signals, length: float) -> Rows:
    windows = find_windows(len(signals.time), signals.period, length)
    ends = windows.ends
    kinetic, potential = library.evaluate("energy_regressor", signals.q[ends], signals.dq[ends])
    columns = [np.diff(kinetic + potential, axis=0)]
    if library.card.friction:
        (friction,) = library.evaluate("friction_regressor", signals.dq)
        columns.append(integrate_windows(np.einsum("ij,ijk->ik", signals.dq, friction), windows))
    power = np.einsum("ij,ij->i", signals.tau, signals.dq)
    return _assemble(
        "energy",
        library.card,
        matrix=np.hstack(columns),
        values=integrate_windows(power, windows),
        time=_find_centres(signals.time[ends]),
        velocity=np.zeros(windows.count),
    )


def _find_centres(ends: FloatArray) -> FloatArray:
    return (ends[1:] + ends[:-1]) / 2.0


def _order_by_joint(matrix: FloatArray) -> FloatArray:
    """Return (N, n, p) as (n N, p), the rows of joint 1 first."""
    return np.swapaxes(matrix, 0, 1).reshape(-1, matrix.shape[2])


def _assemble(
    kind: str,
    card: ModelCard,
    *,
    matrix: FloatArray,
    values: FloatArray,
    time: FloatArray,
    velocity: FloatArray,
    independent: float = 1.0,
) -> Rows:
    parameters = card.beta + card.friction
    scalar = kind == "energy"
    joints = () if scalar else card.joints
    factor = {"torque": "", "momentum": " s"}.get(kind, "")
    groups = max(1, len(joints))
    return Rows(
        kind=kind,
        matrix=matrix,
        values=values,
        group=np.repeat(np.arange(groups), len(values) // groups),
        time=time,
        velocity=velocity,
        names=tuple(parameter.name for parameter in parameters),
        units=tuple(parameter.unit for parameter in parameters),
        group_names=("all joints",) if scalar else tuple(joint.name for joint in joints),
        group_units=("J",) if scalar else tuple(joint.torque_unit + factor for joint in joints),
        independent=independent,
        velocity_units=("",) if scalar else tuple(f"{joint.position_unit}/s" for joint in joints),
        notices=warn_of_energy(card.size) if scalar else (),
    )


def warn_of_energy(joints: int) -> tuple[Notice, ...]:
    """Return the warning that energy rows of so many joints deserve."""
    if joints <= _ENERGY_LIMIT:
        return ()
    text = (
        f"energy rows for {joints} joints: one scalar equation a window adds up what every joint does, so "
        "that small parameters of the last links drown in the work of the first ones and the "
        f"matrix is nearly rank deficient beyond {_ENERGY_LIMIT} joints; torque or momentum rows "
        "keep the joints apart"
    )
    return (Notice(code="identify.energy-rank", text=text),)


def stack_rows(parts: Sequence[Rows]) -> Rows:
    """Return the equations of several recordings of one robot as one set, group by group."""
    first = parts[0]
    group = np.concatenate([part.group for part in parts])
    order = np.argsort(group, kind="stable")
    notices = tuple(dict.fromkeys(notice for part in parts for notice in part.notices))
    return replace(
        first,
        matrix=np.vstack([part.matrix for part in parts])[order],
        values=np.concatenate([part.values for part in parts])[order],
        group=group[order],
        time=np.concatenate([part.time for part in parts])[order],
        independent=sum(part.independent * len(part.values) for part in parts) / len(group),
        velocity=np.concatenate([part.velocity for part in parts])[order],
        notices=notices,
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
    )
