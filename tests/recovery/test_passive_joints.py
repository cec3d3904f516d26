"""Joints without a motor: partial dynamics, and identification where their torque is zero.

Oracles: Pinocchio's crba, nle and aba with the closed form of partial feedback linearisation (M. W. Spong,
Partial feedback linearization of underactuated mechanical systems, IROS 1994); textbook equations of the
cart and pole, and plants integrated by SciPy.
"""

import re
import shutil
import subprocess
from importlib import util
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import symid
from symid.errors import RobotError, UsageError
from tests.calls import do, list_codes
from tests.refusals import refuse
from tests.urdfs import pin

G, RATE, STEPS = 9.81, 500.0, 6000
JOINT = """
[[joint]]
name = "{name}"
kind = "{kind}"
{actuated}{place}
[joint.link]
mass = {mass}
com = [{com}, 0, 0]
inertia = {{ xx = {inertia}, yy = {inertia}, zz = {inertia} }}
{extra}
"""
PARTIAL = ("partial_inverse_dynamics", "partial_forward_dynamics")
FRICTION = '[joint.friction]\nmodel = "coulomb-viscous"\nFv = {}\nFc = 0\n'
SPRING = "[joint.spring]\nstiffness = 40.0\nrest = 0.1\n"


def build(name, rows, gravity="0, -9.81, 0"):
    """Return the robot, and its model in Pinocchio, by the rows of `ROBOTS`."""
    text, model, parent = f'name = "{name}"\nconvention = "modified"\ngravity = [{gravity}]\n', pin.Model(), 0
    for k, (kind, passive, x, mass, com, inertia, fv, spring) in enumerate(rows):
        extra = (FRICTION.format(fv) if fv else "") + (SPRING if spring else "")
        # A slide moves along z, which is turned to x; what follows turns about the vertical plane's normal.
        place = f"a = {x}\n" + ('alpha = "pi/2"\n' if kind == "prismatic" else "")
        place += 'alpha = "-pi/2"\n' if k and rows[k - 1][0] == "prismatic" else ""
        actuated = "actuated = false\n" * passive
        fields = {"name": f"j{k + 1}", "kind": kind, "place": place, "actuated": actuated, "extra": extra}
        text += JOINT.format(mass=mass, com=com, inertia=inertia, **fields)
        turn = {True: np.pi / 2}.get(kind == "prismatic", -np.pi / 2 if 'alpha = "-' in place else 0.0)
        joint = pin.JointModelPZ() if kind == "prismatic" else pin.JointModelRZ()
        rotation = pin.utils.rotate("x", turn)
        parent = model.addJoint(parent, joint, pin.SE3(rotation, np.array([x, 0.0, 0.0])), f"j{k + 1}")
        body = pin.Inertia(mass, np.array([com, 0.0, 0.0]), np.diag([inertia] * 3))
        model.appendBodyToJoint(parent, body, pin.SE3.Identity())
    model.gravity.linear = np.array([float(part) for part in gravity.split(",")])
    return text, model


def act(rows, q, dq):
    """Return what friction and springs add to the torques of the joints."""
    viscous = np.array([row[6] for row in rows])
    stiffness = np.array([40.0 if row[7] else 0.0 for row in rows])
    return -viscous * dq - stiffness * (q - 0.1)


# Joints as (kind, passive, x, mass, com, inertia, Fv, spring).
ROBOTS = {
    "acrobot": [
        ("revolute", True, 0.0, 1.0, 0.5, 0.1, 0.1, False),
        ("revolute", False, 1.0, 1.2, 0.4, 0.08, 0.2, False),
    ],
    "pendubot": [
        ("revolute", False, 0.0, 1.5, 0.4, 0.1, 0.3, False),
        ("revolute", True, 0.8, 0.7, 0.3, 0.05, 0.05, False),
    ],
    "flexible": [
        # A motor, and behind it a virtual joint with a spring in the place of its gear.
        ("revolute", False, 0.0, 0.8, 0.0, 0.2, 0.4, False),
        ("revolute", True, 0.0, 2.0, 0.3, 0.15, 0.3, True),
    ],
    "two passive": [
        ("revolute", True, 0.0, 1.0, 0.3, 0.1, 0.0, False),
        ("revolute", False, 0.5, 1.2, 0.2, 0.08, 0.0, False),
        ("revolute", True, 0.4, 0.6, 0.2, 0.05, 0.0, False),
    ],
    "lift": [
        ("prismatic", True, 0.0, 2.0, 0.0, 0.1, 1.0, True),
        ("revolute", False, 0.0, 1.2, 0.4, 0.08, 0.2, False),
    ],
}


@pytest.fixture(params=ROBOTS)
def case(request, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rows = ROBOTS[request.param]
    text, model = build("arm", rows)
    (tmp_path / "arm.toml").write_text(text)
    passive = [k for k, row in enumerate(rows) if row[1]]
    driven = [k for k in range(len(rows)) if k not in passive]
    return SimpleNamespace(rows=rows, model=model, data=model.createData(), passive=passive, driven=driven)


def solve_partially(case, q, dq, wanted, torque):
    """Return tau_a and ddq_p in Spong's closed form: Mbar = M_aa - M_ap M_pp^-1 M_pa and so on."""
    mass = np.array(pin.crba(case.model, case.data, q))
    mass = np.triu(mass) + np.triu(mass, 1).T
    bias = np.array(pin.nle(case.model, case.data, q, dq)) - [
        -40.0 * (x - 0.1) if row[7] else 0.0 for row, x in zip(case.rows, q, strict=True)
    ]
    a, p = case.driven, case.passive
    gain = mass[np.ix_(a, p)] @ np.linalg.inv(mass[np.ix_(p, p)])
    tau = (mass[np.ix_(a, a)] - gain @ mass[np.ix_(p, a)]) @ wanted + bias[a] + gain @ (torque - bias[p])
    free = np.linalg.solve(mass[np.ix_(p, p)], torque - bias[p] - mass[np.ix_(p, a)] @ wanted)
    return tau, free


def draw(case, seed=2):
    draws, n = np.random.default_rng(seed), len(case.rows)
    q, dq = draws.uniform(-2, 2, (2, n))
    wanted, torque = draws.uniform(-5, 5, len(case.driven)), draws.uniform(-3, 3, len(case.passive))
    braked = any(case.rows[k][6] for k in case.passive)
    return q, dq, wanted, torque if braked else 0.0 * torque, [torque] if braked else []


def test_partial_dynamics_are_those_of_pinocchio(case):
    robot = symid.load("arm.toml")
    lib = robot.compile()
    casadi = {name: robot.casadi(name) for name in PARTIAL}
    robot.write("python", "code")
    path = next(path for path in Path("code").glob("*.py") if "test" not in path.name)
    spec = util.spec_from_file_location("generated", path)
    module = util.module_from_spec(spec)
    spec.loader.exec_module(module)
    for seed in range(5):
        q, dq, wanted, torque, given = draw(case, seed)
        tau, free = solve_partially(case, q, dq, wanted, torque)
        whole = np.zeros(len(q))
        whole[case.driven], whole[case.passive] = tau, torque
        spring = np.array([-40.0 * (x - 0.1) if row[7] else 0.0 for row, x in zip(case.rows, q, strict=True)])
        ddq = pin.aba(case.model, case.data, q, dq, whole + spring)
        np.testing.assert_allclose(ddq[case.driven], wanted, atol=1e-9)
        for partial in (lib.partial_inverse_dynamics, module.partial_inverse_dynamics, casadi[PARTIAL[0]]):
            found = partial(q, dq, wanted, *given, lib.beta)
            np.testing.assert_allclose(np.array(found[0]).ravel(), tau, atol=1e-9)
            np.testing.assert_allclose(np.array(found[1]).ravel(), free, atol=1e-9)
        for partial in (lib.partial_forward_dynamics, module.partial_forward_dynamics, casadi[PARTIAL[1]]):
            accelerations = np.array(partial(q, dq, tau, *given, lib.beta)).ravel()
            np.testing.assert_allclose(accelerations, ddq, atol=1e-9)


@pytest.mark.usefixtures("c_compiler")
def test_the_folder_of_c_tests_itself(case):
    """The references of the self-test are exact; a robot with all motors has no such functions."""
    functions = ["mass_matrix", *PARTIAL]
    symid.load("arm.toml").write("c", "folder", functions=functions)
    built = subprocess.run(
        [shutil.which("make"), "-C", "folder", "check"], capture_output=True, text=True, check=False
    )
    assert built.returncode == 0, built.stdout + built.stderr
    assert PARTIAL[0] not in symid.load("two_link").compile().functions


def swing(case, push, start):
    """Return t, q (t, n) and the torques of the motors (t, a) of a plant that nobody controls."""
    n, times = len(case.rows), np.arange(STEPS) / RATE

    def slope(t, state):
        q, dq = state[:n], state[n:]
        tau = act(case.rows, q, dq)
        tau[case.driven] += push(t)
        return np.concatenate([dq, pin.aba(case.model, case.data, q, dq, tau)])

    run = solve_ivp(slope, (0, times[-1]), start, t_eval=times, rtol=1e-9, atol=1e-10)
    return times, run.y[:n].T, np.array([push(t) for t in times])


def write_csv(times, q, torques, names, noise):
    draws = np.random.default_rng(8)
    q = q + 2e-5 * draws.standard_normal(q.shape)
    torques = torques + noise * torques.std(axis=0) * draws.standard_normal(torques.shape)
    heads = ",".join(["t", *(f"q{k + 1}" for k in range(q.shape[1])), *names])
    np.savetxt(
        "log.csv", np.column_stack([times, q, torques]), delimiter=",", header=heads, comments="", fmt="%.9g"
    )


def assert_values(answer, robot, least=0.03):
    """Compare the parameters with those of the file, in parts of the largest of their kind."""
    truth = {entry.name: entry.value for entry in (*robot.beta, *robot.friction)}
    rows = answer["result"]["parameters"]
    found, stds = ({row["name"]: row[key] for row in rows} for key in ("value", "std"))
    assert found.keys() == truth.keys()
    for name, value in truth.items():
        kind = [abs(other) for key, other in truth.items() if key[:2] == name[:2]]
        assert found[name] == pytest.approx(value, abs=max(least * max(*kind, 0.05), 4.0 * stds[name])), name


@pytest.mark.parametrize("logged", ["driven", "noise"])
def test_parameters_are_identified_from_the_motors_alone(case, logged):
    names = [f"tau{k + 1}" for k in case.driven]
    tones = np.array([0.31, 0.83, 1.7, 2.9]) * 2 * np.pi

    def push(t):
        return 3.0 * np.array(
            [np.sum(np.sin((1 + 0.13 * k) * tones * t + k)) for k in range(len(case.driven))]
        )

    times, q, torques = swing(
        case, push, np.concatenate([np.full(len(case.rows), 0.3), np.zeros(len(case.rows))])
    )
    if logged == "noise":
        # A current sensor at a joint without a motor: its noise is no torque.
        whole = 0.05 * np.random.default_rng(1).standard_normal((STEPS, len(case.rows)))
        whole[:, case.driven] = torques
        torques, names = whole, [f"tau{k + 1}" for k in range(len(case.rows))]
    write_csv(times, q, torques, names, 0.01)
    answer = do("identify", "arm.toml", "log.csv", "-o", "fit.json")
    assert ("log.no-motor" in list_codes(answer)) == (logged == "noise")
    assert answer["result"]["verdict"]["level"] in ("good", "usable")
    assert np.isfinite(answer["result"]["mean_relative_percent"])
    assert_values(answer, symid.load("arm.toml").compile().card, 0.1)
    tried = do("validate", "arm.toml", "fit.json", "log.csv")
    assert tried["result"]["mean_relative_percent"] < 10.0


def test_a_cart_and_its_pole(tmp_path, monkeypatch):
    """Textbook, the pole by its angle from where it hangs.

    (M + m) x" + m l (th" cos th - th'^2 sin th) = F - b x'
    (I + m l^2) th" + m l x" cos th = -m g l sin th - c th'
    """
    monkeypatch.chdir(tmp_path)
    cart, pole, length, inertia, b, c = 1.4, 0.3, 0.4, 0.02, 0.8, 0.01

    def force(t):
        return 4.0 * np.sum(np.sin(2 * np.pi * np.array([0.4, 0.9, 1.6, 2.3]) * t + np.arange(4)))

    def slope(t, state):
        x, angle, dx, rate = state
        mass = [
            [cart + pole, pole * length * np.cos(angle)],
            [pole * length * np.cos(angle), inertia + pole * length**2],
        ]
        right = [
            force(t) - b * dx - 2.0 * x + pole * length * rate**2 * np.sin(angle),
            -c * rate - pole * G * length * np.sin(angle),
        ]
        return [dx, rate, *np.linalg.solve(mass, right)]

    times = np.arange(STEPS) / RATE
    run = solve_ivp(slope, (0, times[-1]), [0.0, 0.4, 0.0, 0.0], t_eval=times, rtol=1e-9, atol=1e-10)
    pushes = np.array([[force(t) - 2.0 * x] for t, x in zip(times, run.y[0], strict=True)])
    # The slide is along y, the pole hangs where its angle is 0 and turns about -x.
    rows = (
        ("prismatic", "", 'alpha = "-pi/2"\ntheta = "pi/2"\n', cart, 0.0, 0.01, b),
        ("revolute", "actuated = false\n", 'alpha = "-pi/2"\n', pole, length, inertia, c),
    )
    keys = ("kind", "actuated", "place", "mass", "com", "inertia", "extra")
    text = 'name = "cart"\nconvention = "modified"\ngravity = [0, 0, -9.81]\n'
    for name, row in zip(("slide", "pole"), rows, strict=True):
        text += JOINT.format(name=name, **dict(zip(keys, (*row[:-1], FRICTION.format(row[-1])), strict=True)))
    (tmp_path / "cart.toml").write_text(text)
    write_csv(times, run.y[:2].T * [1, -1], pushes, ["tau1"], 0.01)
    lib = symid.load("cart.toml").compile()
    angle, rate, wanted = 0.7, 2.0, 1.5
    turning = (-c * rate - pole * length * (G * np.sin(angle) + wanted * np.cos(angle))) / (
        inertia + pole * length**2
    )
    pulled = (cart + pole) * wanted + pole * length * (turning * np.cos(angle) - rate**2 * np.sin(angle))
    state = ([0.1, -angle], [0.5, -rate])
    tau, free = lib.partial_inverse_dynamics(*state, [wanted], [c * rate], lib.beta)
    np.testing.assert_allclose([*tau, *free], [pulled, -turning], rtol=1e-12)
    answer = do("identify", "cart.toml", "log.csv", "-o", "fit.json")
    assert answer["result"]["verdict"]["level"] in ("good", "usable")
    assert_values(answer, lib.card, 0.1)


def test_what_joints_without_a_motor_cannot_do(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text, _ = build("arm", ROBOTS["acrobot"])
    (tmp_path / "arm.toml").write_text(text)
    robot = symid.load("arm.toml")
    told = [refuse(UsageError, call) for call in (robot.simulate, robot.excite)]
    assert all("(j1, actuated = false)" in found["usage.passive-joint"] for found in told)
    # The statement stays in files that are written, and no model for MuJoCo gives the joint a motor.
    assert "actuated = false" in robot.export("again.toml").file.read_text()
    assert len(re.findall("<motor ", robot.export("arm.xml").file.read_text())) == 1
    assert "joint j1: it has no motor" in robot.export("arm.urdf").left_out
    for key in ('mimic = { joint = "j1" }', "elasticity = { stiffness = 9 }", 'kind = "fixed"'):
        kind = 'kind = "fixed"' if "fixed" in key else f'kind = "revolute"\n{key}'
        (tmp_path / "wrong.toml").write_text(f'{text}\n[[joint]]\nname = "j3"\nactuated = false\n{kind}\n')
        found = refuse(RobotError, symid.load, "wrong.toml")
        assert {"robot.not-actuated", "robot.fixed-joint"} & {*found}
