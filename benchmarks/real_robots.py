"""Real recordings: what is foretold within a band, beside what others reached; TX40 values beside others'.

    python benchmarks/real_robots.py FOLDER      the folder that holds tx40/, kr300/ and emps/

Prints tables, also of what processing does to the TX40's values; writes nothing.
"""

import sys
from dataclasses import replace
from pathlib import Path

from symid.codegen.cache import prepare_library
from symid.dynamics.base_parameters import derive_base_parameters
from symid.dynamics.regrouping import (
    build_regrouping,
    evaluate_regrouping,
    express_group,
    list_coupled_readings,
    read_group,
)
from symid.identification.compare import (
    add_readings,
    build_stated_values,
    compare_values,
    compute_grouped_values,
)
from symid.identification.diagnostics.residual_structure import compute_band_residual
from symid.identification.rigid.fit import identify_parameters
from symid.identification.rigid.validation import diagnose_estimate, read_fit_processing
from symid.logs.reader import read_recording
from symid.logs.recording import cut_recording
from symid.robot.loading import locate_robot_file, override_robot
from symid.robot.parameter_values import TableColumns, read_value_table
from symid.robot.toml_reader import read_robot

FITS = (("torque", None), ("torque", "ols"), ("torque", "wls"), ("momentum", "ols"), ("momentum", "wls"))
"""Rows and estimator, None for the one that is chosen."""


def load(name, settings=()):
    """Return a shipped robot with other settings, and its compiled functions."""
    robot = override_robot(read_robot(locate_robot_file(name)), settings)
    return robot, prepare_library(robot)


def measure(library, estimate, recording, band):
    """Return the mean relative residual of a log within a band, in percent; it is processed as in the fit."""
    processing = read_fit_processing(estimate.settings)
    names = tuple(entry.name for entry in (*library.card.beta, *library.card.friction))
    values = estimate.assemble(names)
    return compute_band_residual(values, library, recording, processing, band=band).mean_relative_percent


def show_tx40(folder):
    """Print what all of the TX40's log and its first part foretell."""
    robot, library = load("tx40")
    recording = read_recording(folder / "tx40" / "tx40.npz", robot)
    split = round(0.6 * len(recording.time))
    head, tail = (cut_recording(recording, part) for part in (slice(0, split), slice(split, None)))
    count = len(library.card.beta) + len(library.card.friction)
    print(f"TX40, {count} base parameters; all data within 20 Hz (others 10.4 %), 60/40 within 10 Hz (26 %)")
    for rows, estimator in FITS:
        options = {"rows": rows, "estimator": estimator}
        every = identify_parameters(library, [recording], robot.processing, **options)
        part = identify_parameters(library, [head], robot.processing, **options)
        print(
            f"  {rows:8} {estimator or 'chosen':6}  all {measure(library, every, recording, 20.0):6.2f} %"
            f"   60/40 {measure(library, part, tail, 10.0):6.2f} %"
        )
    show_published(folder, robot, library, recording)
    show_processing(robot, library, recording)


def show_published(folder, robot, library, recording):
    """Print weighted least squares beside the published values, as they stand and with the coupling in."""
    columns = TableColumns(value="wls")
    base = derive_base_parameters(robot)
    path = folder / "tx40" / "published.csv"
    table = read_value_table(path, columns, lambda text: read_group(text, robot, base))
    names = [row.text for row in table.rows]
    titles = [repr(name) for name in names]
    groups = [express_group(base, row.name, title) for row, title in zip(table.rows, titles, strict=True)]
    found = build_regrouping(base, groups, titles)
    print(f"  {len(found.rows)} published groups; in none of them: {', '.join(found.absent)}")
    theirs = build_stated_values([row.value for row in table.rows], [row.deviation for row in table.rows])
    change = evaluate_regrouping(found.rows, robot)
    readings = list_coupled_readings(robot, base, found.rows)
    terms = ", ".join(f"{names[entry.group]} + {entry.name}" for entry in readings)
    for standstill in (0.0, None):
        processing = replace(robot.processing, standstill=standstill)
        estimate = identify_parameters(library, [recording], processing, estimator="wls")
        stds = [entry.std for entry in estimate.parameters]
        ours = build_stated_values(estimate.assemble(found.names), stds, estimate.covariance)
        print("  slow rows left out as chosen" if standstill is None else "  all rows")
        for word, matrix in (("as it stands", change), (terms, add_readings(change, readings))):
            entry = compare_values(compute_grouped_values(matrix, ours), theirs)
            within = " and ".join(f"{entry.count_within(limit)}" for limit in (2.0, 3.0))
            print(
                f"    {word}: {within} of {entry.judged} within 2 and 3 deviations, largest "
                f"{entry.largest:.1f}, chi-square {entry.chi_square.value:.0f}"
            )


def show_processing(robot, library, recording):
    """Print what processing does to the first base parameter and the friction of its joint."""
    cases = (
        ("as chosen", {}),
        ("low-pass 100 Hz", {"filter_cutoff": "100"}),
        ("low-pass 50 Hz", {"filter_cutoff": "50"}),
        ("100 Hz, one row in 25", {"filter_cutoff": "100", "decimation.factor": "25"}),
        ("100 Hz, one row in 100", {"filter_cutoff": "100", "decimation.factor": "100"}),
        ("0.1 s at either end left out", {"drop_first": "500", "drop_last": "500"}),
        ("all rows", {"standstill": "0"}),
        ("rows below 0.05 rad/s left out", {"standstill": "0.05"}),
        ("rows below 0.1 rad/s left out", {"standstill": "0.1"}),
        ("rows below 0.2 rad/s left out", {"standstill": "0.2"}),
    )
    print("TX40: what processing does, ols and wls")
    for name, settings in cases:
        pairs = [(f"processing.{key}", value) for key, value in settings.items()]
        processing = override_robot(robot, pairs, None).processing
        texts = []
        for estimator in ("ols", "wls"):
            estimate = identify_parameters(library, [recording], processing, estimator=estimator)
            known = {entry.name: entry for entry in estimate.parameters}
            texts += [f"{known[key].value:.4f} +- {known[key].std:.4f}" for key in ("ZZR1", "Fv1", "Fc1")]
        print(f"  {name:32} {'  '.join(texts)}")


def show_kr300(folder):
    """Print what runs of the KR300 foretell of others."""
    robot, library = load("kr300")
    logs = {run: read_recording(folder / "kr300" / f"run_{run}.npz", robot) for run in "abc"}
    print("KR300, within 10 Hz: A and B foretell C (others 25.0 %), A foretells B (47.5 %)")
    for rows, estimator in FITS:
        options = {"rows": rows, "estimator": estimator}
        both = identify_parameters(library, [logs["a"], logs["b"]], robot.processing, **options)
        one = identify_parameters(library, [logs["a"]], robot.processing, **options)
        print(
            f"  {rows:8} {estimator or 'chosen':6}  C {measure(library, both, logs['c'], 10.0):6.2f} %"
            f"   B {measure(library, one, logs['b'], 10.0):6.2f} %"
        )
    both = identify_parameters(library, [logs["a"], logs["b"]], robot.processing, estimator="wls")
    found = diagnose_estimate(both, library, [logs["a"], logs["b"]], robot.processing)
    essential = found.essential
    whole = len(essential.kept) + len(essential.dropped)
    processing = read_fit_processing(both.settings)
    left = compute_band_residual(essential.values, library, logs["c"], processing, band=10.0)
    percent = left.mean_relative_percent
    print(f"  {len(essential.kept)} of {whole} parameters are essential; with them alone C {percent:.2f} %")


def show_emps(folder):
    """Print what rows with and without accelerations leave of the EMPS."""
    robot, library = load("emps", [("settings", "published")])
    logs = [read_recording(folder / "emps" / f"DATA_EMPS{end}.mat", robot) for end in ("", "_PULSES")]
    print("EMPS, within 20 Hz: the log of the fit, and the one with pulses")
    for rows in ("torque", "momentum"):
        estimate = identify_parameters(library, logs[:1], robot.processing, rows=rows)
        shares = [measure(library, estimate, log, 20.0) for log in logs]
        print(f"  {rows:8} ols  {shares[0]:6.2f} %  {shares[1]:6.2f} %")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    data = Path(sys.argv[1])
    show_tx40(data)
    show_kr300(data)
    show_emps(data)
