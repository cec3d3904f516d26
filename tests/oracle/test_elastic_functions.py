"""Generated functions of elastic joints: against the model itself, a textbook arm, differences of motions."""

import re
from dataclasses import replace

import numpy as np
import pytest
import sympy

from symid.codegen.casadi_functions import build_functions
from symid.codegen.functions import build_spring_vector
from symid.codegen.library import load_library
from symid.errors import UsageError
from symid.joint_models import build_float_carrier, build_numpy_carrier, prandtl_ishlinskii
from symid.joint_models.hysteresis import Elasticity, Knee, Stop, compute_outer_function, invert_spring
from symid.robot import load_robot
from symid.robot.toml_reader import parse_robot
from tests.builds import build_shipped, make, run, write_c, write_python
from tests.refusals import raises

NAMES = ("inverse_dynamics", "friction", "hysteresis_step", "hysteresis_inverse_step")
ALL = (*NAMES, "elastic_inverse_dynamics")
PLAIN = "-O0"
"""What is looked at here is what the code computes; other tests compile it with optimisation."""
UNEVEN = Elasticity(
    stiffness=250.0,
    stops=(Stop(threshold=0.004, stiffness=80.0),),
    knees=tuple(Knee(threshold=at, slope=s) for at, s in ((-4.0, 0.3), (-1.0, -0.2), (2.0, 0.6))),
)


@pytest.fixture(scope="module")
def arm():
    return load_robot("two_link_elastic")


@pytest.fixture(scope="module")
def uneven(arm):
    """An arm whose joints differ in everything: stops, knees, and none of them."""
    joints = (replace(arm.joints[0], elasticity=UNEVEN), arm.joints[1])
    return replace(arm, name="uneven", joints=joints)


@pytest.fixture(scope="module")
def linear(arm):
    """An arm with plain springs: no plays to be remembered."""
    springs = [Elasticity(stiffness=500.0), Elasticity(stiffness=120.0)]
    joints = tuple(replace(j, elasticity=spring) for j, spring in zip(arm.joints, springs, strict=True))
    return replace(arm, name="linear", joints=joints)


@pytest.fixture(scope="module")
def build(c_compiler, tmp_path_factory):
    def load(robot, names=ALL):
        functions, folder = build_functions(robot, names=names), tmp_path_factory.mktemp(robot.name)
        folders = write_c(functions, folder / "c"), write_python(functions, folder / "python")
        make(folders[0], f"{c_compiler} -Werror", "shared", "check", flags=PLAIN)
        return functions, *map(load_library, folders)

    return load


def find_vectors(card):
    """Return beta, rotor inertias, friction and h of the robot file."""
    listed = (card.beta, card.rotors, card.friction, card.springs)
    return [np.array([parameter.value for parameter in cards]) for cards in listed]


def draw_motion(seed, time, size=2, reach=0.6):
    """Return a smooth motion of some harmonics and its first four derivatives, each (N, n)."""
    rng = np.random.default_rng(seed)
    frequencies = rng.uniform(1.0, 5.0, (4, size))
    phases, sizes = rng.uniform(0, 6, (4, size)), rng.uniform(0.1, reach, (4, size)) / frequencies
    shift = np.pi / 2 * np.arange(5)
    angles = frequencies * time[:, None, None] + phases
    return [np.sum(sizes * frequencies**k * np.sin(angles + shift[k]), axis=1) for k in range(5)]


def stack(function, springs, columns):
    """Return what a function gives for every spring and its column, side by side."""
    pairs = zip(springs, columns.T, strict=True)
    return np.hstack([np.atleast_2d(function(*pair).T).T for pair in pairs])


def delay(states):
    """Return the states before each sample, the first of them zero."""
    return np.vstack([np.zeros(states.shape[1]), states[:-1]])


def follow(elasticity, torques):
    """Return the plays of the inverse after every sample, from a virgin spring."""
    terms = prandtl_ishlinskii.read_spring_terms(elasticity)
    inverse, *sides = invert_spring(build_float_carrier(), terms)
    values = compute_outer_function(build_numpy_carrier(), torques, *sides)
    return prandtl_ishlinskii.compute_plays(values, np.array(inverse.thresholds))


@pytest.mark.parametrize("name", ["arm", "uneven"])
def test_steps_are_those_of_the_model_in_every_language(name, request, build):
    robot = request.getfixturevalue(name)
    functions, *libraries = build(robot)
    springs = [joint.elasticity for joint in robot.joints]
    h = build_spring_vector(springs)
    phi = draw_motion(3, np.linspace(0, 4, 200))[0] * [0.02, 0.03]
    torques = stack(prandtl_ishlinskii.compute_hysteresis_torque, springs, phi)
    radii = [np.array([stop.threshold for stop in spring.stops]) for spring in springs]
    plays = np.hstack(
        [
            prandtl_ishlinskii.compute_plays(column, radius)
            for column, radius in zip(phi.T, radii, strict=True)
        ]
    )
    images = stack(follow, springs, torques)
    step = {function.name(): function for function in functions.functions}["hysteresis_step"]
    for library in libraries:
        tau, next_plays = library.evaluate("hysteresis_step", phi, delay(plays), h)
        np.testing.assert_allclose(tau, torques, rtol=0, atol=1e-14 * np.abs(torques).max())
        np.testing.assert_allclose(next_plays, plays, rtol=0, atol=1e-17)
        back, next_images = library.evaluate("hysteresis_inverse_step", torques, delay(images), h)
        np.testing.assert_allclose(back, phi, rtol=0, atol=2e-15 * np.abs(phi).max())
        np.testing.assert_allclose(next_images, images, rtol=0, atol=1e-14 * np.abs(images).max())
    for k in (0, 50, 137):
        state = delay(plays)[k]
        tau, after = step(phi[k], state, h)
        np.testing.assert_allclose(tau.full().ravel(), torques[k], rtol=0, atol=1e-14 * np.abs(torques).max())
        np.testing.assert_allclose(after.full().ravel(), plays[k], rtol=0, atol=1e-17)


@pytest.mark.parametrize("name", ["arm", "uneven", "linear"])
def test_the_torque_of_the_motors_moves_motors_and_links(name, request, build):
    """Between kinks theta, its differences and the motor's equation agree; no formula of the code is used."""
    robot = request.getfixturevalue(name)
    _, *libraries = build(robot)
    springs = [joint.elasticity for joint in robot.joints]
    step = 2e-5
    time = np.arange(0, 1.5, step)
    motion = draw_motion(5, time)
    results = []
    for library in libraries:
        beta, rotors, friction, h = find_vectors(library.card)
        (torques,) = library.evaluate("inverse_dynamics", *motion[:3], beta)
        images = stack(follow, springs, torques)
        memory = (delay(images),) if images.shape[1] else ()
        found = library.evaluate("elastic_inverse_dynamics", *motion, beta, rotors, friction, h, *memory)
        results.append(found)
        tau, theta, dtheta = found[:3]
        phi = stack(prandtl_ishlinskii.invert_hysteresis, springs, torques)
        np.testing.assert_allclose(theta, motion[0] + phi, rtol=0, atol=1e-14)
        rate = (theta[2:] - theta[:-2]) / (2 * step)
        second = (theta[2:] - 2 * theta[1:-1] + theta[:-2]) / step**2
        (felt,) = library.evaluate("friction", dtheta, friction)
        expected = rotors * second + felt[1:-1] + torques[1:-1]
        good = np.abs(tau[1:-1] - expected) < 2e-4
        # A kink spoils the differences of two samples on each side, nothing else does.
        assert np.mean(good, axis=0).min() > 1 - 4 * 30 / len(time)
        np.testing.assert_allclose(dtheta[1:-1][good], rate[good], rtol=0, atol=2e-7)
        if not memory:
            assert good.all()
    for mine, theirs in zip(*results, strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-14 * np.abs(mine).max())


def test_a_linear_spring_against_the_arm_of_the_textbooks(linear, build):
    """Lagrange's equations of the planar arm, differentiated by SymPy along a given motion."""
    _, library, _ = build(linear)
    card = library.card
    beta, rotors, friction, h = find_vectors(card)
    values = {p.name.replace("R", ""): value for p, value in zip(card.beta, beta, strict=True)}
    t = sympy.Symbol("t")
    q1 = 0.7 * sympy.sin(2 * t) + 0.2 * sympy.cos(3 * t)
    q2 = 0.5 * sympy.cos(sympy.Rational(5, 2) * t) - 0.3 * sympy.sin(t)
    a, b = sympy.Function("a")(t), sympy.Function("b")(t)
    length, weight = 0.3, 9.81
    zz1, zz2, mx2, mx1 = (values[name] for name in ("ZZ1", "ZZ2", "MX2", "MX1"))
    da, db = a.diff(t), b.diff(t)
    kinetic = zz1 * da**2 / 2 + zz2 * (da + db) ** 2 / 2 + mx2 * length * sympy.cos(b) * da * (da + db)
    potential = -weight * (mx1 * sympy.cos(a) + mx2 * sympy.cos(a + b))
    lagrangian = kinetic - potential
    torques = [lagrangian.diff(x.diff(t)).diff(t) - lagrangian.diff(x) for x in (a, b)]
    times = np.linspace(0.1, 2.0, 7)
    motion = [
        np.column_stack([sympy.lambdify(t, q.diff(t, order))(times) for q in (q1, q2)]) for order in range(5)
    ]
    tau, theta, dtheta = library.evaluate("elastic_inverse_dynamics", *motion, beta, rotors, friction, h)
    for k, (q, torque) in enumerate(zip((q1, q2), torques, strict=True)):
        along = torque.subs({a: q1, b: q2}).doit()
        angle = q + along / h[k]
        speed = angle.diff(t)
        viscous, coulomb = friction[2 * k : 2 * k + 2]
        smooth = linear.joints[k].friction.smoothing
        felt = viscous * speed + coulomb * sympy.tanh(speed / smooth)
        motor = rotors[k] * angle.diff(t, 2) + felt + along
        for found, exact in ((theta, angle), (dtheta, speed), (tau, motor)):
            wanted = sympy.lambdify(t, exact)(times)
            np.testing.assert_allclose(found[:, k], wanted, rtol=0, atol=2e-12 * np.abs(wanted).max())


def test_the_catalogue_has_what_the_springs_allow(arm):
    steps = {"hysteresis_step", "hysteresis_inverse_step"}

    def names(robot):
        return {spec.name for spec in build_functions(robot).card.functions} & set(ALL[2:])

    def change(**values):
        first = replace(arm.joints[0], elasticity=replace(arm.joints[0].elasticity, **values))
        return replace(arm, joints=(first, arm.joints[1]))

    assert names(arm) == set(ALL[2:])
    assert names(change(damping=1.0)) == steps
    assert names(change(cubic=5.0, knees=())) == {"hysteresis_step"}
    bare = replace(arm.joints[0], drive=replace(arm.joints[0].drive, has_rotor=False, rotor_inertia=None))
    assert names(replace(arm, joints=(bare, arm.joints[1]))) == steps
    rigid = replace(arm, joints=(replace(arm.joints[0], elasticity=None), arm.joints[1]))
    assert names(rigid) == set()


def test_a_cubic_spring_steps_too(arm, build):
    spring = Elasticity(stiffness=300.0, cubic=2e5, stops=(Stop(threshold=0.003, stiffness=40.0),))
    joints = tuple(replace(joint, elasticity=spring) for joint in arm.joints)
    _, *libraries = build(replace(arm, name="cubic", joints=joints), ("hysteresis_step",))
    phi, h = np.array([0.01, -0.02]), build_spring_vector([spring, spring])
    torques = [prandtl_ishlinskii.compute_hysteresis_torque(spring, phi[k : k + 1])[0] for k in range(2)]
    assert [parameter.name for parameter in libraries[0].card.springs[:4]] == ["k0_1", "kc_1", "k1_1", "r1_1"]
    for library in libraries:
        tau, plays = library.evaluate("hysteresis_step", phi, np.zeros(2), h)
        np.testing.assert_allclose(tau, torques, rtol=1e-14)
        np.testing.assert_allclose(plays, [0.007, -0.017], rtol=1e-14)


def test_the_card_lists_the_parameters_of_the_springs(arm):
    card = build_functions(arm, names=("gravity",)).card
    first = [parameter for parameter in card.springs if parameter.joint == "shoulder"]
    names = ["k0_1", "k1_1", "r1_1", "k2_1", "r2_1", "k3_1", "r3_1", "s1_1", "R1_1", "s2_1", "R2_1"]
    units = ["N m/rad", *["N m/rad", "rad"] * 3, *["1", "N m"] * 2]
    assert [(parameter.name, parameter.unit) for parameter in first] == list(zip(names, units, strict=True))
    assert [parameter.value for parameter in first][-4:] == [0.5, -3.0, 0.5, 3.0]
    with raises(UsageError, "usage.unknown-spring"):
        build_spring_vector([Elasticity(stops=(Stop(threshold=0.1),))])
    springs = [joint.elasticity for joint in arm.joints]
    np.testing.assert_array_equal(build_spring_vector(springs, card), find_vectors(card)[3])
    turned = replace(springs[1], knees=tuple(Knee(threshold=x, slope=0.1) for x in (1.0, 2.0)))
    layouts = r"'elbow'.*\b0\b.*\b3\b.*\b1\b.*\b1\b.*\b0\b.*\b3\b.*\b0\b.*\b2\b"
    with raises(UsageError, "usage.spring-layout", match=layouts):
        build_spring_vector([springs[0], turned], card)


@pytest.mark.parametrize("precision", ["double", "float"])
@pytest.mark.parametrize("name", ["two_link_elastic", "two_link_harmonic", "puma560_elastic"])
def test_the_example_tracks_with_the_hysteresis_it_knows(c_compiler, tmp_path, name, precision):
    """Feed-forward alone knows where the links are: its error is that of the steps, far below the torsion."""
    functions = build_shipped(name)
    folder = write_c(functions, tmp_path / "c", precision=precision)
    make(folder, f"{c_compiler} -Werror", "check", "control_loop", flags=PLAIN)
    said = run(folder, "./control_loop").stdout
    error, torsion = map(float, re.findall(r"\d\.\d+e-\d+", said))
    assert error < 1e-4
    assert torsion > 30 * error
    numbers = np.concatenate(find_vectors(functions.card))
    (tmp_path / "values").write_text(" ".join(map(repr, numbers.tolist())), encoding="utf-8")
    assert run(folder, "./control_loop", str(tmp_path / "values")).stdout == said


ODD = """
name = "odd"
convention = "modified"
gravity = [0, 0, -9.81]
[[joint]]
name = "slide"
kind = "prismatic"
alpha = "pi/2"
drive = { rotor_inertia = 3, rotor_inertia_side = "joint" }
[joint.elasticity]
stiffness = 1e4
stops = [{ threshold = 1e-4, stiffness = 2e3 }]
symmetric = true
knees = [{ threshold = 4, slope = 0.5 }]
[[joint]]
name = "turn"
kind = "revolute"
a = 0.2
drive = { rotor_inertia = "unknown" }
spring = { stiffness = 3, rest = 0.1 }
elasticity = { stiffness = "unknown" }
[[joint]]
name = "finger"
kind = "revolute"
a = 0.1
mimic = { joint = "turn", multiplier = "1/2" }
drive = { rotor_inertia = 1e-3, rotor_inertia_side = "joint" }
"""


@pytest.mark.parametrize("standard", [False, True])
def test_slides_followers_and_unknown_values_have_springs_too(c_compiler, tmp_path, standard):
    robot = parse_robot(ODD)
    functions = build_functions(robot, standard=standard)
    assert [parameter.name for parameter in functions.card.rotors] == ["IA1", "IA2"]
    assert [parameter.unit for parameter in functions.card.springs[:4]] == ["N/m", "N/m", "m", "1"]
    said = make(write_c(functions, tmp_path), f"{c_compiler} -Werror", "all", "check", flags=PLAIN).stdout
    assert "0 of " in said
    assert "elastic_inverse_dynamics" in said
    # Not every value is known: the example asks for them.
    assert run(tmp_path, "./control_loop", check=False).returncode == 2
    braked = ODD + 'friction = { model = "coulomb-viscous" }\n'
    names = [spec.name for spec in build_functions(parse_robot(braked)).card.functions]
    assert "hysteresis_inverse_step" in names
    assert "elastic_inverse_dynamics" not in names
