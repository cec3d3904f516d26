"""`symid compare`: an estimate beside others, in their groups, with deviations of both."""

import dataclasses
from itertools import pairwise

import numpy as np
import pytest

from symid.cli.main import run
from symid.dynamics.base_parameters import derive_base_parameters
from symid.identification.elastic.routing import build_rigid_variant
from symid.identification.stored import write_fit
from symid.joint_models import FrictionValues
from symid.robot.toml_reader import read_robot
from symid.robot.toml_writer import write_robot
from tests.calls import ask, do, list_codes, refuse, say
from tests.chains import PUMA560
from tests.estimates import STD, build_estimate, build_springless_estimate, fill_robot, store_estimate

HEAD = "Izz1 + 1.0*Ia1 + Iyy2 + Iyy3 + 0.07*mz3 + 0.05185*m3 + 0.05185*m4 + 0.05185*m5 + 0.05185*m6"


def compare(*arguments):
    """Return the answer of a comparison that must succeed, and what it found for the one other."""
    answer = do("compare", *arguments)
    (found,) = answer["result"]["others"]
    return answer, found


@pytest.fixture(scope="module")
def wrist(robots_folder):
    """Return the robot with a coupled wrist."""
    return fill_robot(read_robot(robots_folder / "tx40.toml"))


@pytest.fixture(scope="module")
def ours(wrist, tmp_path_factory):
    return store_estimate(wrist, tmp_path_factory.mktemp("wrist") / "ours.json")


@pytest.fixture(scope="module")
def values(wrist):
    return {entry.name: entry.value for entry in build_estimate(wrist).parameters}


def write_table(path, rows, heading="group,value,std"):
    lines = [",".join(str(cell) for cell in row) for row in rows]
    path.write_text("\n".join([heading, *lines]) + "\n", encoding="utf-8")
    return path


def list_all(values):
    """Return a row for every parameter, twice the first and the sum of two neighbours for others."""
    names = [name for name in values if name != "IA6"]
    rows = [(f"2*{names[0]}", 2 * values[names[0]], 2 * STD)]
    rows += [
        (f"{name} - 0.5*{after}", values[name] - 0.5 * values[after], STD)
        for name, after in pairwise(names[1:])
    ]
    return [*rows, (names[-1], values[names[-1]], STD)]


def test_the_same_values_in_other_groups_agree(ours, values, tmp_path):
    table = write_table(tmp_path / "table.csv", list_all(values))
    answer = do("compare", "tx40", ours, table, "--gate", "0.001")
    assert (answer["ok"], answer["warnings"]) == (True, [])
    (found,) = answer["result"]["others"]
    assert (found["judged"], found["absent"], found["lacking"]) == (60, ["IA6"], 0)
    assert found["within"] == {"2": 60, "3": 60}
    assert found["largest"] < 1e-9
    assert found["chi_square"]["value"] == pytest.approx(0.0, abs=1e-9)
    assert (found["chi_square"]["freedom"], found["chi_square"]["probability"]) == (60, 1.0)
    assert found["columns"] == {"name": "group", "value": "value", "deviation": "std", "percent": False}
    assert "probability 1; " in say("compare", "tx40", ours, table)
    second = found["groups"][1]
    assert second["ours_std"] == pytest.approx(STD * np.sqrt(1.25))
    assert (second["line"], second["read_as"]) == (3, None)


def test_a_group_of_standard_parameters_is_in_its_own_deviations(ours, values, tmp_path):
    rows = [(HEAD, values["ZZR1"] - 3 * STD, 100 * np.sqrt(3) * STD / abs(values["ZZR1"] - 3 * STD))]
    table = write_table(tmp_path / "table.csv", rows, "parameter,x,x_std_percent")
    _, found = compare("tx40", ours, table)
    (group,) = found["groups"]
    assert group["deviations"] == pytest.approx(3 / np.sqrt(1 + 3))
    assert group["unit"] == "kg m^2"
    assert found["lacking"] == 0
    assert len(found["absent"]) == 60


def test_a_coupled_drive_that_groups_hold_unnamed_is_inferred_and_not_put_in(ours, values, tmp_path):
    # Two groups hold what drive m6 adds to their joints.
    held = values | {"Fv5": values["Fv5"] + values["Fvm6"], "Fv6": values["Fv6"] + values["Fvm6"]}
    table = write_table(tmp_path / "table.csv", [(name, value, STD) for name, value in held.items()])
    answer, found = compare("tx40", ours, table)
    assert list_codes(answer) == ["compare.coupled-reading"]
    assert found["within"] == {"2": 59, "3": 59}
    away = {entry["group"]: entry["deviations"] for entry in found["groups"]}
    assert away["Fv5"] == pytest.approx(-values["Fvm6"] / (np.sqrt(2) * STD))
    read = {entry["read_as"]: entry["decisive"] for entry in found["readings"]}
    assert read == {"Fv5 + Fvm6": True, "Fv6 + Fvm6": True, "IA5 + IAm6": False, "IA6 + IAm6": False}
    text = answer["warnings"][0]["text"]
    assert "'m6'" in text
    assert '--read-as "Fv6 = Fv6 + Fvm6"' in text

    options = ("--read-as", "Fv6 = Fv6 + Fvm6", "--read-as", "Fv5=fv5+fvm6", "--gate", "0.01")
    answer, found = compare("tx40", ours, table, *options)
    assert (answer["warnings"], found["within"]["2"]) == ([], 61)
    assert {entry["group"]: entry["read_as"] for entry in found["groups"] if entry["read_as"]} == {
        "Fv5": "fv5+fvm6",
        "Fv6": "Fv6 + Fvm6",
    }


def test_a_term_for_which_only_numbers_speak_is_said_to_be_that(ours, values, tmp_path):
    held = values | {"Fc2": values["Fc2"] - values["Fc4"]}
    table = write_table(tmp_path / "table.csv", [(name, value, STD) for name, value in held.items()])
    answer = do("compare", "tx40", ours, table)
    assert list_codes(answer) == ["compare.other-reading"]
    text = answer["warnings"][0]["text"]
    assert " -Fc4 too. " in text
    assert text.endswith('--read-as "Fc2 = Fc2 - Fc4"')


def test_values_that_are_plainly_different_find_no_term(ours, values, tmp_path):
    held = values | {"Fc2": values["Fc2"] * 0.9321, "Fv5": values["Fv5"] * 1.1234}
    table = write_table(tmp_path / "table.csv", [(name, value, STD) for name, value in held.items()])
    code, answer = ask("compare", "tx40", ours, table, "--gate", "3")
    assert (code, answer["ok"], answer["warnings"]) == (1, False, [])
    assert list_codes(answer, "errors") == ["compare.gate"]
    assert " gate of 3" in answer["errors"][0]["text"]
    assert answer["result"]["accepted"] is False


def test_all_mistakes_of_a_table_are_told_at_once(ours, tmp_path):
    rows = [("Izz1", 1, 0.1), ("fv1", "one", 0.1), ("what", 1, 0.1), ("fv2", 1, -1), ("fv3", 1)]
    table = write_table(tmp_path / "table.csv", rows)
    code, answer = ask("compare", "tx40", ours, table)
    assert code == 3
    assert [(entry["line"], entry["code"]) for entry in answer["errors"]] == [
        (2, "usage.other-groups"),
        (3, "table.not-a-number"),
        (4, "usage.unreadable-group"),
        (5, "table.not-a-number"),
        (6, "table.line-length"),
    ]
    assert all(entry["file"] == str(table) for entry in answer["errors"])
    assert "is left over when ZZR1 = ZZ1 + IA1" in answer["errors"][0]["text"]


def test_a_group_that_follows_from_others_is_told_with_its_line(ours, tmp_path):
    table = write_table(tmp_path / "table.csv", [("fv1", 1, 1), ("fv1 + fv2", 1, 1), ("2*fv2", 1, 1)])
    code, answer = ask("compare", "tx40", ours, table)
    assert (code, list_codes(answer, "errors")) == (3, ["usage.other-groups"])
    assert answer["errors"][0]["line"] == 4
    assert "'2*fv2' follows from 'fv1', 'fv1 + fv2'" in answer["errors"][0]["text"]


def test_rows_without_value_and_tables_without_deviation(ours, values, tmp_path):
    rows = [("fv1", values["Fv1"] + STD), ("fv2", "")]
    table = write_table(tmp_path / "table.csv", rows, "name,value")
    answer = do("compare", "tx40", ours, table)
    assert list_codes(answer) == ["compare.empty-value", "compare.no-deviation"]
    (group,) = answer["result"]["others"][0]["groups"]
    assert group["other_std"] is None
    assert group["deviations"] == pytest.approx(-1.0)


def test_percent_of_zero_are_no_deviation(ours, values, tmp_path):
    rows = [("fv1", values["Fv1"], 3), ("fv2", 0, 3)]
    table = write_table(tmp_path / "table.csv", rows, "name,value,std_percent")
    answer = do("compare", "tx40", ours, table)
    assert list_codes(answer) == ["compare.no-deviation"]
    assert answer["warnings"][0]["text"].startswith("1 of 2 ")
    assert "zero" in answer["warnings"][0]["text"]
    spreads = [entry["other_std"] for entry in answer["result"]["others"][0]["groups"]]
    assert spreads == [pytest.approx(0.03 * values["Fv1"]), None]


@pytest.mark.parametrize(
    ("options", "code"),
    [
        (("--read-as", "fv9 = fv1"), "usage.read-as"),
        (("--read-as", "fv1"), "usage.read-as"),
        (("--read-as", "fv1 = fv1", "--read-as", "fv1 = fv2"), "usage.read-as"),
        (("--read-as", "fv1 = nothing"), "usage.unreadable-group"),
        (("--read-as", "fv1 = Izz1"), "usage.other-groups"),
        (("--value", "wls"), "usage.table-column"),
    ],
)
def test_wrong_options_of_a_table(ours, tmp_path, options, code):
    table = write_table(tmp_path / "table.csv", [("fv1", 1, 1)])
    assert refuse("compare", "tx40", ours, table, *options) == (2, [code])


def test_wrong_files(ours, tmp_path):
    assert refuse("compare", "tx40", ours, tmp_path / "none.csv", tmp_path / "none.json") == (
        3,
        ["estimate.format"] * 2,
    )
    assert refuse("compare", "tx40", ours, ours) == (2, ["usage.same-file"])
    other = tmp_path / "other.json"
    other.write_text("{}", encoding="utf-8")
    assert refuse("compare", "tx40", ours, other) == (3, ["estimate.format"])
    copy = tmp_path / "copy.json"
    copy.write_bytes(ours.read_bytes())
    code, answer = ask("compare", "tx40", ours, copy, "--value", "x", "--read-as", "a = b")
    assert (code, list_codes(answer, "errors")) == (2, ["usage.no-table"])
    assert "--value, --read-as" in answer["errors"][0]["text"]
    assert refuse("compare", "panda", ours, copy) == (3, ["estimate.signature"])


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    """Return a folder with a robot file, and the robot with values."""
    folder = tmp_path_factory.mktemp("arm")
    joints = tuple(
        dataclasses.replace(joint, friction=FrictionValues(law="coulomb-viscous")) for joint in PUMA560.joints
    )
    robot = fill_robot(dataclasses.replace(PUMA560, joints=joints))
    (folder / "arm.toml").write_text(write_robot(robot), encoding="utf-8")
    return folder, read_robot(folder / "arm.toml")


def change_estimate(estimate, shifts=(), refused=()):
    """Return an estimate with other values, and without some parameters."""
    moved = dict(shifts)
    kept = [k for k, entry in enumerate(estimate.parameters) if entry.name not in refused]
    return dataclasses.replace(
        estimate,
        parameters=tuple(
            dataclasses.replace(entry, value=entry.value + moved.get(entry.name, 0.0))
            for entry in (estimate.parameters[k] for k in kept)
        ),
        covariance=tuple(tuple(estimate.covariance[i][j] for j in kept) for i in kept if estimate.covariance),
        refused=tuple((name, "no motion shows it") for name in refused),
    )


def test_two_estimates_parameter_by_parameter(arm, tmp_path):
    """Expected from the covariances of both: z, and chi-square with the inverse of their sum."""
    folder, robot = arm
    rng = np.random.default_rng(5)
    count = len(build_estimate(robot).parameters)
    roots = [1e-3 * rng.normal(size=(count, 2 * count)) for _ in range(2)]
    first, second = (root @ root.T for root in roots)
    ours = change_estimate(
        build_estimate(robot, covariance=first, sources=("a.npz",)), refused=("Fc2", "Fv3")
    )
    shifts = {"ZZR1": 0.05, "Fc1": -0.01}
    theirs = build_estimate(robot, covariance=second, sources=("b.npz",))
    theirs = change_estimate(theirs, shifts, refused=("Fc2", "Fc4"))
    write_fit(ours, tmp_path / "ours.json")
    write_fit(theirs, tmp_path / "theirs.json")
    answer, found = compare(folder / "arm.toml", tmp_path / "ours.json", tmp_path / "theirs.json")
    assert answer["warnings"] == []
    assert (found["absent"], found["neither"], found["not_ours"]) == (["Fc4"], ["Fc2"], ["Fv3"])
    assert (found["judged"], found["shared_logs"], found["columns"]) == (count - 3, [], None)
    names = [entry.name for entry in build_estimate(robot).parameters]
    kept = [k for k, name in enumerate(names) if name not in ("Fc2", "Fc4", "Fv3")]
    assert [entry["group"] for entry in found["groups"]] == [names[k] for k in kept]
    total = (first + second)[np.ix_(kept, kept)]
    away = -np.array([shifts.get(names[k], 0.0) for k in kept])
    np.testing.assert_allclose(
        [entry["deviations"] for entry in found["groups"]], away / np.sqrt(np.diag(total)), atol=1e-9
    )
    assert found["chi_square"]["value"] == pytest.approx(away @ np.linalg.solve(total, away), rel=1e-6)


def test_estimates_from_the_same_log_are_not_independent(arm, tmp_path):
    folder, robot = arm
    ours = build_estimate(robot, sources=("log.npz",))
    same = change_estimate(ours, {"Fc1": 3 * STD})
    digests = {**ours.settings, "log_digests": ["beef"]}
    other = dataclasses.replace(same, sources=("copy.npz",), settings=digests)
    ours = dataclasses.replace(ours, settings=digests)
    for path, estimate in (("ours", ours), ("same", same), ("other", other)):
        write_fit(estimate, tmp_path / f"{path}.json")
    paths = [tmp_path / f"{name}.json" for name in ("ours", "same", "other")]
    answer = do("compare", folder / "arm.toml", *paths)
    assert list_codes(answer) == ["compare.shared-logs"] * 2
    assert all(entry["shared_logs"] == ["log.npz"] for entry in answer["result"]["others"])
    assert all(entry["chi_square"]["probability"] is None for entry in answer["result"]["others"])
    out = say("compare", folder / "arm.toml", *paths)
    assert out.count("chi-square") == 2
    assert ", probability" not in out


def test_an_estimate_with_another_friction_model_shares_its_bodies(arm, tmp_path):
    folder, robot = arm
    joints = tuple(
        dataclasses.replace(joint, friction=FrictionValues(law="asymmetric")) for joint in robot.joints
    )
    bodies = fill_robot(dataclasses.replace(robot, joints=joints))
    store_estimate(robot, tmp_path / "ours.json", sources=("a.npz",))
    store_estimate(bodies, tmp_path / "theirs.json", sources=("b.npz",))
    answer = do("compare", folder / "arm.toml", tmp_path / "ours.json", tmp_path / "theirs.json")
    (found,) = answer["result"]["others"]
    count = derive_base_parameters(robot).count
    assert [entry["group"] for entry in found["groups"]] == [
        entry.name for entry in derive_base_parameters(robot).parameters
    ]
    assert (found["judged"], len(found["other_model"]), len(found["absent"])) == (count, 24, 12)


def test_what_cannot_be_compared_at_all(arm, tmp_path):
    folder, robot = arm
    estimate = build_estimate(robot)
    names = [entry.name for entry in estimate.parameters]
    write_fit(change_estimate(estimate, refused=names[1:]), tmp_path / "first.json")
    write_fit(change_estimate(estimate, refused=names[:1]), tmp_path / "rest.json")
    write_fit(change_estimate(estimate, refused=names), tmp_path / "none.json")
    assert refuse("compare", folder / "arm.toml", tmp_path / "first.json", tmp_path / "rest.json") == (
        3,
        ["compare.nothing-common"],
    )
    assert refuse("compare", folder / "arm.toml", tmp_path / "first.json", tmp_path / "none.json") == (
        3,
        ["compare.no-values"],
    )


def test_a_gate_without_any_deviation_cannot_be_passed(capsys, arm, tmp_path):
    folder, robot = arm
    estimate = build_estimate(robot)
    unknown = dataclasses.replace(
        estimate,
        parameters=tuple(dataclasses.replace(entry, std=float("inf")) for entry in estimate.parameters),
        covariance=(),
    )
    write_fit(unknown, tmp_path / "ours.json")
    table = write_table(tmp_path / "table.csv", [("fv1", 1.0)], "name,value")
    code, answer = ask("compare", folder / "arm.toml", tmp_path / "ours.json", table, "--gate", "3")
    assert (code, list_codes(answer, "errors")) == (1, ["compare.gate"])
    assert answer["result"]["others"][0]["judged"] == 0
    assert run(["compare", str(folder / "arm.toml"), str(tmp_path / "ours.json"), str(table)]) == 0
    assert "--deviation" in capsys.readouterr().err


def store_elastic(robot, path, shift=0.0):
    sources = (f"{path.stem}.npz",)
    return write_fit(build_springless_estimate(robot, shift=shift, sources=sources), path)


def test_estimates_of_elastic_joints_are_compared_without_their_springs(robots_folder, tmp_path):
    robot = read_robot(robots_folder / "two_link_elastic.toml")
    ours = store_elastic(robot, tmp_path / "ours.json")
    theirs = store_elastic(robot, tmp_path / "theirs.json", shift=STD)
    answer = do("compare", "two_link_elastic", ours, theirs)
    codes = list_codes(answer)
    assert [code for code in codes if code.startswith("compare")] == ["compare.springs"] * 2
    (found,) = answer["result"]["others"]
    base = derive_base_parameters(robot)
    names = [entry.name for entry in (*base.parameters, *base.friction)]
    assert [entry["group"] for entry in found["groups"]] == names
    assert [entry["deviations"] for entry in found["groups"]] == pytest.approx([-np.sqrt(0.5)] * len(names))
    # Taken as rigid, rotors turn with the links: groups that hold one are other groups.
    rigid = store_estimate(build_rigid_variant(robot), tmp_path / "rigid.json")
    answer, found = compare("two_link_elastic", ours, rigid)
    assert len(found["other_model"]) > 0
    assert set(found["other_model"]) | {entry["group"] for entry in found["groups"]} >= set(names) - {"ZZR1"}
    assert all(abs(entry["deviations"]) < 1e-6 for entry in found["groups"])
