"""How far an identification of elastic joints is from the truth.

Input: what a method found, the truth. Output: errors in percent.

    parameters   largest |estimate - truth| / |truth| over the dynamic parameters whose truth is not zero
    hysteresis   joint by joint RMS(tau_J estimate - tau_J) / RMS(tau_J), on the true torsion of a held-out
                 run

Supported: methods that give no hysteresis: there is no error then.
Not supported: truths that the robot file does not state.
"""

from collections.abc import Sequence

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.functions import ModelCard
from symid.elastic.fit import ElasticFit
from symid.errors import Notice, UsageError
from symid.joint.plays import find_hysteresis_torque
from symid.robot.elasticity import Elasticity
from symid.simulation.elastic_run import ElasticRun

__all__ = ["find_excited_errors", "find_hysteresis_errors", "find_parameter_error", "find_truth"]


def find_truth(card: ModelCard) -> FloatArray:
    """Return the true dynamic parameters [beta; rotors; friction] (p + n + pf,).

    Raises:
        UsageError: the robot file does not state all of them.
    """
    values = {entry.name: entry.value for entry in (*card.beta, *card.rotors, *card.friction)}
    # A joint whose file states no rotor has one nevertheless: chi has an entry for it.
    rotors = [f"IA{joint.number}" for joint in card.joints if card.elastic]
    names = [*(entry.name for entry in card.beta), *rotors, *(entry.name for entry in card.friction)]
    unknown = [name for name in names if values.get(name) is None]
    if unknown:
        text = f"robot {card.robot!r} states no value for {', '.join(unknown)}; a study needs the truth"
        raise UsageError(Notice(code="usage.study-robot", text=text))
    return np.array([values[name] for name in names], dtype=np.float64)


def find_parameter_error(fit: ElasticFit, truth: FloatArray) -> float:
    """Return the parameter error of a fit in percent; `truth` (p + n + pf,)."""
    known = truth != 0.0
    return float(100.0 * np.max(np.abs(fit.chi[known] / truth[known] - 1.0)))


def find_hysteresis_errors(fit: ElasticFit, held_out: ElasticRun) -> FloatArray:
    """Return the hysteresis error of each joint in percent (n,), nan where the method gives no spring."""
    return _compare(fit, held_out.phi, held_out.joint_torque)


def find_excited_errors(
    fit: ElasticFit, truth: Sequence[Elasticity], held_out: ElasticRun, reach: FloatArray
) -> FloatArray:
    """Return the same on the held-out torsion scaled down into what the logs excited: (n,) percent.

    A spring cannot be known beyond the torsion that was seen; this is how well it is known within.

    Args:
        fit: what a method found.
        truth: the true springs, one a joint.
        held_out: whose torsion is scaled.
        reach: (n,) largest torsion of the logs, rad or m.
    """
    phi = held_out.phi * np.minimum(1.0, reach / np.abs(held_out.phi).max(axis=0))
    columns = [find_hysteresis_torque(spring, phi[:, joint]) for joint, spring in enumerate(truth)]
    return _compare(fit, phi, np.column_stack(columns))


def _compare(fit: ElasticFit, phi: FloatArray, torque: FloatArray) -> FloatArray:
    if not fit.elasticity:
        return np.full(phi.shape[1], np.nan)
    found = [find_hysteresis_torque(spring, phi[:, joint]) for joint, spring in enumerate(fit.elasticity)]
    left = np.linalg.norm(np.column_stack(found) - torque, axis=0)
    errors: FloatArray = 100.0 * left / np.linalg.norm(torque, axis=0)
    return errors
