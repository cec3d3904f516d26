"""Identification of elastic joints: recordings of both encoders to dynamics, friction and hysteresis.

Library, recordings, ElasticOptions -> ElasticEstimate.

    Recording -> signals -> rows -> methods -> choice -> estimate

Supported: several recordings; one method, or an automatic choice among those that take moments.
Not supported: delays between channels and offsets of encoders (align the recordings first); one encoder only.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen.library import Library
from symid.data.recording import Recording
from symid.elastic.choice import Score
from symid.elastic.covariance import find_told
from symid.elastic.doubts import check_recordings, find_unknown, list_cards, warn_of_condition, warn_of_fit
from symid.elastic.estimate import ElasticEstimate, MethodTrial
from symid.elastic.fit import ElasticFit
from symid.elastic.methods import ElasticWork, build_work, find_linear_rows, fit_method
from symid.elastic.options import ElasticOptions
from symid.elastic.residuals import find_energy_residual, find_torque_residuals, judge_springs, list_springs
from symid.elastic.selection import choose_fit, fit_candidates
from symid.errors import Notice
from symid.estimators.estimate import ParameterEstimate
from symid.rows.identifiability import RankRule, find_spectrum

__all__ = ["identify_elastic"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Choice:
    """The fit taken, all that were made, their scores, why, and what a reader should know."""

    fit: ElasticFit
    fits: tuple[ElasticFit, ...]
    scores: tuple[Score, ...]
    reason: str
    notices: tuple[Notice, ...] = ()


def identify_elastic(
    library: Library,
    recordings: Sequence[Recording],
    options: ElasticOptions | None = None,
    *,
    echo: Mapping[str, object] | None = None,
) -> ElasticEstimate:
    """Return dynamics, friction and springs that explain the recordings best.

    Args:
        library: the functions of an elastic robot.
        recordings: at least one, each with the positions of motors and links.
        options: method, grids, filters; None for the defaults.
        echo: further settings to keep with the result.

    Raises:
        UsageError: the robot is not elastic, no recording is given, or windows or thresholds do not fit.
        LogError: a recording lacks an encoder, has another number of joints, is too short or uneven.
        IdentifiabilityError: nothing moves, no torque is measured, all torsions drown in the encoders' noise,
            or no spring explains any joint's torque.
    """
    options = options or ElasticOptions()
    hidden = check_recordings(library.card, recordings)
    work = build_work(library, tuple(recordings), options)
    choice = _choose(work, options)
    fit = choice.fit
    told, condition = _find_told(find_linear_rows(work, fit).design)
    springs = judge_springs(work, fit, hidden, warn_of_condition(work, fit, condition))
    return ElasticEstimate(
        robot=library.card.robot,
        signature=library.card.signature,
        method=fit.method,
        reason=choice.reason,
        parameters=_list_parameters(library, fit),
        springs=list_springs(work, fit, springs),
        residual=find_torque_residuals(work, fit),
        energy=find_energy_residual(work, fit),
        condition=condition,
        outcome=fit.outcome,
        history=fit.history,
        trials=_list_trials(choice),
        sources=tuple(recording.source for recording in recordings),
        settings=_write_settings(work, options, echo or {}),
        refused=_list_refused(library, told, find_unknown(work, fit), springs),
        covariance=_write_covariance(fit),
        notices=(
            *springs.values(),
            *choice.notices,
            *fit.notices,
            *warn_of_fit(work, fit, condition, springs),
        ),
    )


def _choose(work: ElasticWork, options: ElasticOptions) -> _Choice:
    if options.method != "automatic":
        fit = fit_method(work, options.method)
        return _Choice(fit=fit, fits=(fit,), scores=(), reason="the method was asked for")
    fits, missing = fit_candidates(work)
    found = choose_fit(work, fits)
    return _Choice(
        fit=found.fit,
        fits=fits,
        scores=found.scores,
        reason=found.reason,
        notices=(*missing, *found.notices),
    )


def _list_parameters(library: Library, fit: ElasticFit) -> tuple[ParameterEstimate, ...]:
    covariance = fit.covariance if fit.covariance is not None else np.zeros((len(fit.chi),) * 2)
    deviations = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    cards = list_cards(library.card)
    return tuple(
        ParameterEstimate(
            name=card.name,
            value=float(value),
            std=float(deviation),
            unit=card.unit,
            expression=card.expression,
            reason=card.reason,
            truth=card.value,
        )
        for card, value, deviation in zip(cards, fit.chi, deviations, strict=True)
    )


def _list_trials(choice: _Choice) -> tuple[MethodTrial, ...]:
    errors = {score.name: score.error for score in choice.scores}
    return tuple(
        MethodTrial(
            method=fit.method,
            outcome=fit.outcome,
            error=errors.get(fit.method),
            values=tuple(map(float, fit.chi)),
        )
        for fit in choice.fits
    )


def _find_told(design: FloatArray) -> tuple[NDArray[np.bool_], float]:
    """Return which parameters the rows tell, and the condition number over the directions that they see."""
    spectrum = find_spectrum(design, RankRule().zero)
    seen = spectrum.singular > RankRule().singular * spectrum.singular[0]
    return find_told(design), float(spectrum.singular[0] / spectrum.singular[seen][-1])


def _list_refused(
    library: Library, told: NDArray[np.bool_], unknown: Mapping[str, str], springs: Mapping[int, Notice]
) -> tuple[tuple[str, str], ...]:
    """Return names and reasons of the parameters and springs that the recordings cannot tell."""
    apart = "the motions of these recordings do not tell it apart from others"
    joints = library.card.joints
    return (
        *(
            (card.name, apart if not known else unknown[card.name])
            for card, known in zip(list_cards(library.card), told.tolist(), strict=True)
            if not known or card.name in unknown
        ),
        *((f"spring of {joints[joint].name}", notice.text) for joint, notice in springs.items()),
    )


def _write_covariance(fit: ElasticFit) -> tuple[tuple[float, ...], ...]:
    return () if fit.covariance is None else tuple(tuple(map(float, row)) for row in fit.covariance)


def _write_settings(
    work: ElasticWork, options: ElasticOptions, echo: Mapping[str, object]
) -> Mapping[str, object]:
    """Return the settings as JSON would give them back, with the cut-offs that were chosen."""
    cutoffs = [part.cutoff for part in work.problem.signals]
    grid = [list(map(float, entry)) for entry in work.problem.thresholds]
    settings = {**echo, **asdict(options), "cutoffs": cutoffs, "grid": grid}
    plain: dict[str, object] = json.loads(json.dumps(settings))
    return plain
