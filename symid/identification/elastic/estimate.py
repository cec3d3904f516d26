"""Results of elastic joints: of one method, with the covariance of its dynamics, and of all."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, final

import numpy as np

from symid.arrays import FloatArray, FrozenArrays
from symid.codegen import ModelCard
from symid.errors import Notice
from symid.identification.elastic.regression import WAVES, DriveEffect
from symid.identification.estimators import DynamicsRecord, Residual
from symid.ipopt import Ending
from symid.joint_models import NO_FRICTION, Elasticity, get_law
from symid.serialization import Finite


@dataclass(frozen=True, slots=True, kw_only=True)
class HistoryEntry:
    """One iteration: merit, the step's relative size, its damping, and the residual norms.

    `norms` are those of the energy rows in J, then of the torque rows joint by joint in N m.
    """

    merit: float
    change: float
    damping: Finite = 1.0
    norms: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MethodFit(FrozenArrays):
    """Parameters of one method, in SI units.

    Args:
        beta: (p,) base parameters of the links; rotor: (n,) rotor inertias on the joint side.
        friction: (pf,) in the order of the model card.
        elasticity: one a joint; empty if the method gives none.
        history: of the iterations, the start first.
        covariance: (p + n + pf, p + n + pf) of `chi`, empty where the method has none; plain: what its rows
            alone say, before it was widened.
    """

    method: str
    beta: FloatArray
    rotor: FloatArray
    friction: FloatArray
    elasticity: tuple[Elasticity, ...] = ()
    history: tuple[HistoryEntry, ...] = ()
    outcome: Ending = Ending.SOLVED
    covariance: FloatArray | None = None
    plain: FloatArray | None = None
    notices: tuple[Notice, ...] = ()

    @property
    def chi(self) -> FloatArray:
        """Return [beta; rotor; friction], all dynamic parameters."""
        return np.concatenate([self.beta, self.rotor, self.friction])


def build_method_fit(
    method: str, chi: FloatArray, sizes: tuple[int, int], elasticity: tuple[Elasticity, ...] = ()
) -> MethodFit:
    """Return chi (p + n + pf,) with the sizes (p, n), and springs, as the result of a method."""
    beta, rotor, friction = np.split(chi, np.cumsum(sizes))
    return MethodFit(method=method, beta=beta, rotor=rotor, friction=friction, elasticity=elasticity)


@dataclass(frozen=True, slots=True, kw_only=True)
class SpringEstimate:
    """The spring of one joint.

    Args:
        joint: its name; torque_unit, position_unit: N m and rad, or N and m.
        elasticity: what was identified; truth: what the robot file states, None where it leaves out a part.
        torsion: the largest |phi| in the recordings, rad or m.
        excited: the largest threshold whose stop slipped, 0 for none: stops beyond it are not identifiable.
        torque: the largest |tau_J| that the spring gave: knees beyond it are not identifiable.
        torque_std: standard deviation of its torque in the recordings, rms, N m or N; slope_std: that of the
            largest slope, without branches that near zero, N m/rad or N/m; None where not computed.
        told: whether the spring is identifiable; where not, its numbers mean nothing: `reason` says why.
    """

    joint: str
    torque_unit: str
    position_unit: str
    elasticity: Elasticity
    torsion: Finite
    excited: Finite
    torque: Finite
    truth: Elasticity | None = None
    told: bool = True
    reason: str = ""
    torque_std: Finite | None = None
    slope_std: Finite | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodTrial:
    """A method that was tried.

    Args:
        error: of prediction in units of the noise, squared; None where methods were not compared.
        values: of all dynamic parameters, in the order of the estimate's.
    """

    method: str
    outcome: Ending
    error: Finite | None
    values: tuple[Finite, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ElasticEvidence:
    """What is left unexplained, one value a joint.

    Args:
        held_out: percent of a motor's torque below the edge of the band that fits of the dynamics without
            its stretch leave; noise: the same in units of the torque's noise, as it is above the motion.
        springs: percent of a joint's torque, by the links, that its spring leaves; empty without springs.
        contradiction: chi^2 of the one-shot problem against dynamics without springs, over its limit, beyond
            which they contradict each other; 0 where they were not compared. known: the same of what was
            known against the logs alone.
    """

    held_out: tuple[Finite, ...]
    noise: tuple[Finite, ...]
    springs: tuple[Finite, ...] = ()
    contradiction: Finite = 0.0
    known: Finite = 0.0


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class ElasticEstimate(DynamicsRecord):
    """Dynamics and springs of a robot whose joints are elastic.

    `parameters` are base parameters, rotor inertias and friction, in this order; `residual` is the torque
    left unexplained by dynamics and springs, joint by joint, filtered; `refused` names springs too.

    Args:
        method: whose result this is; `reason` why it was chosen.
        springs: one an elastic joint, empty where the method gives none.
        energy: what is left of the energy rows.
        outcome, history: how the method ended, and its iterations.
        trials: all methods that were compared.
        effects: of drives, gears and links, taken off before anything was fitted.
        evidence: what is left unexplained; None in files of earlier editions.
    """

    kind: ClassVar[str] = "elastic"
    method: str
    reason: str
    springs: tuple[SpringEstimate, ...]
    energy: Residual
    outcome: Ending
    history: tuple[HistoryEntry, ...]
    trials: tuple[MethodTrial, ...]
    effects: tuple[DriveEffect, ...] = ()
    evidence: ElasticEvidence | None = None

    def list_mistakes(self) -> list[str]:
        """Return what is wrong with a record from a file: entries that do not fit each other."""
        mistakes = DynamicsRecord.list_mistakes(self)
        counts = dict.fromkeys(WAVES, 2)
        counts |= dict.fromkeys(("torque-lag", "link-friction", "torsion-offset"), 1)
        for effect in self.effects:
            count, joints = counts.get(effect.kind), range(-1, len(self.residual))
            whole = len(effect.values) == len(effect.deviations) == count and effect.joint in joints
            if not whole or not all(map(math.isfinite, (*effect.values, *effect.deviations, effect.order))):
                mistakes.append(f"effects: {effect.kind} of joint {effect.joint}: no such effect")
        first = len(self.trials[0].values) if self.trials else 0
        mistakes += [
            f"trials: {trial.method}: expected {first} values as of the first, got {len(trial.values)}"
            for trial in self.trials
            if len(trial.values) != first
        ]
        if self.evidence is not None:
            found, size = self.evidence, len(self.residual)
            lengths = (len(found.held_out), len(found.noise), len(found.springs) or size)
            if lengths != (size,) * 3 or min(*found.held_out, *found.noise, *found.springs, 0.0) < 0.0:
                mistakes.append("evidence: expected one value a joint, not negative")
        for entry in self.springs:
            for spring in (entry.elasticity, entry.truth):
                if spring is None:
                    continue
                stops = (stop.stiffness for stop in spring.stops)
                numbers = (spring.stiffness, spring.damping, spring.cubic, *stops)
                if any(value is None or not math.isfinite(value) for value in numbers):
                    mistakes.append(f"springs: {entry.joint}: expected a number, got null")
            mistakes += [
                f"springs: {entry.joint}: {name}: expected a number that is not negative, got {value:g}"
                for name in ("torsion", "excited", "torque")
                if not (value := getattr(entry, name)) >= 0.0
            ]
        return mistakes

    def list_strangers(self, card: ModelCard) -> list[str]:
        """Return where parameters, springs or residuals are not those of the model, in its order."""
        elastic = [joint for joint, gives in zip(card.joints, card.yielding, strict=True) if gives]
        rotors = [f"IA{joint.number}" for joint in elastic]
        expected = [*(entry.name for entry in card.beta), *rotors, *(entry.name for entry in card.friction)]
        joints = [joint.name for joint in elastic]
        found = [entry.name for entry in self.parameters]
        springs = [entry.joint for entry in self.springs]
        if found == expected and springs in ([], joints) and len(self.residual) == card.size:
            return []
        return [f"expected parameters {', '.join(expected)}, and springs for {', '.join(joints)} or none"]

    def build_fit(self, card: ModelCard) -> MethodFit:
        """Return the values as a fit of the model of `card`; rigid joints have no rotor and no spring."""
        bases, size = len(card.beta), card.size
        places = [bases + joint for joint in range(size) if card.yielding[joint]]
        places = [*range(bases), *places, *range(bases + size, bases + size + len(card.friction))]
        values = np.zeros(bases + size + len(card.friction))
        values[places] = [entry.value for entry in self.parameters]
        springs = {spring.joint: spring.elasticity for spring in self.springs}
        whole = tuple(springs.get(joint.name, Elasticity()) for joint in card.joints)
        covariance = None
        if self.covariance:
            covariance = np.zeros((len(values),) * 2)
            covariance[np.ix_(places, places)] = self.covariance
        return replace(
            build_method_fit(self.method, values, (bases, size), whole if springs else ()),
            history=self.history,
            outcome=self.outcome,
            covariance=covariance,
            notices=self.notices,
        )


_LAWS = (
    *("coulomb-viscous", "coulomb-viscous-offset", "asymmetric", "stribeck", "stribeck+offset"),
    *("improved-stribeck", "asymmetric-stribeck", "cubic", "stribeck+cubic", "power-law", "makkar"),
)
"""Of robot files when estimates did not have the names of laws."""


def name_friction(parameters: Sequence[str]) -> tuple[str, ...]:
    """Return the friction models of joints whose parameters have these names; empty if unknown."""
    numbers = [name.removeprefix("IA") for name in parameters if re.fullmatch(r"IA\d+", name)]
    kinds = {tuple(entry.name for entry in get_law(law).linear): law for law in _LAWS} | {(): NO_FRICTION}
    letters = {letter for names in kinds for letter in names}
    found = [
        tuple(name.removesuffix(number) for name in parameters if name in {f"{x}{number}" for x in letters})
        for number in numbers
    ]
    return tuple(kinds[entry] for entry in found) if all(entry in kinds for entry in found) else ()
