"""`--train` and `--test`: what is fitted and predicted is what files with these samples alone would give."""

import numpy as np
import pytest

import symid
from symid.cli.main import run
from tests.calls import ask, do, fail, find_texts, find_values, list_codes

pytestmark = pytest.mark.usefixtures("shared_work")
SAMPLES, BOUND = 6001, 3601
"""Of logs of 6 s at 1 kHz, and the first sample behind 60 %."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with two logs and, of the first one, files with its first 60 % and with the rest."""
    folder = tmp_path_factory.mktemp("parts")
    for name, seed in (("whole", 5), ("other", 6)):
        path = folder / f"{name}.npz"
        options = ("--duration", "6", "--seed", str(seed), "-q")
        assert run(["simulate", "two_link", "-o", str(path), *options]) == 0
    columns = dict(np.load(folder / "whole.npz"))
    for name, kept in (("head", slice(0, BOUND)), ("tail", slice(BOUND, None))):
        cut = {key: entry[kept] if entry.shape[:1] == (SAMPLES,) else entry for key, entry in columns.items()}
        np.savez(folder / f"{name}.npz", **cut)
    return folder


@pytest.fixture(scope="module")
def estimate(folder):
    path = folder / "estimate.json"
    call = ("identify", "two_link", str(folder / "whole.npz"), "--train", "0:60%", "-o", str(path), "-q")
    assert run(list(call)) == 0
    return path


def test_a_part_is_fitted_as_a_file_with_its_samples(folder):
    alone = do("identify", "two_link", folder / "head.npz")
    for part in ("0:60%", ":60%", "0:3.601", "0s:60%"):
        answer = do("identify", "two_link", folder / "whole.npz", "--train", part)
        assert find_values(answer) == find_values(alone)
        assert "log.cut" in list_codes(answer)


def test_each_log_may_have_its_own_part(folder):
    logs = (folder / "whole.npz", folder / "other.npz")
    alone = do("identify", "two_link", folder / "head.npz", logs[1])
    answer = do("identify", "two_link", *logs, "--train", "0:60%", "--train", "0:100%")
    assert find_values(answer) == find_values(alone)
    for count in (3, 4):
        parts = ("--train", "0:60%") * count
        assert fail("identify", "two_link", *logs, *parts) == (2, "usage.log-part")


def test_a_file_of_runs_states_parts(folder):
    runs = folder / "runs.toml"
    runs.write_text('[[run]]\nfile = "whole.npz"\ntrain = "0:60%"\n[[run]]\nfile = "other.npz"\n')
    alone = do("identify", "two_link", folder / "head.npz", folder / "other.npz")
    assert find_values(do("identify", "two_link", runs)) == find_values(alone)
    call = ("identify", "two_link", runs, "--train", "0:50%")
    assert fail(*call) == (2, "usage.log-part")


@pytest.mark.parametrize("options", [(), ("--band", "20")])
def test_the_rest_is_predicted_as_a_log_of_its_own(folder, estimate, options):
    call = ("validate", "two_link", estimate)
    alone = do(*call, folder / "tail.npz", *options)
    for part in ("60%:", "60:", "3.601s:"):
        answer = do(*call, folder / "whole.npz", "--test", part, *options)
        assert answer["result"]["mean_relative_percent"] == pytest.approx(
            alone["result"]["mean_relative_percent"], rel=1e-9
        )
        assert "validate.fitted-log" not in list_codes(answer)
    if options:
        assert answer["result"]["band"]["stacked_percent"] == pytest.approx(
            alone["result"]["band"]["stacked_percent"], rel=1e-9
        )


@pytest.mark.parametrize(
    ("part", "words"), [((), "3.401 of the 5.801 s"), (("--test", "50%:"), "0.4 of the 2.8 s")]
)
def test_fitted_samples_are_no_test(folder, estimate, part, words):
    """The robot file cuts 0.1 s off at either end of what is fitted, and of what is predicted."""
    answer = do("validate", "two_link", estimate, folder / "whole.npz", *part)
    assert words in find_texts(answer, "validate.fitted-log")


def test_samples_that_processing_cut_off_are_a_test(folder, tmp_path):
    """Both ends are cut by settings, once without and once with fitted samples in what is predicted."""
    found, log = tmp_path / "estimate.json", folder / "whole.npz"
    call = ("identify", "two_link", log, "--drop-first", 0, "--drop-last", 2000, "-o", found)
    do(*call)
    for first, fitted in ((4001, False), (3000, True)):
        ends = ("--set", f"processing.drop_first={first}", "--set", "processing.drop_last=0")
        assert ("validate.fitted-log" in list_codes(do("validate", "two_link", found, log, *ends))) is fitted


def test_one_call_fits_and_predicts(capsys, folder, estimate):
    call = ("identify", "two_link", folder / "whole.npz")
    alone = do("validate", "two_link", estimate, folder / "whole.npz", "--test", "60%:")
    for parts in (("0:60%", "60:"), ("0:60", "60%:"), ("0:60%", "60%:100%")):
        answer = do(*call, "--train", parts[0], "--test", parts[1])
        (found,) = answer["result"]["validations"]
        assert found["mean_relative_percent"] == alone["result"]["mean_relative_percent"]
        assert "validate.fitted-log" not in list_codes(answer)
    page = folder / "held_out.html"
    assert run([*map(str, call), "--train", "0:60%", "--test", "60%:", "--page", str(page)]) == 0
    left = alone["result"]["mean_relative_percent"]
    out, text = capsys.readouterr().out, page.read_text()
    assert f"{left:.4f} %" in out
    assert "page: " in out
    # The page shows what the held-out part was predicted by.
    assert f"<dt>residual of the torque on a held-out log</dt><dd>{left:.2g} %</dd>" in text
    assert text.count("Measured and predicted torque") >= 2


def test_logs_one_after_the_other_in_a_file_are_logs(folder, tmp_path):
    columns = [dict(np.load(folder / f"{name}.npz")) for name in ("whole", "other")]
    both = {
        key: np.concatenate([one[key] for one in columns]) if entry.shape[:1] == (SAMPLES,) else entry
        for key, entry in columns[0].items()
    }
    np.savez(tmp_path / "both.npz", **both)
    parts, fit = ("--train", "0:60%", "--test", "60%:"), tmp_path / "fit.json"
    apart = do("identify", "two_link", folder / "whole.npz", folder / "other.npz", *parts)
    answer = do("identify", "two_link", tmp_path / "both.npz", *parts, "-o", fit)
    assert find_values(answer) == find_values(apart)
    tried = [[found["residual"] for found in one["result"]["validations"]] for one in (answer, apart)]
    assert tried[0] == tried[1]
    assert len(tried[0]) == 2
    assert "validate.fitted-log" not in list_codes(answer)
    answer = do("validate", "two_link", fit, tmp_path / "both.npz", "--test", "60%:")
    shown = [answer["result"]["residual"], *(found["residual"] for found in answer["result"]["validations"])]
    assert shown == tried[0]
    robot = symid.load("two_link")
    logs = symid.read_logs(tmp_path / "both.npz", robot)
    of_second = robot.identify(logs[1])
    seen = [{note.code for note in of_second.validate(log).notices} for log in logs]
    assert ["validate.fitted-log" in codes for codes in seen] == [False, True]
    assert robot.identify(logs).parameters == robot.identify(tmp_path / "both.npz").parameters


@pytest.mark.parametrize(
    "parts",
    [
        ("--test", "60%:"),
        ("--train", "0:60%", "--test", "50%:"),
        ("--train", "0:60%", "--test", "5s:"),
        ("--train", "0:60%", "--test", "60%:", "--test", "80%:"),
        ("--train", "60%"),
        ("--train", "0:60%", "--test", "60%:", "--method", "stiffness"),
    ],
)
def test_parts_that_do_not_go_together_are_refused(folder, parts):
    code, found = fail("identify", "two_link", folder / "whole.npz", *parts)
    assert code == 2
    assert found in {"usage.log-part", "usage.mixed-options"}


def test_parts_that_the_log_lacks_are_refused(folder, estimate):
    log = folder / "whole.npz"
    assert fail("identify", "two_link", log, "--train", "20:") == (3, "log.part")
    assert fail("validate", "two_link", estimate, log, "--test", "20s:") == (3, "log.part")
    assert fail("validate", "two_link", estimate, log, "--test", "x") == (2, "usage.log-part")


def test_a_page_and_its_diagnosis_follow_parts(folder, estimate, tmp_path):
    call = ("report", estimate, "-o", tmp_path / "page.html", "--force")
    log = ("--validation", folder / "whole.npz")
    answer = do(*call, *log, "--test", "60%:", "--diagnose")
    assert "validate.fitted-log" not in list_codes(answer)
    # The logs of the fit are read again with its parts.
    assert answer["result"]["diagnosis"]["refit"]["largest_difference_stds"] <= 1e-12
    assert "validate.fitted-log" in list_codes(ask(*call, *log)[1])
    assert fail(*call, "--test", "60%:") == (2, "usage.no-validation")


def test_friction_and_springs_take_parts_too(folder, tmp_path):
    found, log = tmp_path / "law.json", folder / "whole.npz"
    law = ("--rows", "friction", "--model", "coulomb-viscous")
    do("identify", "two_link", log, *law, "--train", "0:60%", "-o", found)
    for part, fitted in (("60:", False), ("40:", True)):
        answer = do("validate", "two_link", found, log, "--test", part)
        assert ("validate.fitted-log" in list_codes(answer)) is fitted
    springs, log = tmp_path / "springs.json", tmp_path / "elastic.npz"
    do("simulate", "two_link_elastic", "--duration", "6", "-o", log)
    call = (
        "identify",
        "two_link_elastic",
        log,
        "--method",
        "two-step",
        "--thresholds",
        "0",
        "--train",
        "0:60%",
    )
    assert ask(*call, "-o", springs)[0] in {0, 1}
    for part, fitted in (("60:", False), ("40:", True)):
        # A linear spring leaves most of what these elastic joints do.
        _, answer = ask("validate", "two_link_elastic", springs, log, "--test", part)
        assert ("validate.fitted-log" in list_codes(answer)) is fitted


def test_logs_in_memory_have_parts():
    robot = symid.load("two_link")
    log = robot.simulate(duration=6.0, seed=5).log
    fit = robot.identify(log, train="0:60%")
    assert fit.values == robot.identify(log, train=(0.0, 3.601)).values
    assert fit.values == robot.identify([log], train=["0:60%"]).values
    assert fit.values == robot.identify(log.cut("0:60%")).values
    alone = fit.validate(log, test="60%:")
    assert alone.residual == fit.validate(log.cut((3.601, None))).residual
    for given in ({"test": "60%:"}, {"test": "60:"}, {"test": (3.601, None)}):
        codes = {notice.code for notice in fit.validate(log, **given).notices}
        assert "validate.fitted-log" not in codes
    assert "validate.fitted-log" in {notice.code for notice in fit.validate(log).notices}
    assert len(log.cut("60%:")) == SAMPLES - BOUND
    with pytest.raises(symid.UsageError):
        log.cut("0:60%").cut("0:10%")
