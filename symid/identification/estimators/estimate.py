"""Records of results: parameters with their uncertainty, residuals, outcome, validation.

A fit -> `Estimate`, which is written to and read from JSON without loss; an estimate and a log that it was
not fitted to -> `Validation`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.errors import Notice
from symid.robot import Processing

OPEN_SETTINGS = ("filter_cutoff", "decimation.factor")
"""Entries of the processing that may be left open."""
_WHO = {
    "stated": "as stated",
    "fit": "as in the fit",
    "log": "chosen from this log, whose sample period is not that of the fit",
}


class Outcome(Enum):
    """How a fit ended; the value is the explanation."""

    SOLVED = "all parameters were found"
    SOME_REFUSED = "some parameters cannot be learnt from this log and were left out"


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterEstimate:
    """One identified parameter in SI units; `truth` where the robot file states it.

    `expression` says what standard parameters it groups, `reason` why.
    """

    name: str
    value: float
    std: float
    unit: str
    expression: str = ""
    reason: str = ""
    truth: float | None = None

    @property
    def relative_std_percent(self) -> float:
        """Return 100 std / |value|; infinite where the value is zero."""
        return 100.0 * self.std / abs(self.value) if self.value else float("inf")

    def __str__(self) -> str:
        """Return it as `ZZ2 = 0.080935 +- 8.1e-05 kg m^2`, with one standard deviation."""
        return f"{self.name} = {self.value:.5g} +- {self.std:.2g} {self.unit}".rstrip()


@dataclass(frozen=True, slots=True, kw_only=True)
class Residual:
    """What a model leaves unexplained at one joint (or of one scalar equation).

    `norm` is |y - A x|_2 in the rows' unit, `relative_percent` 100 norm / |y|_2 (infinite where
    nothing was measured), over `samples` rows; `std` the residual's standard deviation.
    """

    joint: str
    norm: float
    relative_percent: float
    std: float
    samples: int
    unit: str


def _compute_mean_relative(residual: tuple[Residual, ...]) -> float:
    """Return the plain mean over joints of the relative residuals, in percent."""
    return sum(entry.relative_percent for entry in residual) / len(residual)


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """The result of an identification, with all that was used to get it.

    Args:
        robot: its name; `signature` that of its model card.
        rows: how measurements became equations; `estimator` how equations became parameters.
        friction: the friction model of each joint.
        parameters: what was learnt, in the order of the model card.
        residual: what the fit leaves unexplained, joint by joint.
        condition: condition number of the column-scaled matrix, over what can be learnt.
        samples: rows of the fit.
        sources: the logs.
        settings: processing, log map and options, after overrides.
        refused: parameters that the log cannot tell, with the reason.
        unresolved: values of least norm for refused parameters that act only together. They
            complete a prediction of motions like those of the log; one by one they mean nothing.
        covariance: of `parameters`, row by row.
        notices: what a reader of the result should know.
    """

    robot: str
    signature: str
    rows: str
    estimator: str
    friction: tuple[str, ...]
    parameters: tuple[ParameterEstimate, ...]
    residual: tuple[Residual, ...]
    condition: float
    outcome: Outcome
    samples: int
    sources: tuple[str, ...]
    settings: Mapping[str, object]
    refused: tuple[tuple[str, str], ...] = ()
    unresolved: tuple[tuple[str, float], ...] = ()
    covariance: tuple[tuple[float, ...], ...] = ()
    notices: tuple[Notice, ...] = ()

    @property
    def mean_relative_percent(self) -> float:
        """Return the mean over joints of the relative residuals, in percent."""
        return _compute_mean_relative(self.residual)

    def assemble(self, names: tuple[str, ...]) -> FloatArray:
        """Return the parameters in the order of `names`, zero where nothing is known: (p,)."""
        known = dict(self.unresolved) | {entry.name: entry.value for entry in self.parameters}
        return np.array([known.get(name, 0.0) for name in names], dtype=np.float64)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Series:
    """Measured and predicted values of one joint's rows.

    Args:
        time: (M,) s; velocity: (M,) of the joint, in `velocity_unit`.
        measured, predicted: (M,) in `unit`.
    """

    joint: str
    unit: str
    velocity_unit: str
    time: FloatArray
    velocity: FloatArray
    measured: FloatArray
    predicted: FloatArray

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("time", "velocity", "measured", "predicted"):
            object.__setattr__(self, name, freeze(getattr(self, name)))


@dataclass(frozen=True, slots=True, kw_only=True)
class ResolvedProcessing:
    """What is used for a log, and whence each entry of `OPEN_SETTINGS` comes: "stated", "fit" or "log"."""

    processing: Processing
    origin: Mapping[str, str]
    notices: tuple[Notice, ...] = ()

    def tell(self) -> str:
        """Return the processing in a sentence."""
        cutoff, factor = self.processing.filter_cutoff, self.processing.decimation.factor
        parts = (
            "positions pass no filter" if cutoff is None else f"positions pass a low-pass at {cutoff:g} Hz",
            "every row is kept" if factor == 1 else f"one row in {factor} is kept",
        )
        who = [_WHO[self.origin[name]] for name in OPEN_SETTINGS]
        if who[0] == who[1]:
            return f"{parts[0]}, and {parts[1]}: {who[0]}"
        return f"{parts[0]} ({who[0]}), and {parts[1]} ({who[1]})"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Validation:
    """What an estimate explains of a log.

    `fitted` where it was fitted to that very log, which is no test; `processing` how the log was processed.
    """

    robot: str
    signature: str
    source: str
    rows: str
    residual: tuple[Residual, ...]
    series: tuple[Series, ...]
    samples: int
    fitted: bool = False
    notices: tuple[Notice, ...] = ()
    processing: ResolvedProcessing | None = None

    @property
    def mean_relative_percent(self) -> float:
        """Return the mean over joints of the relative residuals, in percent."""
        return _compute_mean_relative(self.residual)
