"""The catalogue in SymPy against generated programs, Pinocchio, Lagrange's equations and exact identities."""

import functools
import math
import os
import sys
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import sympy
from sympy.physics.mechanics import dynamicsymbols

from symid.codegen.functions import list_robot_specs
from symid.codegen.routes import choose_route
from symid.codegen.symbolic import derive_symbolic
from symid.dynamics.base_parameters import build_standard_parameters, derive_base_parameters
from symid.errors import UsageError
from symid.joint_models import FrictionValues
from symid.robot import load_robot
from symid.robot.description import Coupling, Drive, Spring
from tests import chains
from tests.builds import run
from tests.refusals import raises
from tests.sx_programs import run_program

PI = np.pi
ROWS = [(0.0, 0, 0, "q"), (PI / 6, 0.2, 0.1, "q"), (PI / 3, 0.1, "q", 0.3), (PI / 2, 0, "L1", "q")]
MAIN = ("mass_matrix", "coriolis_matrix", "gravity", "inverse_dynamics")
MAIN += ("torque_regressor", "energy", "jacobian")
# The solved system of seven joints has billions of operations: only its shared form is evaluated.
WRITTEN_OUT = 300_000


def build_coupled():
    """Return twisted axes: one follows another, a coupled drive, rotors, a spring, friction, a length."""
    robot = chains.build_chain(ROWS, rotors=True, friction="coulomb-viscous-offset", name="coupled")
    robot = chains.follow(robot, 3, 1, "-63/100", friction=FrictionValues(law="none"), drive=Drive())
    joints = list(robot.joints)
    joints[1] = replace(joints[1], spring=Spring())
    joints[0] = replace(joints[0], friction=replace(joints[0].friction, smoothing=0.03))
    drive = Coupling(name="m", terms=((0, Fraction(1)), (1, Fraction(-1, 2))), has_rotor=True)
    return replace(robot, joints=tuple(joints), couplings=(drive,), symbols=(("L1", 0.35),))


@pytest.fixture(scope="module")
def robots():
    names = ("two_link", "rrp_twisted", "two_link_elastic", "two_link_symbols", "tx40", "panda")
    return {name: load_robot(name) for name in names} | {"coupled": build_coupled()}


@pytest.fixture(scope="module")
def derive(robots):
    """Every function of a robot, derived once: {name: (spec, function)}."""

    @functools.cache
    def find(name):
        robot = robots[name]
        base = derive_base_parameters(robot)
        wanted = dict(CASES)[name]
        specs = [spec for spec in list_robot_specs(robot, base) if wanted is None or spec.name in wanted]
        return base, {spec.name: (spec, derive_symbolic(robot, spec.name, base=base)) for spec in specs}

    return find


def draw(function, seed):
    """Return random inputs by name, and as arrays in order."""
    rng = np.random.default_rng(seed)
    inputs = {name: rng.uniform(-2, 2, column.shape[0]) for name, column in function.inputs.items()}
    # Denominators of springs and mass matrices stay away from zero.
    for name in inputs.keys() & {"h", "beta", "IA"}:
        inputs[name] = rng.uniform(1, 2, inputs[name].size)
    return inputs


def evaluate(expression, known):
    """Return the value of an expression; `known` has those of symbols, and keeps those of shared parts."""
    if expression not in known:
        values = [evaluate(part, known) for part in expression.args]
        match expression:
            case sympy.Add():
                found = sum(values)
            case sympy.Mul():
                found = math.prod(values)
            case sympy.Pow():
                found = values[0] ** values[1]
            case sympy.sin() | sympy.cos():
                found = getattr(math, expression.func.__name__)(values[0])
            case _:
                made = expression.func(*values) if values else expression
                # The parts of a case distinction are no numbers.
                found = float(made) if isinstance(made, sympy.Expr) else made
        known[expression] = found
    return known[expression]


def list_entries(value):
    parts = value if isinstance(value, tuple) else (value,)
    return [entry for part in parts for entry in np.ravel(part).tolist()]


def evaluate_outputs(function, *arrays):
    """Return the outputs as they are written, at inputs in order and then the lengths."""
    symbols = [symbol for column in function.inputs.values() for symbol in column]
    symbols += function.lengths
    known = dict(zip(symbols, np.concatenate(arrays).tolist(), strict=True))
    return [[evaluate(entry, known) for entry in list_entries(v)] for v in function.outputs.values()]


CASES = [
    *(
        (name, None)
        for name in ("two_link", "rrp_twisted", "two_link_elastic", "two_link_symbols", "coupled")
    ),
    ("tx40", ("mass_matrix", "inverse_dynamics", "friction", "friction_regressor", "momentum_regressor")),
    ("panda", (*MAIN, "forward_dynamics")),
]


@pytest.mark.parametrize("name", [name for name, _ in CASES])
def test_expressions_equal_generated_programs(robots, derive, name):
    base, functions = derive(name)
    for spec, function in functions.values():
        assert [port.name for port in spec.outputs] == list(function.outputs)
        program = choose_route(robots[name], base, spec).program
        lengths = ([float(value) for value in function.lengths.values()],) if function.lengths else ()
        numeric = [function.lambdify(), functools.partial(evaluate_outputs, function)]
        for seed in (1, 2):
            inputs = draw(function, seed)
            expected = run_program(program, inputs)
            # A random mass matrix need not be positive: what is divided by may be small.
            tolerance = 1e-10 if spec.name == "forward_dynamics" else 1e-12
            for call in numeric:
                found = call(*inputs.values(), *lengths)
                for value, output in zip(found, expected, strict=True):
                    chains.assert_close(
                        np.asarray(value, dtype=float).reshape(output.shape), output, tolerance
                    )


def vanish(expression, coordinates):
    """Return the remainder of an expression by s^2 + c^2 = 1; zero if and only if it vanishes everywhere."""
    value = sympy.expand(sympy.expand_trig(sympy.expand(expression)))
    for q in coordinates:
        s, c = sympy.Symbol(f"s_{q}"), sympy.Symbol(f"c_{q}")
        value = sympy.rem(sympy.expand(value.subs({sympy.sin(q): s, sympy.cos(q): c})), s**2 + c**2 - 1, s)
    return sympy.expand(value)


@pytest.mark.parametrize("name", ["two_link", "two_link_symbols"])
def test_dynamics_follow_from_the_energy(robots, name):
    """Lagrange's equations by `sympy.diff`, dM/dt - 2C skew, regressor times beta, M ddq + c = tau."""
    get = {
        n: derive_symbolic(robots[name], n) for n in (*MAIN, "bias", "forward_dynamics", "lagrange_regressor")
    }
    torque = get["inverse_dynamics"]
    q, dq, ddq, beta = torque.inputs.values()
    kinetic, potential = get["energy"].outputs.values()
    mass, coriolis = get["mass_matrix"].expr, get["coriolis_matrix"].expr

    def rate(value):
        return sum(
            (value.diff(a) * b for a, b in [*zip(q, dq, strict=True), *zip(dq, ddq, strict=True)]), sympy.S(0)
        )

    lagrangian = kinetic - potential
    for k in range(2):
        equation = rate(lagrangian.diff(dq[k])) - lagrangian.diff(q[k])
        assert vanish(equation - torque.expr[k], q) == 0
        row = get["lagrange_regressor"].expr[k, :] * beta
        assert vanish(row[0] - lagrangian.diff(q[k]), q) == 0
    assert (dq.T * mass * dq)[0].expand() - (2 * kinetic).expand() == 0
    skew = mass.applyfunc(rate) - 2 * coriolis
    assert all(vanish(entry, q) == 0 for entry in skew + skew.T)
    rest = (coriolis * dq + get["gravity"].expr) - get["bias"].expr
    assert all(vanish(entry, q) == 0 for entry in rest)
    product = get["torque_regressor"].expr * beta - torque.expr
    assert all(vanish(entry, q) == 0 for entry in product)
    tau = get["forward_dynamics"].inputs["tau"]
    solved = mass * get["forward_dynamics"].expr + get["bias"].expr - tau
    assert all(vanish(sympy.fraction(sympy.together(entry))[0], q) == 0 for entry in solved)


def test_panda_equals_pinocchio(robots):
    rng, robot = np.random.default_rng(1), robots["panda"]
    links, (q, dq, ddq) = chains.draw_parameters(rng, robot.size), rng.uniform(-3, 3, (3, robot.size))
    torque = chains.find_pinocchio_torques(chains.set_inertia(robot, links), (q, dq, ddq))
    values = chains.name_parameters(links)
    pi = np.array([values[parameter.label] for parameter in build_standard_parameters(robot).parameters])
    beta = chains.compute_beta(derive_base_parameters(robot), links)
    for chosen, vector in ((False, beta), (True, pi)):
        (found,) = derive_symbolic(robot, "inverse_dynamics", standard=chosen).lambdify()(q, dq, ddq, vector)
        chains.assert_close(np.ravel(found), torque)


def test_twisted_axes_keep_their_roots(robots):
    """dM/dt - 2C of a spatial arm is skew exactly; the twist of pi/6 shows as sqrt(3)."""
    mass, coriolis = (derive_symbolic(robots["rrp_twisted"], n) for n in ("mass_matrix", "coriolis_matrix"))
    q, dq = coriolis.inputs["q"], coriolis.inputs["dq"]
    assert mass.expr.has(sympy.sqrt(3))
    rate = mass.expr.applyfunc(lambda e: sum(e.diff(a) * b for a, b in zip(q, dq, strict=True)))
    skew = rate - 2 * coriolis.expr
    assert all(vanish(entry, q[:2]) == 0 for entry in skew + skew.T)


def test_a_small_arm_reads_as_in_a_textbook(robots):
    function = derive_symbolic(robots["two_link"], "mass_matrix")
    zz1, zz2, mx, my, q2 = sympy.symbols("ZZR1 ZZ2 MX2 MY2 q2")
    first = zz1 + zz2 + mx * sympy.cos(q2) - my * sympy.sin(q2)
    assert function.expr[0, 0] == first
    assert function.expr[1, 1] == zz2
    assert repr(function) == "mass_matrix(q, beta) -> M"
    assert function.latex().startswith(r"M = \begin{bmatrix}MX_{2} \cos{\left(q_{2} \right)} - MY_{2} \sin")
    gravity = derive_symbolic(robots["two_link_symbols"], "gravity").expr
    g, q1 = sympy.symbols("g q1")
    assert gravity[1] == g * (mx * sympy.cos(q1 + q2) - my * sympy.sin(q1 + q2))
    friction = derive_symbolic(robots["two_link"], "friction")
    assert friction.latex().startswith(
        r"\tau_f = \begin{bmatrix}F_{c,1} \operatorname{sign}{\left(\dot q_{1} \right)} + F_{v,1} \dot q_{1}"
    )
    assert friction._repr_latex_().startswith(r"$$\begin{aligned} \tau_f &= \begin{bmatrix}")


def test_a_smoothed_sign_keeps_its_speed_exactly(derive):
    _, friction = derive("coupled")[1]["friction"]
    assert friction.expr[0].has(sympy.tanh(sympy.Symbol("dq1") * sympy.Rational(100, 3)))


def test_no_float_anywhere(derive):
    for name in ("two_link", "rrp_twisted", "two_link_elastic", "coupled"):
        for _, function in derive(name)[1].values():
            parts = [value for _, value in function.share()[0]]
            if function.operations < WRITTEN_OUT:
                parts += [entry for value in function.outputs.values() for entry in list_entries(value)]
            assert not any(part.has(sympy.Float) for part in parts), function.name


def test_own_symbols_may_be_functions_of_time():
    q, t = dynamicsymbols("q1 q2"), dynamicsymbols._t
    speeds = [angle.diff(t) for angle in q]
    energy = derive_symbolic(chains.TWO_LINK, "energy", symbols={"q": q, "dq": speeds})
    symbols = {"q": q, "dq": speeds, "ddq": [speed.diff(t) for speed in speeds]}
    torque = derive_symbolic(chains.TWO_LINK, "inverse_dynamics", symbols=symbols)
    lagrangian = energy["T"] - energy["V"]
    for angle, speed, tau in zip(q, speeds, torque.expr, strict=True):
        equation = lagrangian.diff(speed).diff(t) - lagrangian.diff(angle)
        assert sympy.expand(sympy.expand_trig(equation - tau)) == 0


def test_what_does_not_fit_is_named(robots):
    robot = robots["two_link"]
    with raises(UsageError, "usage.unknown-function"):
        derive_symbolic(robot, "mass")
    for symbols, code in (({"dq": [1, 2]}, "usage.unknown-input"), ({"q": [1]}, "usage.wrong-symbols")):
        with raises(UsageError, code):
            derive_symbolic(robot, "gravity", symbols=symbols)
    with pytest.raises(UsageError, match="T, V"):
        _ = derive_symbolic(robot, "energy").expr
    long = derive_symbolic(robots["panda"], "mass_matrix")
    with pytest.raises(UsageError, match="share"):
        long.latex()
    assert long._repr_latex_() is None


SCRIPT = """
from sympy import srepr
from symid.codegen.symbolic import derive_symbolic
from symid.robot import load_robot
for name in ("inverse_dynamics", "forward_dynamics", "hysteresis_inverse_step"):
    function = derive_symbolic(load_robot("two_link_elastic"), name)
    steps, outputs = function.share()
    print(srepr((tuple(function.outputs.values()), steps, tuple(outputs.values()))))
"""


def test_equal_expressions_under_any_hash_seed(project):
    command, seeds = (sys.executable, "-c", SCRIPT), ("0", "42")
    runs = [run(project, *command, env={**os.environ, "PYTHONHASHSEED": seed}) for seed in seeds]
    assert runs[0].stdout == runs[1].stdout != ""


def test_the_panda_of_a_table_of_numbers_has_the_same_form(robots):
    """The shipped file and the DH rows give the same expressions: its wording takes no part."""
    for name in ("mass_matrix", "gravity"):
        assert derive_symbolic(chains.PANDA, name).expr == derive_symbolic(robots["panda"], name).expr
