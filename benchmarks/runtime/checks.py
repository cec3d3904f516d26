"""Whether all contenders compute the same, before anything is timed.

Input: a case, results of a program. Output: the largest difference, relative to the largest value.

Two things are defined only up to a choice, and compared without it: the Coriolis matrix by its product with
the velocity, the potential energy by its change from the first sample.
"""

from typing import Any

import numpy as np

from robots import SAMPLES, Case, import_pinocchio
from symid.arrays import FloatArray

__all__ = ["build_references", "find_difference"]


def _mirror(upper: FloatArray) -> FloatArray:
    return np.asarray(np.triu(upper) + np.triu(upper, 1).T)


def _evaluate(case: Case, data: Any, q: FloatArray, dq: FloatArray, ddq: FloatArray) -> dict[str, FloatArray]:
    pin, model = import_pinocchio(), case.model
    tau = pin.rnea(model, data, q, dq, ddq).copy()
    gravity = pin.computeGeneralizedGravity(model, data, q).copy()
    pin.computeRNEADerivatives(model, data, q, dq, ddq)
    torques = [data.dtau_dq.copy(), data.dtau_dv.copy(), _mirror(data.M)]
    pin.computeABADerivatives(model, data, q, dq, tau)
    accelerations = [data.ddq_dq.copy(), data.ddq_dv.copy(), _mirror(data.Minv)]
    return {
        "inverse_dynamics_derivatives": np.stack(torques),
        "forward_dynamics_derivatives": np.stack(accelerations),
        "inverse_dynamics": tau,
        "gravity": gravity,
        "mass_matrix": _mirror(pin.crba(model, data, q)).copy(),
        "coriolis_matrix": pin.nonLinearEffects(model, data, q, dq) - gravity,
        "forward_dynamics": ddq,
        "kinetic_energy_regressor": pin.computeKineticEnergyRegressor(model, data, q, dq).copy(),
        "potential_energy_regressor": pin.computePotentialEnergyRegressor(model, data, q).copy(),
        "torque_regressor": pin.computeJointTorqueRegressor(model, data, q, dq, ddq).copy(),
    }


def build_references(case: Case) -> dict[str, FloatArray]:
    """Return what Pinocchio's Python module gives, (SAMPLES, ...) a function, in its own order of joints."""
    data = case.model.createData()
    order = list(case.order)
    rows = [_evaluate(case, data, *(part[k, order] for part in case.states[:3])) for k in range(SAMPLES)]
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def _bring_over(case: Case, name: str, reference: FloatArray, *, columns: bool) -> FloatArray:
    """Return a reference in our order of joints, if `columns` with the base columns only."""
    if name.endswith("regressor") and columns:
        reference = reference[..., list(case.columns)]
    back = np.argsort(case.order)
    if name == "mass_matrix" or name.endswith("derivatives"):
        return reference[..., back, :][..., back]
    return reference if "energy" in name else reference[:, back]


def find_difference(
    case: Case, name: str, found: FloatArray, reference: FloatArray, *, ours: bool, base: bool
) -> float:
    """Return how far `found` is from `reference`, relative to its largest value.

    Args:
        case: the robot.
        name: of the function.
        found: (SAMPLES * size,) as a program wrote it.
        reference: (SAMPLES, ...) from `build_references`.
        ours: whether `found` has our order of joints.
        base: whether its regressor has the base columns only.
    """
    if ours:
        reference = _bring_over(case, name, reference, columns=True)
    elif base and name.endswith("regressor"):
        reference = reference[..., list(case.columns)]
    found = found.reshape(SAMPLES, -1)
    if name == "forward_dynamics_derivatives":
        # Without the acceleration itself, which `forward_dynamics` has.
        found = found[:, case.robot.size :]
    if name == "coriolis_matrix":
        dq = case.states[1] if ours else case.states[1][:, list(case.order)]
        found = np.einsum("kij,kj->ki", found.reshape(SAMPLES, dq.shape[1], -1), dq)
    reference = reference.reshape(SAMPLES, -1)
    if found.shape != reference.shape:
        return float("inf")
    if name == "potential_energy_regressor":
        found, reference = found - found[0], reference - reference[0]
    return float(np.abs(found - reference).max() / max(1e-12, np.abs(reference).max()))
