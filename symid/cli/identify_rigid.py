"""From options of `symid identify` to the estimate of a rigid robot.

Input: a robot, its library, recordings, options. Output: `Estimate`.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from symid.cli.estimator_options import OUTPUT_ERROR, SIMULATING, build_estimator_options
from symid.cli.inputs import describe_logs, show_path
from symid.cli.output import Console

if TYPE_CHECKING:  # these load numpy
    from symid.codegen.library import Library
    from symid.data.recording import Recording
    from symid.estimators.estimate import Estimate
    from symid.robot.description import Robot

__all__ = ["check_simulated", "fit_rigid", "show_tracking"]


def check_simulated(robot: "Robot", recordings: Sequence["Recording"], estimator: str) -> None:
    """Refuse what an estimator that simulates the robot cannot simulate, before anything is compiled.

    Raises:
        UsageError: no controller, no reference, elastic joints.
    """
    if estimator in SIMULATING:
        from symid.identification.controlled_estimate import check_controlled

        check_controlled(robot, recordings)


def fit_rigid(
    robot: "Robot",
    library: "Library",
    recordings: Sequence["Recording"],
    console: Console,
    *,
    rows: str,
    estimator: str,
    options: Mapping[str, Any],
) -> "Estimate":
    """Return the estimate that rows and estimator make of the recordings.

    Args:
        robot: as it is identified.
        library: its functions.
        recordings: the logs.
        console: told of each simulation.
        rows: their kind.
        estimator: its name.
        options: of `estimator_options`, "window" and "period".
    """
    from symid.data.runs import find_weights
    from symid.identification.identify import identify_parameters
    from symid.rows.identifiability import WHOLE_MODEL, RankRule

    rule = RankRule(least=0.0 if options["partial"] else WHOLE_MODEL)
    weights, echo = find_weights(recordings), describe_logs(robot, recordings)
    if estimator in SIMULATING:
        from symid.identification.instrumental_estimate import identify_instrumental
        from symid.identification.output_error_estimate import identify_output_error
        from symid.identification.storage import read_estimate

        start: str | None = options["start"]
        identify = identify_output_error if estimator == OUTPUT_ERROR else identify_instrumental
        return identify(
            robot,
            library,
            recordings,
            start=None if start is None else read_estimate(Path(start), library.card),
            start_name="" if start is None else show_path(Path(start)),
            rule=rule,
            weights=weights,
            echo=echo,
            tell=console.progress,
        )
    return identify_parameters(
        library,
        recordings,
        robot.processing,
        rows=rows,
        estimator=estimator,
        options=build_estimator_options(robot, library, recordings, estimator=estimator, options=options),
        **{name: options[name] for name in ("window", "overlap") if options[name] is not None},
        rule=rule,
        weights=weights,
        echo=echo,
    )


def show_tracking(estimate: "Estimate") -> list[str]:
    """Return what an estimator that simulates the robot says of its simulations, nothing of others."""
    told: Any = estimate.settings.get("fit")
    if estimate.estimator not in SIMULATING or not isinstance(told, Mapping):
        return []
    count = told["iterations"]
    lines = [f"begun with {told['start']}; {count} simulation{'s'[: count > 1]} of the controlled robot"]
    lines += [
        f"{entry['joint']}: simulated positions {entry['simulated_from_measured']:.3g} {entry['unit']} (rms) "
        f"from the measured ones, the reference {entry['reference_from_measured']:.3g} {entry['unit']}"
        for entry in told["tracking"]
    ]
    if "wls" in told:
        lines.append(told["wls"]["verdict"])
    return ["\n".join(lines)]
