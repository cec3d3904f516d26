"""Pages of results that are no fits: verdict, numbers of the first screen, question and answer of figures."""

import math
import re
from dataclasses import replace
from html import unescape

import numpy as np
import pytest

import symid
from symid.errors import Notice
from symid.report.drawings import draw_log, draw_robot, place_arm
from symid.report.result_pages import judge_check, judge_comparison, judge_payload
from symid.robot import load_robot, name_for_commands
from symid.robot.mjcf_reader import parse_xml_robot


@pytest.fixture(scope="module")
def robot():
    return symid.load("two_link")


@pytest.fixture(scope="module")
def log(robot):
    return robot.simulate(duration=4.0, seed=1).log


def read_page(path):
    text = path.read_text(encoding="utf-8")
    numbers = re.findall(r"<dt>(.*?)</dt><dd>(.*?)</dd>", text)
    captions = [unescape(one) for one in re.findall(r"<figcaption>(.*?)</figcaption>", text)]
    assert ("<script" in text) == (" data-frame=" in text)
    # Every figure has a question, and says more behind it.
    assert all(re.fullmatch(r"[^?]+\? .+\.", caption) for caption in captions), captions
    assert len(captions) <= 12
    return {unescape(what): unescape(value) for what, value in numbers}, text


def test_a_checked_log_has_a_page(robot, log, tmp_path):
    found = robot.check(log)
    numbers, text = read_page(found.report(tmp_path / "check.html"))
    plain = found.to_dict()["excitation"]
    good = sum(entry["verdict"] == "identifiable" for entry in plain["parameters"])
    assert numbers["parameters identifiable"] == f"{good} of {len(plain['parameters'])}"
    assert float(numbers["condition number (column-scaled)"]) == pytest.approx(plain["condition"], rel=0.05)
    assert '<section class="verdict good"' in text
    # A robot that comes with symid is named, not its file.
    assert "symid identify two_link " in unescape(text)
    own = tmp_path / "two_link.toml"
    own.write_bytes(robot.path.read_bytes())
    assert name_for_commands(load_robot(str(own))) == str(own)
    # Without a log the page has the robot alone.
    numbers, text = read_page(robot.check().report(tmp_path / "robot.html"))
    assert numbers == {}
    assert "check of a robot file" in text


def test_a_check_is_judged_by_what_was_found(robot, log):
    found = robot.check(log).product
    sign = Notice(code="log.torque-sign", text="the torque of elbow has another sign")
    poor = replace(found.excitation.parameters[0], verdict="poorly identifiable")
    some = replace(found.excitation, parameters=(poor, *found.excitation.parameters[1:]))
    assert poor.name in judge_check(replace(found, excitation=some)).details[0]
    for changes, level in (
        ({}, "good"),
        ({"notices": (sign,)}, "doubtful"),
        ({"errors": (sign,)}, "wrong"),
        ({"excitation": None}, "usable"),
        ({"excitation": some}, "usable"),
    ):
        assert judge_check(replace(found, **changes)).level == level


def test_a_trajectory_has_a_page(robot, tmp_path):
    found = robot.excite(harmonics=2, period=2.0, candidates=10, starts=1)
    numbers, _ = read_page(found.report(tmp_path / "excite.html"))
    assert float(numbers["condition number (column-scaled)"]) == pytest.approx(found.condition, rel=1e-3)
    most = max(entry.share for entry in found.margins if entry.share is not None)
    used = next(value for what, value in numbers.items() if what.startswith("of a limit used at most"))
    assert float(used.split()[0]) == pytest.approx(100.0 * most, rel=0.05)
    assert len(found.plot()) == 3


def test_a_comparison_has_a_page(robot, log, tmp_path):
    first, second = robot.identify(log), robot.identify(robot.simulate(duration=4.0, seed=2).log)
    found = first.compare(second)
    numbers, text = read_page(found.report(tmp_path / "compare.html"))
    assert numbers["groups within two standard deviations"] == f"{found.count_within(2.0)} of {found.judged}"
    assert f"{found.largest:.2g}" in numbers.values()
    assert '<section class="verdict good"' in text
    far = replace(found.found[0].comparison, deviations=found.found[0].comparison.deviations + 9.0)
    assert judge_comparison([replace(found.found[0], comparison=far)]).level == "doubtful"
    blind = replace(found.found[0].comparison, deviations=np.full(12, np.nan))
    assert judge_comparison([replace(found.found[0], comparison=blind)]).level == "usable"


def test_a_payload_has_a_page(robot, log, tmp_path):
    heavy = tmp_path / "carrying.toml"
    heavy.write_text(robot.path.read_text().replace("mass = 1.9", "mass = 2.9"))
    loaded = symid.load(heavy).simulate(duration=4.0, seed=2).log
    found = robot.payload(loaded, log)
    numbers, text = read_page(found.report(tmp_path / "payload.html"))
    assert float(numbers["mass"].split()[0]) == pytest.approx(found.mass, abs=found["mass"].std)
    assert all(reason in unescape(text) for reason in (e.reason for e in found.payload.quantities) if reason)
    assert judge_payload(found.payload).level == "usable"
    assert judge_payload(replace(found.payload, moved=4.0)).level == "doubtful"
    known = tuple(replace(entry, value=1.0, std=0.1) for entry in found.payload.quantities)
    assert judge_payload(replace(found.payload, quantities=known)).level == "good"


def test_stiffnesses_have_a_page(tmp_path):
    elastic = symid.load("two_link_elastic")
    found = elastic.identify_stiffness(elastic.simulate(duration=6.0, seed=1).log)
    numbers, text = read_page(found.report(tmp_path / "stiffness.html"))
    told = [entry for entry in found.joints.values() if entry.stiffness is not None]
    assert numbers["joints with a stiffness"] == f"{len(told)} of {len(found.joints)}"
    for entry in told:
        low, high = entry.interval
        assert f"{entry.stiffness:.4g}: {low:.4g} to {high:.4g}" in text


def test_frames_of_the_skeleton_are_those_of_the_kinematics():
    # Two links of a planar arm, by hand.
    two = load_robot("two_link")
    length = two.joints[1].placement.translation[0].to_float(dict(two.symbols))
    _, frames = place_arm(two, (0.3, 0.5))
    assert frames[1][:3, 3] == pytest.approx([length * math.cos(0.3), length * math.sin(0.3), 0.0])
    assert frames[1][:3, 0] == pytest.approx([math.cos(0.8), math.sin(0.8), 0.0])
    # A prismatic joint moves along its own z.
    scara = load_robot("scara")
    slide = next(k for k, joint in enumerate(scara.joints) if joint.prismatic)
    low, high = (place_arm(scara, [q * (k == slide) for k in range(4)])[1][slide] for q in (0.0, 0.2))
    assert high[:3, 3] - low[:3, 3] == pytest.approx(0.2 * low[:3, 2])


@pytest.fixture
def tool_arm():
    joint = (
        '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><origin xyz="{4}"/>{5}</joint>'
    )
    parts = [
        '<link name="base"/><link name="l1"/><link name="tool0"/>',
        joint.format("j1", "revolute", "base", "l1", "0 0 0.5", '<axis xyz="0 0 1"/>'),
        joint.format("hold", "fixed", "l1", "tool0", "0.2 0 0", ""),
    ]
    return parse_xml_robot(f'<robot name="arm">{"".join(parts)}</robot>', "arm.urdf")


@pytest.mark.parametrize("name", ["scara", "panda", "quadruped", "two_link_symbols", "two_arms", "ppr"])
def test_every_kind_of_robot_is_drawn(name):
    drawing = draw_robot(load_robot(name))
    assert drawing.svg.count("frame-z") == load_robot(name).size
    assert drawing.caption.startswith(f"Where are the joints of {name}? ")
    # Labels lie in the figure, and no two over each other.
    pattern = r'<text x="([-\d.]+)" y="([-\d.]+)" text-anchor="(start|end)">(.+?)</text>'
    boxes = []
    for x, y, anchor, text in re.findall(pattern, drawing.svg):
        left = float(x) - 7.2 * len(text) * (anchor == "end")
        assert not any(
            left < right and start < left + 7.2 * len(text) and abs(float(y) - other) < 15.0
            for start, right, other in boxes
        ), text
        boxes.append((left, left + 7.2 * len(text), float(y)))
        assert min(boxes[-1]) >= 0.0


def test_a_tool_that_is_fixed_to_the_last_link_is_drawn(tool_arm):
    """The frame of tool0 stands 0.2 m along x of the last link, which is turned by 90 degrees."""
    links, frames = place_arm(tool_arm, [math.pi / 2])
    assert len(links) == 2
    np.testing.assert_allclose(links[1], [[0.0, 0.0, 0.0], [0.0, 0.0, 0.5], [0.0, 0.2, 0.5]], atol=1e-12)
    assert len(frames) == 1


def test_marks_of_a_log_are_what_its_check_found(robot, log):
    checked = robot.check(log).logs[0]
    torque = log.tau.copy()
    torque[:, 1] = np.clip(torque[:, 1], -2.0, 2.0)
    entry = replace(checked.joints[1], peak=2.0, saturated=0.3)
    held = replace(checked, joints=(checked.joints[0], entry))
    limited = replace(log.recording, torque=torque)
    plain, marked = (draw_log(one, robot.description, held)[1] for one in (log.recording, limited))
    assert "as if limited: elbow" in marked.caption
    assert "found by the check" in marked.svg
    narrow = replace(robot.description.joints[0].limits, position=(-0.1, 0.1))
    joints = (replace(robot.description.joints[0], limits=narrow), *robot.description.joints[1:])
    moved, _ = draw_log(log.recording, replace(robot.description, joints=joints))
    assert "beyond the limits of the robot file: shoulder" in moved.caption
    assert plain.caption.startswith("What did it take?")


def test_what_is_plotted_is_told_by_the_file(robot, log, tmp_path):
    path = robot.excite(harmonics=2, period=2.0, candidates=10, starts=1).save(tmp_path / "motion.csv")
    assert robot.plot(path).drawings[0].caption.startswith("Where does it go? trajectory motion.csv")
    saved = robot.plot(log.save(tmp_path / "log.csv"))
    assert saved.drawings[0].caption.startswith("Where did the joints go?")
    fit = robot.identify(log)
    assert robot.plot(fit.save(tmp_path / "fit.json")).drawings == fit.plot().drawings
    with pytest.raises(symid.UsageError, match="leave one of them out"):
        robot.plot(path, pose=[0.1, 0.2])
