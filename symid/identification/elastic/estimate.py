"""Results of elastic joints: of one method, of the identification, and as JSON files.

Numbers of a solver -> MethodFit; fits and their rows -> ElasticEstimate <-> file, without loss.

Supported: methods that give no hysteresis; methods without iterations; format 1, SI units; a number that
is not finite is written as null.
Not supported: uncertainties in a `MethodFit`, other than the covariance of its dynamics.
"""

import json
import math
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.codegen import ModelCard
from symid.errors import EstimateError, Notice, RobotError
from symid.identification.estimators import ParameterEstimate, Residual
from symid.identification.rigid import write_file
from symid.joint_models import FRICTION_MODELS
from symid.robot import Elasticity, Knee, Stop


class MethodOutcome(Enum):
    """How a method ended; the value is the explanation."""

    SOLVED = "solved in one pass, without iterations"
    CONVERGED = "parameters and residuals no longer changed"
    ACCEPTABLE = "the solver met its looser tolerances only"
    STALLED = "no step lowered the merit any more; the best iterate was kept"
    LIMIT = "the limit of iterations was reached; the best iterate was kept"
    INFEASIBLE = "no parameters satisfy the constraints"
    DIVERGED = "the iterates ran away"
    FAILED = "the solver broke down"

    @property
    def usable(self) -> bool:
        """Return whether the parameters may be used."""
        return self in {
            MethodOutcome.SOLVED,
            MethodOutcome.CONVERGED,
            MethodOutcome.ACCEPTABLE,
            MethodOutcome.STALLED,
            MethodOutcome.LIMIT,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class HistoryEntry:
    """One iteration: merit, the step's relative size, its damping, and the residual norms.

    `norms` are those of the energy rows in J, then of the torque rows joint by joint in N m.
    """

    merit: float
    change: float
    damping: float = 1.0
    norms: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MethodFit:
    """Parameters of one method, in SI units.

    Args:
        method: its name.
        beta: (p,) base parameters of the links; rotor: (n,) rotor inertias on the joint side.
        friction: (pf,) in the order of the model card.
        elasticity: one a joint; empty if the method gives none.
        history: of the iterations, the start first.
        covariance: (p + n + pf, p + n + pf) of `chi`, empty where the method has none.
    """

    method: str
    beta: FloatArray
    rotor: FloatArray
    friction: FloatArray
    elasticity: tuple[Elasticity, ...] = ()
    history: tuple[HistoryEntry, ...] = ()
    outcome: MethodOutcome = MethodOutcome.SOLVED
    covariance: FloatArray | None = None
    notices: tuple[Notice, ...] = ()

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("beta", "rotor", "friction"):
            object.__setattr__(self, name, freeze(getattr(self, name)))
        if self.covariance is not None:
            object.__setattr__(self, "covariance", freeze(self.covariance))

    @property
    def chi(self) -> FloatArray:
        """Return [beta; rotor; friction], all dynamic parameters."""
        return np.concatenate([self.beta, self.rotor, self.friction])


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
    outcome: MethodOutcome
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
    outcome: MethodOutcome
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

    def build_fit(self, bases: int) -> MethodFit:
        """Return the values as a fit, with `bases` base parameters at its beginning."""
        values = np.array([entry.value for entry in self.parameters])
        joints = len(self.residual)
        return MethodFit(
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


_FORMAT = "symid elastic estimate"
_VERSION = 1


def write_elastic_estimate(estimate: ElasticEstimate, path: Path) -> Path:
    """Write the estimate to `path` as JSON and return the path.

    Raises:
        OutputError: the file cannot be written.
    """
    data = _write_plain({"format": _FORMAT, "version": _VERSION, **asdict(estimate)})
    data["outcome"] = estimate.outcome.name
    for trial, entry in zip(estimate.trials, data["trials"], strict=True):
        entry["outcome"] = trial.outcome.name
    return write_file(path, json.dumps(data, indent=1, allow_nan=False, ensure_ascii=False) + "\n")


def read_elastic_estimate(path: Path, card: ModelCard | None = None) -> ElasticEstimate:
    """Return the estimate stored at `path`.

    Args:
        path: a file that `write_elastic_estimate` wrote.
        card: the model that it must belong to, if given.

    Raises:
        EstimateError: there is no such file, it holds something else, or belongs to another model.
    """
    data = _read_json(path)
    if data.get("format") != _FORMAT:
        raise _refuse(path, "this is JSON, but not an estimate of elastic joints written by symid")
    if data.get("version") != _VERSION:
        raise _refuse(path, f"version {data.get('version')!r} of the format; this symid reads {_VERSION}")
    try:
        estimate = _build_estimate(data)
    except RobotError as error:
        raise _refuse(path, f"a spring that cannot be: {error}") from error
    except KeyError as error:
        raise _refuse(path, f"{error} is missing or unknown") from error
    except (TypeError, ValueError, AttributeError, OverflowError) as error:
        raise _refuse(path, str(error)) from error
    if card is not None:
        check_elastic_model(estimate, card, path)
    return estimate


def is_elastic_estimate(path: Path) -> bool:
    """Return whether `path` holds an estimate of elastic joints, whatever else may be wrong with it."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(data, dict) and data.get("format") == _FORMAT


def check_elastic_model(estimate: ElasticEstimate, card: ModelCard, path: Path | str = "") -> None:
    """Refuse an estimate of another model, or one that was changed by hand until it fits no model.

    Raises:
        EstimateError: it is; `path` is named.
    """
    if estimate.signature != card.signature:
        text = (
            f"the estimate is of robot {estimate.robot!r}, and its model is not that of {card.robot!r} as it "
            "is now; use the same robot and options, or identify again"
        )
        raise EstimateError(Notice(code="estimate.signature", text=text, file=str(path)))
    rotors = [f"IA{joint.number}" for joint in card.joints]
    expected = [*(entry.name for entry in card.beta), *rotors, *(entry.name for entry in card.friction)]
    found = [entry.name for entry in estimate.parameters]
    joints = [joint.name for joint in card.joints]
    springs = [entry.joint for entry in estimate.springs]
    if found != expected or springs not in ([], joints) or len(estimate.residual) != len(joints):
        text = (
            f"its parameters, springs and residuals are not those of the model {card.robot!r}: expected "
            f"{', '.join(expected)}, and springs for {', '.join(joints)} or none; identify again"
        )
        raise EstimateError(Notice(code="estimate.parameters", text=text, file=str(path)))


def _refuse(path: Path, text: str) -> EstimateError:
    return EstimateError(Notice(code="estimate.format", text=text, file=str(path)))


def _write_plain(value: Any) -> Any:  # noqa: ANN401 (JSON is what it is)
    """Return `value` with tuples as lists and numbers that are not finite as None."""
    match value:
        case float():
            return value if math.isfinite(value) else None
        case Mapping():
            return {str(key): _write_plain(entry) for key, entry in value.items()}
        case tuple() | list():
            return [_write_plain(entry) for entry in value]
    return value


def _read_json(path: Path) -> dict[str, Any]:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise _refuse(path, f"cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise _refuse(path, "not a text file, so not an estimate") from error
    except (ValueError, RecursionError) as error:
        raise _refuse(path, f"not JSON: {error}") from error
    if not isinstance(data, dict):
        raise _refuse(path, "this is JSON, but not an estimate of elastic joints written by symid")
    return data


def _build_estimate(data: Mapping[str, Any]) -> ElasticEstimate:
    count = len(data["parameters"])
    covariance = tuple(tuple(_read_number(entry) for entry in row) for row in data["covariance"])
    if {len(covariance), *map(len, covariance)} - {0, count}:
        message = f"covariance: expected {count} rows of {count} numbers, one for each parameter"
        raise ValueError(message)
    return ElasticEstimate(
        robot=_read_text(data["robot"]),
        signature=_read_text(data["signature"]),
        method=_read_text(data["method"]),
        reason=_read_text(data["reason"]),
        parameters=tuple(
            ParameterEstimate(
                **{**entry, "value": _read_finite(entry["value"]), "std": _read_number(entry["std"])}
            )
            for entry in data["parameters"]
        ),
        springs=tuple(map(_read_spring, data["springs"])),
        residual=tuple(map(_read_residual, data["residual"])),
        energy=_read_residual(data["energy"]),
        condition=_read_number(data["condition"]),
        outcome=MethodOutcome[data["outcome"]],
        history=tuple(
            HistoryEntry(
                merit=_read_number(entry["merit"]),
                change=_read_number(entry["change"]),
                damping=_read_finite(entry["damping"]),
                norms=tuple(map(_read_number, entry["norms"])),
            )
            for entry in data["history"]
        ),
        trials=tuple(map(_read_trial, data["trials"])),
        sources=tuple(map(_read_text, data["sources"])),
        settings=dict(data["settings"]),
        refused=tuple((_read_text(name), _read_text(reason)) for name, reason in data["refused"]),
        covariance=covariance,
        notices=tuple(Notice(**entry) for entry in data["notices"]),
    )


def _read_text(value: object) -> str:
    if not isinstance(value, str):
        message = f"expected text, got {value!r}"
        raise TypeError(message)
    return value


def _read_flag(value: object) -> bool:
    if not isinstance(value, bool):
        message = f"expected true or false, got {value!r}"
        raise TypeError(message)
    return value


def _read_finite(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        message = f"expected a number, got {value!r}"
        raise TypeError(message)
    return float(value)


def _read_number(value: object) -> float:
    return math.inf if value is None else _read_finite(value)


def _read_trial(entry: Mapping[str, Any]) -> MethodTrial:
    error = entry["error"]
    return MethodTrial(
        method=_read_text(entry["method"]),
        outcome=MethodOutcome[entry["outcome"]],
        error=None if error is None else _read_finite(error),
        values=tuple(map(_read_finite, entry["values"])),
    )


def _read_residual(entry: Mapping[str, Any]) -> Residual:
    return Residual(
        joint=_read_text(entry["joint"]),
        norm=_read_finite(entry["norm"]),
        relative_percent=_read_number(entry["relative_percent"]),
        std=_read_number(entry["std"]),
        samples=int(_read_finite(entry["samples"])),
        unit=_read_text(entry["unit"]),
    )


def _read_spring(entry: Mapping[str, Any]) -> SpringEstimate:
    truth = entry["truth"]
    return SpringEstimate(
        joint=_read_text(entry["joint"]),
        torque_unit=_read_text(entry["torque_unit"]),
        position_unit=_read_text(entry["position_unit"]),
        torsion=_read_finite(entry["torsion"]),
        excited=_read_finite(entry["excited"]),
        torque=_read_finite(entry["torque"]),
        elasticity=_read_elasticity(entry["elasticity"]),
        truth=None if truth is None else _read_elasticity(truth),
        # Estimates of before springs could be refused do not say.
        told=_read_flag(entry.get("told", True)),
        reason=_read_text(entry.get("reason", "")),
    )


def _read_elasticity(entry: Mapping[str, Any]) -> Elasticity:
    return Elasticity(
        stiffness=_read_finite(entry["stiffness"]),
        damping=_read_finite(entry["damping"]),
        cubic=_read_finite(entry["cubic"]),
        stops=tuple(
            Stop(threshold=_read_finite(stop["threshold"]), stiffness=_read_finite(stop["stiffness"]))
            for stop in entry["stops"]
        ),
        knees=tuple(
            Knee(threshold=_read_finite(knee["threshold"]), slope=_read_finite(knee["slope"]))
            for knee in entry["knees"]
        ),
    )
