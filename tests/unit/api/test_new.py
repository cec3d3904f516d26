"""A new robot file from Python: numbers and names in any form, refusals, and what is written."""

import shutil
from pathlib import Path

import numpy as np
import pytest

import symid
from symid import DraftOptions
from symid.errors import UsageError

ROWS = "joint,alpha,a,d,theta\nshoulder,0,0,0,q\nelbow,0,0.5,0,q\n"


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "rows.csv"
    path.write_text(ROWS)
    return path


@pytest.mark.parametrize("gear", ["50,-30", [50, -30], (50.0, -30.0), np.array([50, -30])])
def test_numbers_are_given_as_text_or_as_a_sequence(table, tmp_path, gear):
    draft = symid.new_robot(table=table, convention="modified", rotors=True, options=DraftOptions(gear=gear))
    robot = symid.load(draft.save(tmp_path / "arm.toml"))
    assert [joint.drive.gear for joint in robot.joints] == [50.0, -30.0]
    assert all(joint.drive.has_rotor for joint in robot.joints)
    assert [notice.code for notice in draft.notices] == ["new.gravity"]
    assert draft.to_dict()["notices"] == 1


def test_one_number_is_for_all(table):
    options = DraftOptions(convention="modified", gear=80, gravity=[0, -9.81, 0])
    draft = symid.new_robot(table=table, options=options)
    assert {joint.drive.gear for joint in draft.robot.joints} == {80.0}
    assert draft.notices == ()
    assert [str(part) for part in draft.robot.gravity] == ["0", "-981/100", "0"]


def test_columns_are_named_by_text_or_by_list(table, tmp_path):
    time = np.arange(400) * 0.01
    log = tmp_path / "log.csv"
    moves = np.column_stack([time, *(np.sin(k * time) for k in (1, 2, 3, 4))])
    np.savetxt(log, moves, delimiter=",", header="t [s],a,b,c [N m],d [N m]", comments="")
    given = {"table": table, "log": log}
    given["options"] = DraftOptions(convention="modified", gravity=(0, 0, -9.81))
    texts = {"columns": {"position": "a,b", "torque": "c,d"}, "units": {"position": "rad"}}
    lists = {"columns": {"position": ["a", "b"], "torque": ("c", "d")}, "units": {"position": ["rad"]}}
    first, second = (symid.new_robot(**given, **named) for named in (texts, lists))
    assert first.text == second.text
    assert 'columns = ["a", "b"]' in first.text
    assert "position  a, b     rad\n" in str(first)


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ({}, "usage.call"),
        ({"columns": {"position": "a"}}, "usage.call"),
        ({"robot": "scara", "options": DraftOptions(gear=0)}, "usage.copied"),
        ({"convention": "modified", "options": DraftOptions(gear=0)}, "usage.numbers"),
        ({"convention": "modified", "options": DraftOptions(gravity=[0, 1])}, "usage.gravity"),
        ({"convention": "modified", "log": "log.csv", "columns": {"posision": "a"}}, "usage.quantity"),
        ({"convention": "modified", "log": "log.csv", "columns": {"position": []}}, "usage.quantity"),
    ],
)
def test_what_does_not_go_together_is_refused(table, options, code):
    source = {"table": table} if "convention" in options else {}
    with pytest.raises(UsageError) as caught:
        symid.new_robot(**source, **options)
    assert {notice.code for notice in caught.value.notices} == {code}


def test_doctor_tells_what_is_missing(monkeypatch):
    monkeypatch.setattr("symid.api.first_steps._PACKAGES", ("click", "no-such-package-here"))
    monkeypatch.setattr("shutil.which", lambda _: None)
    found = symid.doctor()
    assert [notice.code for notice in found.errors] == ["doctor.missing"]
    assert "pip install no-such-package-here" in found.errors[0].text
    assert any(notice.text.startswith("make: none") for notice in found.notices)
    assert not found.accepted


def test_entries_that_go_while_doctor_counts_them_are_left_out(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    for name in ("going", "staying", ".new-half"):
        (tmp_path / "symid" / name).mkdir(parents=True)
        (tmp_path / "symid" / name / "library.so").write_bytes(bytes(10**6))
    original = Path.lstat

    def lstat(path):
        if path.parent.name == "going":
            shutil.rmtree(path.parent, ignore_errors=True)
        return original(path)

    monkeypatch.setattr(Path, "lstat", lstat)
    (found,) = (entry.found for entry in symid.doctor().findings if entry.name == "cache")
    assert found.endswith("1 libraries, 2.0 MB")
