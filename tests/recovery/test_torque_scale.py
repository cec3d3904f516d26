"""The size of torques: currents without gears are refused, another size than the file's masses is said.

Truth: Pinocchio's rnea of robots with values, rotors and friction; logs of its torques as currents.
"""

import re
from pathlib import Path

import numpy as np
import pytest

from tests.calls import ask, do, fail, find_texts, list_codes, say
from tests.urdfs import pin

LINK = """<link name="{name}"><inertial><origin xyz="{com}" rpy="0 0 0"/><mass value="{mass}"/>
<inertia ixx="{i}" iyy="{i}" izz="{j}" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="{xyz}" rpy="0 0 0"/><axis xyz="{axis}"/>
<limit lower="-3" upper="3" effort="1e4" velocity="20"/></joint>"""
ROBOTS = {
    # Joints as (kind, axis, placement), links as (mass, com, I, J).
    "pendulum": ([("revolute", "0 1 0", "0 0 0")], [(4.0, "0.3 0 0.02", 0.3, 0.2)]),
    "arm": (
        [
            ("revolute", "0 0 1", "0 0 0.3"),
            ("revolute", "0 1 0", "0 0 0.1"),
            ("revolute", "0 1 0", "0.5 0 0"),
        ],
        [(9.0, "0 0 0.1", 0.4, 0.3), (6.0, "0.25 0 0", 0.2, 0.1), (3.0, "0.2 0 0.05", 0.1, 0.05)],
    ),
    "lift": (
        [("prismatic", "0 0 1", "0 0 0"), ("revolute", "0 1 0", "0.2 0 0.4")],
        [(12.0, "0 0 0.1", 0.3, 0.3), (5.0, "0.3 0 0.1", 0.2, 0.1)],
    ),
}
GEARS, CONSTANTS = (101.0, 80.0, 51.0), (0.11, 0.09, 0.06)
ROTORS, VISCOUS, DRY = (1.2, 0.8, 0.3), (4.0, 3.0, 1.0), (5.0, 3.0, 1.0)


def write_urdf(joints, links):
    names = [f"j{k}" for k in range(1, len(joints) + 1)]
    parts = ['<robot name="arm"><link name="base"/>']
    for k, ((kind, axis, xyz), (mass, com, i, j)) in enumerate(zip(joints, links, strict=True)):
        parent = f"l{names[k - 1]}" if k else "base"
        moves = {"kind": kind, "axis": axis, "xyz": xyz}
        parts.append(JOINT.format(name=names[k], parent=parent, child=f"l{names[k]}", **moves))
        parts.append(LINK.format(name=f"l{names[k]}", mass=mass, com=com, i=i, j=j))
    return "\n".join((*parts, "</robot>"))


@pytest.fixture(params=ROBOTS)
def arm(request, tmp_path, monkeypatch):
    """Return a URDF, a log of currents in A, and the same log in N m, as names; the number of joints."""
    monkeypatch.chdir(tmp_path)
    text = write_urdf(*ROBOTS[request.param])
    (tmp_path / "arm.urdf").write_text(text)
    model = pin.buildModelFromXML(text)
    data, n = model.createData(), model.nq
    rate, noise = 250.0, np.random.default_rng(3)
    t = np.arange(0, 16, 1 / rate)
    tones = np.array([[0.13, 0.31, 0.47], [0.17, 0.29, 0.53], [0.11, 0.37, 0.59]])[:n] * 2 * np.pi
    sizes = np.array([[0.5, 0.25, 0.15]])
    phases = np.arange(3 * n).reshape(n, 3)
    waves = tones[None] * t[:, None, None] + phases
    q = np.sum(sizes * np.sin(waves), axis=2)
    dq = np.sum(sizes * tones * np.cos(waves), axis=2)
    ddq = -np.sum(sizes * tones**2 * np.sin(waves), axis=2)
    tau = np.array([pin.rnea(model, data, *row) for row in zip(q, dq, ddq, strict=True)])
    tau += ddq * ROTORS[:n] + dq * VISCOUS[:n] + np.sign(dq) * DRY[:n]
    tau += 0.01 * tau.std(axis=0) * noise.standard_normal(tau.shape)
    units = ["m" if kind == "prismatic" else "rad" for kind, *_ in ROBOTS[request.param][0]]
    heads = [f"j{k} position [{unit}]" for k, unit in enumerate(units, start=1)]
    for name, unit, values in (("amps", "A", tau / GEARS[:n] / CONSTANTS[:n]), ("torques", "", tau)):
        ends = [unit or ("N" if entry == "m" else "N m") for entry in units]
        what = "current" if unit else "torque"
        columns = [*heads, *(f"j{k} {what} [{end}]" for k, end in enumerate(ends, start=1))]
        table = np.column_stack([t, q, values])
        head = ",".join(("time [s]", *columns))
        np.savetxt(tmp_path / f"{name}.csv", table, fmt="%.7g", delimiter=",", header=head, comments="")
    return n


def draft(n, *more, log="amps.csv"):
    constants = ("--torque-constant", ",".join(map(str, CONSTANTS[:n]))) if log == "amps.csv" else ()
    start = ("new", "arm.toml", "--from-urdf", "arm.urdf", "--log", log, "--force")
    return (*start, "--friction", "coulomb-viscous", *constants, *more)


def list_ratios(answer):
    return np.array([*answer["result"]["torque_ratio"].values()])


@pytest.mark.parametrize("rotors", [("--rotors",), ()], ids=["rotors", "plain"])
def test_currents_never_make_a_robot_of_another_size(arm, rotors):
    gears = ",".join(f"{gear:g}" for gear in GEARS[:arm])
    assert fail(*draft(arm, *rotors)) == (3, "new.torque-constant")
    # What the user states wrongly is said by all three verbs, and no file is written.
    do(*draft(arm, *rotors, "--gear", "1"))
    # Amperes are stated already, and not asked for.
    text = find_texts(do("check", "arm.toml", "amps.csv"), "log.effort-size")
    assert "torque constants, gears or the side of the currents may be wrong" in text
    assert "--units" not in text
    code, answer = ask("identify", "arm.toml", "amps.csv", "-o", "fit.json")
    assert (code, answer["result"]["verdict"]["level"]) == (0, "doubtful")
    assert "identify.scale" in list_codes(answer)
    assert fail("export", "arm.toml", "fit.json", "-o", "new.urdf") == (3, "export.scale")
    wrong = list_ratios(do("export", "arm.toml", "fit.json", "-o", "all.toml", "--ratio", "1e4"))
    assert np.all(wrong < 0.2)
    # With the gears all is right.
    do(*draft(arm, *rotors, "--gear", gears))
    assert "log.effort-size" not in list_codes(do("check", "arm.toml", "amps.csv"))
    answer = do("identify", "arm.toml", "amps.csv", "-o", "fit.json", "--force")
    assert "identify.scale" not in list_codes(answer)
    ratios = list_ratios(do("export", "arm.toml", "fit.json", "-o", "new.urdf"))
    assert np.all((ratios > 0.4) & (ratios < 3.0))
    if rotors:
        np.testing.assert_allclose(ratios, 1.0, atol=0.1)
        assert "identified / robot file: " in say("export", "arm.toml", "fit.json", "-o", "again.toml")


def test_partly_known_values_are_enough(arm):
    """Links without values, and rotors nobody knows: what is left of the file still has a size."""
    do(*draft(arm, "--rotors", log="torques.csv"))
    file = Path("arm.toml")
    text = file.read_text()
    if arm == 3:
        # The first link turns about the vertical: nothing but its inertia acts.
        text, count = re.subn(r"\n\[joint\.link\]\n(?:.+\n)+", "\n", text, count=1)
        assert count == 1
    file.write_text(text.replace("torque = {", "torque = { factor = 0.01,"))
    answer = do("check", "arm.toml", "torques.csv")
    assert {"log.effort-size", "log.torque-size", "log.wrong-unit"} & {*list_codes(answer)}
    answer = ask("identify", "arm.toml", "torques.csv", "-o", "fit.json", "--accept")[1]
    assert answer["result"]["verdict"]["level"] in ("doubtful", "wrong")
    assert fail("export", "arm.toml", "fit.json", "-o", "new.toml", "--accept") == (3, "export.scale")
    file.write_text(text)
    do("identify", "arm.toml", "torques.csv", "-o", "fit.json", "--force")
    ratios = list_ratios(do("export", "arm.toml", "fit.json", "-o", "new.toml"))
    np.testing.assert_allclose(ratios, 1.0, atol=0.1)


def test_torques_beyond_what_the_joints_can_do_are_another_unit(arm):
    """Twice the torque, which the file's masses do not tell of; the joints' limits do."""
    file = Path("arm.toml")
    do(*draft(arm, "--rotors", log="torques.csv"))
    peaks = [joint["peak"] for joint in do("check", "arm.toml", "torques.csv")["result"]["logs"][0]["joints"]]
    limits = iter(peaks)
    text = re.sub(r"(?m)^torque = 10000.*$", lambda _: f"torque = {0.8 * next(limits):.6g}", file.read_text())
    assert next(limits, None) is None
    file.write_text(text)
    # Peaks a quarter above the limit are a fact, and no mistake.
    answer = do("check", "arm.toml", "torques.csv")
    assert "log.torque-beyond-limit" not in list_codes(answer)
    assert "log.torque-peaks" in list_codes(answer)
    right = do("identify", "arm.toml", "torques.csv", "-o", "right.json")["result"]["verdict"]
    file.write_text(text.replace("torque = {", "torque = { factor = 2.0,"))
    assert "log.torque-beyond-limit" in list_codes(do("check", "arm.toml", "torques.csv"))
    answer = do("identify", "arm.toml", "torques.csv", "--train", "0:70%", "--test", "70%:", "-o", "fit.json")
    verdict, tried = answer["result"]["verdict"], answer["result"]["validations"][0]["verdict"]
    assert verdict["level"] == tried["level"] == "doubtful" != right["level"]
    for said in (verdict, tried):
        assert "far beyond the limits of the joints: j1 2." in said["headline"]
        assert "check unit, factor and gear, or these limits" in said["headline"]
    assert fail("export", "arm.toml", "fit.json", "-o", "new.urdf") == (3, "export.limit")
    do("export", "arm.toml", "fit.json", "-o", "new.urdf", "--ratio", "3.5")
    do("identify", "arm.toml", "torques.csv", "--rows", "friction", "-o", "rubbing.json")
    assert fail("export", "arm.toml", "rubbing.json", "-o", "rubbing.toml") == (3, "export.limit")
    # Where the limits were wrong, correcting them is enough.
    file.write_text(re.sub(r"(?m)^torque = [0-9.e+]+$", "torque = 1e4", file.read_text()))
    do("export", "arm.toml", "fit.json", "-o", "again.urdf")
    # Limits that the file's own bodies contradict are placeholders, and cap nothing.
    file.write_text(re.sub(r"(?m)^torque = [0-9.e+]+$", "torque = 1.0", text))
    answer = do("identify", "arm.toml", "torques.csv", "-o", "fit.json", "--force")
    assert answer["result"]["verdict"]["level"] == right["level"]
    do("export", "arm.toml", "fit.json", "-o", "placeholders.urdf")
