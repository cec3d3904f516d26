"""Validation: what identified parameters explain of a log that they were not fitted to.

Input: an estimate, the library of the same model, a recording. Output: `Validation`.

Supported: torque rows (the default), and momentum and energy rows.
Not supported: a log with other joints, or a model other than the estimate's.
"""

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.functions import ModelCard
from symid.codegen.library import Library
from symid.data.logs import is_fitted
from symid.data.recording import Recording
from symid.errors import EstimateError, Notice
from symid.estimators.estimate import Estimate, Series, Validation
from symid.estimators.statistics import find_residuals
from symid.identification.fitted_processing import settle_as_fitted
from symid.robot.log_map import Processing
from symid.rows.preparation import prepare_rows
from symid.rows.rows import WINDOW, Rows

__all__ = ["check_model", "validate_estimate"]


def validate_estimate(
    estimate: Estimate,
    library: Library,
    recording: Recording,
    processing: Processing,
    *,
    rows: str = "torque",
    window: float = WINDOW,
    overlap: float = 0.0,
) -> Validation:
    """Return residuals and series of `recording` under the estimate; nothing is fitted.

    Args:
        estimate: the parameters.
        library: the functions of the same model.
        recording: the log.
        processing: as stated; what it leaves open is as in the fit, see `settle_as_fitted`.
        rows: one of `ROW_KINDS`.
        window: length of windows in s.
        overlap: part of a window that the next one shares.

    Raises:
        EstimateError: the estimate belongs to another model than the library.
        LogError: the recording does not fit the robot.
        IdentifiabilityError: no joint moves in it.
    """
    check_model(estimate, library.card)
    fitted = is_fitted(recording, estimate.sources, estimate.settings)
    settled = settle_as_fitted(estimate, processing, recording)
    built = prepare_rows(rows, library, recording, settled.processing, window=window, overlap=overlap)
    predicted = built.matrix @ estimate.assemble(built.names)
    return Validation(
        robot=estimate.robot,
        signature=estimate.signature,
        source=recording.source,
        rows=rows,
        residual=find_residuals(built, built.values - predicted, 0),
        series=_split_series(built, predicted),
        samples=len(built.values),
        fitted=fitted,
        notices=(*settled.notices, *built.notices, *([_say_fitted(recording.source)] if fitted else [])),
        processing=settled,
    )


def check_model(estimate: Estimate, card: ModelCard, file: str = "") -> None:
    """Check that the estimate was made with the model of `card`.

    Raises:
        EstimateError: its signature is another one, or its parameters are not the model's; the
            message says what differs.
    """
    if estimate.signature == card.signature:
        _check_names(estimate, card, file)
        return
    friction = tuple(joint.friction for joint in card.joints)
    if estimate.robot != card.robot:
        difference = f"it was identified for robot {estimate.robot!r}, the robot given is {card.robot!r}"
    elif estimate.friction != friction:
        difference = (
            f"its friction is {', '.join(estimate.friction)}, that of the robot given {', '.join(friction)}"
        )
    else:
        difference = (
            f"the model of robot {card.robot!r} has changed since: its signature is now "
            f"{card.signature[:12]}, the estimate's is {estimate.signature[:12]}"
        )
    text = (
        f"the estimate does not fit the model: {difference}; "
        "use the same robot and options, or identify again"
    )
    raise EstimateError(Notice(code="estimate.signature", text=text, file=file))


def _check_names(estimate: Estimate, card: ModelCard, file: str) -> None:
    """Check that each parameter of the model is either known or refused, once, and that there is no other."""
    expected = {entry.name for entry in (*card.beta, *card.friction)}
    found = [entry.name for entry in estimate.parameters] + [name for name, _ in estimate.refused]
    problems = [f"{name!r} is given twice" for name in dict.fromkeys(found) if found.count(name) > 1]
    strange = [name for name, _ in estimate.unresolved if name not in expected]
    problems += [f"{name!r} is no parameter of it" for name in (*found, *strange) if name not in expected]
    problems += [f"{name!r} is missing" for name in sorted(expected - set(found))]
    if problems:
        text = (
            f"its parameters are not those of the model {card.robot!r}: {', '.join(problems)}; identify again"
        )
        raise EstimateError(Notice(code="estimate.parameters", text=text, file=file))


def _say_fitted(source: str) -> Notice:
    text = "the estimate was fitted to this very log, which is no test of it; validate on another motion"
    return Notice(code="validate.fitted-log", text=text, file=source)


def _split_series(rows: Rows, predicted: FloatArray) -> tuple[Series, ...]:
    masks = [(index, rows.group == index) for index in range(len(rows.group_names))]
    return tuple(
        Series(
            joint=rows.group_names[index],
            unit=rows.group_units[index],
            velocity_unit=rows.velocity_units[index],
            time=rows.time[mask],
            velocity=rows.velocity[mask],
            measured=rows.values[mask],
            predicted=predicted[mask],
        )
        for index, mask in masks
        if np.any(mask)
    )
