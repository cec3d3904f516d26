"""The private header of a C library: numbers side by side, and sine and cosine of several angles at once.

Input: options. Output: the text of the header.

    x -> n = round(2 x / pi), r = x - n pi/2;  sin r = r + r^3 S(r^2);  cos r = 1 - r^2/2 + r^4 C(r^2).

S and C are minimax polynomials on |r| <= pi/4 (Remez 1934), found in 60 digits with the relative error of
sin r and cos r as weight, and rounded one coefficient after another, the others fitted again each time. In
exact arithmetic they err by less than 2^-57 (double) and 2^-27 (float).

Supported: double and float; compilers with vector types of GCC, and C99 without them.
"""

from dataclasses import dataclass

from symid.codegen.describe import BANNER
from symid.codegen.printing import find_literal
from symid.codegen.templates import write_template

__all__ = ["LanesContext", "write_lanes"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LanesContext:
    """lanes.h.jinja."""

    banner: str
    macro: str
    real: str
    bits: str
    suffix: str
    limit: str
    limit_literal: str
    avx_lanes: int
    sse_lanes: int
    two_over_pi: str
    shifter: str
    exponent: str
    reduced: str
    polynomial_lines: tuple[str, ...]
    sign_shift: int
    magnitude: str
    eight_lines: tuple[str, ...]
    four_lines: tuple[str, ...]
    two_lines: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Kind:
    """Numbers of one precision. `parts` sum up to pi/2; products of all but the last with n are exact."""

    bits: int
    limit: float
    shifter: float
    two_over_pi: float
    parts: tuple[float, ...]
    sine: tuple[float, ...]
    cosine: tuple[float, ...]


_KINDS = {
    "double": _Kind(
        bits=64,
        limit=1e6,
        shifter=1.5 * 2.0**52,
        two_over_pi=0.6366197723675814,
        parts=(1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21),
        sine=(
            -0.1666666666666663,
            0.00833333333332184,
            -0.00019841269829358528,
            2.7557313538514234e-06,
            -2.5050734389257543e-08,
            1.5895433289345187e-10,
        ),
        cosine=(
            0.041666666666666595,
            -0.0013888888888873338,
            2.480158728899748e-05,
            -2.7557314215299134e-07,
            2.087570511500033e-09,
            -1.135873277660174e-11,
        ),
    ),
    "float": _Kind(
        bits=32,
        limit=1e4,
        shifter=1.5 * 2.0**23,
        two_over_pi=0.6366197723675814,
        parts=(1.5703125, 0.0004837512969970703, 7.549533620476723e-08, 2.5633440682570896e-12),
        sine=(-0.16666655242443085, 0.008332189172506332, -0.0001951828453456983),
        cosine=(0.04166664555668831, -0.0013887309469282627, 2.4432327336398885e-05),
    ),
}


def _write_polynomial(coefficients: tuple[float, ...], precision: str) -> str:
    """Return the text of the polynomial in z, w = z z: pairs, so that few sums wait for each other."""
    texts = [f"ALL({find_literal(value, precision)})" for value in coefficients]
    pairs = [
        f"({texts[k]} + z * {texts[k + 1]})" if k + 1 < len(texts) else texts[k]
        for k in range(0, len(texts), 2)
    ]
    whole = pairs.pop()
    for pair in reversed(pairs):
        whole = f"({pair} + w * {whole})"
    return whole


def _write_reduction(kind: _Kind, precision: str) -> str:
    text = "x"
    for part in kind.parts:
        text = f"({text} - n * ALL({find_literal(part, precision)}))"
    return text[1:-1]


def _write_polynomials(kind: _Kind, precision: str) -> tuple[str, ...]:
    one, half = (f"ALL({find_literal(value, precision)})" for value in (1.0, 0.5))
    return (
        "const lanes w = z * z;",
        f"const lanes a = r + (r * z) * {_write_polynomial(kind.sine, precision)};",
        f"const lanes b = ({one} - {half} * z) + w * {_write_polynomial(kind.cosine, precision)};",
    )


def _write_transposition(width: int, first: int) -> list[str]:
    """Return statements that turn `width` lanes, from x[first] on, and store them as `width` rows.

    Elements are exchanged between lanes 1, 2, 4 apart, one bit of their numbers at a time.
    """
    names = [f"x[{first + k}]" for k in range(width)]
    lines, step = [], 1
    while step < width:
        turned = list(names)
        for k in range(width):
            if k & step:
                continue
            low = [width + (i ^ step) if i & step else i for i in range(width)]
            high = [width + i if i & step else i | step for i in range(width)]
            for place, order in ((k, low), (k | step, high)):
                turned[place] = f"y{first + place}_{step}"
                numbers = ", ".join(map(str, order))
                lines.append(
                    f"const lanes {turned[place]} = SHUFFLE({names[k]}, {names[k | step]}, {numbers});"
                )
        names, step = turned, 2 * step
    for k, name in enumerate(names):
        lines.append(f"store_lanes(out + stride * {k} + {first}, {name});")
    return lines


def _write_store(width: int) -> tuple[str, ...]:
    return tuple(line for first in range(0, 8, width) for line in _write_transposition(width, first))


def write_lanes(macro: str, precision: str) -> str:
    """Return the header for a library whose macros begin with `macro`."""
    kind = _KINDS[precision]
    double = precision == "double"
    context = LanesContext(
        banner=BANNER,
        macro=macro,
        real=precision,
        bits=f"uint{kind.bits}_t",
        suffix="" if double else "f",
        limit=f"{kind.limit:g}",
        limit_literal=find_literal(kind.limit, precision),
        avx_lanes=4 if double else 8,
        sse_lanes=2 if double else 4,
        two_over_pi=find_literal(kind.two_over_pi, precision),
        shifter=find_literal(kind.shifter, precision),
        exponent="0x4330000000000000" if double else "0x4b000000",
        reduced=_write_reduction(kind, precision),
        polynomial_lines=_write_polynomials(kind, precision),
        sign_shift=kind.bits - 2,
        magnitude="0x7fffffffffffffff" if double else "0x7fffffff",
        eight_lines=_write_store(8),
        four_lines=_write_store(4),
        two_lines=_write_store(2),
    )
    return write_template("c/lanes.h.jinja", context)
