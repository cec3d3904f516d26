"""Springs with branches get folders of code in that of their robot; springs with stops alone do not."""

from dataclasses import replace

import numpy as np
import pytest

import symid
from symid.codegen.functions import build_spring_vector
from symid.errors import UsageError
from symid.joint_models import BoucWen, Elasticity, Stop, run_element
from tests.unit.robot.test_elasticity_branches import write_arm

BENT = Elasticity(stiffness=380.0, branches=(BoucWen(level=1.5, length=0.004, sharpness=1.4),))
PLAIN = Elasticity(stiffness=90.0, stops=(Stop(threshold=0.003, stiffness=30.0),))


def load(folder, *springs):
    return symid.load(write_arm(folder, springs))


def write(folder, *springs):
    """Return what is written of an arm in Python."""
    return load(folder, *springs).write("python", folder / "code", functions=["gravity"]).product


@pytest.mark.parametrize("target", ["c", "python", "casadi"])
def test_every_spring_has_a_folder(tmp_path, target):
    robot = load(tmp_path, BENT, PLAIN)
    made = robot.write(target, tmp_path / "code", functions=["gravity"])
    assert [spring.folder.name for spring in made.product.springs] == ["spring_shoulder", "spring_elbow"]
    assert all(spring.record.selftest == "passed" for spring in made.product.springs)
    assert "spring_elbow" in made.to_text()
    assert made.to_dict()["springs"] == [str(spring.folder) for spring in made.product.springs]
    again = robot.write(target, tmp_path / "code", functions=["gravity"])
    assert again.unchanged
    assert all(spring.unchanged for spring in again.product.springs)


def test_the_code_of_a_spring_is_the_spring_of_the_file(tmp_path):
    (module,) = (file for file in write(tmp_path, BENT, PLAIN).springs[0].files if file.suffix == ".py")
    space = {}
    exec(compile(module.read_text(), module.name, "exec"), space)  # noqa: S102  generated here
    (kind,) = (value for value in space.values() if isinstance(value, type))
    element, phi = kind(), 0.01 * np.sin(0.3 * np.arange(200))
    found = [element.step(float(value)) for value in phi]
    np.testing.assert_allclose(found, run_element(BENT, phi).output, rtol=1e-11, atol=1e-12)


def test_the_functions_of_such_a_robot_are_those_of_its_links(tmp_path):
    names = {spec.name for spec in load(tmp_path, BENT, PLAIN).library.card.functions}
    assert not {name for name in names if "hysteresis" in name or "elastic" in name}
    assert load(tmp_path, PLAIN, PLAIN).library.card.springs


def test_springs_with_stops_alone_have_none_and_one_of_unknown_stiffness_is_named(tmp_path):
    assert write(tmp_path, PLAIN, PLAIN).springs == ()
    product = write(tmp_path, BENT, Elasticity())
    assert [spring.folder.name for spring in product.springs] == ["spring_shoulder"]
    (notice,) = (entry for entry in product.notices if entry.code == "generate.unknown-spring")
    assert "'elbow'" in notice.text


def test_h_holds_no_branches():
    with pytest.raises(UsageError, match="branches"):
        build_spring_vector([BENT])


def test_joints_may_have_any_name(tmp_path):
    from symid.robot.toml_reader import read_robot
    from symid.robot.toml_writer import write_robot

    file = write_arm(tmp_path, (BENT, PLAIN))
    arm = read_robot(file)
    joints = (replace(arm.joints[0], name="left arm/1"), arm.joints[1])
    file.write_text(write_robot(replace(arm, joints=joints)))
    made = symid.load(file).write("python", tmp_path / "code", functions=["gravity"])
    assert made.product.springs[0].folder.name == "spring_left_arm_1"
