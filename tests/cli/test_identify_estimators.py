"""`symid identify` with every estimator and kind of rows, and what does not go together."""

import pytest

from tests.calls import do, refuse


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("estimators") / "log.npz"
    do("simulate", "two_link", "--seed", "1", "--duration", "10", "-o", path)
    return path


@pytest.mark.parametrize("estimator", ["gls", "huber", "ridge", "consistent", "sequential"])
def test_every_estimator_finds_the_stated_values(log, estimator):
    result = do("identify", "two_link", log, "--estimator", estimator)["result"]
    assert result["estimator"] == estimator
    assert result["settings"]["fit"]
    for entry in result["parameters"]:
        assert abs(entry["value"] - entry["truth"]) < 0.02 * max(abs(entry["truth"]), 0.2)


@pytest.mark.parametrize(
    "options",
    [
        ("--rows", "filtered", "--window", "0.05"),
        ("--rows", "power"),
        ("--rows", "momentum", "--window", "0.2", "--overlap", "0.5"),
    ],
)
def test_every_kind_of_rows_finds_the_stated_values(log, options):
    answer = do("identify", "two_link", log, "--estimator", "wls", *options)
    for entry in answer["result"]["parameters"]:
        assert abs(entry["value"] - entry["truth"]) < 0.05 * max(abs(entry["truth"]), 0.2)
    if "--overlap" in options:
        assert answer["result"]["settings"]["overlap"] == 0.5


def test_an_estimate_is_a_prior(log, tmp_path):
    first = tmp_path / "first.json"
    do("identify", "two_link", log, "-o", first)
    answer = do("identify", "two_link", log, "--estimator", "ridge", "--prior", first, "--prior-weight", "1")
    assert answer["result"]["settings"]["fit"]["prior_weight"] == 1.0


@pytest.mark.parametrize(
    "options",
    [
        ("--overlap", "0.5"),
        ("--window", "0.1"),
        ("--prior", "robot"),
        ("--period", "2"),
        ("--rows", "filtered", "--overlap", "0.5"),
    ],
)
def test_options_of_others_are_refused(log, options):
    assert refuse("identify", "two_link", log, *options) == (2, ["usage.mixed-options"])


def test_a_motion_that_does_not_repeat_tells_no_noise(log):
    assert refuse("identify", "two_link", log, "--estimator", "gls", "--period", "0.37") == (
        2,
        ["usage.period"],
    )


def test_the_studies_of_identification_answer(log):
    answer = do("study", "precision", "two_link", "--seeds", "3", "--jobs", "1")
    assert [entry["method"] for entry in answer["result"]["methods"]] == ["wls", "momentum", "consistent"]
    assert do("study", "cutoff", "two_link", log)["result"]["lines"]
    for arguments in (("precision",), ("cutoff", "two_link"), ("elastic", "two_link")):
        assert refuse("study", *arguments) == (2, ["usage.call"])
