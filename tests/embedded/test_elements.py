"""What the float code of elements with hysteresis costs on a Cortex-M4F: no double, instructions a step."""

import re
from statistics import median

import numpy as np
import pytest

from symid.codegen import ElementCode, generate_element
from symid.joint_models import describe_inverse, needs_time
from tests.elements import ELEMENTS
from tests.embedded.test_cortex_m4f import FLOAT_MATH, count_calls
from tests.embedded.tools import (
    CORTEX_M4F,
    build_image,
    compile_object,
    find_tool,
    read_sizes,
    read_undefined,
    run_command,
    run_image,
    trace_image,
)

pytestmark = pytest.mark.embedded

STEPS = 50
MAIN = """#include "{prefix}.h"

static const float inputs[{count}] = {{{rows}}};

int main(void)
{{
    {prefix}_state state;
    float result = 0.0f;
    int wrong = {prefix}_reset(&state, 0.0f, 0);
    for (int k = 0; k < {count}; k++) {{
        wrong += {prefix}_{kind}(&state, inputs[k], {period}&result);
    }}
    return wrong;
}}
"""


@pytest.fixture(params=ELEMENTS)
def written(request, tmp_path):
    order = ElementCode(name=request.param, precision="float", reach=0.8)
    made = generate_element(ELEMENTS[request.param], order, tmp_path / "code", progress=lambda _: None)
    return request.param, made.folder, made.manifest["prefix"]


def test_no_element_holds_a_double_and_its_test_passes_on_the_board(written, tmp_path):
    _, folder, prefix = written
    source = folder / f"{prefix}.c"
    target = compile_object(CORTEX_M4F, source, tmp_path / "x.o")
    assert read_undefined(target) <= FLOAT_MATH
    assert not re.search(r"\.f64\b", run_command(find_tool("arm-none-eabi-objdump"), "-d", target))
    image = build_image(CORTEX_M4F, [source, folder / "selftest.c"], folder, tmp_path / "image.elf")
    assert re.search(r"^0 of \d functions failed", run_image(CORTEX_M4F, image, tmp_path), re.MULTILINE)


@pytest.mark.parametrize("kind", ["step", "inverse"])
def test_instructions_of_a_call(written, tmp_path, figure, kind):
    name, folder, prefix = written
    if kind == "inverse" and describe_inverse(ELEMENTS[name]):
        pytest.skip("it has no inverse")
    x = 0.6 * np.sin(np.cumsum(np.random.default_rng(2).normal(size=STEPS)))
    rows = ", ".join(f"{value:.6f}f" for value in x)
    period = "1e-3f, " if needs_time(ELEMENTS[name]) else ""
    (tmp_path / "main.c").write_text(
        MAIN.format(prefix=prefix, kind=kind, count=STEPS, rows=rows, period=period)
    )
    sources = [folder / f"{prefix}.c", tmp_path / "main.c"]
    image = build_image(CORTEX_M4F, sources, folder, tmp_path / "image.elf")
    run_image(CORTEX_M4F, image, tmp_path)
    trace = trace_image(CORTEX_M4F, image, tmp_path)
    calls = count_calls(trace, read_sizes(image), f"{prefix}_{kind}")
    assert len(calls) == STEPS
    totals = [sum(counts.values()) for counts in calls]
    figure(f"Cortex-M4F, element {name}, {kind}: {median(totals):.0f} instructions (most {max(totals)})")
    if kind == "step":
        assert max(totals) < 4000
