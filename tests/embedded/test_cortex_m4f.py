"""What the float code costs on a Cortex-M4F: no double, size, stack, instructions a call."""

import re
from statistics import median

import pytest

from tests.embedded.programs import draw_inputs, write_meter
from tests.embedded.sources import with_folders
from tests.embedded.tools import (
    CORTEX_M4F,
    build_image,
    compile_object,
    find_tool,
    keep_object,
    read_sizes,
    read_undefined,
    run_command,
    run_image,
    trace_image,
)

pytestmark = pytest.mark.embedded

LARGEST, DEEPEST, LONGEST = 7000, 512, 1600
STATES = 50
METERED = ("inverse_dynamics", "gravity", "bias", "mass_matrix", "forward_dynamics")
# Functions of float numbers that a C library has; anything else is a double or a helper of the compiler.
FLOAT_MATH = {"sinf", "cosf", "tanf", "sqrtf", "expf", "tanhf", "powf", "fabsf", "memset", "memcpy"}
each_source = with_folders(("panda",), ("float",))


@with_folders(("panda", "two_link_elastic", "two_arms"), ("float",))
def test_no_object_holds_a_double(folder):
    for source in folder.library:
        target = keep_object(CORTEX_M4F, source)
        own = {name for name in read_undefined(target) if name.startswith(folder.prefix)}
        assert read_undefined(target) - own <= FLOAT_MATH, source.name
        text = run_command(find_tool("arm-none-eabi-objdump"), "-d", target)
        # The unit of a Cortex-M4F has no arithmetic on double registers: only these names move 64 bits.
        assert not re.search(r"\.f64\b", text), source.name


def test_a_double_is_found_where_there_is_one(tmp_path):
    (tmp_path / "wrong.c").write_text(
        "float f(double x);\nfloat f(double x)\n{\n    return (float)(x * x);\n}\n"
    )
    target = compile_object(CORTEX_M4F, tmp_path / "wrong.c", tmp_path / "wrong.o")
    assert read_undefined(target) == {"__aeabi_dmul", "__aeabi_d2f"}


@each_source
def test_no_soft_float_is_linked(folder, tmp_path):
    """Neither by the generated code nor by the functions of the C library that it calls."""
    spec = next(entry for entry in folder.functions.card.functions if entry.name == "inverse_dynamics")
    main = write_meter(folder.prefix, spec, draw_inputs(folder.functions.card, spec, 1))
    main = re.sub(r"#include <stdio.h>", "", main)
    (tmp_path / "main.c").write_text(re.sub(r'printf\("%u\\n", depth\[k\]\);', "out[0] += depth[k];", main))
    source = folder.path / f"{folder.prefix}_inverse_dynamics.c"
    image = build_image(
        CORTEX_M4F, [source, tmp_path / "main.c"], folder.path, tmp_path / "image.elf", "-Wl,--gc-sections"
    )
    soft = [name for name in read_sizes(image) if re.match(r"__aeabi_[dfl]|__aeabi_u?i2[df]", name)]
    assert soft == []


@each_source
def test_inverse_dynamics_is_small(folder, tmp_path, figure):
    source = folder.path / f"{folder.prefix}_inverse_dynamics.c"
    target = compile_object(CORTEX_M4F, source, tmp_path / "x.o", "-fstack-usage")
    lines = run_command(find_tool("arm-none-eabi-size"), target).splitlines()
    whole = int(lines[1].split()[0])
    batch = read_sizes(target)[f"{folder.prefix}_inverse_dynamics_batch"][1]
    rows = (line.split("\t") for line in (tmp_path / "x.su").read_text().splitlines())
    frames = {where.split(":")[-1]: (int(bytes_), kind) for where, bytes_, kind in rows}
    assert {kind for _, kind in frames.values()} == {"static"}
    deepest = sum(size for name, (size, _) in frames.items() if not name.endswith("_batch"))
    figure(
        f"Cortex-M4F, {folder.label}, inverse dynamics: {whole - batch} byte of code and constants"
        f" ({whole} with the batch function), {deepest} byte of stack by -fstack-usage"
    )
    assert whole - batch <= LARGEST
    assert deepest < DEEPEST


def count_calls(trace, symbols, entry):
    """Return, call by call, the instructions from the entry of a function to its return, by function."""
    owner = {}
    for name, (address, size) in symbols.items():
        owner.update(dict.fromkeys(range(address & ~1, (address & ~1) + size, 2), name))
    start = symbols[entry][0] & ~1
    calls, position = [], 0
    while start in trace[position:]:
        first = trace.index(start, position)
        back = trace[first - 1] + 4
        last = trace.index(back, first)
        counts = {}
        for address in trace[first:last]:
            name = owner.get(address, "?")
            counts[name] = counts.get(name, 0) + 1
        calls.append(counts)
        position = last
    return calls


@pytest.mark.parametrize("name", METERED)
@each_source
def test_instructions_and_stack_of_a_call(folder, tmp_path, figure, name):
    card = folder.functions.card
    spec = next(entry for entry in card.functions if entry.name == name)
    (tmp_path / "main.c").write_text(write_meter(folder.prefix, spec, draw_inputs(card, spec, STATES)))
    source = folder.path / f"{folder.prefix}_{name}.c"
    image = build_image(CORTEX_M4F, [source, tmp_path / "main.c"], folder.path, tmp_path / "image.elf")
    depths = [int(line) for line in run_image(CORTEX_M4F, image, tmp_path).split()]
    symbols = read_sizes(image)
    ours = read_sizes(keep_object(CORTEX_M4F, source))
    trace = trace_image(CORTEX_M4F, image, tmp_path)
    assert count_calls(trace, symbols, "meter_block") == [{"meter_block": 101}]
    calls = count_calls(trace, symbols, f"{folder.prefix}_{name}")
    assert len(calls) == len(depths) == STATES
    own = [sum(count for part, count in counts.items() if part in ours) for counts in calls]
    totals = [sum(counts.values()) for counts in calls]
    figure(
        f"Cortex-M4F, {folder.label}, {name}: {median(totals):.0f} instructions a call (most {max(totals)}),"
        f" of them {max(own)} its own; stack {max(depths)} byte"
    )
    if name == "inverse_dynamics":
        assert max(depths) < DEEPEST
        assert (max(totals) if folder.trigonometry == "own" else max(own)) <= LONGEST
