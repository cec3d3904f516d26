"""Every verb does its work, on files, and says what it did."""

import json
import re

import numpy as np
import pytest

from symid.cli.main import run
from tests.calls import ask, do, fail, find_codes, hear, list_codes


def test_generate_says_when_there_is_no_compiler(tmp_path, monkeypatch):
    monkeypatch.setattr("symid.codegen.generation.locate_compiler", lambda *_: None)
    assert list_codes(do("generate", "emps", "-o", tmp_path / "code")) == ["generate.selftest-not-run"]


@pytest.mark.parametrize("more", [(), ("--force",), ("--force", "--target", "python")])
def test_generate_refuses_a_folder_of_others(tmp_path, more):
    (tmp_path / "thesis.txt").write_text("mine")
    assert fail("generate", "emps", *more, "-o", tmp_path) == (3, "output.foreign-folder")
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]
    assert (tmp_path / "thesis.txt").read_text() == "mine"


@pytest.mark.parametrize("trajectory", ["ta", "tb"])
def test_simulate_clean_closes_the_energy_balance(tmp_path, trajectory):
    arguments = ("--trajectory", trajectory, "--duration", "3", "--clean")
    answer = do("simulate", "two_link", "-o", tmp_path / "run.csv", *arguments)
    assert answer["result"]["noise"] == 0.0
    assert answer["result"]["energy_gap"] < 1e-6


def test_simulate_ta_is_for_two_joints(tmp_path, monkeypatch):
    monkeypatch.setattr("symid.simulation.elastic_experiment.check_stated_values", lambda _: None)
    code, answer = ask("simulate", "emps", "--trajectory", "ta", "-o", tmp_path / "a.npz")
    assert code == 2
    assert list(tmp_path.iterdir()) == []
    assert answer["errors"][0]["code"] == "usage.trajectory"


def test_identify_finds_the_truth(log):
    result = do("identify", "two_link", log, "--drop-first", "2000")["result"]
    assert result["settings"]["processing"]["drop_first"] == 2000
    assert {"condition", "outcome", "residual", "parameters"} <= result.keys()
    for entry in result["parameters"]:
        assert entry["std"] > 0
        assert entry["value"] == pytest.approx(entry["truth"], abs=6 * entry["std"])
        assert entry["relative_std_percent"] == pytest.approx(100 * entry["std"] / abs(entry["value"]))


def test_set_and_named_options_are_the_same(log):
    named = ("--cutoff", "40", "--decimate", "5")
    generic = ("--set", "processing.filter_cutoff=40", "--set", "processing.decimation.factor=5")
    left = do("identify", "two_link", log, *named)
    right = do("identify", "two_link", log, *generic)
    assert left["result"] == right["result"]
    assert left["result"]["settings"]["processing"]["filter_cutoff"] == 40


@pytest.mark.parametrize(
    ("damage", "expected"),
    [
        ({"tau": None}, "log.missing-column"),
        ({"time": lambda t: t[::-1]}, "log."),
        ({"q": lambda q: np.where(q == q[50], np.nan, q)}, "log.not-finite"),
        ({"q": lambda q: q[:, :1]}, "log."),
    ],
)
def test_a_wrong_log_is_refused_and_nothing_is_written(log, tmp_path, damage, expected):
    with np.load(log) as archive:
        arrays = dict(archive)
    for name, change in damage.items():
        key = name if name in arrays else "t"
        if change is None:
            del arrays[key]
        else:
            arrays[key] = change(arrays[key])
    bad, output = tmp_path / "bad.npz", tmp_path / "estimate.json"
    np.savez(bad, **arrays)
    code, answer = ask("identify", "two_link", bad, "-o", output)
    assert code == 3
    assert answer["errors"][0]["code"].startswith(expected)
    assert str(bad) in answer["errors"][0]["file"]
    assert not output.exists()


def test_all_wrong_logs_are_told_at_once(tmp_path):
    code, answer = ask("identify", "two_link", tmp_path / "a.npz", tmp_path / "b.mat")
    assert code == 3
    assert len(answer["errors"]) == 2


def test_a_unit_that_does_not_exist(log):
    code, answer = ask(
        "identify", "two_link", log, "--set", "log.torque.columns=tau", "--set", "log.torque.unit=furlong"
    )
    assert code == 2
    assert "furlong" in answer["errors"][0]["text"]


def test_validate_refuses_the_estimate_of_another_robot(log, estimate, tmp_path):
    assert ask("validate", "two_link", tmp_path / "none.json", log)[0] == 3
    data = json.loads(estimate.read_text())
    data["settings"] = {}
    broken = tmp_path / "broken.json"
    broken.write_text(json.dumps(data))
    assert fail("validate", "two_link", broken, log) == (3, "estimate.settings")


def test_report_is_one_page(log, estimate, tmp_path):
    page = tmp_path / "report.html"
    answer = do("report", estimate, "--validation", log, "-o", page)
    text = page.read_text()
    assert answer["result"]["validations"] == [str(log)]
    assert "ZZR1" in text
    assert "http" + "://" not in text.replace("http" + "://www.w3.org", "")


def test_doctor():
    answer = do("doctor")
    names = {entry["name"] for entry in answer["result"]["findings"]}
    assert {"python", "sympy", "casadi", "C compiler", "cache", "robots", "templates"} <= names
    (calls,) = (entry for entry in answer["result"]["findings"] if entry["name"] == "calls of compiled code")
    assert re.match(r"Python's limited API|ctypes", calls["found"])


@pytest.mark.parametrize("rows", ["momentum", "energy"])
def test_the_report_compares_rows_of_one_kind(log, tmp_path, rows):
    other, found, page = (tmp_path / name for name in ("other.npz", "estimate.json", "report.html"))
    do("simulate", "two_link", "-o", other, "--noise", "0.5", "--seed", "4", "--duration", "5")
    do("identify", "two_link", log, "--rows", rows, "-o", found)
    do("report", found, "--validation", other, "-o", page)
    text = page.read_text()
    assert "does not carry over" not in text
    assert "nothing about carrying over" not in text


def test_the_log_of_the_fit_is_told_even_under_another_name(log, estimate, tmp_path):
    twin = tmp_path / "twin.npz"
    twin.write_bytes(log.read_bytes())
    for path in (log, twin):
        assert "validate.fitted-log" in find_codes(do("validate", "two_link", estimate, path))


def test_simulate_says_first_what_the_file_lacks(tmp_path, monkeypatch):
    monkeypatch.setattr("symid.codegen.cache.prepare_library", None)
    assert fail("simulate", "emps", "-o", tmp_path / "a.npz") == (3, "robot.no-values")
    assert fail("simulate", "two_link", "-o", tmp_path / "a.txt") == (3, "output.unknown-suffix")


def test_simulate_names_every_value_that_is_not_stated(tmp_path):
    robot = tmp_path / "lacking.toml"
    robot.write_text(LACKING)
    text = hear(3, "robot.no-values", "simulate", robot, "-o", tmp_path / "a.npz")
    assert text.partition("not stated: ")[2].split("; ") == [
        "joint 'j2': [joint.link] mass, com and inertia",
        "joint 'j2': stiffness and rest of [joint.spring]",
        "joint 'j2': the values of friction coulomb-viscous",
        "coupling 'm': the rotor_inertia",
        "coupling 'm': the values of friction asymmetric",
    ]


LACKING = """
name = "lacking"
convention = "modified"
gravity = [0, 0, -9.81]
[[joint]]
name = "j1"
kind = "revolute"
link = { mass = 2.0, com = [0.1, 0, 0.1], inertia = { xx = 0.1, yy = 0.1, zz = 0.1 } }
spring = { stiffness = 10, rest = 0 }
[[joint]]
name = "j2"
kind = "revolute"
a = 0.3
mimic = { joint = "j1", multiplier = -2 }
spring = { stiffness = 10, rest = "unknown" }
friction = { model = "coulomb-viscous" }
[[joint]]
name = "j3"
kind = "revolute"
a = 0.3
link = { mass = 2.0, com = [0.1, 0, 0.1], inertia = { xx = 0.1, yy = 0.1, zz = 0.1 } }
[[coupling]]
name = "m"
terms = { j1 = 1, j3 = 2 }
rotor_inertia = "unknown"
friction = { model = "asymmetric" }
"""


@pytest.mark.parametrize(
    "arguments",
    [
        ("simulate", "two_link", "-o", "a.npz", "--duration", "nan"),
        ("simulate", "two_link", "-o", "a.npz", "--duration", "inf"),
        ("simulate", "two_link", "-o", "a.npz", "--noise", "nan"),
        ("simulate", "two_link", "-o", "a.npz", "--noise", "inf"),
        ("validate", "two_link", "a.json", "a.npz", "--gate", "nan"),
        ("identify", "two_link", "a.npz", "--cutoff", "-5"),
        ("identify", "two_link", "a.npz", "--cutoff", "nan"),
        ("identify", "two_link", "a.npz", "--decimate", "0"),
        ("identify", "two_link", "a.npz", "--drop-first", "-1"),
        ("check", "two_link", "--set", "processing.foo=1"),
        ("check", "r" * 400),
        ("check", "two_link", "--set", "processing.filter_cutoff=-5"),
    ],
)
def test_values_that_cannot_be_are_usage(arguments):
    code, answer = ask(*arguments)
    assert code == 2
    assert answer["ok"] is False


def test_validate_and_report_restore_the_log_map(log, tmp_path):
    found, page = tmp_path / "estimate.json", tmp_path / "report.html"
    units = ("log.torque.columns=tau", "log.torque.unit=mN m")
    settings = [part for text in units for part in ("--set", text)]
    do("identify", "two_link", log, *settings, "-o", found)
    fitted = do("identify", "two_link", log, *settings)
    answer = do("validate", "two_link", found, log)
    mean = fitted["result"]["mean_relative_percent"]
    assert answer["result"]["mean_relative_percent"] == pytest.approx(mean, rel=0.05)
    told = [entry["text"] for entry in answer["warnings"] if entry["code"] == "estimate.settings-differ"]
    assert any(text.startswith("log.torque.unit: the estimate has mN m") for text in told)
    assert "estimate.settings-differ" in find_codes(do("report", found, "--validation", log, "-o", page))
    assert "was multiplied by 0.001" in page.read_text()


@pytest.mark.parametrize(
    "change",
    [
        {"processing": {"filter_order": "x"}},
        {"processing": {"decimation": 3}},
        {"processing": {"colour": 3}},
        {"processing": [], "log": {}},
        {"log": {"torque": {"columns": "tau", "unit": "furlong"}}},
        {"log": 3},
        {"window": "long"},
    ],
)
def test_settings_of_an_estimate_are_checked(log, estimate, tmp_path, change):
    data = json.loads(estimate.read_text())
    data["settings"] |= change
    broken = tmp_path / "broken.json"
    broken.write_text(json.dumps(data))
    page = tmp_path / "report.html"
    assert fail("report", broken, "--validation", log, "-o", page) == (3, "estimate.settings")
    assert not page.exists()


def test_no_output_destroys_an_input(log, estimate, tmp_path):
    mine = tmp_path / "mine.npz"
    mine.write_bytes(log.read_bytes())
    link = tmp_path / "link.npz"
    link.symlink_to(mine)
    found = tmp_path / "found.json"
    found.write_bytes(estimate.read_bytes())
    before = {path: path.read_bytes() for path in (mine, found)}
    for arguments in (
        ("identify", "two_link", mine, "-o", mine),
        ("identify", "two_link", mine, "-o", link),
        ("report", found, "-o", found),
        ("report", found, "--validation", mine, "-o", mine),
    ):
        for force in ((), ("--force",)):
            assert fail(*arguments, *force) == (3, "output.is-input")
    assert before == {path: path.read_bytes() for path in (mine, found)}


def test_what_is_only_worth_knowing_is_a_note(capsys, log):
    assert run(["identify", "two_link", str(log)]) == 0
    written = capsys.readouterr()
    lines = [line for line in written.err.splitlines() if "were left out" in line]
    assert lines
    assert all(line.startswith("note: ") for line in lines)
    assert "norm  relative/%" in written.out


def test_options_of_a_robot_that_was_not_named_are_refused(estimate, tmp_path):
    page = tmp_path / "page.html"
    text = hear(2, "usage.no-robot", "report", estimate, "-o", page, "--backend", "python", "--base", "x")
    assert text.startswith("--base, --backend cannot be used without --robot")
    assert not page.exists()
