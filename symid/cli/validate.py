"""`symid validate ROBOT ESTIMATE LOG`: what an estimate explains of a log it was not fitted to."""

from pathlib import Path

import click

import symid
from symid.api.fit import ElasticFit, Fit, RigidFit
from symid.api.validation import LogValidation
from symid.cli.inputs import NamedRobot, split_settings
from symid.cli.options import (
    METHOD,
    OUTPUT,
    PROCESSING,
    FiniteRange,
    Verb,
    option,
    robot_argument,
    set_option,
    verb,
)
from symid.cli.output import Answer, Console, make_answer
from symid.errors import Notice, UsageError

__all__ = ["command"]


@click.command("validate", cls=Verb)
@robot_argument(computes=True)
@click.argument("estimate", type=click.Path(path_type=Path))
@click.argument("log", type=click.Path(path_type=Path))
@option(
    "--gate",
    type=FiniteRange(min=0.0, min_open=True),
    metavar="PERCENT",
    group=OUTPUT,
    help="Largest acceptable mean of the joints' relative residuals; of elastic joints, in each table.",
)
@option(
    "--band",
    type=FiniteRange(min=0.0, min_open=True),
    metavar="HZ",
    group=PROCESSING,
    help="Compare torques at the full sample rate, both low-passed alike at HZ, without half a second at "
    "either end; the gate is of that figure.",
)
@option(
    "--tracking",
    is_flag=True,
    group=METHOD,
    help="Elastic joints: simulate how links follow another motion with feed-forward of ESTIMATE; the "
    "robot file must state the true values.",
)
@option(
    "--against",
    type=click.Path(path_type=Path),
    metavar="ESTIMATE",
    group=METHOD,
    help="With --tracking: a second estimate to compare with.",
)
@option(
    "--seed",
    type=click.IntRange(min=0),
    metavar="N",
    group=METHOD,
    help="With --tracking: follow a random motion of this seed.  [default: tc for two joints, else 1]",
)
@set_option
@verb
def command(
    console: Console,
    *,
    robot: NamedRobot,
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
    pairs = split_settings(settings)
    given = [name for name, value in (("--against", against), ("--seed", seed)) if value is not None]
    if given and not tracking:
        text = f"{', '.join(given)} is of the motion that --tracking simulates; give --tracking too"
        raise UsageError(Notice(code="usage.no-tracking", text=text))
    fit = symid.load_fit(estimate, robot.load(console))
    if isinstance(fit, ElasticFit) and tracking:
        _refuse_band(fit, band)
        others = [] if against is None else [_load_elastic(against)]
        return make_answer(fit.track(log, against=others, seed=seed, gate=gate, settings=pairs))
    if tracking:
        text = "--tracking needs an estimate of elastic joints with their springs; leave it out"
        raise UsageError(Notice(code="usage.rigid-tracking", text=text, file=str(estimate)))
    return make_answer(_validate(fit, log, gate=gate, band=band, settings=pairs))


def _validate(
    fit: Fit, log: Path, *, gate: float | None, band: float | None, settings: dict[str, str]
) -> LogValidation:
    if isinstance(fit, RigidFit):
        return fit.validate(log, gate=gate, band=band, settings=settings)
    _refuse_band(fit, band)
    return fit.validate(log, gate=gate, settings=settings)


def _refuse_band(fit: Fit, band: float | None) -> None:
    if band is not None:
        kind = "elastic joints" if isinstance(fit, ElasticFit) else "a law of friction"
        text = f"--band needs an estimate of base parameters, and this one is of {kind}; leave it out"
        raise UsageError(Notice(code="usage.no-band", text=text, file=str(fit.file)))


def _load_elastic(path: Path) -> ElasticFit:
    fit = symid.load_fit(path)
    if not isinstance(fit, ElasticFit):
        text = "--against compares with another estimate of elastic joints, and this is none"
        raise UsageError(Notice(code="usage.rigid-tracking", text=text, file=str(path)))
    return fit
