"""The verdict on the command line: first, its exit codes, `--accept`, and how many warnings are printed."""

import json

import numpy as np
import pytest

import symid
from symid.cli.call import Answer, Console, answer_call, print_answer
from symid.errors import Notice
from tests.calls import ask, call, do, fail, refuse, say


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Return a log of a simulated arm, one of another motion, and one whose torques are random numbers."""
    folder = tmp_path_factory.mktemp("logs")
    robot = symid.load("two_link")
    runs = [robot.simulate(duration=5.0, seed=seed).log for seed in (1, 2)]
    noise = np.random.default_rng(5).normal(size=runs[0].tau.shape)
    random = symid.build_log(robot, time=runs[0].time, q=runs[0].q, tau=noise)
    names = ("train.npz", "test.npz", "random.npz")
    return [log.save(folder / name) for log, name in zip((*runs, random), names, strict=True)]


@pytest.fixture(scope="module")
def fits(logs, tmp_path_factory):
    """Return the fit of the log, and that of the random numbers."""
    folder = tmp_path_factory.mktemp("fits")
    codes = []
    for log, name in ((logs[0], "fit.json"), (logs[2], "wrong.json")):
        codes.append(answer_call(["identify", "two_link", str(log), "-o", str(folder / name), "-q"]))
    assert codes == [0, 1]
    return folder / "fit.json", folder / "wrong.json"


def test_the_verdict_is_the_first_line_and_the_first_entry(logs, fits, tmp_path):
    for arguments in (
        ("identify", "two_link", logs[0]),
        ("validate", "two_link", fits[0], logs[1]),
        ("report", fits[0], "-o", tmp_path / "page.html", "--force"),
    ):
        out = say(*arguments)
        assert out.startswith(("verdict: good - ", "verdict: usable - "))
        answer = do(*arguments)
        assert next(iter(answer["result"])) == "verdict"
        assert {"level", "headline", "cause", "remedy", "details"} == set(answer["result"]["verdict"])
        assert out.startswith(f"verdict: {answer['result']['verdict']['level']} - ")


def test_a_wrong_fit_exits_1_and_is_written(logs, fits):
    code, out, err = call("identify", "two_link", logs[2])
    assert code == 1
    assert out.startswith("verdict: wrong - ")
    assert "; no single mistake that was tested explains it.\nremedy: " in out
    assert err.splitlines()[-1].startswith("error: ")
    code, answer = ask("identify", "two_link", logs[2])
    assert (code, answer["ok"]) == (1, False)
    assert [entry["code"] for entry in answer["errors"]] == ["identify.wrong"]
    stored = json.loads(fits[1].read_text(encoding="utf-8"))
    assert stored["verdict"]["level"] == "wrong"
    assert symid.load_fit(fits[1]).verdict.level == "wrong"


def test_accept_lets_a_script_go_on(logs, fits, tmp_path):
    answer = do("identify", "two_link", logs[2], "--accept")
    assert answer["ok"]
    assert answer["warnings"][0]["code"] == "identify.wrong"
    page = tmp_path / "page.html"
    assert call("report", fits[1], "-o", page)[0] == 1
    assert 'class="verdict wrong"' in page.read_text(encoding="utf-8")
    assert call("report", fits[1], "-o", page, "--force", "--accept")[0] == 0


def test_the_export_of_a_wrong_fit_is_refused(fits, tmp_path):
    path = tmp_path / "arm.toml"
    code, answer = ask("export", "two_link", fits[1], "-o", path)
    assert code == 3
    assert [entry["code"] for entry in answer["errors"]] == ["export.wrong"]
    assert "--accept" in answer["errors"][0]["text"]
    assert not path.exists()
    assert fail("export", "two_link", fits[1], "-o", path, "--accept") == (3, "export.scale")
    more = ("--accept", "--ratio", "1e9")
    assert fail("export", "two_link", fits[1], "-o", path, *more) == (3, "export.cost")
    answer = do("export", "two_link", fits[1], "-o", path, *more, "--limit", "1e6")
    assert answer["warnings"][0]["code"] == "identify.wrong"
    assert path.exists()


def test_a_log_that_is_not_predicted_exits_1_but_for_accept(logs, fits):
    arguments = ("validate", "two_link", fits[0], logs[2])
    code, answer = ask(*arguments)
    assert code == 1
    assert [entry["code"] for entry in answer["errors"]] == ["validate.wrong"]
    assert answer["result"]["verdict"]["level"] == "wrong"
    assert do(*arguments, "--accept")["warnings"][0]["code"] == "validate.wrong"
    # A gate is the user's own; it is not a verdict.
    assert refuse(*arguments, "--accept", "--gate", "5") == (1, ["validate.gate-missed"])


def make_answer(count):
    notices = [Notice(code="log.converted", text="a note")]
    notices += [Notice(code=f"export.k{k}", text=f"w{k}") for k in range(count - 1)]
    notices.append(Notice(code="log.torque-sign", text="the sign", file="a.csv"))
    error = Notice(code="validate.gate-missed", text="the gate")
    said = ("verdict: good - Fine.",)
    return Answer(said, said, {}, warnings=tuple(notices), errors=(error,), exit_code=1)


def show(count, *, quiet=False, **flags):
    flags = {"as_json": False, "verbose": False, "whole": False} | flags
    print_answer(make_answer(count), Console(quiet=quiet), **flags)


def test_three_warnings_then_notes_then_errors(capsys, monkeypatch):
    monkeypatch.setenv("NO_COLOR", "1")
    show(5)
    written = capsys.readouterr()
    assert written.out == "verdict: good - Fine.\n"
    assert written.err.splitlines() == [
        "warning: a.csv: the sign",
        "warning: w0",
        "warning: w1",
        "warning: and 2 more warnings: -v shows them",
        "note: a note",
        "error: the gate",
    ]
    show(5, verbose=True)
    assert len(capsys.readouterr().err.splitlines()) == 7
    show(5, quiet=True)
    assert capsys.readouterr().err == "error: the gate\n"
    show(5, as_json=True)
    codes = [entry["code"] for entry in json.loads(capsys.readouterr().out)["warnings"]]
    assert codes == ["log.torque-sign", *(f"export.k{k}" for k in range(4)), "log.converted"]
