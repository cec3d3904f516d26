"""Records of results: what was identified, of any kind, what speaks for it, and what it explains of a log.

A fit -> `FitRecord`: `Estimate` of rigid joints, `ElasticEstimate`, `FrictionIdentification`; a fit and a
log -> `Validation`. What a joint does at a row is

    at rest       its mean speed over 0.1 s is below a 500th of its top speed, for 0.1 s or longer
    at reversal   else, slower than a twentieth of its top speed
    in motion     else
"""

import math
import re
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import partial
from typing import Any, ClassVar, final

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, FrozenArrays, find_runs
from symid.codegen import ModelCard, ParameterCard
from symid.errors import EstimateError, Notice, UsageError
from symid.identification.judge import POLICY, numerics
from symid.identification.regression import ROW_KINDS
from symid.joint_models import FrictionValues, rename_law
from symid.notation import MOUNTING
from symid.robot import FixedBody, Processing, Robot, is_same_body
from symid.serialization import HIDDEN, Finite, name_key, read_record

PHASES = ("motion", "reversal", "rest")
_SLOW, _STANDING = 0.05, 0.002
"""Parts of the top speed, but for one row in a hundred."""
_SPAN = 0.1
"""s, over which a speed is averaged, and that a rest lasts at least."""


def find_phases(time: FloatArray, velocity: FloatArray, run: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the place in `PHASES` of what a joint does at its rows (m,); `time` in s rises in each `run`."""
    top = float(np.quantile(np.abs(velocity), 1.0 - POLICY.alarm)) if len(velocity) else 0.0
    phases = (np.abs(velocity) <= _SLOW * top).astype(np.intp)
    for number in np.unique(run):
        own = np.flatnonzero(run == number)
        steps = np.diff(time[own])
        span = max(3, round(_SPAN / float(np.median(steps)))) if len(steps) else 3
        wide = np.pad(velocity[own], (span // 2, (span - 1) // 2), mode="edge")
        average = np.convolve(wide, np.full(span, 1.0 / span), mode="valid")
        for first, last in find_runs(np.abs(average) <= _STANDING * top, span):
            phases[own[first:last]] = 2
    return phases


@dataclass(frozen=True, slots=True)
class MotionResidual:
    """What is left of one joint's rows, by what the joint does.

    `rms` in `unit` and `rows` of each of `PHASES`, None where it has no rows; `left_out` of these rows do not
    count in the joint's residual, `whole` is the rms with them.
    """

    joint: str
    unit: str
    rms: tuple[float | None, ...]
    rows: tuple[int, ...]
    left_out: int
    whole: float

    @classmethod
    def measure(
        cls, joint: str, unit: str, errors: FloatArray, phases: NDArray[np.intp], left_out: int
    ) -> "MotionResidual":
        """Return it from the errors (m,) and phases (m,) of all rows."""
        parts = [errors[phases == place] for place in range(len(PHASES))]
        rms = tuple(float(np.sqrt(np.mean(part**2))) if len(part) else None for part in parts)
        whole = float(np.sqrt(np.mean(errors**2)))
        return cls(joint, unit, rms, tuple(map(len, parts)), left_out, whole)


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """One setting that was tried.

    `band` Hz, of the rows; `instruments` Hz, band of the instruments, 0 for least squares; `held_out`
    cross-validated residual in percent of the torque, mean over joints; `fall` squares left over those of the
    best candidate, `p` of so large a difference by chance, `consistent` the same, from the same rows with the
    lowest instruments; `states` up to which columns of the log they are used.
    """

    band: float
    instruments: float
    held_out: float
    fall: float
    p: float
    consistent: float
    states: str


@dataclass(frozen=True, slots=True, kw_only=True)
class SettingsChoice:
    """What was chosen: scoring band (Hz), all candidates, the place of the one taken, standstill speeds."""

    scoring: float
    candidates: tuple[Candidate, ...]
    taken: int
    standstill: tuple[float, ...]

    @property
    def chosen(self) -> Candidate:
        """Return the candidate that was taken."""
        return self.candidates[self.taken]


@dataclass(frozen=True, slots=True, kw_only=True)
class JointEvidence:
    """Held-out residual of one joint within the scoring band: rms, in percent of that of the torque.

    `fitted` by the fit itself, `held_out` by fits to other stretches, of all rows; `moving` and `slow` of
    rows above and below a tenth of the top speed (infinite where there are none). `share` is the part of the
    rows that the fit left out as slow, `torque` the rms of the torque in N m or N; the larger one of log and
    fit counts, and the noise of the sensor is taken off.
    """

    joint: str
    fitted: float
    held_out: float
    moving: float
    slow: float
    share: float
    torque: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ConsistencyTest:
    """Whether two estimates from the same logs say the same of a joint's torque.

    `what` is "halves", "logs", "slow rows" or "band"; against the robot file "gravity" (its direction), and
    "scale" of a joint, only where it differs. `part` is which log, how far gravity is turned, or how many
    times the torque is. `verdict` is "same", "different" or "inconclusive"; `size` percent of the torque by
    which they differ beyond noise, `bound` at most; `p` the probability of so large a difference by chance.
    """

    what: str
    joint: str
    part: str = ""
    verdict: str
    size: float
    bound: float
    p: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Cause:
    """A single mistake in the log or the robot file that explains a fit, or a term that the model lacks.

    `cause` is what is wrong and `remedy` what to do, in words; `family` what else is of its kind; `joints`
    those whose torque it touches, none for all. `before` and `after` are percent of their held-out torque
    left with it and without it; `p` of chance, adjusted for all that were tried.
    """

    code: str
    family: str
    cause: str
    remedy: str
    joints: tuple[str, ...] = ()
    before: float
    after: float
    p: float


@dataclass(frozen=True, slots=True)
class JointRange:
    """What a fit covers of a joint: positions `low` to `high`, `speed` and `acceleration` at most (SI)."""

    joint: str
    low: float
    high: float
    speed: float
    acceleration: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """What speaks for and against an estimate.

    `joints`: held-out residual of each joint that moves and has a torque, within `scoring` Hz; `stretches`
    that were held out, or whole `logs`, 0 for stretches. `tests`: whether halves, logs, slow and fast rows,
    and bands say the same. `impossible`: what no robot can have, in words; `bounded` percent that a fit
    without that leaves of the held-out torque, 0 where nothing is. `causes`: one, or several that explain the
    logs equally well. `in_proportion`: pairs of joints that move so throughout all logs; `period` s, of a
    motion that repeats, 0 for one that does not; `covered` positions, speeds and accelerations of the logs.
    """

    joints: tuple[JointEvidence, ...]
    scoring: float
    stretches: int
    logs: int
    tests: tuple[ConsistencyTest, ...] = ()
    impossible: tuple[str, ...] = ()
    bounded: float
    causes: tuple[Cause, ...] = ()
    in_proportion: tuple[tuple[str, str], ...] = ()
    period: float
    covered: tuple[JointRange, ...] = ()

    @property
    def held_out(self) -> float:
        """Return the mean over joints of the held-out residual, in percent."""
        return sum(entry.held_out for entry in self.joints) / max(1, len(self.joints))

    @property
    def unexplained(self) -> float:
        """Return the same, each joint counted for 100 % at most: one that needs little torque is noise."""
        return sum(min(100.0, entry.held_out) for entry in self.joints) / max(1, len(self.joints))

    @property
    def fitted(self) -> float:
        """Return the mean over joints of the residual of the fit itself, in percent."""
        return sum(entry.fitted for entry in self.joints) / max(1, len(self.joints))


@dataclass(frozen=True, slots=True, kw_only=True)
class LawTrial:
    """A law that was tried, with `unknowns` parameters.

    `fitted_percent` is the residual of the fit to all rows, |e| / |tau|, `held_percent` that of the held-out
    rows, `held_rms` in N m or N; `ratio` the squared error of the held-out rows, relative to Coulomb, viscous
    and constant friction; `behind` its mean difference from the best law, in its standard errors; `aicc` of
    the fit to all rows; `reason` why it was not tried, or cannot be taken; else empty.
    """

    law: str
    unknowns: int
    fitted_percent: float | None = None
    held_percent: float | None = None
    held_rms: float | None = None
    ratio: float | None = field(default=None, metadata=name_key("squared_error_ratio"))
    behind: float | None = field(default=None, metadata=name_key("standard_errors_behind"))
    aicc: float | None = None
    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class LawSelection:
    """Trials of all laws; `chosen` is the law taken, `verdict` why, `blocks` how many there were."""

    trials: tuple[LawTrial, ...]
    chosen: str
    verdict: str
    blocks: int


OPEN_SETTINGS = ("filter_cutoff", "decimation.factor")
"""Entries of the processing that may be left open."""
SIGNIFICANT = POLICY.printed
"""Standard deviations from which on a value differs from zero."""


class Outcome(Enum):
    """How a fit ended; the value is the explanation."""

    SOLVED = "all identifiable parameters have values"
    SOME_REFUSED = "some parameters are not identifiable from these logs and were left out"


@dataclass(frozen=True, slots=True)
class ParameterEstimate:
    """One identified parameter in SI units; `truth` where the robot file states it.

    `expression` is the group of standard parameters, `reason` why they are grouped.
    """

    name: str
    value: Finite
    std: float
    unit: str
    expression: str = ""
    reason: str = ""
    truth: Finite | None = None

    @property
    def relative_std_percent(self) -> float:
        """Return 100 std / |value|; infinite where the value is zero."""
        return 100.0 * self.std / abs(self.value) if self.value else float("inf")

    @property
    def significant(self) -> bool:
        """Return whether the value differs from zero."""
        return abs(self.value) >= SIGNIFICANT * self.std

    @property
    def error_percent(self) -> float | None:
        """Return 100 (value - truth) / |truth|; None where the truth is zero or not known."""
        return 100.0 * (self.value - self.truth) / abs(self.truth) if self.truth else None

    @property
    def near_truth(self) -> bool | None:
        """Return whether the value misses the truth by chance at most; None where it is not known."""
        return None if self.truth is None else abs(self.value - self.truth) <= POLICY.printed * self.std

    def __str__(self) -> str:
        """Return it as `ZZ2 = 0.080935 +- 8.1e-05 kg m^2`, with one standard deviation."""
        return f"{self.name} = {self.value:.5g} +- {self.std:.2g} {self.unit}".rstrip()


def split_uncertain(parameters: Sequence[ParameterEstimate]) -> tuple[list[str], list[str]]:
    """Return the names of those that are uncertain, and of those that are known to be near zero.

    A value that does not differ significantly from zero has no relative deviation. Its deviation is compared
    with the largest significant value of the same unit at the same joint: MY of a link with MX, XY with XX.
    What is small beside it is known to be small; where there is none, nothing is known.
    """
    places = [(entry.unit, re.findall(r"\d*$", entry.name)[0]) for entry in parameters]
    largest = dict.fromkeys(places, 0.0)
    for entry, place in zip(parameters, places, strict=True):
        if entry.significant:
            largest[place] = max(largest[place], abs(entry.value))
    uncertain, zero = list[str](), list[str]()
    for entry, place in zip(parameters, places, strict=True):
        scale = abs(entry.value) if entry.significant else largest[place]
        if not entry.std <= 0.01 * POLICY.uncertain * scale:
            uncertain.append(entry.name)
        elif not entry.significant:
            zero.append(entry.name)
    return uncertain, zero


def list_parameters(
    cards: Sequence[ParameterCard], values: FloatArray, covariance: FloatArray | None
) -> tuple[ParameterEstimate, ...]:
    """Return the parameters of cards with values (p,) and covariance (p, p), None for deviations of 0."""
    deviations = np.zeros(len(cards)) if covariance is None else np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return tuple(
        ParameterEstimate(card.name, value, std, card.unit, card.expression, card.reason, card.value)
        for card, value, std in zip(cards, values.tolist(), deviations.tolist(), strict=True)
    )


@dataclass(frozen=True, slots=True)
class Residual:
    """The residual of one joint, or of one scalar equation.

    `norm` is |y - A x|_2 in the rows' unit, `relative_percent` 100 norm / |y|_2 (infinite where
    nothing was measured), over `samples` rows; `std` the residual's standard deviation, of estimates that of
    the rows that they keep, without slow ones.
    """

    joint: str
    norm: Finite
    relative_percent: float
    std: float
    samples: int
    unit: str

    @classmethod
    def measure(
        cls, joint: str, errors: FloatArray, measured: FloatArray, unit: str, std: float | None = None
    ) -> "Residual":
        """Return the residual of errors and measured values (m,); `std` is the root mean square if None."""
        norm, whole = float(np.linalg.norm(errors)), float(np.linalg.norm(measured))
        std = norm / float(np.sqrt(len(errors))) if std is None else std
        return cls.build(joint, norm, whole, len(errors), unit, std)

    @classmethod
    def build(  # noqa: PLR0917 - as the fields stand
        cls, joint: str, norm: float, whole: float, samples: int, unit: str, std: float
    ) -> "Residual":
        """Return the residual of errors and measured values with the norms `norm` and `whole`."""
        return cls(joint, norm, 100.0 * norm / whole if whole else float("inf"), std, samples, unit)


def compute_mean_relative(residual: Sequence[Residual]) -> float:
    """Return the plain mean over joints of the relative residuals, in percent; see `list_shares`."""
    shares = list_shares(residual)
    return sum(shares) / len(shares)


def list_shares(residual: Sequence[Residual]) -> list[float]:
    """Return the relative residuals of the joints that have a torque; of all where none has."""
    shares = [entry.relative_percent for entry in residual]
    return [share for share in shares if math.isfinite(share)] or shares


@dataclass(frozen=True, slots=True, kw_only=True)
class FitRecord:
    """The result of an identification, of any kind: what all of them have.

    `robot` is its name, `signature` that of its model card; `friction` the friction model of each joint,
    empty where friction itself was identified; `sources` the logs; `settings` processing, log map and
    options, after overrides; `refused` parameters or joints that are not identifiable, with the reason;
    `simulated` whether all logs were simulated from the robot file, whose values are then the truth; `file`
    the robot's, empty where its name finds it.
    """

    kind: ClassVar[str]
    robot: str
    signature: str
    friction: tuple[str, ...] = ()
    sources: tuple[str, ...]
    settings: Mapping[str, object]
    refused: tuple[tuple[str, str], ...] = ()
    notices: tuple[Notice, ...] = field(default=(), metadata=HIDDEN)
    simulated: bool = field(default=False, metadata=HIDDEN)
    file: str = field(default="", metadata=HIDDEN)

    @property
    def beyond_limit(self) -> dict[str, tuple[float, float]]:
        """Return torque and limit, N m or N, of joints whose torques in the logs were far beyond, by name.

        An EstimateError where a file holds something else.
        """
        stored: Any = self.settings.get("beyond_limit", {})
        try:
            found = {joint: (float(torque), float(most)) for joint, (torque, most) in stored.items()}
        except (AttributeError, TypeError, ValueError):
            found = {"": (0.0, 0.0)}
        if all(0.0 < most < torque < math.inf for torque, most in found.values()):
            return found
        text = "its settings have no usable 'beyond_limit': expected a torque and the limit below it of each "
        text += f"joint, got {stored!r:.60}; identify again"
        raise EstimateError(Notice(code="estimate.settings", text=text))

    @abstractmethod
    def list_mistakes(self) -> list[str]:
        """Return what is wrong with a record from a file: entries that do not fit each other."""

    @abstractmethod
    def list_strangers(self, card: ModelCard) -> list[str]:
        """Return where parameters or joints are not those of the model."""


def check_model(record: FitRecord, card: ModelCard, file: str = "") -> None:
    """Raise EstimateError where the record was not made with the model of `card`; `file` is named."""
    if record.signature == card.signature:
        if strangers := record.list_strangers(card):
            text = f"the fit does not match the model {card.robot!r}: {', '.join(strangers)}; identify again"
            raise EstimateError(Notice(code="estimate.parameters", text=text, file=file))
        return
    difference = f"the model of robot {card.robot!r} has changed since: its signature is "
    difference += f"{card.signature[:12]}, that of the fit {record.signature[:12]}"
    own = ", ".join(map(rename_law, record.friction))
    theirs = ", ".join(joint.friction for joint in card.joints)
    if own and own != theirs:
        difference = f"its friction models are {own}, those of the robot {theirs}"
    check_robot(record, card.robot, file, difference)


def check_robot(record: FitRecord, robot: str, file: str = "", difference: str = "") -> None:
    """Raise EstimateError where the record was made for a robot of another name, or with a `difference`."""
    if record.robot != robot:
        difference = f"it was identified for robot {record.robot!r}, not for {robot!r}"
    if difference:
        text = f"the fit does not match the model: {difference}"
        text += "; use the same robot and options, or identify again"
        raise EstimateError(Notice(code="estimate.signature", text=text, file=file))


def describe_other_bodies(record: FitRecord, robot: Robot, card: ModelCard) -> str:
    """Return how bodies on fixed joints, such as tools, differ from those in the robot file of the fit.

    Nothing where the base parameters of `card`, made of `robot`, are those that were stated then, so that the
    same is written in another way, or those of the fit, which an export wrote.
    """
    now, before = {body.name: body for body in robot.fixed}, _read_fixed(record)
    links = {joint.name: joint.inertial for joint in robot.joints} | {e.carrier: e.own for e in robot.fixed}
    texts = []
    for name in dict.fromkeys((*now, *before)):
        body, old = now.get(name), before.get(name)
        what = ""
        if old is None:
            what = "is new"
        elif body is None:
            # Else the moving link has other values, and this body may be among them.
            what = "is gone" if is_same_body(links.get(old.carrier), old.own) else ""
        elif body.carrier != old.carrier or not is_same_body(body.inertial, old.inertial):
            # An export writes all links of a URDF or MJCF model anew.
            rewritten = robot.convention in {"urdf", "mjcf"} and not is_same_body(body.own, old.own)
            what = "" if rewritten else "is another"
        shown = body or old
        if what and shown is not None:
            mass = "" if shown.inertial is None else f"{shown.inertial[9]:.3g} kg "
            texts.append(f"{name!r} ({mass}on the link of {shown.carrier!r}) {what}")
    if not texts or not isinstance(record, DynamicsRecord):
        return ""
    stated = {entry.name: entry.value for entry in card.beta}
    known = [entry for entry in record.parameters if entry.name in stated]
    values = [stated[entry.name] for entry in known]
    size = max((abs(value) for value in values if value is not None), default=0.0)
    near = partial(math.isclose, rel_tol=numerics.CONVERGED, abs_tol=numerics.EXACT * size)
    for others in ([entry.truth for entry in known], [entry.value for entry in known]):
        pairs = zip(values, others, strict=True)
        if known and all(a is not None and b is not None and near(a, b) for a, b in pairs):
            return ""
    return ", ".join(texts)


def warn_of_other_bodies(record: FitRecord, robot: Robot, card: ModelCard, file: str) -> tuple[Notice, ...]:
    """Return the warning that the robot file states other bodies on fixed joints than that of the fit."""
    changes = describe_other_bodies(record, robot, card)
    text = f"since the fit the robot file has changed: {changes}; the fit is of the robot in its own logs: "
    text += "give the robot file that it was made with, or identify again"
    return (Notice(code="estimate.other-bodies", text=text, file=file),) if changes else ()


def check_bodies(record: FitRecord, robot: Robot, card: ModelCard, file: str = "") -> None:
    """Raise EstimateError where `warn_of_other_bodies` warns: there, values of the fit are taken as true."""
    if notices := warn_of_other_bodies(record, robot, card, file):
        raise EstimateError(*notices)


def _read_fixed(record: FitRecord) -> dict[str, FixedBody]:
    """Return the bodies on fixed joints in the robot file of the fit, by name; InputError if unusable."""
    entries = record.settings.get("fixed", ())
    wanted = list(entries) if isinstance(entries, list | tuple) else [entries]
    return {body.name: body for body in (read_record(FixedBody, entry, "fixed") for entry in wanted)}


@dataclass(frozen=True, slots=True, kw_only=True)
class FittedLaw:
    """The friction law of a joint that was chosen, or whose shape values were fitted.

    `shape` are its shape values, in the law's order, `names` of these among the parameters; `smoothing` v0 of
    its sign in rad/s or m/s, 0 for the sign; `selection` how the law was chosen, None where it was named.
    """

    joint: str
    law: str
    shape: tuple[float, ...] = ()
    names: tuple[str, ...] = field(default=(), metadata=HIDDEN)
    smoothing: float
    selection: LawSelection | None = None

    @property
    def friction(self) -> FrictionValues:
        """Return the law as robots have it, without its linear values."""
        return FrictionValues(law=rename_law(self.law), shape=self.shape, smoothing=self.smoothing)


@dataclass(frozen=True, slots=True, kw_only=True)
class DynamicsRecord(FitRecord):
    """Parameters of the dynamics, of rigid or elastic joints.

    `parameters` are those identified, in the order of the model card, with their `covariance`, empty where
    the method has none; `residual` joint by joint; `condition` number of the column-scaled matrix, over the
    identifiable directions; `laws` that were chosen or fitted with their shape values.
    """

    parameters: tuple[ParameterEstimate, ...]
    residual: tuple[Residual, ...]
    condition: float
    covariance: tuple[tuple[float, ...], ...] = field(default=(), metadata=HIDDEN)
    laws: tuple[FittedLaw, ...] = ()

    @property
    def mean_relative_percent(self) -> float:
        """Return the mean over joints of the relative residuals, in percent."""
        return compute_mean_relative(self.residual)

    def list_mistakes(self) -> list[str]:
        """Return what is wrong with a record from a file: entries that do not fit each other."""
        count, mistakes = len(self.parameters), []
        _read_fixed(self)
        if self.covariance and [len(row) for row in self.covariance] != [count] * count:
            mistakes.append(f"covariance: expected {count} rows of {count} numbers, one for each parameter")
        if not self.residual:
            mistakes.append("residual: expected one entry for each joint, got none")
        for name in dict.fromkeys(self.friction):
            try:
                rename_law(name)
            except UsageError as error:
                mistakes += [f"friction: {notice.text}" for notice in error.notices]
        if not self.sources:
            mistakes.append("sources: expected at least one log, got none")
        stds = {f"parameters: {entry.name}: std": entry.std for entry in self.parameters}
        for name, number in ({"condition": self.condition} | stds).items():
            if not number >= 0.0:
                mistakes.append(f"{name}: expected a number that is not negative, got {number:g}")
        negative = [entry.samples for entry in self.residual if entry.samples < 0]
        return mistakes + [f"residual.samples: expected a count, got {count}" for count in negative]


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate(DynamicsRecord):
    """Parameters of a robot whose joints are rigid, or taken as rigid.

    `rows`: how measurements became equations; `estimator` how equations became parameters; `samples` rows of
    the fit. `unresolved` are values of least norm for refused parameters that act only together: they
    complete a prediction of motions like those of the log. `choice`: how settings were chosen that were left
    open; `evidence`: what speaks for the estimate. `motion` (K, 3 n) are states q, dq, ddq of the logs, in
    which what other values cost is measured.
    """

    kind: ClassVar[str] = "rigid"
    rows: str
    estimator: str
    outcome: Outcome
    samples: int
    unresolved: tuple[tuple[str, Finite], ...] = field(default=(), metadata=HIDDEN)
    choice: SettingsChoice | None = None
    evidence: Evidence | None = None
    motion: tuple[tuple[float, ...], ...] = field(default=(), metadata=HIDDEN)

    @property
    def ending(self) -> str:
        """Return how the fit ended, and how many of the values are weak."""
        own = [entry for entry in self.parameters if entry.reason != MOUNTING]
        weak = sum(entry.relative_std_percent > POLICY.uncertain for entry in own)
        return self.outcome.value + f"; {weak} of {len(own)} are poorly identifiable" * bool(weak)

    @property
    def besides(self) -> frozenset[str]:
        """Return the names of parameters that are none of the model: shape values, gravity and zeros."""
        mounting: Any = self.settings.get("mounting", {})
        return frozenset({name for law in self.laws for name in law.names} | set(mounting.get("names", ())))

    def assemble(self, names: Sequence[str]) -> FloatArray:
        """Return the parameters in the order of `names`, zero where nothing is known: (p,)."""
        known = dict(self.unresolved) | {entry.name: entry.value for entry in self.parameters}
        return np.array([known.get(name, 0.0) for name in names], dtype=np.float64)

    def list_mistakes(self) -> list[str]:
        """Return what is wrong with a record from a file: entries that do not fit each other."""
        mistakes = DynamicsRecord.list_mistakes(self)
        if self.samples < 0:
            mistakes.append(f"samples: expected a count, got {self.samples}")
        if self.rows not in ROW_KINDS:
            mistakes.append(f"rows: expected one of {', '.join(ROW_KINDS)}, got {self.rows!r}")
        return mistakes

    def list_strangers(self, card: ModelCard) -> list[str]:
        """Return where a parameter of the model is neither known nor refused, once, or one is not its own."""
        expected = {entry.name for entry in (*card.beta, *card.friction)}
        found = [entry.name for entry in self.parameters] + [name for name, _ in self.refused]
        problems = [f"{name!r} is given twice" for name in dict.fromkeys(found) if found.count(name) > 1]
        found = [name for name in found if name not in self.besides]
        strange = [name for name, _ in self.unresolved if name not in (expected | self.besides)]
        unknown = (name for name in (*found, *strange) if name not in expected)
        problems += [f"{name!r} is not a parameter of it" for name in unknown]
        return problems + [f"{name!r} is missing" for name in sorted(expected - set(found))]


@dataclass(frozen=True, slots=True, eq=False)
class Series(FrozenArrays):
    """Measured and predicted values (M,) of one joint's rows in `unit`; `time` (M,) in s, `velocity` (M,)."""

    joint: str
    unit: str
    velocity_unit: str
    time: FloatArray
    velocity: FloatArray
    measured: FloatArray
    predicted: FloatArray


_ORIGINS = {
    "stated": "as stated",
    "fit": "as in the fit",
    "log": "chosen from this log, whose sample period differs from that of the fit",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class ResolvedProcessing:
    """The processing of a log, and the origin of each entry of `OPEN_SETTINGS`: "stated", "fit" or "log"."""

    processing: Processing
    origin: Mapping[str, str]
    notices: tuple[Notice, ...] = ()

    def describe(self) -> str:
        """Return the processing in a sentence."""
        cutoff, factor = self.processing.filter_cutoff, self.processing.decimation.factor
        filtering = "positions: no filter" if cutoff is None else f"positions: low-pass at {cutoff:g} Hz"
        thinning = "no decimation" if factor == 1 else f"decimation by {factor}"
        first, second = (_ORIGINS[self.origin[name]] for name in OPEN_SETTINGS)
        if first == second:
            return f"{filtering}; {thinning} ({first})"
        return f"{filtering} ({first}); {thinning} ({second})"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Validation:
    """What an estimate explains of a log.

    `fitted` where it was fitted to that very log, which is no test; `processing` how the log was processed.
    `residual` is that within the `scoring` band in Hz of a fit that chose its settings, and then `all_rows`
    has that of the rows as they are; of other fits `scoring` is 0, and `residual` is that of the rows.
    `motion` has the residual in motion, at reversal and at rest, also of rows that `residual` leaves out.
    """

    robot: str
    signature: str = field(metadata=HIDDEN)
    source: str = field(metadata=name_key("log"))
    rows: str
    residual: tuple[Residual, ...]
    series: tuple[Series, ...] = field(metadata=HIDDEN)
    samples: int
    fitted: bool = field(default=False, metadata=HIDDEN)
    notices: tuple[Notice, ...] = field(default=(), metadata=HIDDEN)
    processing: ResolvedProcessing | None = field(default=None, metadata=HIDDEN)
    scoring: float
    all_rows: tuple[Residual, ...] = ()
    motion: tuple[MotionResidual, ...] = ()

    @property
    def mean_relative_percent(self) -> float:
        """Return the mean over joints of the relative residuals, in percent."""
        return compute_mean_relative(self.residual)
