"""What a fit leaves unexplained, and how far its springs were seen.

ElasticWork, ElasticFit -> `Residual` and `SpringEstimate` records.

A spring is refused where nothing of the joint torque that the motor equation shows is its doing: where it
leaves `_NOTHING` or more of that torque's scatter, or has no stiffness at all.

Supported: filtered torques joint by joint, energies window by window.
Not supported: fits without springs, which leave the joint torque out.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from symid.arrays import FloatArray
from symid.elastic.estimate import SpringEstimate
from symid.elastic.fit import ElasticFit
from symid.elastic.methods import ElasticWork, find_spring_torque
from symid.elastic.windows import find_window_work
from symid.errors import IdentifiabilityError, Notice
from symid.estimators.estimate import Residual
from symid.joint.plays import find_hysteresis_torque
from symid.robot.elasticity import Elasticity

__all__ = ["find_energy_residual", "find_torque_residuals", "judge_springs", "list_springs"]

_NOTHING = 0.9
"""Of the joint torque's scatter; a spring that leaves as much explains less than a fifth of its square."""


def find_torque_residuals(work: ElasticWork, fit: ElasticFit) -> tuple[Residual, ...]:
    """Return, joint by joint, F[tau] less what motor and spring explain, N m or N."""
    problem = work.problem
    target, spring = _find_sides(work, fit)
    errors = target - spring
    return tuple(
        _write_residual(card.name, errors[:, joint], problem.torque[:, joint], card.torque_unit)
        for joint, card in enumerate(problem.library.card.joints)
    )


def judge_springs(
    work: ElasticWork, fit: ElasticFit, hidden: Mapping[int, Notice], doubts: Sequence[Notice] = ()
) -> Mapping[int, Notice]:
    """Return, by joint, why its spring is refused; joints whose spring is told are left out.

    Args:
        work: the equations.
        fit: what was made of them.
        hidden: joints whose torsion cannot be seen, with what is said of them.
        doubts: what else may be the cause, to be said where all are refused.

    Raises:
        IdentifiabilityError: no joint has a spring that can be told.
    """
    target, spring = _find_sides(work, fit)
    left, whole = np.std(target - spring, axis=0), np.std(target, axis=0)
    refused = dict(hidden)
    for joint, card in enumerate(work.problem.library.card.joints):
        stiff = fit.elasticity[joint].initial_stiffness
        if joint not in refused and not (stiff and left[joint] < _NOTHING * whole[joint]):
            refused[joint] = _say_nothing(card.name, float(left[joint] / max(whole[joint], 1e-300)))
    if len(refused) == work.problem.sizes[1]:
        raise IdentifiabilityError(*(refused[joint] for joint in sorted(refused)), *doubts)
    return {joint: refused[joint] for joint in sorted(refused)}


def _say_nothing(joint: str, share: float) -> Notice:
    text = (
        f"joint {joint!r}: no spring explains its torque: of the scatter of the joint torque that the motor "
        f"equation shows, the one found leaves {100 * share:.0f} %, and less than {100 * _NOTHING:g} % was "
        "wanted; check the sign and the factor of the torque, and whether the positions of motor and link "
        "are swapped; where these are right, load the joint more, or try another method"
    )
    return Notice(code="elastic.no-spring", text=text)


def _find_sides(work: ElasticWork, fit: ElasticFit) -> tuple[FloatArray, FloatArray]:
    """Return F[tau_J] (M, n) by the motor equation, and by the springs."""
    problem = work.problem
    drive = fit.chi[problem.sizes[0] :]
    spring = [find_spring_torque(problem, fit, number) for number in range(len(problem.signals))]
    target: FloatArray = problem.torque - problem.motor @ drive
    return target, np.concatenate(spring)


def find_energy_residual(work: ElasticWork, fit: ElasticFit) -> Residual:
    """Return the energy supplied less what springs, links, rotors and friction took, J."""
    problem = work.problem
    taken = [
        find_window_work(fit.elasticity, signals, rows)
        for signals, rows in zip(problem.signals, problem.energy, strict=True)
    ]
    errors = problem.supplied - np.concatenate(taken) - problem.design @ fit.chi
    return _write_residual("all joints", errors, problem.supplied, "J")


def list_springs(
    work: ElasticWork, fit: ElasticFit, refused: Mapping[int, Notice]
) -> tuple[SpringEstimate, ...]:
    """Return the spring of every joint, and how far it was seen; `refused` comes from `judge_springs`."""
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
                told=joint not in refused,
                reason=refused[joint].text if joint in refused else "",
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
