"""Generated functions of friction against the closed forms of the laws; what of it is part of the model."""

from dataclasses import replace

import numpy as np
import pytest

from symid.codegen.casadi_functions import build_functions
from symid.dynamics import compute_friction_columns
from symid.dynamics.base_parameters import build_standard_parameters, derive_base_parameters
from symid.errors import UsageError
from symid.joint_models import FrictionValues, get_law, list_value_names
from symid.joint_models.carriers import build_float_carrier
from tests.chains import build_chain
from tests.friction_forms import EVERY_LAW, find_linear_torque, give_shape
from tests.refusals import raises

VELOCITIES = (-2.0, -0.21, -0.1, 0.0, 0.15, 0.3, 1.5)
OTHERS = {"position": 0.7, "load": -8.0, "temperature": 31.0}
PORTS = {"position": "q", "load": "load", "temperature": "temperature"}
ROW = (0.0, 0, 0, "q")


def give_friction(robot, *frictions):
    joints = tuple(
        replace(joint, friction=friction) for joint, friction in zip(robot.joints, frictions, strict=True)
    )
    return replace(robot, joints=joints)


@pytest.mark.parametrize("standard", [False, True])
@pytest.mark.parametrize("name", EVERY_LAW)
def test_functions_of_friction_equal_the_closed_form(name, standard):
    given = FrictionValues(law=name, shape=give_shape(name, 7.0))
    robot = give_friction(build_chain([ROW]), given)
    built = build_functions(robot, names=("friction", "friction_regressor"), standard=standard)
    friction, regressor = built.functions
    law = get_law(name)
    others = {key: OTHERS[key] for key in law.inputs[1:]}
    values = np.arange(1.0, 1 + len(law.linear))
    own = dict(zip(list_value_names(given), values, strict=True))
    base = build_standard_parameters(robot) if standard else derive_base_parameters(robot)
    grouped = [sum(float(share) * own[entry] for (_, entry), share in p.terms) for p in base.friction]
    for velocity in VELOCITIES:
        if velocity == 0.0 and len(grouped) < len(values):
            # Parameters are grouped by what they do in motion.
            continue
        expected = find_linear_torque(name, values, given.shape, velocity, **others)
        inputs = (velocity, *others.values())
        assert float(friction(*inputs, grouped)) == pytest.approx(expected, rel=1e-13, abs=1e-14)
        assert float(regressor(*inputs) @ grouped) == pytest.approx(expected, rel=1e-13, abs=1e-14)
        columns = compute_friction_columns(given, build_float_carrier(), {"velocity": velocity, **others})
        assert float(np.dot(columns, values)) == pytest.approx(expected, rel=1e-13, abs=1e-14)
    ports = ["dq", *(PORTS[key] for key in law.inputs[1:])]
    assert [friction.name_in(k) for k in range(friction.n_in())] == [*ports, "f"]
    assert [regressor.name_in(k) for k in range(regressor.n_in())] == ports
    assert built.card.friction_inputs == tuple(ports[1:])
    # An offset beside a constant torque of the law is the same.
    double = ("asymmetric+offset", "improved-stribeck+offset", "asymmetric-stribeck-1+offset")
    if standard or name not in double:
        # The number of a wave or a power is kept apart from that of the joint.
        names = [f"{entry}_1" if entry[-1].isdigit() else f"{entry}1" for entry in own]
        assert [parameter.name for parameter in built.card.friction] == names


def test_functions_have_the_inputs_that_any_joint_reads_in_one_order():
    laws = ("temperature", "coulomb-viscous", "position-torque", "none", "load-dependent")
    robot = give_friction(build_chain([(0.3, 0.1, 0.2, "q")] * 5), *(FrictionValues(law=law) for law in laws))
    built = build_functions(robot, names=("friction", "friction_regressor"))
    friction, regressor = built.functions
    ports = ["dq", "q", "load", "temperature"]
    assert [friction.name_in(k) for k in range(friction.n_in())] == [*ports, "f"]
    assert [regressor.name_in(k) for k in range(regressor.n_in())] == ports
    card = built.card
    assert card.friction_inputs == ("q", "load", "temperature")
    rng = np.random.default_rng(8)
    dq, q, load, temperature = (rng.uniform(-2, 2, 5) for _ in ports)
    values = np.arange(1.0, 1 + len(card.friction))
    inputs = card.gather_friction_inputs(dq, temperature=temperature, load=load, q=q)
    found, rest = np.array(friction(*inputs, values)).ravel(), list(values)
    for k, law in enumerate(laws):
        own = [rest.pop(0) for _ in list_value_names(FrictionValues(law=law))]
        all_given = {"position": q[k], "load": load[k], "temperature": temperature[k]}
        used = {} if law == "none" else {key: all_given[key] for key in get_law(law).inputs[1:]}
        expected = 0.0 if law == "none" else find_linear_torque(law, own, (), dq[k], **used)
        assert found[k] == pytest.approx(expected, rel=1e-13)
    with raises(UsageError, "friction.input", match=r"depends on the load and the temperature of the"):
        card.gather_friction_inputs(dq, q=q)
    velocity_only = build_functions(give_friction(robot, *[FrictionValues(law="cubic")] * 5)).card
    assert velocity_only.friction_inputs == ()
    assert velocity_only.gather_friction_inputs(dq, q=q) == (dq,)


@pytest.mark.parametrize("name", EVERY_LAW)
@pytest.mark.parametrize("prismatic", [False, True])
def test_every_law_has_parameters_with_units(name, prismatic):
    robot = build_chain([(0.0, 0, "q", 0.0) if prismatic else ROW])
    robot = give_friction(robot, FrictionValues(law=name, shape=give_shape(name)))
    cards = build_functions(robot, names=("friction",), standard=True).card.friction
    law = get_law(name)
    units = [entry.unit_prismatic if prismatic else entry.unit for entry in law.linear]
    assert [card.unit for card in cards] == units
    # A factor of the load has none.
    assert all(entry.unit != entry.unit_prismatic for entry in law.linear if entry.unit != "1")


def test_shape_values_are_part_of_the_model():
    signatures = set()
    for law, shape in (
        ("stribeck", (0.3,)),
        ("stribeck", (0.2,)),
        ("stribeck-exponent", (0.3, 1.5)),
        ("stribeck-exponent", (0.3, 1.6)),
        ("stribeck-1.5", (0.3,)),
        ("tustin", (0.3,)),
        ("lorentzian", (0.3,)),
    ):
        changed = give_friction(build_chain([ROW]), FrictionValues(law=law, shape=shape))
        signatures.add(build_functions(changed, names=("friction",)).card.signature)
    assert len(signatures) == 7
