"""What an elastic identification says: dynamics, springs, how sure, how it came about.

Input: fits and their rows. Output: `ElasticEstimate`, which is written to and read from JSON without loss.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from symid.elastic.fit import ElasticFit, ElasticOutcome, HistoryEntry
from symid.errors import Notice
from symid.estimators.estimate import ParameterEstimate, Residual
from symid.joint.friction import FRICTION_MODELS
from symid.robot.elasticity import Elasticity

__all__ = ["ElasticEstimate", "MethodTrial", "SpringEstimate"]


@dataclass(frozen=True, slots=True, kw_only=True)
class SpringEstimate:
    """The spring of one joint.

    Args:
        joint: its name; torque_unit, position_unit: N m and rad, or N and m.
        elasticity: what was found; truth: what the robot file states, None where it leaves out a part.
        torsion: the largest |phi| in the recordings, rad or m.
        excited: the largest threshold whose stop slipped, 0 for none: stops beyond it are not seen.
        torque: the largest |tau_J| that the spring gave: knees beyond it are not seen.
        told: whether the recordings tell the spring; where not, its numbers mean nothing: `reason` says why.
    """

    joint: str
    torque_unit: str
    position_unit: str
    elasticity: Elasticity
    torsion: float
    excited: float
    torque: float
    truth: Elasticity | None = None
    told: bool = True
    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodTrial:
    """A method that was tried.

    Args:
        method: its name; outcome: how it ended.
        error: of prediction in units of the noise (see `choice`), None where none was asked for.
        values: of all dynamic parameters, in the order of the estimate's.
    """

    method: str
    outcome: ElasticOutcome
    error: float | None
    values: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ElasticEstimate:
    """The result of an identification of elastic joints, with all that was used to get it.

    Args:
        robot: its name; `signature` that of its model card.
        method: whose result this is; `reason` why it was chosen.
        parameters: base parameters, rotor inertias, friction, in this order.
        springs: one a joint, empty where the method gives none.
        residual: torque left unexplained by dynamics and springs, joint by joint, filtered.
        energy: the same of the energy rows.
        condition: of the column-scaled rows that the dynamics were fitted to.
        outcome, history: how the method ended, and its iterations.
        trials: all methods that were compared.
        refused: parameters and springs that the recordings cannot tell, with the reason.
        covariance: of `parameters`, row by row.
        sources: the recordings; settings: all options; notices: what a reader should know.
    """

    robot: str
    signature: str
    method: str
    reason: str
    parameters: tuple[ParameterEstimate, ...]
    springs: tuple[SpringEstimate, ...]
    residual: tuple[Residual, ...]
    energy: Residual
    condition: float
    outcome: ElasticOutcome
    history: tuple[HistoryEntry, ...]
    trials: tuple[MethodTrial, ...]
    sources: tuple[str, ...]
    settings: Mapping[str, object]
    refused: tuple[tuple[str, str], ...] = ()
    covariance: tuple[tuple[float, ...], ...] = ()
    notices: tuple[Notice, ...] = ()

    @property
    def friction(self) -> tuple[str, ...]:
        """Return the friction models of the joints, as their parameters' names tell; empty if they do not."""
        names = [entry.name for entry in self.parameters]
        numbers = [name.removeprefix("IA") for name in names if re.fullmatch(r"IA\d+", name)]
        letters = {letter for model in FRICTION_MODELS.values() for letter in model.parameters}
        kinds = {model.parameters: kind.value for kind, model in FRICTION_MODELS.items()}
        found = [
            tuple(name.removesuffix(number) for name in names if name in {f"{x}{number}" for x in letters})
            for number in numbers
        ]
        return tuple(kinds[entry] for entry in found) if all(entry in kinds for entry in found) else ()

    def build_fit(self, bases: int) -> ElasticFit:
        """Return the values as a fit, with `bases` base parameters at its beginning."""
        values = np.array([entry.value for entry in self.parameters])
        joints = len(self.residual)
        return ElasticFit(
            method=self.method,
            beta=values[:bases],
            rotor=values[bases : bases + joints],
            friction=values[bases + joints :],
            elasticity=tuple(spring.elasticity for spring in self.springs),
            history=self.history,
            outcome=self.outcome,
            covariance=np.array(self.covariance) if self.covariance else None,
            notices=self.notices,
        )
