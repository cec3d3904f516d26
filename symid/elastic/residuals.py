"""What a fit leaves unexplained, and how far its springs were seen.

ElasticWork, ElasticFit -> `Residual` and `SpringEstimate` records.

Supported: filtered torques joint by joint, energies window by window.
Not supported: fits without springs, which leave the joint torque out.
"""

import numpy as np

from symid.arrays import FloatArray
from symid.elastic.estimate import SpringEstimate
from symid.elastic.filtered import filter_smooth
from symid.elastic.fit import ElasticFit
from symid.elastic.methods import ElasticWork
from symid.elastic.windows import find_window_work
from symid.identification.estimate import Residual
from symid.joint.plays import find_hysteresis_torque
from symid.robot.elasticity import Elasticity

__all__ = ["find_energy_residual", "find_torque_residuals", "list_springs"]


def find_torque_residuals(work: ElasticWork, fit: ElasticFit) -> tuple[Residual, ...]:
    """Return, joint by joint, F[tau] less what motor and spring explain, N m or N."""
    problem = work.problem
    drive = fit.chi[problem.sizes[0] :]
    entries = []
    for joint, card in enumerate(problem.library.card.joints):
        errors, whole = [], []
        for signals, rows in zip(problem.signals, problem.filtered, strict=True):
            torque = find_hysteresis_torque(fit.elasticity[joint], signals.phi[:, joint])
            spring = filter_smooth(torque, problem.options.rate, signals.period)[rows.keep]
            errors.append(rows.find_motor_side(drive)[:, joint] - spring)
            whole.append(rows.torque[:, joint])
        entries.append(
            _write_residual(card.name, np.concatenate(errors), np.concatenate(whole), card.torque_unit)
        )
    return tuple(entries)


def find_energy_residual(work: ElasticWork, fit: ElasticFit) -> Residual:
    """Return the energy supplied less what springs, links, rotors and friction took, J."""
    problem = work.problem
    taken = [
        find_window_work(fit.elasticity, signals, rows)
        for signals, rows in zip(problem.signals, problem.energy, strict=True)
    ]
    errors = problem.supplied - np.concatenate(taken) - problem.design @ fit.chi
    return _write_residual("all joints", errors, problem.supplied, "J")


def list_springs(work: ElasticWork, fit: ElasticFit) -> tuple[SpringEstimate, ...]:
    """Return the spring of every joint with the range in which it was seen."""
    card, signals = work.problem.library.card, work.problem.signals
    springs = []
    for joint, (entry, elasticity) in enumerate(zip(card.joints, fit.elasticity, strict=True)):
        phi = [part.phi[:, joint] for part in signals]
        torque = [find_hysteresis_torque(elasticity, part) for part in phi]
        # A stop is sure to have slipped once the torsion's range exceeds twice its threshold.
        span = max(float(np.ptp(part)) for part in phi)
        slipped = [stop.threshold for stop in elasticity.stops if 2.0 * stop.threshold <= span]
        stated = card.elasticity[joint]
        springs.append(
            SpringEstimate(
                joint=entry.name,
                torque_unit=entry.torque_unit,
                position_unit=entry.position_unit,
                elasticity=elasticity,
                torsion=max(float(np.abs(part).max()) for part in phi),
                excited=max(slipped, default=0.0),
                torque=max(float(np.abs(part).max()) for part in torque),
                truth=stated if stated is not None and _is_complete(stated) else None,
            )
        )
    return tuple(springs)


def _is_complete(elasticity: Elasticity) -> bool:
    return elasticity.initial_stiffness is not None


def _write_residual(name: str, errors: FloatArray, whole: FloatArray, unit: str) -> Residual:
    norm, size = float(np.linalg.norm(errors)), float(np.linalg.norm(whole))
    return Residual(
        joint=name,
        norm=norm,
        relative_percent=100.0 * norm / size if size else float("inf"),
        std=norm / float(np.sqrt(len(errors))),
        samples=len(errors),
        unit=unit,
    )
