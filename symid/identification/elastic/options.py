"""Options of an identification of elastic joints: hysteresis model, filters, stopping rule; names of methods.

Supported: thresholds and knees that are given, or grids over the torsion and torque of the recordings.
Not supported: another hysteresis model for each joint. Loads nothing heavy: the command line reads the names.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from numbers import Real

from symid.errors import UsageError
from symid.identification.judge import numerics

METHODS = ("automatic", "two-step", "nlp")
"""What a user may ask for; "automatic" compares these and others on the data and takes the best."""
NLP_ROWS = ("energy", "filtered", "momentum")
HESSIANS = ("exact", "gauss-newton")
RATE = 60.0
"""rad/s, of the filter of rows where motion reaches up to 20 Hz, as that of arms does. Faster motions ask for
as much more: what lies far above the filter is noise in its rows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NlpOptions:
    """How the one-shot problem of the method "nlp" is set up and solved; wrong values raise UsageError.

    Args:
        rows: some of `NLP_ROWS`; hessian: one of `HESSIANS`.
        stribeck: whether friction gets Fs exp(-(v / vs)^2) sign(v) on top.
        smoothing: v0 of tanh(v / v0) in place of sign(v) in it, rad/s or m/s; 0 for the sign.
        speeds: least and greatest vs, rad/s or m/s.
        odd: whether springs harden alike on both sides.
        slopes: least and greatest slope of the outer function.
        least_stiffness: the least k0 as a part of the linear spring.
        rounds: of weighing the rows by their residuals, at most; 0 keeps the weights of the start.
        iterations: of Ipopt, at most.
    """

    rows: tuple[str, ...] = ("energy", "momentum")
    hessian: str = "exact"
    stribeck: bool = False
    smoothing: float = 0.0
    speeds: tuple[float, float] = (1e-3, 10.0)
    odd: bool = False
    slopes: tuple[float, float] = (0.05, 20.0)
    least_stiffness: float = 1e-3
    rounds: int = numerics.ROUNDS
    iterations: int = 200

    def __post_init__(self) -> None:
        """Refuse wrong values, all at once."""
        mistakes = _list_mistakes(
            self,
            positive={"least_stiffness": "1"},
            counts={"rounds": 0, "iterations": 1},
        )
        if self.hessian not in HESSIANS:
            mistakes.insert(0, f"hessian {self.hessian!r}: allowed are {', '.join(HESSIANS)}")
        # A text in place of a tuple of texts is refused by its letters.
        if not self.rows or not set(self.rows) <= set(NLP_ROWS) or len(set(self.rows)) < len(self.rows):
            allowed = ", ".join(NLP_ROWS)
            mistakes.append(f"rows {self.rows!r}: must be a tuple of some of {allowed}, each once")
        if not 0.0 < self.speeds[0] < self.speeds[1] < math.inf:
            mistakes.append(f"speeds {self.speeds}: must be positive, the least first")
        if not 0.0 < self.slopes[0] < 1.0 < self.slopes[1] < math.inf:
            text = "must be positive; 1, the slope at zero torque, lies between"
            mistakes.append(f"slopes {self.slopes}: {text}")
        if not 0.0 <= self.smoothing < math.inf:
            mistakes.append(f"smoothing {self.smoothing:g}: must be a speed in rad/s or m/s, or 0")
        UsageError.refuse(mistakes, code="usage.nlp-option")


@dataclass(frozen=True, slots=True, kw_only=True)
class ElasticOptions:
    """How elastic joints are identified; wrong values raise UsageError.

    Args:
        stops: number m of thresholds of a grid, r_i = i / (m + 1) max |phi|.
        thresholds: one tuple a joint, rad or m, in place of the grid.
        knees: number of knees on either side of the outer function; 0 for a plain Prandtl-Ishlinskii model.
        knee_torques: one tuple a joint of signed torques, N m or N, in place of the grid.
        refine: optimise the places of thresholds and knees that are on a grid; not of those given.
        window: length of an energy row in s.
        rate: lambda of the filter lambda / (s + lambda), rad/s; None for what the motion asks for.
        cutoff: of the zero-phase low-pass in Hz; 0 for none, None to choose by the encoders' noise.
        tolerance: of the relative change of parameters and residuals at which the iteration stops.
        iterations: at most; nlp: of the method "nlp".
        effects: find what drives, gears and encoders add (`DriveEffect`), and take it off.
        known: dynamic parameters that are not identified, by name, such as those of CAD, in SI units.
    """

    stops: int = 8
    thresholds: tuple[tuple[float, ...], ...] | None = None
    knees: int = 4
    knee_torques: tuple[tuple[float, ...], ...] | None = None
    refine: bool = True
    window: float = 0.1
    rate: float | None = None
    cutoff: float | None = None
    tolerance: float = 1e-4
    iterations: int = numerics.ROUNDS
    nlp: NlpOptions = field(default_factory=NlpOptions)
    effects: bool = True
    known: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse wrong values, all at once."""
        mistakes = _list_mistakes(
            self,
            positive={"window": "s", "tolerance": "1"},
            counts={"stops": 0, "knees": 0, "iterations": 1},
        )
        if self.rate is not None and not 0.0 < self.rate < math.inf:
            mistakes.append(f"rate {self.rate:g}: must be a positive number (unit rad/s)")
        if self.cutoff is not None and not 0.0 <= self.cutoff < math.inf:
            mistakes.append(f"cutoff {self.cutoff:g}: must be a frequency in Hz, or 0 for no filter")
        for name, least in (("thresholds", 0.0), ("knee_torques", -math.inf)):
            for grid in getattr(self, name) or ():
                allowed = all(least < value < math.inf and value != 0.0 for value in grid)
                if not allowed or list(grid) != sorted(set(grid)):
                    sign = "positive" if least == 0.0 else "finite, not 0,"
                    mistakes.append(f"{name} {grid}: must be {sign} and increase, each once")
        mistakes += [
            f"known {name} {value!r}: must be a finite number"
            for name, value in dict[str, object](self.known).items()
            if not (isinstance(value, Real) and math.isfinite(value))
        ]
        UsageError.refuse(mistakes, code="usage.elastic-option")

    @property
    def filter_rate(self) -> float:
        """Return the rate of the filter of rows in rad/s: that of arms where no motion has set it."""
        return RATE if self.rate is None else self.rate

    @property
    def moves_stops(self) -> bool:
        """Return whether the fit optimises the places of the stops: not if given or to stay on the grid."""
        return self.refine and self.thresholds is None


def check_grids(options: ElasticOptions, joints: int) -> None:
    """Raise UsageError where thresholds or knees are given for another number of joints."""
    given = {"thresholds": options.thresholds, "knee_torques": options.knee_torques}
    mistakes = [
        f"{name} are given for {len(grid)} joints; the robot has {joints}"
        for name, grid in given.items()
        if grid is not None and len(grid) != joints
    ]
    UsageError.refuse(mistakes, code="usage.elastic-option")


def _list_mistakes(options: object, *, positive: Mapping[str, str], counts: Mapping[str, int]) -> list[str]:
    """Return what is wrong with fields: units of positive numbers, least whole numbers."""
    mistakes = []
    for name, unit in positive.items():
        if not 0.0 < (value := getattr(options, name)) < math.inf:
            mistakes.append(f"{name} {value:g}: must be a positive number (unit {unit})")
    for name, least in counts.items():
        # The remainder of what is not a number is not zero either.
        if (value := getattr(options, name)) < least or value % 1:
            mistakes.append(f"{name} {value}: must be a whole number, {least} or more")
    return mistakes
