"""Validation: what identified parameters explain of a log that they were not fitted to.

Input: an estimate, the library of the same model, a recording. Output: `Validation`.

Supported: torque rows (the default), and momentum and energy rows.
Not supported: a log with other joints, or a model other than the estimate's.
"""

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.functions import ModelCard
from symid.codegen.library import Library
from symid.data.recording import Recording
from symid.errors import EstimateError, Notice
from symid.identification.estimate import Estimate, Series, Validation
from symid.identification.preparation import prepare_rows
from symid.identification.rows import WINDOW, Rows
from symid.identification.statistics import find_residuals
from symid.robot.description import Processing

__all__ = ["check_model", "validate_estimate"]


def validate_estimate(
    estimate: Estimate,
    library: Library,
    recording: Recording,
    processing: Processing,
    *,
    rows: str = "torque",
    window: float = WINDOW,
) -> Validation:
    """Return residuals and series of `recording` under the estimate; nothing is fitted.

    Raises:
        EstimateError: the estimate belongs to another model than the library.
        LogError: the recording does not fit the robot.
        IdentifiabilityError: no joint moves in it.
    """
    check_model(estimate, library.card)
    built = prepare_rows(rows, library, recording, processing, window=window)
    predicted = built.matrix @ estimate.assemble(built.names)
    return Validation(
        robot=estimate.robot,
        signature=estimate.signature,
        source=recording.source,
        rows=rows,
        residual=find_residuals(built, built.values - predicted, 0),
        series=_split_series(built, predicted),
        samples=len(built.values),
        notices=built.notices,
    )


def check_model(estimate: Estimate, card: ModelCard, file: str = "") -> None:
    """Check that the estimate was made with the model of `card`.

    Raises:
        EstimateError: its signature is another one; the message says what differs.
    """
    if estimate.signature == card.signature:
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
