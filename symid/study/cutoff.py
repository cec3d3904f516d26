"""What the cut-off of the position filter does to a fit: torque rows, decimated or not, and momentum rows.

Input: a library, a recording, its processing. Output: `CutoffStudy`.

For every cut-off the parameters are fitted (WLS) to the first 60 % of the log, and foretell the torque of the
rest: mean over joints of |tau - tau_hat| / |tau|, both low-passed alike (`metric`). The states of the part
that is foretold pass the log's own filter throughout, so that only the fit differs.

Supported: rigid robots; cut-offs below 0.45 of the sample rate.
Not supported: a choice by the result: that would use up the data that judge it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from symid.codegen.library import Library
from symid.data.recording import Recording
from symid.errors import IdentifiabilityError
from symid.identification.identify import identify_parameters
from symid.residuals.metric import find_band_residual, predict_torques
from symid.robot.log_map import Decimation, Processing
from symid.rows.cutoff import choose_filters, choose_window

__all__ = ["CUTOFFS", "CutoffLine", "CutoffStudy", "study_cutoff"]

CUTOFFS = (10.0, 15.0, 20.0, 30.0, 50.0, 75.0, 100.0, 150.0, 200.0, 300.0)
BAND = 10.0
"""Of the comparison, in Hz."""
_SHARE = 0.6
_HIGHEST = 0.45


@dataclass(frozen=True, slots=True, kw_only=True)
class CutoffLine:
    """One cut-off in Hz: residuals foretold in percent; None where nothing could be fitted."""

    cutoff: float
    decimated: float | None
    plain: float | None
    momentum: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class CutoffStudy:
    """All cut-offs; `factor` of the decimation, `chosen` cut-off of the log, `band` of the comparison."""

    robot: str
    source: str
    factor: int
    chosen: float
    band: float
    lines: tuple[CutoffLine, ...]


def study_cutoff(
    library: Library,
    recording: Recording,
    processing: Processing,
    *,
    cutoffs: Sequence[float] = CUTOFFS,
    progress: Callable[[int, int], None] | None = None,
) -> CutoffStudy:
    """Return what fits with every cut-off foretell.

    Args:
        library: the robot's functions.
        recording: the log.
        processing: of the robot file; its cut-off is replaced.
        cutoffs: Hz.
        progress: told how many are done, of how many.
    """
    settled = choose_filters(processing, [recording]).processing
    if settled.filter_cutoff is None:
        settled = choose_filters(replace(settled, automatic=True), [recording]).processing
    window = choose_window("momentum", settled, recording.period)
    count = len(recording.time)
    middle = round(_SHARE * count)
    rest = replace(settled, drop_first=max(settled.drop_first, middle))
    usable = [value for value in cutoffs if value < _HIGHEST / recording.period]
    lines = []
    for value in usable:
        last = max(settled.drop_last, count - middle)
        filtered = replace(settled, filter_cutoff=value, drop_last=last)
        plain = replace(filtered, decimation=Decimation())
        lines.append(
            CutoffLine(
                cutoff=value,
                decimated=_foretell(library, recording, filtered, rest, "torque"),
                plain=_foretell(library, recording, plain, rest, "torque"),
                momentum=_foretell(library, recording, plain, rest, "momentum", window=window),
            )
        )
        if progress is not None:
            progress(len(lines), len(usable))
    return CutoffStudy(
        robot=library.card.robot,
        source=recording.source,
        factor=settled.decimation.factor,
        chosen=settled.filter_cutoff or 0.0,
        band=BAND,
        lines=tuple(lines),
    )


def _foretell(
    library: Library,
    recording: Recording,
    fitted: Processing,
    judged: Processing,
    rows: str,
    *,
    window: float | None = None,
) -> float | None:
    try:
        estimate = identify_parameters(
            library, [recording], fitted, rows=rows, estimator="wls", window=window
        )
    except IdentifiabilityError:
        return None
    names = tuple(entry.name for entry in (*library.card.beta, *library.card.friction))
    prediction = predict_torques(estimate.assemble(names), library, recording, judged, band=BAND)
    return find_band_residual(prediction).mean_relative_percent
