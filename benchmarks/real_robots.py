"""Real recordings: what is foretold within a band, beside what others reached; TX40 values beside others'.

    python benchmarks/real_robots.py FOLDER      the folder that holds tx40/, kr300/ and emps/

Prints tables; writes nothing.
"""

import csv
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from symid.codegen.cache import prepare_library
from symid.data.readers import read_recording
from symid.formats.locate import find_robot_file
from symid.formats.toml import read_robot
from symid.identification.diagnosis import diagnose_estimate
from symid.identification.identify import identify_parameters
from symid.identification.metric import find_band_residual, predict_torques
from symid.parameters.base import find_base_parameters
from symid.parameters.regrouping import find_regrouping, read_group

FITS = (("torque", "ols"), ("torque", "wls"), ("momentum", "ols"), ("momentum", "wls"))
COUPLED = {"fv5": "fv5 + fvm6", "fv6": "fv6 + fvm6", "Ia5": "Ia5 + Iam6"}


def load(name):
    """Return a shipped robot and its compiled functions."""
    robot = read_robot(find_robot_file(name))
    return robot, prepare_library(robot)


def measure(library, estimate, recording, processing, band):
    """Return the mean relative residual of a log within a band, in percent."""
    names = tuple(entry.name for entry in (*library.card.beta, *library.card.friction))
    prediction = predict_torques(estimate.assemble(names), library, recording, processing, band=band)
    return find_band_residual(prediction).mean_relative_percent


def show_tx40(folder):
    """Print what all of the TX40's log and its first part foretell."""
    robot, library = load("tx40")
    recording = read_recording(folder / "tx40" / "tx40.npz", robot)
    whole = replace(robot.processing, drop_first=0, drop_last=0)
    split = round(0.6 * len(recording.time))
    head = replace(robot.processing, drop_last=len(recording.time) - split)
    tail = replace(whole, drop_first=split)
    count = len(library.card.beta) + len(library.card.friction)
    print(f"TX40, {count} base parameters; all data within 20 Hz (others 10.4 %), 60/40 within 10 Hz (26 %)")
    for rows, estimator in FITS:
        options = {"rows": rows, "estimator": estimator}
        every = identify_parameters(library, [recording], robot.processing, **options)
        part = identify_parameters(library, [recording], head, **options)
        print(
            f"  {rows:8} {estimator}  all {measure(library, every, recording, whole, 20.0):6.2f} %"
            f"   60/40 {measure(library, part, recording, tail, 10.0):6.2f} %"
        )
    show_published(folder, robot, library, recording)


def show_published(folder, robot, library, recording):
    """Print weighted least squares beside the published values, in the published groups."""
    with (folder / "tx40" / "published.csv").open(encoding="utf-8", newline="") as file:
        published = list(csv.DictReader(file))
    groups = [
        read_group(COUPLED.get(row["base_parameter"], row["base_parameter"]), robot) for row in published
    ]
    found = find_regrouping(find_base_parameters(robot), groups)
    print(
        f"  {len(found.rows)} published groups and {', '.join(found.absent)}: same space {found.is_complete}"
    )
    change = np.array([[float(value) for value in row] for row in found.rows])
    estimate = identify_parameters(library, [recording], robot.processing, estimator="wls")
    values = change @ estimate.assemble(found.names)
    spread = np.sqrt(np.diag(change @ np.array(estimate.covariance) @ change.T))
    print(f"  {'group':32} {'ours':>10} {'std':>9} {'published':>10} {'std':>9} {'in std':>7}")
    for row, value, std in zip(published, values, spread, strict=True):
        other = float(row["wls"])
        stated = abs(other) * float(row["wls_std_percent"]) / 100.0
        away = (value - other) / np.hypot(std, stated)
        name = row["base_parameter"][:32]
        print(f"  {name:32} {value:10.5f} {std:9.5f} {other:10.5f} {stated:9.5f} {away:7.2f}")


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
            f"  {rows:8} {estimator}  C {measure(library, both, logs['c'], robot.processing, 10.0):6.2f} %"
            f"   B {measure(library, one, logs['b'], robot.processing, 10.0):6.2f} %"
        )
    both = identify_parameters(library, [logs["a"], logs["b"]], robot.processing, estimator="wls")
    found = diagnose_estimate(both, library, [logs["a"], logs["b"]], robot.processing)
    essential = found.essential
    whole = len(essential.kept) + len(essential.dropped)
    prediction = predict_torques(essential.values, library, logs["c"], robot.processing, band=10.0)
    percent = find_band_residual(prediction).mean_relative_percent
    print(f"  {len(essential.kept)} of {whole} parameters are essential; with them alone C {percent:.2f} %")


def show_emps(folder):
    """Print what rows with and without accelerations leave of the EMPS."""
    robot, library = load("emps")
    logs = [read_recording(folder / "emps" / f"DATA_EMPS{end}.mat", robot) for end in ("", "_PULSES")]
    print("EMPS, within 20 Hz: the log of the fit, and the one with pulses")
    for rows in ("torque", "momentum"):
        estimate = identify_parameters(library, logs[:1], robot.processing, rows=rows)
        shares = [measure(library, estimate, log, robot.processing, 20.0) for log in logs]
        print(f"  {rows:8} ols  {shares[0]:6.2f} %  {shares[1]:6.2f} %")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    data = Path(sys.argv[1])
    show_tx40(data)
    show_kr300(data)
    show_emps(data)
