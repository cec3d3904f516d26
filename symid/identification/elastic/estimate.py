"""Results of elastic joints, and how uncertain they are by the rows of a fit.

    springs   dw = J^+ (Y dbeta + e),   J = d F[spring] / dw, Y beta + e = F[spring]

Springs follow the torque of the links, whose parameters have a covariance, and what they leave of it, e, is
correlated in stretches.

Supported: residuals correlated over less than a hundredth of the rows (Liang and Zeger 1986); rows that do
not identify all parameters, whose variance is then infinite; springs of stops and knees; several recordings.
Not supported: the uncertainty of dynamics from springs that a fit took as given; numbers of springs that do
not hold between samples, such as elements on grids.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, final

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, FrozenArrays
from symid.codegen import ModelCard
from symid.errors import Notice
from symid.identification.diagnostics import sum_block_scores
from symid.identification.elastic import regression
from symid.identification.estimators import DynamicsRecord, Residual
from symid.identification.hysteresis import differentiate_spring
from symid.identification.judge import POLICY, compute_chance, numerics
from symid.identification.regression import RankRule, compute_spectrum
from symid.ipopt import Ending
from symid.joint_models import Elasticity, find_most_slope
from symid.serialization import Finite, keep_name


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
        covariance: (p + n + pf, p + n + pf) of `chi`, empty where the method has none; shown: without what no
            row shows; plain: what its rows alone say, before it was widened.
        recordings: whose rows its dynamics come from; all where empty.
    """

    method: str
    beta: FloatArray
    rotor: FloatArray
    friction: FloatArray
    elasticity: tuple[Elasticity, ...] = ()
    history: tuple[HistoryEntry, ...] = ()
    outcome: Ending = Ending.SOLVED
    covariance: FloatArray | None = None
    shown: FloatArray | None = None
    plain: FloatArray | None = None
    recordings: tuple[int, ...] = ()
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
        identifiable: whether the spring is; where not, its numbers mean nothing, and `reason` says why.
    """

    joint: str
    torque_unit: str
    position_unit: str
    elasticity: Elasticity
    torsion: Finite
    excited: Finite
    torque: Finite
    truth: Elasticity | None = None
    identifiable: bool = field(default=True, metadata=keep_name("told"))
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
    """Held-out residuals, one value a joint.

    Args:
        held_out: percent of a motor's torque below the edge of the band that fits of the dynamics without
            its stretch leave; noise: the same in units of the torque's noise, as it is above the motion.
        springs: percent of a joint's torque, by the links, that its spring leaves; empty without springs.
        contradiction: how far a dynamic parameter with springs surely is from that without, as a part of its
            size and over what does no harm, beyond which they contradict each other; 0 where they were not
            compared. known: the same of what was known against the logs alone.
        drifting: joints whose friction changes with time.
    """

    held_out: tuple[Finite, ...]
    noise: tuple[Finite, ...]
    springs: tuple[Finite, ...] = ()
    contradiction: Finite = 0.0
    known: Finite = 0.0
    drifting: tuple[str, ...] = ()


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class ElasticEstimate(DynamicsRecord):
    """Dynamics and springs of a robot whose joints are elastic.

    `parameters` are base parameters, rotor inertias and friction, in this order; `residual` is the torque
    unexplained by dynamics and springs, joint by joint, filtered; `refused` names springs too.

    Args:
        method: whose result this is; `reason` why it was chosen.
        springs: one an elastic joint, empty where the method gives none.
        energy: what is left of the energy rows.
        outcome, history: how the method ended, and its iterations.
        trials: all methods that were compared.
        effects: of drives, gears and links, taken off before anything was fitted.
        evidence: held-out residuals; None in files of earlier editions.
    """

    kind: ClassVar[str] = "elastic"
    method: str
    reason: str
    springs: tuple[SpringEstimate, ...]
    energy: Residual
    outcome: Ending
    history: tuple[HistoryEntry, ...]
    trials: tuple[MethodTrial, ...]
    effects: tuple[regression.DriveEffect, ...] = ()
    evidence: ElasticEvidence | None = None

    def list_mistakes(self) -> list[str]:
        """Return what is wrong with a record from a file: entries that do not fit each other."""
        mistakes = DynamicsRecord.list_mistakes(self)
        single = ("torque-lag", "link-friction", "torsion-offset")
        counts = dict.fromkeys(regression.WAVES, 2) | dict.fromkeys(single, 1)
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
        entries = zip(regression.list_parameter_cards(card), regression.mark_rigid_rotors(card), strict=True)
        expected = [entry.name for entry, merged in entries if not merged]
        joints = [joint.name for joint, gives in zip(card.joints, card.yielding, strict=True) if gives]
        found = [entry.name for entry in self.parameters]
        springs = [entry.joint for entry in self.springs]
        if found == expected and springs in ([], joints) and len(self.residual) == card.size:
            return []
        return [f"expected parameters {', '.join(expected)}, and springs for {', '.join(joints)} or none"]

    def build_fit(self, card: ModelCard) -> MethodFit:
        """Return the values as a fit of the model of `card`; rigid joints have no rotor and no spring."""
        shown = ~regression.mark_rigid_rotors(card)
        values, covariance = np.zeros(len(shown)), None
        values[shown] = [entry.value for entry in self.parameters]
        if self.covariance:
            covariance = np.zeros((len(values),) * 2)
            covariance[np.ix_(shown, shown)] = self.covariance
        springs = {spring.joint: spring.elasticity for spring in self.springs}
        whole = tuple(springs.get(joint.name, Elasticity()) for joint in card.joints)
        sizes = len(card.beta), card.size
        return replace(
            build_method_fit(self.method, values, sizes, whole if springs else ()),
            history=self.history,
            outcome=self.outcome,
            covariance=covariance,
            notices=self.notices,
        )


STRETCHES = 100
"""Of time, within which errors are correlated."""
MODEL_ERROR = 5e-4
"""Of a parameter: what columns of measured, filtered states leave wrong where no row shows it. Found on arms
of other simulators, where no noise explained as much."""
_TORQUE_ERROR = MODEL_ERROR / 2.0
"""Of a spring's torque, the same: parameters take up what their columns are off by. Measured along the true
torsion on arms of five foreign truths: 1e-4 to 4e-4."""
_RULE = RankRule()


def measure_identifiability(
    design: FloatArray, known: FloatArray | None = None
) -> tuple[NDArray[np.bool_], float]:
    """Return which parameters (p,) rows F (m, p) identify, and the condition number of their regressor.

    Those of the `known` (p,) that are no NaN need no rows.
    """
    free = np.ones(design.shape[1], dtype=bool) if known is None else np.isnan(known)
    if not np.any(free):
        return ~free, 1.0
    spectrum = compute_spectrum(design[:, free], _RULE.zero)
    kept = spectrum.singular[spectrum.singular > _RULE.singular * spectrum.singular[0]]
    identifiable = ~free
    identifiable[free] = spectrum.mask_identifiable(_RULE)
    return identifiable, float(kept[0] / kept[-1])


def mark_unidentifiable(covariance: FloatArray, identifiable: NDArray[np.bool_]) -> FloatArray:
    """Return `covariance` (p, p), infinite and without correlations where not `identifiable` (p,)."""
    marked = np.where(np.outer(identifiable, identifiable), covariance, 0.0)
    np.fill_diagonal(marked, np.where(identifiable, np.diag(covariance), np.inf))
    return marked


def compute_covariance(
    design: FloatArray, errors: FloatArray | None = None, known: FloatArray | None = None
) -> FloatArray:
    """Return the covariance (p, p) of a least-squares fit, with infinite variances where not identifiable.

    G = (F'F)^-1 of rows F (m, p) for noise of size one; with errors e (m,), in the order of time,
    G (sum_b F_b' e_b e_b' F_b) G over blocks b. It is zero for those of the `known` (p,) that are no NaN.
    """
    if known is not None and not np.all(np.isnan(known)):
        free = np.flatnonzero(np.isnan(known))
        covariance = np.zeros((len(known),) * 2)
        if len(free):
            covariance[np.ix_(free, free)] = compute_covariance(design[:, free], errors)
        return covariance
    spectrum = compute_spectrum(design, _RULE.zero)
    kept = spectrum.singular > _RULE.singular * spectrum.singular[0]
    # A root (p, r) of the pseudo-inverse of F'F.
    root = spectrum.scales[:, None] * spectrum.directions[kept].T / spectrum.singular[kept]
    covariance = root @ root.T
    if errors is not None:
        scores, _ = sum_block_scores(design, errors, np.zeros(len(errors), dtype=np.intp), STRETCHES)
        covariance = root @ (root.T @ scores @ root) @ root.T
    return mark_unidentifiable(covariance, spectrum.mask_identifiable(_RULE))


def measure_spring_spread(
    spring: Elasticity,
    compute: Callable[[Elasticity], Sequence[FloatArray]],
    columns: Sequence[FloatArray],
    errors: Sequence[FloatArray],
    covariance: FloatArray,
    *,
    shown: FloatArray,
) -> tuple[float, float]:
    """Return the deviation of a spring's torque, rms over the rows, and that of its slope.

    What is left of a row of hardly filtered states, and of one two time constants of its filter later, has no
    noise in common: their mean product is the square of what no value of the spring explains, an error of its
    torque as well.
    The slope is the largest one, of springs without branches that near zero.

    Of every recording, `compute` returns F[torque] (M,) of another spring, `columns` (M, p) are those of the
    links' parameters, `errors` (M,) what the spring leaves; N m or N. `covariance` (p, p) is finite, `shown`
    what rows show of it: columns that are off move parameters, and hardly the torque that they give.
    """
    # A constant is of an encoder's zero.
    errors = [error - error.mean() if len(error) else error for error in errors]
    whole = differentiate_spring(spring, lambda moved: np.concatenate(compute(moved)))
    slopes = differentiate_spring(spring, lambda moved: np.array([_get_slope(moved)]))[0]
    lengths: FloatArray = np.linalg.norm(whole, axis=0)
    # A number without effect has no deviation that matters.
    lengths = np.where(lengths > 0.0, lengths, np.inf)
    scaled = whole / lengths
    inverse = np.linalg.pinv(scaled.T @ scaled, rcond=numerics.RANK, hermitian=True)
    carried = inverse @ (scaled.T @ np.concatenate(columns))
    owner = np.repeat(np.arange(len(errors)), [len(error) for error in errors])
    scores, _ = sum_block_scores(scaled, np.concatenate(errors), owner, STRETCHES)
    noise = inverse @ scores @ inverse
    spread, full = (carried @ part @ carried.T + noise for part in (shown, covariance))
    apart = round(2.0 * regression.ROWS)
    products = [error[apart:] * error[:-apart] for error in errors]
    shared = np.concatenate([np.zeros(1), *products])
    # What differs from zero by chance only is no error.
    means = np.array([part.mean() for part in np.array_split(shared, STRETCHES) if len(part)])
    lacking = max(0.0, float(shared.mean())) if compute_chance(means) < POLICY.alarm else 0.0
    squares = np.concatenate(compute(spring)) ** 2
    squares = np.einsum("ij,jk,ik->i", scaled, spread, scaled) + lacking + _TORQUE_ERROR**2 * squares
    torque = float(np.sqrt(np.mean(squares)))
    way = slopes / lengths
    # States are filtered, which rounds the corner at a reversal, where the slope is that near zero. Changes
    # by a knee on each side of a torque that small are what noise makes, and in doubt as a whole.
    soon = POLICY.relevance * max(float(np.max(np.abs(part))) for part in compute(spring))
    bent = sum(abs(knee.slope) for knee in spring.knees if abs(knee.threshold) < soon) / 2.0
    fixed = np.hypot(MODEL_ERROR, bent) * abs(_get_slope(spring))
    return torque, float(np.hypot(fixed, np.sqrt(max(0.0, float(way @ full @ way)))))


def _get_slope(spring: Elasticity) -> float:
    return find_most_slope(spring) if spring.branches else spring.initial_stiffness or 0.0
