"""Instrumental variables from a robot file and logs to an estimate, with a verdict on least squares.

Input: a robot whose file states the controller, its library, recordings with references. Output: `Estimate`.

Supported: several recordings, of unequal weight. Not supported: elastic robots.
"""

from collections.abc import Callable, Mapping, Sequence

from symid.codegen.library import Library
from symid.data.recording import Recording
from symid.errors import Notice
from symid.estimators.estimate import Estimate
from symid.identification.controlled_estimate import Way, identify_controlled
from symid.identification.controlled_runs import ControlledFit
from symid.identification.exogeneity import Exogeneity, find_exogeneity
from symid.identification.instrumental_fit import find_start, fit_instrumental
from symid.identification.servo import ServoLoop
from symid.residuals.doubts import warn_of_processing
from symid.robot.description import Robot
from symid.robot.log_map import Processing
from symid.rows.identifiability import JOINT_AT_REST, RankRule

__all__ = ["INSTRUMENTAL", "identify_instrumental"]

INSTRUMENTAL = "instrumental"
"""The estimator's name."""
_REFERENCES = "instruments along the references"
_SHOWN = 4
_ROUNDING = 1e-16


def identify_instrumental(
    robot: Robot,
    library: Library,
    recordings: Sequence[Recording],
    *,
    start: Estimate | None = None,
    start_name: str = "",
    rule: RankRule | None = None,
    weights: Sequence[float] | None = None,
    echo: Mapping[str, object] | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> Estimate:
    """Return the parameters that explain the torque, with instruments from the simulated robot.

    Args and Raises: as `identify_controlled`.
    """
    return identify_controlled(
        _WAY,
        robot,
        library,
        recordings,
        start=start,
        start_name=start_name,
        rule=rule,
        weights=weights,
        echo=echo,
        tell=tell,
    )


def _begin(
    library: Library, recordings: Sequence[Recording], loops: Sequence[ServoLoop], processing: Processing
) -> tuple[Mapping[str, float], str] | None:
    values = find_start(library, recordings, loops, processing)
    return None if values is None else (values, _REFERENCES)


def _judge(
    found: ControlledFit, processing: Processing, recordings: Sequence[Recording]
) -> tuple[Mapping[str, object], tuple[Notice, ...]]:
    """Return how good the instruments are and what they say of least squares, and notices."""
    solution = found.solution.instrumental
    if solution is None:
        return {}, ()
    verdict = find_exogeneity(found.rows, solution, processing.noise_freedom)
    strong = solution.strength < float("inf")
    told = {
        "instruments": {
            "correlation": solution.correlation,
            "strength": solution.strength if strong else None,
        },
        "wls": {
            "biased": bool(verdict.biased),
            "statistic": verdict.statistic,
            "freedom": list(verdict.freedom),
            "probability": verdict.probability,
            "shifts": dict(verdict.shifts),
            "verdict": _say_verdict(verdict),
        },
    }
    # Raw differences are what instruments are for; a filter that damps the motion is not.
    blurs = (notice for notice in warn_of_processing(processing, recordings) if notice.code == _BLURS)
    return told, (*_warn_of_bias(verdict), *blurs)


def _say_verdict(verdict: Exogeneity) -> str:
    chance = "chance below 1e-16"
    if verdict.probability > _ROUNDING:
        chance = f"chance {verdict.probability:.2g}"
    if verdict.biased:
        names = ", ".join(f"{name} {shift:+.2g}" for name, shift in verdict.biased[:_SHOWN])
        return f"wls of these rows is biased by noise in the states, in its deviations: {names} ({chance})"
    if verdict.told:
        return f"wls of these rows differs, by less than its deviations but by more than chance ({chance})"
    return f"wls of these rows is not biased by noise in the states, as far as can be told ({chance})"


def _warn_of_bias(verdict: Exogeneity) -> tuple[Notice, ...]:
    if not verdict.biased:
        return ()
    text = (
        f"{_say_verdict(verdict)}: the filter leaves too much noise in the states, or blurs where joints "
        "turn around (processing.filter_cutoff, decimation, processing.standstill); all fits of torque rows "
        "of this log but this one bear it"
    )
    return (Notice(code="identify.biased-wls", text=text),)


_BLURS = "identify.low-cutoff"
_WAY = Way(
    name=INSTRUMENTAL,
    fit=fit_instrumental,
    price="the instruments are worse for it, which the deviations bear",
    judge=_judge,
    begin=_begin,
    kept=(JOINT_AT_REST, "identify.automatic"),
)
