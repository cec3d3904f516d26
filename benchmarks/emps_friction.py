"""Friction of a real servo axis (EMPS): laws on the published pipeline, motion simulated from the force.

    python benchmarks/emps_friction.py [FOLDER] [ladder|choice|simulation ...]

FOLDER holds DATA_EMPS.mat and DATA_EMPS_PULSES.mat (Janot, Gautier, Brunot 2019), by default
../shared/data/emps.

    ladder       four laws whose numbers are known, and those numbers
    choice       of a law by blocks of DATA_EMPS held back; the one chosen then meets PULSES
    simulation   of the axis without feedback, 20 samples given: a model is chosen by blocks of DATA_EMPS held
                 back, fitted to DATA_EMPS, and only then meets PULSES, next to the fit of four parameters

Nothing is fitted to PULSES, and nothing is chosen by it.
"""

import sys
from pathlib import Path

import numpy as np
from axis_simulation import (
    AxisModel,
    AxisRun,
    AxisTrial,
    OutputErrorFit,
    SearchPlan,
    build_axis_run,
    build_axis_samples,
    choose_axis_trial,
    compute_relative_residual,
    compute_window_rmse,
    fit_whole_run,
    try_axis_model,
)

from symid.identification.friction.estimators import fit_friction
from symid.identification.friction.joint_fit import FrictionSamples
from symid.identification.friction.selection import CANDIDATE_LAWS, select_law
from symid.joint_models.friction_catalogue import get_law
from symid.logs.reader import read_recording
from symid.logs.recording import Recording
from symid.robot.description import Robot
from symid.robot.loading import load_robot

KNOWN = {
    "coulomb-viscous-offset": "4.0834 / 5.9824",
    "stribeck+offset": "3.9468 / 5.9047",
    "asymmetric": "3.1117 / 5.3649",
    "asymmetric-stribeck": "2.9325 / 5.2809",
}
LAWS = (*CANDIDATE_LAWS, "asymmetric-stribeck-both", "asymmetric-stribeck-exponent")
TERMS = ((), ("drift",), ("drift", "slope", "bend"))
FOUR = AxisModel(law=get_law("coulomb-viscous-offset"))
MODELS = tuple(
    AxisModel(law=get_law(law), terms=terms)
    for law, terms in (
        ("coulomb-viscous-offset", ()),
        ("asymmetric", ()),
        ("coulomb-viscous-offset", ("drift",)),
        ("asymmetric", ("drift",)),
        ("stribeck+offset", ("drift",)),
        ("load-dependent+offset", ("drift",)),
        ("asymmetric", ("slope", "bend")),
        ("asymmetric", ("drift", "spring")),
        ("asymmetric", ("drift", "slope")),
        ("asymmetric-stribeck", ("drift",)),
        ("cubic+offset", ("drift",)),
        ("asymmetric", ("drift", "slope", "bend")),
    )
)
PLAN = SearchPlan(cutoff=100.0, lengths=(1.5, 3.1, 6.2), shape=(0.03,), restarts=2)
PUBLISHED = np.array([95.1089, 203.5034, 20.3935, -3.1648])


def main() -> None:
    """Print the tables asked for."""
    words = sys.argv[1:]
    tables = [word for word in words if word in {"ladder", "choice", "simulation"}]
    folders = [word for word in words if word not in tables]
    folder = Path(folders[0]) if folders else Path(__file__).resolve().parents[2] / "shared" / "data" / "emps"
    robot = load_robot("emps", [("settings", "published")])
    data, pulses = (
        read_recording(folder / name, robot) for name in ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat")
    )
    for table in tables or ["ladder", "choice", "simulation"]:
        {"ladder": print_ladder, "choice": print_choice, "simulation": print_simulation}[table](
            robot, data, pulses
        )


def print_ladder(robot: Robot, data: Recording, pulses: Recording) -> None:
    """Print the laws whose numbers are known."""
    fitted, unseen = (build_axis_samples(entry, robot.processing) for entry in (data, pulses))
    print(f"{'law':32}{'values':>7}{'DATA %':>9}{'PULSES %':>10}   known")
    for law, known in KNOWN.items():
        print(f"{write_row(fitted, unseen, law)}   {known}")


def write_row(fitted: FrictionSamples, unseen: FrictionSamples, name: str) -> str:
    """Return what a law that is fitted to one recording leaves of it and of the other."""
    law = get_law(name)
    estimate = fit_friction(fitted, law)
    unknowns = len(estimate.linear) + len(estimate.shape) + len(estimate.other)
    percents = [compute_relative_residual(samples, law, estimate) for samples in (fitted, unseen)]
    return f"{name:32}{unknowns:7}{percents[0]:9.4f}{percents[1]:10.4f}"


def print_choice(robot: Robot, data: Recording, pulses: Recording) -> None:
    """Print how laws foretell blocks of DATA_EMPS held back, and what the chosen one leaves of PULSES."""
    chosen = []
    for terms in TERMS:
        samples = build_axis_samples(data, robot.processing, terms=terms)
        selection, _ = select_law(samples, LAWS)
        print(f"\nbeside the law: {', '.join(terms) or 'nothing'}. {selection.verdict}")
        for trial in selection.trials[:5]:
            print(f"{trial.law:32}{trial.unknowns + 1 + len(terms):7}{trial.held_percent:9.4f} % held back")
        held = min(
            trial.held_percent or np.inf for trial in selection.trials if trial.law == selection.chosen
        )
        chosen.append((held, selection.chosen, terms))
    held, law, terms = min(chosen)
    fitted, unseen = (build_axis_samples(entry, robot.processing, terms=terms) for entry in (data, pulses))
    print(f"\nchosen: {law} with {', '.join(terms) or 'nothing'} beside it, {held:.4f} % held back")
    print(write_row(fitted, unseen, law))


def print_simulation(_robot: Robot, data: Recording, pulses: Recording) -> None:
    """Print how each model foretells blocks held back, and the simulations of PULSES."""
    run, unseen = build_axis_run(data), build_axis_run(pulses)
    print(f"\n{'model':40}{'values':>7}   held back, mm: all, each block")
    trials = []
    for model in MODELS:
        trials.append(try_axis_model(model, run, PLAN, generator=np.random.default_rng(0)))
        blocks = "  ".join(f"{1e3 * value:.2f}" for value in trials[-1].held)
        print(
            f"{model.name:40}{len(model.parameters):7}   {1e3 * trials[-1].rmse:6.3f}   {blocks}", flush=True
        )
    chosen = choose_axis_trial(trials)
    print(f"chosen: {chosen.model.name}")
    fits = [
        fit_whole_run(model, run, PLAN, generator=np.random.default_rng(0))
        for model in dict.fromkeys((FOUR, chosen.model))
    ]
    print_fits(fits, chosen, unseen)


def print_fits(fits: list[OutputErrorFit], chosen: AxisTrial, unseen: AxisRun) -> None:
    """Print what fits to DATA_EMPS leave of PULSES."""
    print(f"\n{'root mean square error of the position, mm':60}{'DATA':>8}{'PULSES':>8}   known")
    published = 1e3 * compute_window_rmse(FOUR, PUBLISHED, unseen)
    print(f"{'published values of four parameters':60}{'':8}{published:8.2f}   8.82")
    for model, fit, known in zip((FOUR, chosen.model), fits, ("4.35", "2.64 (network)"), strict=False):
        error = 1e3 * compute_window_rmse(model, np.array(fit.values), unseen)
        print(f"{model.name:60}{1e3 * fit.rmse:8.3f}{error:8.2f}   {known}")
        values = ", ".join(f"{name} {value:.4f}" for name, value in zip(fit.names, fit.values, strict=True))
        print(f"    {values}; {fit.evaluations} simulations")


if __name__ == "__main__":
    main()
