"""Options of an identification of elastic joints: method, hysteresis model, filters, stopping rule.

Supported: thresholds and knees of one's own, or grids over the torsion and torque of the recordings.
Not supported: another hysteresis model for each joint. Loads nothing heavy: the command line reads the names.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from symid.errors import Notice, UsageError

METHODS = ("automatic", "two-step", "linear-spring", "elimination", "weighted", "nlp", "independent")
SCHEMES = ("two-cost", "same-cost")
NLP_ROWS = ("energy", "filtered", "momentum")
HESSIANS = ("exact", "gauss-newton")


@dataclass(frozen=True, slots=True, kw_only=True)
class NlpOptions:
    """How the one-shot problem of the method "nlp" is set up and solved.

    Args:
        rows: some of `NLP_ROWS`.
        hessian: one of `HESSIANS`.
        stribeck: whether friction gets Fs exp(-(v / vs)^2) sign(v) on top.
        smoothing: v0 of tanh(v / v0) in place of sign(v) in it, rad/s or m/s; 0 for the sign.
        speeds: least and greatest vs, rad/s or m/s.
        odd: whether springs harden alike on both sides.
        slopes: least and greatest slope of the outer function.
        weight_limit: greatest weight as a multiple of the linear spring; least_stiffness: the least k0.
        rounds: of weighing the rows by their residuals; 0 keeps the weights of the linear springs.
        tolerance: of Ipopt, on the scaled problem.
        iterations: of Ipopt, at most.
    """

    rows: tuple[str, ...] = ("energy", "momentum")
    hessian: str = "exact"
    stribeck: bool = False
    smoothing: float = 0.0
    speeds: tuple[float, float] = (1e-3, 10.0)
    odd: bool = False
    slopes: tuple[float, float] = (0.05, 20.0)
    weight_limit: float = 100.0
    least_stiffness: float = 1e-3
    rounds: int = 2
    tolerance: float = 1e-9
    iterations: int = 200

    def __post_init__(self) -> None:
        """Check what every later stage relies on.

        Raises:
            UsageError: with all that is wrong.
        """
        mistakes = []
        rows: object = self.rows
        if isinstance(rows, str):
            mistakes.append(f"rows {self.rows!r}: must be a tuple of kinds, such as ({NLP_ROWS[0]!r},)")
        else:
            if not self.rows or any(kind not in NLP_ROWS for kind in self.rows):
                mistakes.append(f"rows {self.rows}: must be some of {', '.join(NLP_ROWS)}")
            if len(set(self.rows)) < len(self.rows):
                mistakes.append(f"rows {self.rows}: each kind once")
        if self.hessian not in HESSIANS:
            mistakes.append(f"hessian {self.hessian!r}: allowed are {', '.join(HESSIANS)}")
        for name in ("speeds", "slopes"):
            low, high = getattr(self, name)
            if not 0.0 < low < high < math.inf:
                mistakes.append(f"{name} ({low:g}, {high:g}): must be positive, the least first")
        low, high = self.slopes
        if not low < 1.0 < high:
            mistakes.append(
                f"slopes ({low:g}, {high:g}): one must lie between them, it is the slope at zero torque"
            )
        mistakes += [
            f"{name} {getattr(self, name):g}: must be a positive number"
            for name in ("weight_limit", "least_stiffness", "tolerance")
            if not 0.0 < getattr(self, name) < math.inf
        ]
        if not 0.0 <= self.smoothing < math.inf:
            mistakes.append(f"smoothing {self.smoothing:g}: must be a speed, or 0")
        mistakes += _list_wrong_counts(self, {"rounds": 0, "iterations": 1})
        _refuse("usage.nlp-option", mistakes)


@dataclass(frozen=True, slots=True, kw_only=True)
class ElasticOptions:
    """How elastic joints are identified.

    Args:
        method: one of `METHODS`; "automatic" compares several on the data and takes the best.
        scheme: of the two-step method, one of `SCHEMES`.
        stops: number m of thresholds of a grid, r_i = i / (m + 1) max |phi|.
        thresholds: one tuple a joint, rad or m, in place of the grid.
        knees: number of knees on either side of the outer function; 0 for a plain Prandtl-Ishlinskii model.
        knee_torques: one tuple a joint of signed torques, N m or N, in place of the grid.
        refine: move thresholds and knees off their grids to where the data put them; not those given.
        window: length of an energy row in s.
        rate: lambda of the filter lambda / (s + lambda), rad/s.
        cutoff: of the zero-phase low-pass in Hz; 0 for none, None to choose by the encoders' noise.
        tolerance: of the relative change of parameters and residuals at which the iteration stops.
        iterations: at most.
        nlp: of the method "nlp".
    """

    method: str = "automatic"
    scheme: str = "two-cost"
    stops: int = 8
    thresholds: tuple[tuple[float, ...], ...] | None = None
    knees: int = 4
    knee_torques: tuple[tuple[float, ...], ...] | None = None
    refine: bool = True
    window: float = 0.1
    rate: float = 60.0
    cutoff: float | None = None
    tolerance: float = 1e-4
    iterations: int = 30
    nlp: NlpOptions = field(default_factory=NlpOptions)

    def __post_init__(self) -> None:
        """Check what every later stage relies on.

        Raises:
            UsageError: with all that is wrong.
        """
        mistakes = [
            f"{name} {getattr(self, name)!r}: there is no such {name}; allowed are {', '.join(allowed)}"
            for name, allowed in {"method": METHODS, "scheme": SCHEMES}.items()
            if getattr(self, name) not in allowed
        ]
        mistakes += [
            f"{name} {getattr(self, name):g}: must be a positive number (unit {unit})"
            for name, unit in {"window": "s", "rate": "rad/s", "tolerance": "1"}.items()
            if not 0.0 < getattr(self, name) < math.inf
        ]
        if self.cutoff is not None and not 0.0 <= self.cutoff < math.inf:
            mistakes.append(f"cutoff {self.cutoff:g}: must be a frequency in Hz, or 0 for no filter")
        mistakes += _list_wrong_counts(self, {"stops": 0, "knees": 0, "iterations": 1})
        mistakes += [
            f"thresholds {grid}: must be positive and increase, each once"
            for grid in self.thresholds or ()
            if any(not 0.0 < value < math.inf for value in grid) or not _is_increasing(grid)
        ]
        mistakes += [
            f"knee_torques {grid}: must differ from 0 and increase, each once"
            for grid in self.knee_torques or ()
            if any(not math.isfinite(value) or not value for value in grid) or not _is_increasing(grid)
        ]
        _refuse("usage.elastic-option", mistakes)

    @property
    def moves_stops(self) -> bool:
        """Return whether the data place stops and knees: not those that are given or stay on their grid."""
        return self.refine and self.thresholds is None


def check_grids(options: ElasticOptions, joints: int) -> None:
    """Check that given thresholds and knees are those of so many joints.

    Raises:
        UsageError: they are not.
    """
    given = {"thresholds": options.thresholds, "knee_torques": options.knee_torques}
    mistakes = [
        f"{name} are given for {len(grid)} joints; the robot has {joints}"
        for name, grid in given.items()
        if grid is not None and len(grid) != joints
    ]
    _refuse("usage.elastic-option", mistakes)


def _refuse(code: str, mistakes: Sequence[str]) -> None:
    if mistakes:
        raise UsageError(*(Notice(code=code, text=text) for text in mistakes))


def _list_wrong_counts(options: object, counts: dict[str, int]) -> list[str]:
    small = [
        f"{name} {getattr(options, name)}: must be {least} or more"
        for name, least in counts.items()
        if getattr(options, name) < least
    ]
    return small + [
        f"{name} {getattr(options, name)}: must be a whole number"
        for name in counts
        # Not a number leaves no zero either.
        if getattr(options, name) % 1
    ]


def _is_increasing(grid: Sequence[float]) -> bool:
    return list(grid) == sorted(set(grid))
