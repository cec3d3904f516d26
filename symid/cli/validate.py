"""`symid validate ROBOT ESTIMATE LOG`: what an estimate explains of a log it was not fitted to."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from symid.cli.friction_result import validate_friction_result
from symid.cli.inputs import load_robot_library, load_robot_of_estimate, read_one_log
from symid.cli.options import FiniteRange, set_option, split_settings, verb
from symid.cli.output import Answer, Console
from symid.cli.tables import describe_band, describe_validation, show_band, show_residual
from symid.cli.validate_elastic import ElasticCall, answer_elastic, find_missed_gate
from symid.errors import Notice, UsageError

if TYPE_CHECKING:  # these load numpy
    from symid.codegen.library import Library
    from symid.data.recording import Recording
    from symid.estimators.estimate import Estimate
    from symid.residuals.metric import BandResidual
    from symid.robot.log_map import Processing

__all__ = ["command"]

_MISSED = 1


@click.command("validate")
@click.argument("robot")
@click.argument("estimate", type=click.Path(path_type=Path))
@click.argument("log", type=click.Path(path_type=Path))
@click.option(
    "--gate",
    type=FiniteRange(min=0.0, min_open=True),
    metavar="PERCENT",
    help="Largest acceptable mean of the joints' relative residuals; of elastic joints, in each table.",
)
@click.option(
    "--band",
    type=FiniteRange(min=0.0, min_open=True),
    metavar="HZ",
    help="Compare torques at the full sample rate, both low-passed alike at HZ, without half a second at "
    "either end; the gate is of that figure.",
)
@click.option(
    "--tracking",
    is_flag=True,
    help="Of elastic joints: simulate how links follow another motion with feed-forward of ESTIMATE; the "
    "robot file must state the true values.",
)
@click.option(
    "--against",
    type=click.Path(path_type=Path),
    metavar="ESTIMATE",
    help="With --tracking: a second estimate to compare with.",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    help="With --tracking: follow a random motion.  [default: tc for two joints, else 1]",
)
@set_option
@verb
def command(
    console: Console,
    *,
    robot: str,
    estimate: Path,
    log: Path,
    gate: float | None,
    band: float | None,
    tracking: bool,
    against: Path | None,
    seed: int | None,
    settings: tuple[str, ...],
) -> Answer:
    """Predict the torques of LOG with the parameters in ESTIMATE; nothing is fitted.

    Filter and friction are those of the identification; a result of --rows friction is tried as
    well, with the rigid part beside it. Exit code 1 when the gate is missed.
    """
    call = ElasticCall(
        robot=robot,
        estimate=estimate,
        log=log,
        gate=gate,
        pairs=split_settings(settings),
        tracking=tracking,
        against=against,
        seed=seed,
    )
    given = [name for name, value in (("--against", against), ("--seed", seed)) if value is not None]
    if given and not tracking:
        text = f"{', '.join(given)} is of the motion that --tracking simulates; give --tracking too"
        raise UsageError(Notice(code="usage.no-tracking", text=text))
    from symid.elastic.storage import is_elastic_estimate

    if is_elastic_estimate(estimate):
        _refuse_band(band, "elastic joints", estimate)
        return answer_elastic(console, call)
    if tracking:
        text = "--tracking needs an estimate of elastic joints with their springs; leave it out"
        raise UsageError(Notice(code="usage.rigid-tracking", text=text, file=str(estimate)))
    from symid.friction.results import is_friction_result

    if is_friction_result(estimate):
        _refuse_band(band, "a law of friction", estimate)
        return validate_friction_result(console, call)
    return _answer_rigid(console, call, band)


def _refuse_band(band: float | None, kind: str, estimate: Path) -> None:
    if band is not None:
        text = f"--band needs an estimate of base parameters, and this one is of {kind}; leave it out"
        raise UsageError(Notice(code="usage.no-band", text=text, file=str(estimate)))


def _answer_rigid(console: Console, call: ElasticCall, band: float | None) -> Answer:
    """Return what the rigid model explains; one that was identified as rigid is tried as rigid."""
    from symid.elastic.motor_side import (
        build_motor_recording,
        build_rigid_estimate,
        build_rigid_variant,
    )
    from symid.identification.fitted_processing import settle_as_fitted
    from symid.identification.storage import read_estimate
    from symid.identification.validate import check_model, validate_estimate

    read = read_estimate(call.estimate)
    described = load_robot_of_estimate(call.robot, read, call.pairs)
    found = build_rigid_estimate(read, described)
    recording = build_motor_recording(read_one_log(call.log, described), described)
    library = load_robot_library(build_rigid_variant(described), console)
    check_model(found, library.card, str(call.estimate))
    console.progress(f"validating on {recording.source}")
    settled = settle_as_fitted(found, described.processing, recording)
    validation = validate_estimate(found, library, recording, described.processing)
    residual = None if band is None else _compare_band(found, library, recording, settled.processing, band)
    reached = (residual or validation).mean_relative_percent
    errors = find_missed_gate(reached, call.gate, recording.source)
    kind = " (joints taken as rigid)" if any(described.elastic) else ""
    within = "" if band is None else f" within {band:g} Hz"
    headline = f"{described.name}{kind} on {recording.source}{within}: mean relative residual {reached:.4f} %"
    text = "\n\n".join(
        (
            f"{headline}\n{settled.tell()}",
            show_residual(validation.residual) if residual is None else show_band(residual),
        )
    )
    return Answer(
        text=text,
        result={
            **describe_validation(validation),
            **({} if residual is None else {"band": describe_band(residual)}),
            "processing": {**asdict(settled.processing), "origin": dict(settled.origin)},
            "gate": call.gate,
            "accepted": not errors,
        },
        warnings=(*described.notices, *library.notices, *recording.notices, *validation.notices),
        errors=errors,
        exit_code=_MISSED if errors else 0,
    )


def _compare_band(
    estimate: "Estimate", library: "Library", recording: "Recording", processing: "Processing", band: float
) -> "BandResidual":
    from symid.residuals.metric import find_band_residual, predict_torques

    names = tuple(entry.name for entry in (*library.card.beta, *library.card.friction))
    values = estimate.assemble(names)
    return find_band_residual(predict_torques(values, library, recording, processing, band=band))
