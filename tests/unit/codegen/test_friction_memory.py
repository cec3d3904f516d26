"""Generated friction with a state: in C, Python and CasADi against its equations, and each other."""

import ctypes
import re
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from symid.codegen.cache import prepare_library
from symid.codegen.casadi_functions import build_functions
from symid.codegen.python_targets import generate_python_module
from symid.joint_models import FrictionValues
from symid.robot import load_robot
from symid.robot.toml_reader import parse_robot
from tests.builds import list_failed, make, run, spoil, write_c
from tests.state_laws import count_deflections, give_values, take_step, write_table

STRICT = "-O1 -Wall -Wextra -Werror"
HEAD = 'name = "{}"\nconvention = "modified"\ngravity = [0, 0, -9.81]\n'
JOINT = """
[[joint]]
name = "j{number}"
kind = "revolute"
alpha = {alpha}
[joint.link]
mass = 2.0
com = [0.2, 0.01, 0.0]
inertia = {{ xx = 0.01, yy = 0.02, zz = 0.03 }}
[joint.friction]
{friction}
"""
PLAIN = 'model = "coulomb-viscous"\nFv = 0.4\nFc = 0.9'
LOADED = 'model = "load-dependent-stribeck"\nFv = 0.3\nFc = 0.8\nFl = 0.1\nFe = 0.2\nFle = 0.01\nvs = 0.1'
ROBOTS = {
    "alone": ("dahl", "lugre", "generalised-maxwell-slip"),
    "mixed": (LOADED, "lugre+offset", PLAIN, "maxwell-slip"),
}
FEW = ("friction", "friction_step")
FUNCTIONS = (*FEW, "inverse_dynamics", "forward_dynamics")


def build_robot(name):
    text = HEAD.format(name)
    tables = [law if "=" in law else write_table(law) for law in ROBOTS[name]]
    for number, table in enumerate(tables):
        text += JOINT.format(number=number, alpha='"pi/2"' if number % 2 else 0, friction=table)
    return parse_robot(text)


def draw_states(name, count=30):
    """Return velocities, ways, deflections and loads: some bristles bend, some slip, some rest."""
    rng, size = np.random.default_rng(4), len(ROBOTS[name])
    dq = rng.normal(size=(count, size)) * 10.0 ** rng.uniform(-3, 0, (count, size))
    dq[rng.uniform(size=dq.shape) < 0.1] = 0.0
    z = rng.normal(size=(count, sum(count_deflections(law) for law in ROBOTS[name] if "=" not in law))) * 3e-4
    return dq, dq * 1e-3, z, rng.normal(size=dq.shape) * 5.0


def compute_friction(name, dq, z, load):
    """Return friction and deflections after 1 ms, by the equations."""
    torque, after = np.empty(len(dq)), []
    for joint, law in enumerate(ROBOTS[name]):
        if "=" not in law:
            own = [float(one) for one in z[len(after) : len(after) + count_deflections(law)]]
            torque[joint], moved = take_step(give_values(law), dq[joint], 1e-3, own)
            after += moved
        elif law == PLAIN:
            torque[joint] = 0.9 * np.sign(dq[joint]) + 0.4 * dq[joint]
        else:
            level = 0.8 + 0.1 * abs(load[joint])
            level += (0.2 + 0.01 * abs(load[joint])) * np.exp(-((dq[joint] / 0.1) ** 2))
            torque[joint] = level * np.sign(dq[joint]) + 0.3 * dq[joint]
    return torque, after


@pytest.fixture(scope="module", params=sorted(ROBOTS))
def arm(request):
    return request.param


@pytest.fixture(scope="module")
def functions(arm):
    return build_functions(build_robot(arm), names=FUNCTIONS)


@pytest.mark.parametrize("backend", ["c", "python", "casadi"])
def test_a_step_is_that_of_the_equations(arm, backend, c_compiler):
    library = prepare_library(build_robot(arm), names=FEW, backend=backend)
    values = np.array([entry.value for entry in library.card.friction])
    dq, way, z, load = draw_states(arm)
    given = library.card.gather_friction_inputs(dq, q=dq, load=load, temperature=dq)[1:]
    torque, after = library.evaluate("friction_step", dq, way, z, *given, values)
    for k in range(len(dq)):
        wanted, moved = compute_friction(arm, dq[k], z[k], load[k])
        assert_allclose(torque[k], wanted, rtol=1e-12, atol=1e-12)
        assert_allclose(after[k], moved, rtol=1e-12, atol=1e-16)
    # After a long way it is the friction of steady sliding.
    dq[dq == 0.0] = 0.01
    steady, _ = library.evaluate("friction_step", dq, 1e3 * np.sign(dq), z, *given, values)
    (sliding,) = library.evaluate("friction", dq, *given, values)
    assert_allclose(steady, sliding, rtol=1e-12)


@pytest.mark.parametrize("precision", ["double", "float"])
def test_c_compiles_strictly_and_passes_its_own_test(functions, precision, tmp_path, c_compiler):
    write_c(functions, tmp_path, precision=precision, states=20)
    done = make(tmp_path, c_compiler, "all", "check", flags=STRICT)
    (line,) = (line for line in done.stdout.splitlines() if line.startswith("friction_state"))
    assert line.endswith("ok")
    # The example controls the robot with the bristles' own feed-forward.
    assert float(run(tmp_path, "./control_loop").stdout.split()[-4]) < 5e-3


def test_the_self_test_notices_a_state_that_is_not_kept(functions, arm, tmp_path, c_compiler):
    path = write_c(functions, tmp_path, states=5) / f"symid_{arm}_friction_state.c"
    spoil(path, "state->z[k] = next[k];", "state->z[k] = 0.5 * next[k];")
    done = make(tmp_path, c_compiler, "check", flags="-O1", check=False)
    assert (done.returncode != 0, list_failed(done)) == (True, ["friction_state"])


class StateInC:
    """The state of the generated C, called with arrays."""

    def __init__(self, folder, compiler, arm, sizes):
        stem, target = f"symid_{arm}", folder / "friction.so"
        sources = [str(folder / f"{stem}_{part}.c") for part in ("friction_state", "friction_step")]
        flags = ("-std=c99", "-fPIC", "-shared", *STRICT.split())
        subprocess.run([compiler, *flags, *sources, "-o", str(target), "-lm"], check=True)
        shared = ctypes.CDLL(str(target))
        self.begin, self.move = (getattr(shared, f"{stem}_friction_state_{end}") for end in ("init", "step"))
        self.z, self.torque = np.full(sizes[1], 7.0), np.empty(sizes[0])
        assert self.begin(ctypes.c_void_p(self.z.ctypes.data)) == 0

    def step(self, dq, period, *given):
        rows = [np.ascontiguousarray(row, dtype=float) for row in given]
        pointers = [ctypes.c_void_p(row.ctypes.data) for row in (*rows, self.torque)]
        state, speed = (ctypes.c_void_p(row.ctypes.data) for row in (self.z, dq))
        code = self.move(state, speed, ctypes.c_double(period), *pointers)
        return code, self.torque.copy()


def test_the_state_of_c_is_that_of_python_along_a_motion(functions, arm, tmp_path, c_compiler):
    write_c(functions, tmp_path / "c")
    module = {}
    sources = dict(generate_python_module(functions).files)
    exec(compile(sources[f"symid_{arm}.py"], "module", "exec"), module)  # noqa: S102  our own text
    state = module["FrictionState"]()
    sizes = (len(ROBOTS[arm]), len(state.z))
    in_c = StateInC(tmp_path / "c", c_compiler, arm, sizes)
    values = np.array([entry.value for entry in functions.card.friction])
    time = np.arange(400) * 1e-3
    path = np.stack(
        [0.2 * np.sin(9.0 * time + k) + 0.01 * np.sin(90.0 * time) for k in range(sizes[0])], axis=1
    )
    z = state.z
    for k, dq in enumerate(path):
        load = np.cos(time[k] + np.arange(sizes[0]))
        given = functions.card.gather_friction_inputs(dq, q=dq, load=load, temperature=dq)[1:]
        code, torque = in_c.step(dq, 1e-3, *given, values)
        assert code == 0
        assert_allclose(torque, state.step(dq, 1e-3, *given, values), rtol=1e-12, atol=1e-12)
        wanted, z = compute_friction(arm, dq, z, load)
        assert_allclose(torque, wanted, rtol=1e-11, atol=1e-11)
        assert_allclose(in_c.z, state.z, rtol=1e-12, atol=1e-16)
    kept = in_c.z.copy()
    for dq, period in ((np.full(sizes[0], np.nan), 1e-3), (path[0], -1e-3), (path[0], np.inf)):
        assert in_c.step(dq, period, *given, values)[0] == 2
        with pytest.raises(ValueError, match="must be finite, and the period not negative"):
            state.step(dq, period, *given, values)
    assert np.array_equal(in_c.z, kept)
    state.reset()
    assert in_c.begin(ctypes.c_void_p(in_c.z.ctypes.data)) == 0
    assert not state.z.any()
    assert not in_c.z.any()


def test_the_example_of_an_elastic_robot_moves_with_bristles(tmp_path, c_compiler):
    robot = load_robot("two_link_elastic")
    friction = FrictionValues(law="lugre", values=(1.0, 1.5, 0.4), shape=(0.1, 2.0), bristles=(2e4, 40.0))
    joints = tuple(replace(joint, friction=friction) for joint in robot.joints)
    functions = build_functions(replace(robot, joints=joints))
    make(write_c(functions, tmp_path, states=5), c_compiler, "all", "check", flags=STRICT)
    said = run(tmp_path, "./control_loop").stdout
    assert float(re.search(r"tracking error .*?: (\S+) rad", said)[1]) < 5e-3
