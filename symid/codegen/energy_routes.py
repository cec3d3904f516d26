"""Routes to the energies and to what follows from them by differentiation.

Input: a workspace. Output: energies, their regressors, and forms derived by p = dT/ddq and
tau = dp/dt - dL/dq (Lagrange).

Supported: everything the recursion supports.
"""

from collections.abc import Sequence

from symid.algebra.vectors import total
from symid.codegen.differentiation import find_gradient, find_rates, find_rates_along
from symid.codegen.outputs import lay_coordinates, line_up
from symid.codegen.workspace import Elements, Workspace
from symid.dynamics.composite import gather_body
from symid.dynamics.drives import DRIVE, find_drive_energy
from symid.dynamics.energy import find_body_energy, find_energy_rows
from symid.notation import INERTIAL

__all__ = [
    "build_energy",
    "build_energy_of_bodies",
    "build_energy_rows",
    "derive_lagrange_columns",
    "derive_mass_matrix",
    "derive_momentum_columns",
    "derive_torque_columns",
    "derive_torques",
]


def _find_rows(workspace: Workspace) -> tuple[Elements, Elements]:
    """Return kinetic and potential energy per base parameter."""
    algebra = workspace.recursion.algebra
    kinetic, potential = [], []
    rows = [find_energy_rows(algebra, motion) for motion in workspace.recursion.motions]
    for link, name in workspace.base.keys:
        if name in DRIVE:
            drive = find_drive_energy(workspace.recursion, (link, name))
            kinetic.append(drive[0])
            potential.append(drive[1])
        else:
            kinetic.append(rows[link].kinetic[INERTIAL.index(name)])
            potential.append(rows[link].potential[INERTIAL.index(name)])
    return tuple(kinetic), tuple(potential)


def _weigh(workspace: Workspace, row: Sequence[int]) -> int:
    """Return a row times the base parameters."""
    algebra = workspace.recursion.algebra
    result = algebra.zero
    for value, parameter in zip(row, workspace.parameters.values(), strict=True):
        result = algebra.add(result, algebra.mul(value, parameter))
    return result


def build_energy_rows(workspace: Workspace) -> tuple[Elements, ...]:
    """Return the energy regressors."""
    return _find_rows(workspace)


def build_energy(workspace: Workspace) -> tuple[Elements, ...]:
    """Return the energies as regressors times parameters."""
    kinetic, potential = _find_rows(workspace)
    return (_weigh(workspace, kinetic),), (_weigh(workspace, potential),)


def build_energy_of_bodies(workspace: Workspace) -> tuple[Elements, ...]:
    """Return the energies as sums over links and drives."""
    recursion, algebra = workspace.recursion, workspace.recursion.algebra
    parts = [
        find_body_energy(algebra, gather_body(algebra, workspace.parameters, link), motion)
        for link, motion in enumerate(recursion.motions)
    ]
    for key, value in workspace.parameters.items():
        if key[1] in DRIVE:
            kinetic, potential = find_drive_energy(recursion, key)
            parts.append((algebra.mul(value, kinetic), algebra.mul(value, potential)))
    return (total(algebra, [part[0] for part in parts]),), (total(algebra, [part[1] for part in parts]),)


def _rate(workspace: Workspace, values: Sequence[int]) -> list[int]:
    """Return the time derivatives of values that depend on q and dq."""
    inputs = workspace.inputs
    pairs = (*zip(inputs["q"], inputs["dq"], strict=True), *zip(inputs["dq"], inputs["ddq"], strict=True))
    return find_rates(workspace.table, values, dict(pairs))


def _derive_torque(workspace: Workspace, kinetic: int, potential: int) -> list[int]:
    table, inputs = workspace.table, workspace.inputs
    momenta = find_gradient(table, kinetic, inputs["dq"])
    slopes = find_gradient(table, table.add(kinetic, -potential), inputs["q"])
    return [table.add(rate, -slope) for rate, slope in zip(_rate(workspace, momenta), slopes, strict=True)]


def derive_torques(workspace: Workspace) -> tuple[Elements, ...]:
    """Return the joint torques."""
    (kinetic,), (potential,) = build_energy(workspace)
    return (lay_coordinates(workspace, _derive_torque(workspace, kinetic, potential)),)


def derive_mass_matrix(workspace: Workspace) -> tuple[Elements, ...]:
    """Return the mass matrix as dp/ddq.

    The velocities are inputs of the momentum only: p is linear in them, its derivatives are free of them.
    """
    table = workspace.table
    rates = tuple(table.input(-1, joint) for joint in range(workspace.robot.freedom))
    moving = workspace.move(rates)
    kinetic = _weigh(moving, _find_rows(moving)[0])
    momenta = find_gradient(table, kinetic, rates)
    one = table.constant(1.0)
    columns = find_rates_along(table, momenta, [{rate: one} for rate in rates])
    return (line_up(workspace, columns),)


def _collect(workspace: Workspace, columns: Sequence[Sequence[int]]) -> tuple[Elements, ...]:
    return (line_up(workspace, columns),)


def derive_momentum_columns(workspace: Workspace) -> tuple[Elements, ...]:
    """Return the momentum regressor."""
    table, rates = workspace.table, workspace.inputs["dq"]
    kinetic, _ = _find_rows(workspace)
    return _collect(workspace, [find_gradient(table, value, rates) for value in kinetic])


def derive_lagrange_columns(workspace: Workspace) -> tuple[Elements, ...]:
    """Return the regressor of dL/dq."""
    table, position = workspace.table, workspace.inputs["q"]
    pairs = zip(*_find_rows(workspace), strict=True)
    return _collect(workspace, [find_gradient(table, table.add(t, -v), position) for t, v in pairs])


def derive_torque_columns(workspace: Workspace) -> tuple[Elements, ...]:
    """Return the torque regressor."""
    pairs = zip(*_find_rows(workspace), strict=True)
    return _collect(workspace, [_derive_torque(workspace, t, v) for t, v in pairs])
