"""A template is given all that it names, and nothing else; literals read back as what was written."""

from dataclasses import replace

import numpy as np
import pytest

from symid.codegen import source_text
from symid.codegen.c_library import generate_c_library, generate_friction_state, write_python_call
from symid.codegen.casadi_functions import build_functions
from symid.codegen.compiled_models import write_branch, write_external, write_springs
from symid.codegen.element_code import ElementCode, build_sources
from symid.codegen.printing import write_literal
from symid.codegen.python_targets import generate_casadi_target, generate_python_module
from symid.codegen.source_text import read_template_bytes, write_template
from symid.errors import GenerationError, UsageError
from symid.joint_models import Elasticity, FrictionValues, Relaxation, get_law
from symid.options import GenerateOptions
from symid.robot import load_robot
from tests.refusals import raises


def test_every_template_is_written_by_a_target(monkeypatch):
    """Each is given what it names: else writing it fails."""
    written, check = set(), source_text._list_variables

    def look(name):
        written.add(name)
        return check(name)

    monkeypatch.setattr(source_text, "_list_variables", look)
    options = GenerateOptions(states=3, friction_laws=True)
    for name in ("two_link", "two_link_elastic"):
        functions = build_functions(load_robot(name))
        generate_c_library(functions, options)
    generate_python_module(functions, GenerateOptions(states=3))
    robot = load_robot("two_link")
    friction = FrictionValues(law="dahl", values=(0.4, 0.9), bristles=(1e4,))
    joints = tuple(replace(joint, friction=friction) for joint in robot.joints)
    remembering = build_functions(replace(robot, joints=joints), names=("friction_step",))
    generate_c_library(remembering, options)
    generate_python_module(remembering, GenerateOptions(states=3))
    generate_casadi_target(functions, GenerateOptions(states=3))
    generate_friction_state(get_law("lugre"))
    write_external(build_functions(robot), "inverse_dynamics")
    write_python_call(functions.card, "symid_x")
    for target in ("c", "python", "casadi"):
        build_sources(Elasticity(stiffness=1.0), ElementCode(target=target))
    write_springs((Elasticity(stiffness=1.0, offset=0.5),))
    write_branch(Relaxation(stiffness=1.0, time=1.0))
    folders = ("c", "python", "casadi", "element")
    assert sorted(written) == sorted(dict(read_template_bytes(*folders)))


def test_a_context_with_other_names_is_refused():
    with pytest.raises(
        GenerationError, match=r"lacks \['digest', 'signature', 'version'\] and has \['colour'\]"
    ) as caught:
        write_template("c/info.c.jinja", {"banner": "", "prefix": "", "robot": ""}, colour="")
    assert caught.value.notices[0].code == "codegen.template-context"


def test_literals_read_back_exactly():
    rng = np.random.default_rng(5)
    for value in (0.1, 1e300, 5e-324, 3.0, 1.0 / 3.0, 123456789.123, 1e-5, *rng.standard_normal(200)):
        assert float(write_literal(value)) == value
        if abs(value) < 1e38:
            text = write_literal(value, "float")
            assert text.endswith("f")
            assert set("e.") & set(text)
            assert np.float32(text[:-1]) == np.float32(value)


def test_options_are_checked():
    with raises(UsageError, "usage.precision", match="'double', 'float'"):
        GenerateOptions(precision="half")
    with raises(UsageError, "usage.trigonometry", match="'own', 'library'"):
        GenerateOptions(trigonometry="tables")
    with raises(UsageError, "usage.states", match=r"\b0\b"):
        GenerateOptions(states=0)
