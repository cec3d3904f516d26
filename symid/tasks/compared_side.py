"""An estimate as one side of a comparison: its values in order, its logs, what speaks against it.

Input: a robot, an estimate. Output: `EstimateSide`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from symid.elastic.estimate import ElasticEstimate
from symid.errors import EstimateError, Notice
from symid.estimators.estimate import Estimate
from symid.identification.comparison import StatedValues, build_stated_values
from symid.robot.description import Robot
from symid.tasks.identified import Identified, build_identified

__all__ = ["EstimateSide", "build_side"]

_PATTERN = "identify.pattern"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EstimateSide:
    """An estimate that is compared, and its values in the order of its base parameters.

    Args:
        source: where it is from.
        identified: what it says of the robot.
        names: of its parameters, with `values`.
        logs: path and digest of each log; an empty digest is not known.
        notices: what speaks against its deviations, and what of it is not compared.
    """

    source: Path
    identified: Identified
    names: tuple[str, ...]
    values: StatedValues
    logs: tuple[tuple[str, str], ...]
    notices: tuple[Notice, ...]


def build_side(robot: Robot, estimate: Estimate | ElasticEstimate, source: Path) -> EstimateSide:
    """Return an estimate of `robot` as a side of a comparison; `source` is where it is from.

    Raises:
        EstimateError: it is of another model, or says no value.
    """
    found = build_identified(robot, estimate, source)
    if not found.values:
        text = "it has no value of any base parameter; identify again"
        raise EstimateError(Notice(code="compare.no-values", text=text, file=str(source)))
    return EstimateSide(
        source=source,
        identified=found,
        names=tuple(entry.name for entry in found.values),
        values=build_stated_values(
            [entry.value for entry in found.values], [entry.std for entry in found.values], found.covariance
        ),
        logs=_list_logs(estimate),
        notices=_list_doubts(found, estimate.notices, source),
    )


def _list_logs(estimate: Estimate | ElasticEstimate) -> tuple[tuple[str, str], ...]:
    digests = estimate.settings.get("log_digests")
    known = [*digests] if isinstance(digests, list | tuple) else []
    known += [""] * (len(estimate.sources) - len(known))
    return tuple((source, str(digest)) for source, digest in zip(estimate.sources, known, strict=False))


def _list_doubts(found: Identified, notices: Sequence[Notice], source: Path) -> tuple[Notice, ...]:
    """Return what speaks against the deviations of an estimate, and what of it is not compared."""
    doubts = [
        Notice(code="compare.pattern", text=entry.text, file=str(source))
        for entry in notices
        if entry.code == _PATTERN
    ]
    if not found.covariance and sum(math.isfinite(entry.std) for entry in found.values) > 1:
        text = (
            "it has no covariance: its values are taken as independent of each other, which chi-square feels"
        )
        doubts.append(Notice(code="compare.no-covariance", text=text, file=str(source)))
    if found.springs or found.rotors:
        text = "base parameters and friction are compared; rotors and springs of elastic joints are not"
        doubts.append(Notice(code="compare.springs", text=text, file=str(source)))
    return tuple(doubts)
