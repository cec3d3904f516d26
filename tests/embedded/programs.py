"""Programs in C around generated functions, for this machine and for a board alike.

`write_runner` evaluates every function at the states of a file; `write_meter` calls one function at states
that it carries, and says how deep the stack went.
"""

from collections.abc import Mapping

import numpy as np

from symid.codegen.functions import FunctionSpec, ModelCard, Port
from symid.codegen.printing import write_literal

SPREAD = {
    "q": 2.9,
    "dq": 2.5,
    "ddq": 10.0,
    "dqr": 2.5,
    "ddqr": 10.0,
    "tau": 50.0,
    "dddq": 50.0,
    "ddddq": 500.0,
}
SPREAD |= {"phi": 0.01, "P": 0.005, "tau_J": 20.0, "Q": 5.0}
Samples = dict[str, np.ndarray]


def draw_inputs(card: ModelCard, spec: FunctionSpec, states: int) -> Samples:
    """Return inputs (states, size) that floats hold exactly; parameters are the robot file's, or near one."""
    rng = np.random.default_rng([7, *spec.name.encode()])
    known = {card.vector: card.beta, "f": card.friction, "IA": card.rotors, "h": card.springs}
    drawn = {}
    for port in spec.inputs:
        if port.name in known:
            values = [entry.value for entry in known[port.name]]
            near = rng.uniform(0.5, 1.5, port.size)
            full = [float(n) if value is None else value for n, value in zip(near, values, strict=True)]
            rows = np.tile(full, (states, 1))
        else:
            rows = rng.uniform(-1.0, 1.0, (states, port.size)) * SPREAD[port.name]
        drawn[port.name] = rows.astype(np.float32).astype(float)
    return drawn


def join_inputs(drawn: Mapping[str, Samples], specs: tuple[FunctionSpec, ...], precision: str) -> bytes:
    """Return the file that a runner reads: state after state of each function."""
    tables = [np.hstack([drawn[spec.name][port.name] for port in spec.inputs]).ravel() for spec in specs]
    return np.concatenate(tables).astype(precision).tobytes()


def split_outputs(
    data: bytes, specs: tuple[FunctionSpec, ...], states: int, precision: str
) -> dict[str, Samples]:
    """Return outputs (states, size) of each function from the file that a runner wrote."""
    numbers = np.frombuffer(data, precision).astype(float)
    results, start = {}, 0
    for spec in specs:
        width = sum(port.size for port in spec.outputs)
        table = numbers[start : start + states * width].reshape(states, width)
        start += states * width
        edges = np.cumsum([port.size for port in spec.outputs])[:-1]
        names = [port.name for port in spec.outputs]
        results[spec.name] = dict(zip(names, np.split(table, edges, axis=1), strict=True))
    assert start == numbers.size
    return results


def _place(ports: tuple[Port, ...], array: str) -> list[str]:
    starts = np.cumsum([0, *(port.size for port in ports)])
    return [f"{array} + {start}" for start in starts[:-1]]


def _call(prefix: str, spec: FunctionSpec, inputs: str, outputs: str) -> str:
    arguments = ", ".join([*_place(spec.inputs, inputs), *_place(spec.outputs, outputs)])
    return f"{prefix}_{spec.name}({arguments})"


def _measure(ports: tuple[Port, ...]) -> int:
    return max(sum(port.size for port in ports), 1)


def write_runner(prefix: str, card: ModelCard, precision: str, states: int) -> str:
    """Return a `main` that reads inputs.bin and writes outputs.bin, every function at `states` states."""
    specs = card.functions
    calls = [
        f"static int call_{spec.name}(void)\n{{\n    return {_call(prefix, spec, 'in', 'out')};\n}}\n"
        for spec in specs
    ]
    runs = [
        f"    bad += run(from, to, {_measure(spec.inputs)}, {_measure(spec.outputs)}, call_{spec.name});"
        for spec in specs
    ]
    return "\n".join(
        [
            f'#include "{prefix}.h"\n#include <stdio.h>\n',
            f"static {precision} in[{max(_measure(spec.inputs) for spec in specs)}];",
            f"static {precision} out[{max(_measure(spec.outputs) for spec in specs)}];\n",
            *calls,
            "static int run(FILE *from, FILE *to, size_t inputs, size_t outputs, int (*call)(void))\n{",
            f"    for (int k = 0; k < {states}; ++k) {{",
            "        if (fread(in, sizeof in[0], inputs, from) != inputs || call() != 0 ||",
            "            fwrite(out, sizeof out[0], outputs, to) != outputs) {",
            "            return 1;\n        }\n    }\n    return 0;\n}\n",
            "int main(void)\n{",
            '    FILE *from = fopen("inputs.bin", "rb");\n    FILE *to = fopen("outputs.bin", "wb");',
            "    int bad = 0;\n    if (from == NULL || to == NULL) {\n        return 2;\n    }",
            *runs,
            "    return fclose(to) == 0 && bad == 0 ? 0 : 1;\n}\n",
        ]
    )


METER = """#include "{prefix}.h"
#include <stdio.h>
#define STATES {states}
#define PAINTED 2048
static const float in[STATES][{inputs}] = {{
{rows}
}};
static float out[{outputs}];
static unsigned depth[STATES];
/* A block whose instructions are counted by hand: 100 and the return. */
void meter_block(void);
__asm__(".text\\n.thumb\\n.thumb_func\\n.global meter_block\\n.type meter_block, %function\\n"
        "meter_block:\\n.rept 100\\nnop\\n.endr\\nbx lr\\n.size meter_block, . - meter_block\\n");
static volatile unsigned char *find_stack(void)
{{
    unsigned char *top;
    __asm__ volatile("mov %0, sp" : "=r"(top));
    return top;
}}
int main(void)
{{
    meter_block();
    for (int k = 0; k < STATES; ++k) {{
        volatile unsigned char *const top = find_stack();
        unsigned unused = 0;
        for (unsigned i = 1; i <= PAINTED; ++i) {{
            top[-(int)i] = 0xA5u;
        }}
        if ({call} != 0) {{
            return 1;
        }}
        while (unused < PAINTED && top[(int)unused - PAINTED] == 0xA5u) {{
            ++unused;
        }}
        depth[k] = PAINTED - unused;
    }}
    for (int k = 0; k < STATES; ++k) {{
        printf("%u\\n", depth[k]);
    }}
    return 0;
}}
"""


def _write_number(value: float) -> str:
    return ("-" if value < 0.0 else "") + write_literal(abs(value), "float")


def write_meter(prefix: str, spec: FunctionSpec, drawn: Samples) -> str:
    """Return a `main` for a board that calls one float function and prints the bytes of stack per call."""
    table = np.hstack([drawn[port.name] for port in spec.inputs])
    rows = (", ".join(map(_write_number, row)) for row in table)
    return METER.format(
        prefix=prefix,
        states=len(table),
        inputs=table.shape[1],
        outputs=_measure(spec.outputs),
        rows="\n".join(f"    {{{row}}}," for row in rows),
        call=_call(prefix, spec, "in[k]", "out"),
    )
