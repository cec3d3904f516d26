"""Options of an identification of elastic joints: method, hysteresis model, filters, stopping rule.

Numbers and names -> ElasticOptions. Loads nothing heavy: the command line reads the names of the methods.

Supported: thresholds and knees of one's own, or grids over the torsion and torque of the recordings.
Not supported: another hysteresis model for each joint.
"""

import math
from dataclasses import dataclass

from symid.errors import Notice, UsageError

METHODS = ("automatic", "two-step", "linear-spring", "elimination", "weighted", "nlp", "independent")
SCHEMES = ("two-cost", "same-cost")


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

    def __post_init__(self) -> None:
        """Check what every later stage relies on.

        Raises:
            UsageError: with all that is wrong.
        """
        mistakes = [*_list_name_mistakes(self), *_list_number_mistakes(self), *_list_grid_mistakes(self)]
        if mistakes:
            raise UsageError(*(Notice(code="usage.elastic-option", text=text) for text in mistakes))


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
    if mistakes:
        raise UsageError(*(Notice(code="usage.elastic-option", text=text) for text in mistakes))


def _list_name_mistakes(options: ElasticOptions) -> list[str]:
    allowed = {"method": METHODS, "scheme": SCHEMES}
    return [
        f"{name} {getattr(options, name)!r}: there is no such {name}; allowed are {', '.join(names)}"
        for name, names in allowed.items()
        if getattr(options, name) not in names
    ]


def _list_number_mistakes(options: ElasticOptions) -> list[str]:
    positive = {"window": "s", "rate": "rad/s", "tolerance": "1"}
    mistakes = [
        f"{name} {getattr(options, name):g}: must be a positive number (unit {unit})"
        for name, unit in positive.items()
        if not 0.0 < getattr(options, name) < math.inf
    ]
    if options.cutoff is not None and not 0.0 <= options.cutoff < math.inf:
        mistakes.append(f"cutoff {options.cutoff:g}: must be a frequency in Hz, or 0 for no filter")
    counts = {"stops": 0, "knees": 0, "iterations": 1}
    mistakes += [
        f"{name} {getattr(options, name)}: must be {least} or more"
        for name, least in counts.items()
        if getattr(options, name) < least
    ]
    mistakes += [
        f"{name} {getattr(options, name)}: must be a whole number"
        for name in counts
        if getattr(options, name) % 1
    ]
    return mistakes


def _list_grid_mistakes(options: ElasticOptions) -> list[str]:
    mistakes = [
        f"thresholds {grid}: must be positive and increase, each once"
        for grid in options.thresholds or ()
        if any(not 0.0 < value < math.inf for value in grid) or list(grid) != sorted(set(grid))
    ]
    mistakes += [
        f"knee_torques {grid}: must differ from 0 and increase, each once"
        for grid in options.knee_torques or ()
        if any(not math.isfinite(value) or not value for value in grid) or list(grid) != sorted(set(grid))
    ]
    return mistakes
