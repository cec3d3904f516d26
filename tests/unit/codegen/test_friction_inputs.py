"""Functions of friction that reads positions, loads and temperatures: all targets, the examples in C."""

import re
from dataclasses import replace

import numpy as np
import pytest

from symid.codegen.cache import prepare_library
from symid.codegen.casadi_functions import build_functions
from symid.codegen.functions import build_spring_vector
from symid.joint_models import FrictionValues, get_law
from symid.robot import load_robot
from tests.builds import make, run, write_c
from tests.friction_forms import find_linear_torque

STRICT = "-std=c99 -O1 -Wall -Wextra -Wpedantic -Wconversion -Wshadow -Wdouble-promotion -Werror"
NAMES = {"position": "q", "load": "load", "temperature": "temperature"}
# Linear values, and shape values.
VALUES = {
    "load-dependent": ((0.8, 1.1, 0.05), ()),
    "load-dependent-stribeck": ((0.8, 1.1, 0.05, 0.3, 0.02), (0.1,)),
    "position-dependent-1,3x8": ((0.5, 0.9, 0.2, -0.1, 0.05, 0.04), ()),
    # Once a turn, a wave would be like a weight, and part of a base parameter.
    "position-torque-5": ((0.5, 0.9, 0.2, -0.1), ()),
    "temperature": ((0.5, 0.9, -0.005, -0.004), ()),
    "temperature-viscous": ((0.5, 0.9, 3.0), (25.0,)),
    "coulomb-viscous": ((0.5, 0.9), ()),
}
PAIRS = (
    ("load-dependent", "position-dependent-1,3x8"),
    ("position-torque-5", "temperature"),
    ("temperature-viscous", "load-dependent-stribeck"),
    ("coulomb-viscous", "load-dependent"),
    ("temperature", "coulomb-viscous"),
)
EACH_PAIR = pytest.mark.parametrize("laws", PAIRS, ids=" ".join)


def set_friction(robot, laws, *, smoothing=0.0):
    joints = []
    for joint, name in zip(robot.joints, laws, strict=True):
        values, shape = VALUES[name]
        friction = FrictionValues(law=name, values=values, shape=shape, smoothing=smoothing)
        joints.append(replace(joint, friction=friction))
    return replace(robot, joints=tuple(joints))


@pytest.fixture(scope="module")
def arm():
    return load_robot("two_link")


@pytest.fixture(scope="module")
def elastic_arm():
    return load_robot("two_link_elastic")


def list_ports(laws):
    read = {key for name in laws for key in get_law(name).inputs[1:]}
    return [port for key, port in NAMES.items() if key in read]


@pytest.mark.parametrize("backend", ["c", "casadi", "python"])
@EACH_PAIR
def test_every_backend_has_the_torque_of_the_formulas(arm, c_compiler, backend, laws):
    robot = set_friction(arm, laws)
    library = prepare_library(robot, names=("friction", "friction_regressor"), backend=backend)
    rng, count = np.random.default_rng(4), 37
    dq, q, load = rng.uniform(-2, 2, (3, count, 2))
    given = {"q": q, "load": 20.0 * load, "temperature": rng.uniform(10, 70, (count, 2))}
    inputs = library.card.gather_friction_inputs(dq, **given)
    assert len(inputs) == 1 + len(list_ports(laws))
    f = np.concatenate([VALUES[name][0] for name in laws])
    (torque,), (rows,) = (
        library.evaluate("friction", *inputs, f),
        library.evaluate("friction_regressor", *inputs),
    )
    for k in range(count):
        for joint, name in enumerate(laws):
            others = {key: given[NAMES[key]][k, joint] for key in get_law(name).inputs[1:]}
            expected = find_linear_torque(name, *VALUES[name], dq[k, joint], **others)
            assert torque[k, joint] == pytest.approx(expected, rel=1e-12, abs=1e-13)
    np.testing.assert_allclose(rows @ f, torque, rtol=1e-12, atol=1e-13)


@EACH_PAIR
def test_values_of_the_robot_file_are_constants_and_inputs_stay_inputs(arm, laws):
    robot = set_friction(arm, laws)
    (constant,) = build_functions(robot, names=("friction",), constant=True).functions
    (open_one,) = build_functions(robot, names=("friction",)).functions
    ports = ["dq", *list_ports(laws)]
    assert [constant.name_in(k) for k in range(constant.n_in())] == ports
    inputs = np.random.default_rng(5).uniform(-2, 2, (len(ports), 2))
    f = np.concatenate([VALUES[name][0] for name in laws])
    np.testing.assert_allclose(constant(*inputs), open_one(*inputs, f), rtol=1e-13)


@EACH_PAIR
def test_motors_of_elastic_joints_feel_friction_under_the_torque_of_the_spring(elastic_arm, laws):
    robot = set_friction(elastic_arm, laws, smoothing=0.01)
    plain = set_friction(elastic_arm, ("coulomb-viscous", "coulomb-viscous"), smoothing=0.01)
    names = ("elastic_inverse_dynamics", "inverse_dynamics", "friction")
    built = {
        key: {function.name(): function for function in build_functions(each, names=names).functions}
        for key, each in (("own", robot), ("plain", plain))
    }
    function = built["own"]["elastic_inverse_dynamics"]
    ports = [function.name_in(k) for k in range(function.n_in())]
    # Positions and loads of the motors follow from the motion; temperatures do not.
    warm = ["temperature"] if "temperature" in list_ports(laws) else []
    assert ports == ["q", "dq", "ddq", "dddq", "ddddq", *warm, "beta", "IA", "f", "h", "Q"]
    rng = np.random.default_rng(6)
    motion = list(rng.uniform(-1, 1, (5, 2)))
    beta, rotors = rng.uniform(0.1, 1.0, function.numel_in(ports.index("beta"))), np.array([0.25, 0.05])
    h = build_spring_vector([joint.elasticity for joint in elastic_arm.joints])
    plays = np.zeros(function.numel_in(ports.index("Q")))
    temperature = np.array([25.0, 52.0])
    f = np.concatenate([VALUES[name][0] for name in laws])
    given = [temperature] if warm else []
    torque, theta, dtheta, _ = function(*motion, *given, beta, rotors, f, h, plays)
    bare, *_ = built["plain"]["elastic_inverse_dynamics"](*motion, beta, rotors, np.zeros(4), h, plays)
    load = np.array(built["own"]["inverse_dynamics"](*motion[:3], beta)).ravel()
    theta, dtheta = np.array(theta).ravel(), np.array(dtheta).ravel()
    found = np.array(torque - bare).ravel()
    all_given = {"q": theta, "load": load, "temperature": temperature}
    expected = built["own"]["friction"](dtheta, *(all_given[port] for port in list_ports(laws)), f)
    np.testing.assert_allclose(found, np.array(expected).ravel(), rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize(("precision", "constant"), [("double", False), ("float", True)])
@pytest.mark.parametrize("elastic", [False, True], ids=["rigid", "elastic"])
@pytest.mark.parametrize("laws", PAIRS[:3], ids=" ".join)
def test_the_example_in_c_tracks(  # noqa: PLR0917 - what is combined
    arm, elastic_arm, c_compiler, tmp_path, laws, elastic, precision, constant
):
    robot = set_friction(elastic_arm if elastic else arm, laws, smoothing=0.01)
    functions = build_functions(robot, constant=constant)
    make(
        write_c(functions, tmp_path, precision=precision),
        c_compiler,
        "selftest",
        "control_loop",
        flags=STRICT,
    )
    assert "0 of " in run(tmp_path, "./selftest").stdout
    error = float(re.findall(r"\d\.\d+e[-+]\d+", run(tmp_path, "./control_loop").stdout)[0])
    assert error < (1e-3 if elastic else 1e-2)
