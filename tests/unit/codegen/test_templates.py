"""A template and its context hold the same names; literals read back as what was written."""

from dataclasses import dataclass, fields

import numpy as np
import pytest
from jinja2 import Environment, meta

from symid.codegen import (
    c_friction as friction_c,
    c_friction as friction_state,
    c_library as lanes,
    c_library as python_call_source,
    c_programs as c_contexts,
    c_programs as c_parameters,
    python_targets as casadi_target,
    python_targets as python_module,
)
from symid.codegen.printing import write_literal
from symid.codegen.source_text import GenerateOptions, read_template_bytes, write_template
from symid.errors import GenerationError, UsageError

CONTEXTS = {
    "c/header.h.jinja": c_contexts.HeaderContext,
    "c/function.c.jinja": c_contexts.FunctionContext,
    "c/lanes.h.jinja": lanes.SimdContext,
    "c/python_call.c.jinja": python_call_source.CallContext,
    "c/parameters.c.jinja": c_parameters.ParametersContext,
    "c/info.c.jinja": c_contexts.InfoContext,
    "c/friction.h.jinja": friction_c.FrictionHeaderContext,
    "c/friction.c.jinja": friction_c.FrictionContext,
    "c/friction_state.h.jinja": friction_state.FrictionStateHeaderContext,
    "c/friction_state.c.jinja": friction_state.FrictionStateContext,
    "c/hysteresis.h.jinja": c_contexts.StateHeaderContext,
    "c/hysteresis.c.jinja": c_contexts.StateContext,
    "c/hysteresis_test.c.jinja": c_contexts.StateTestContext,
    "c/selftest.c.jinja": c_contexts.SelfTestContext,
    "c/control_loop.c.jinja": c_contexts.ControlLoopContext,
    "c/elastic_loop.c.jinja": c_contexts.ElasticLoopContext,
    "c/Makefile.jinja": c_contexts.MakefileContext,
    "c/CMakeLists.txt.jinja": c_contexts.CMakeContext,
    "c/package.pc.in.jinja": c_contexts.PackageContext,
    "c/README.md.jinja": c_contexts.ReadmeContext,
    "python/module.py.jinja": python_module.ModuleContext,
    "python/README.md.jinja": python_module.ModuleReadmeContext,
    "casadi/loader.py.jinja": casadi_target.LoaderContext,
    "casadi/info.c.jinja": casadi_target.CasadiInfoContext,
    "casadi/Makefile.jinja": casadi_target.CasadiMakefileContext,
    "casadi/README.md.jinja": casadi_target.CasadiReadmeContext,
}


def test_every_template_has_a_context_with_its_variables():
    templates = dict(read_template_bytes("c", "python", "casadi"))
    assert sorted(templates) == sorted(CONTEXTS)
    for name, content in templates.items():
        used = meta.find_undeclared_variables(Environment(autoescape=True).parse(content.decode()))
        assert used == {field.name for field in fields(CONTEXTS[name])}, name


def test_a_context_with_other_names_is_refused():
    @dataclass(frozen=True)
    class Wrong:
        banner: str = ""
        colour: str = ""

    with pytest.raises(
        GenerationError, match=r"lacks \['digest', 'prefix', 'signature', 'version'\] and has \['colour'\]"
    ) as caught:
        write_template("c/info.c.jinja", Wrong())
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
    with pytest.raises(UsageError, match="double, float") as caught:
        GenerateOptions(precision="half")
    assert caught.value.notices[0].code == "usage.precision"
    with pytest.raises(UsageError, match="own, library") as caught:
        GenerateOptions(trigonometry="tables")
    assert caught.value.notices[0].code == "usage.trigonometry"
    with pytest.raises(UsageError, match="at least one") as caught:
        GenerateOptions(states=0)
    assert caught.value.notices[0].code == "usage.states"
