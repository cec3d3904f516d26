"""Every verb does its work, on files, and says what it did."""

import pytest

from tests.calls import ask, do, fail, find_codes, hear


def test_identify_finds_the_truth(log):
    result = do("identify", "two_link", log, "--drop-first", "2000")["result"]
    assert result["settings"]["processing"]["drop_first"] == 2000
    assert {"condition", "outcome", "residual", "parameters"} <= result.keys()
    for entry in result["parameters"]:
        assert entry["std"] > 0
        assert entry["value"] == pytest.approx(entry["truth"], abs=6 * entry["std"])
        assert entry["relative_std_percent"] == pytest.approx(100 * entry["std"] / abs(entry["value"]))


def test_all_wrong_logs_are_told_at_once(tmp_path):
    code, answer = ask("identify", "two_link", tmp_path / "a.npz", tmp_path / "b.mat")
    assert code == 3
    assert len(answer["errors"]) == 2


@pytest.mark.parametrize("rows", ["momentum", "energy"])
def test_the_report_compares_rows_of_one_kind(log, tmp_path, rows):
    other, found, page = (tmp_path / name for name in ("other.npz", "estimate.json", "report.html"))
    do("simulate", "two_link", "-o", other, "--noise", "0.5", "--seed", "4", "--duration", "5")
    do("identify", "two_link", log, "--rows", rows, "-o", found)
    do("report", found, "--validation", other, "-o", page)
    text = page.read_text()
    assert "does not carry over" not in text
    assert "nothing about carrying over" not in text


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
    assert len(told) == 1
    assert "log.torque.unit: mN m (file: nothing)" in told[0]
    assert "estimate.settings-differ" in find_codes(do("report", found, "--validation", log, "-o", page))
    assert "was multiplied by 0.001" in page.read_text()


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


def test_options_of_a_robot_that_was_not_named_are_refused(estimate, tmp_path):
    page = tmp_path / "page.html"
    text = hear(2, "usage.no-robot", "report", estimate, "-o", page, "--backend", "python", "--base", "x")
    assert text.startswith("--base, --backend cannot be used without --robot")
    assert not page.exists()
