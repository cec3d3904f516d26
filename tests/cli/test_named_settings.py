"""Named settings of a robot file as a user calls them: `--settings NAME`, alone and with `--set`."""

import numpy as np
import pytest

from tests.calls import ask, do, fail, hear

FORCE_FACTOR = 35.15065188


def find_texts(answer, code):
    return [entry["text"] for entry in answer["warnings"] if entry["code"] == code]


@pytest.fixture
def axis_log(tmp_path):
    """Return 10 s of the EMPS at 1 kHz, 95 kg with dry and viscous friction and a little noise."""
    time = 1e-3 * np.arange(10000)
    q = 0.1 * np.sin(3.0 * time) + 0.02 * np.sin(11.0 * time)
    v = 0.3 * np.cos(3.0 * time) + 0.22 * np.cos(11.0 * time)
    a = -0.9 * np.sin(3.0 * time) - 2.42 * np.sin(11.0 * time)
    force = 95.0 * a + 200.0 * v + 20.0 * np.sign(v) - 3.0 + np.random.default_rng(0).normal(size=len(time))
    np.savez(tmp_path / "axis.npz", t=time, qm=q, vir=force / FORCE_FACTOR)
    return tmp_path / "axis.npz"


def test_a_named_set_is_what_its_keys_say(axis_log):
    arguments = ("identify", "emps", axis_log)
    answer = do(*arguments, "--settings", "published")
    processing = answer["result"]["settings"]["processing"]
    assert (processing["filter_cutoff"], processing["drop_first"]) == (100.0, 49)
    assert (processing["decimation"]["factor"], processing["noise_freedom"]) == (10, "one")
    assert not processing["automatic"]
    # The same by hand.
    pairs = (
        *("automatic=false", "filter_cutoff=100", "drop_first=49", "standstill=0", "noise_freedom=one"),
        "decimation.factor=10",
    )
    single = [part for pair in pairs for part in ("--set", f"processing.{pair}")]
    other = do(*arguments, *single)
    assert other["result"]["parameters"] == answer["result"]["parameters"]
    assert other["result"]["settings"]["processing"] == processing


def test_single_settings_and_options_win(axis_log):
    arguments = ("identify", "emps", axis_log, "--set", "processing.filter_cutoff=60")
    processing = do(*arguments, "--settings", "published", "--decimate", "5")["result"]["settings"][
        "processing"
    ]
    assert (processing["filter_cutoff"], processing["drop_first"]) == (60.0, 49)
    assert processing["decimation"]["factor"] == 5


def test_a_fit_knows_the_set_again(axis_log, tmp_path):
    fit = tmp_path / "fit.json"
    ask("identify", "emps", axis_log, "--settings", "published", "-o", fit)
    answer = do("validate", "emps", fit, axis_log)
    assert find_texts(answer, "estimate.settings-differ") == [
        "the estimate has the settings 'published' of the robot file, and they are used"
    ]
    named = do("validate", "emps", fit, axis_log, "--settings", "published")
    assert not find_texts(named, "estimate.settings-differ")
    assert named["result"]["mean_relative_percent"] == answer["result"]["mean_relative_percent"]
    ask("identify", "emps", axis_log, "--cutoff", "60", "--decimate", "5", "-o", fit, "--force")
    other = do("validate", "emps", fit, axis_log, "--settings", "published")
    assert other["result"]["samples"] == answer["result"]["samples"]


def test_an_unknown_set_is_a_mistake_of_the_call(axis_log, tmp_path):
    for verb in (("check",), ("identify",), ("study", "cutoff")):
        code, answer = ask(*verb, "emps", axis_log, "--settings", "publsihed")
        (error,) = answer["errors"]
        assert (code, error["code"]) == (2, "usage.unknown-settings")
        assert "it has published; did you mean published?" in error["text"]
        assert error["file"].endswith("emps.toml")
    fit, page = tmp_path / "fit.json", tmp_path / "page.html"
    ask("identify", "emps", axis_log, "-o", fit)
    assert fail("validate", "emps", fit, axis_log, "--settings", "other") == (2, "usage.unknown-settings")
    text = hear(2, "usage.no-validation", "report", fit, "--settings", "published", "-o", page)
    assert text.startswith("--settings is of the logs")
    do("report", fit, "--validation", axis_log, "--settings", "published", "-o", page)
    assert page.is_file()
