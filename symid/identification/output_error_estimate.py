"""Output error from a robot file and logs to an estimate like all others.

Input: a robot whose file states the controller, its library, recordings with references. Output: `Estimate`.

Supported: several recordings, of unequal weight. Not supported: elastic robots.
"""

from collections.abc import Callable, Mapping, Sequence

from symid.codegen.library import Library
from symid.data.recording import Recording
from symid.estimators.estimate import Estimate
from symid.identification.controlled_estimate import Way, identify_controlled
from symid.identification.output_error import fit_output_error
from symid.robot.description import Robot
from symid.rows.identifiability import RankRule

__all__ = ["OUTPUT_ERROR", "identify_output_error"]

OUTPUT_ERROR = "output-error"
"""The estimator's name."""
_WAY = Way(name=OUTPUT_ERROR, fit=fit_output_error, price="the parameters bear the difference")


def identify_output_error(
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
    """Return the parameters whose simulated robot needs the torques that were measured.

    Args and Raises: as `identify_controlled`; the processing's filter is not used.
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
