"""`validate` and `report` process logs as the fit did: filters that were chosen, and settings of runs."""

import json

import numpy as np
import pytest

from symid.cli.main import run
from tests.calls import ask, do, fail, list_codes, say

pytestmark = pytest.mark.usefixtures("shared_work")


@pytest.fixture(scope="module")
def folder(tmp_path_factory, robots_folder):
    """Return a folder with a robot that leaves its processing open, a clean log and a noisy one."""
    folder = tmp_path_factory.mktemp("open")
    text = (robots_folder / "two_link.toml").read_text(encoding="utf-8")
    (folder / "arm.toml").write_text(text[: text.index("# For logs at 1 kHz.")], encoding="utf-8")
    for name, seed in (("clean", 5), ("noisy", 6)):
        path = folder / f"{name}.npz"
        do("simulate", "two_link", "--clean", "-o", path, "--seed", seed)
        columns = dict(np.load(path))
        generator = np.random.default_rng(seed)
        if name == "noisy":
            for key in [key for key in columns if key.startswith("q")]:
                columns[key] = columns[key] + generator.normal(0.0, 1e-3, size=columns[key].shape)
        for key in [key for key in columns if key.startswith("tau")]:
            columns[key] = columns[key] + generator.normal(0.0, 0.5, size=columns[key].shape)
        np.savez(path, **columns)
    count = len(columns["t"])
    thin = {key: entry[::4] if entry.shape[:1] == (count,) else entry for key, entry in columns.items()}
    np.savez(folder / "slow.npz", **thin)
    return folder


@pytest.fixture(scope="module")
def estimate(folder):
    path = folder / "estimate.json"
    do("identify", folder / "arm.toml", folder / "noisy.npz", "-o", path)
    return path


def validate(folder, log, *options):
    return do("validate", folder / "arm.toml", folder / "estimate.json", folder / log, *options)


def test_validation_filters_as_the_fit_did(folder, estimate):
    stored = json.loads(estimate.read_text())["settings"]["processing"]
    call = ("identify", folder / "arm.toml", folder / "clean.npz")
    do(*call, "-o", folder / "clean.json")
    assert json.loads((folder / "clean.json").read_text())["settings"]["processing"] != stored
    answer = validate(folder, "clean.npz")
    used = answer["result"]["processing"]
    assert used.pop("origin") == {"filter_cutoff": "fit", "decimation.factor": "fit"}
    assert used == stored
    # The estimate does not differ from a robot file that leaves it open.
    assert "estimate.settings-differ" not in list_codes(answer)
    out = say("validate", folder / "arm.toml", estimate, folder / "clean.npz")
    assert f"low-pass at {stored['filter_cutoff']:g} Hz" in out
    assert f" by {stored['decimation']['factor']} " in out


def test_a_log_at_another_rate_has_filters_of_its_own(folder, estimate):
    stored = json.loads(estimate.read_text())["settings"]["processing"]
    for options in ((), ("--band", "5")):
        answer = validate(folder, "slow.npz", *options)
        used = answer["result"]["processing"]
        assert set(used["origin"].values()) == {"log"}
        assert used["decimation"]["factor"] < stored["decimation"]["factor"]
        assert "identify.automatic" in list_codes(answer)


@pytest.mark.parametrize(
    "case",
    [("filter_cutoff=33", 33.0, None), ("decimation.factor=1", None, 1), ("decimation.factor=3", None, 3)],
)
def test_settings_of_the_call_win(folder, estimate, case):
    setting, cutoff, factor = case
    stored = json.loads(estimate.read_text())["settings"]["processing"]
    used = validate(folder, "clean.npz", "--set", f"processing.{setting}")["result"]["processing"]
    assert used["filter_cutoff"] == (cutoff or stored["filter_cutoff"])
    assert used["decimation"]["factor"] == (factor or stored["decimation"]["factor"])
    assert "stated" in used["origin"].values()


@pytest.fixture(scope="module")
def runs(folder):
    """Return a file of three runs, no two of them alike, and the estimate from it."""
    path = folder / "runs.toml"
    path.write_text(
        '[[run]]\nfile = "clean.npz"\nweight = 4\ndrop_last = 4000\n'
        '[[run]]\nfile = "clean.npz"\ndrop_first = 6500\nweight = 0.5\n'
        '[[run]]\nfile = "noisy.npz"\ndrop_first = 700\noffset = [0.01, "-0.5 deg"]\n',
        encoding="utf-8",
    )
    return path


@pytest.mark.parametrize("options", [(), ("--rows", "momentum", "--overlap", "0.5", "--estimator", "wls")])
def test_a_diagnosis_reads_runs_as_the_fit_did(folder, runs, tmp_path, options):
    found, page = tmp_path / "estimate.json", tmp_path / "page.html"
    freedom = ("--set", "processing.noise_freedom=one")
    do("identify", folder / "arm.toml", runs, *options, *freedom, "--drop-first", 50, "-o", found)
    call = ("report", found, "--robot", folder / "arm.toml", "--diagnose", "-o", page)
    answer = do(*call)
    assert answer["result"]["diagnosis"]["refit"]["largest_difference_stds"] <= 1e-12
    assert not {"diagnosis.other-values", "diagnosis.changed-log"} & set(list_codes(answer))
    # Settings for a held-out log do not touch the logs of the fit.
    held = ("--validation", folder / "noisy.npz", "--set", "processing.filter_cutoff=20", "--force")
    _, answer = ask(*call, *held)
    assert answer["result"]["diagnosis"]["refit"]["largest_difference_stds"] <= 1e-12
    (used,) = answer["result"]["processing"]
    assert (used["filter_cutoff"], used["origin"]["filter_cutoff"]) == (20.0, "stated")
    assert used["origin"]["decimation.factor"] == "fit"
    assert "noisy.npz: positions: low-pass at 20 Hz (as stated)" in say(*call, *held)
    data = json.loads(found.read_text())
    for entry in data["settings"]["runs"]:
        entry["offset"] = [0.0]
    found.write_text(json.dumps(data))
    assert "diagnosis.other-values" in list_codes(do(*call, "--force"))
    del data["settings"]["runs"][0]
    found.write_text(json.dumps(data))
    assert fail(*call, "--force") == (3, "runs.settings")


def test_a_log_that_has_changed_is_named(capsys, folder, tmp_path):
    log, found = tmp_path / "log.npz", tmp_path / "estimate.json"
    columns = dict(np.load(folder / "clean.npz"))
    np.savez(log, **columns)
    do("identify", folder / "arm.toml", log, "-o", found)
    for key in [key for key in columns if key.startswith("tau")]:
        columns[key] = 1.01 * columns[key]
    np.savez(log, **columns)
    call = ("report", found, "--robot", folder / "arm.toml", "--diagnose", "-o", tmp_path / "page.html")
    answer = do(*call)
    assert {"diagnosis.changed-log", "diagnosis.other-values"} <= set(list_codes(answer))
    assert answer["result"]["diagnosis"]["refit"]["largest_difference_stds"] > 0.1
    assert run([*map(str, call), "--force", "-q"]) == 0
    moved = answer["result"]["diagnosis"]["refit"]["largest_difference_stds"]
    assert f"{moved:.1g} standard deviations" in capsys.readouterr().out


def test_a_page_of_momentum_rows_takes_a_coarse_log(capsys, folder, tmp_path):
    """Windows of the fit are shorter than two samples of it."""
    with np.load(folder / "clean.npz") as log:
        columns = {key: log[key] for key in log.files}
    count = len(columns["t"])
    thin = {key: entry[::10] if entry.shape[:1] == (count,) else entry for key, entry in columns.items()}
    np.savez(tmp_path / "coarse.npz", **thin)
    call = ("identify", folder / "arm.toml", folder / "clean.npz", "--rows", "momentum", "--window", "0.004")
    assert run([*map(str, call), "-o", str(tmp_path / "fit.json"), "-q"]) == 0
    call = ("report", tmp_path / "fit.json", "--robot", folder / "arm.toml")
    capsys.readouterr()
    log = ("--validation", tmp_path / "coarse.npz", "-o", tmp_path / "page.html")
    assert "validate.longer-windows" in list_codes(do(*call, *log))
    assert (tmp_path / "page.html").exists()
