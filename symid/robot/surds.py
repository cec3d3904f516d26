"""Quotients and square roots of exact numbers.

Input: numbers over the rationals with sqrt(2) and sqrt(3). Output: the same; a root only where it is one of
these numbers.

Supported: every number that `Exact` can hold without a symbol.
"""

import decimal
import itertools
import math
from decimal import Decimal
from fractions import Fraction

from symid.robot.geometry import ONE, ZERO, Exact, Surd

__all__ = ["find_inverse", "find_root"]

_ROOTS = (1, 2, 3, 6)
# How sqrt(2), sqrt(3) and sqrt(6) change their signs under the four automorphisms of the field.
_SIGNS = ((1, 1, 1, 1), (1, -1, 1, -1), (1, 1, -1, -1), (1, -1, -1, 1))
_GUARD_DIGITS = 30


def _conjugate(value: Surd, signs: tuple[int, int, int, int]) -> Exact:
    one, two, three, six = (sign * part for sign, part in zip(signs, value, strict=True))
    return Exact.surd(one, two, three, six)


def find_inverse(value: Exact) -> Exact:
    """Return 1 / value.

    Raises:
        ZeroDivisionError: the value is zero.
    """
    others = ONE
    for signs in _SIGNS[1:]:
        others = others * _conjugate(value.coefficient(""), signs)
    norm = (value * others).coefficient("")[0]
    return others * Exact.surd(1 / norm)


def _find_rational_root(value: Fraction) -> Exact | None:
    """Return the root of a rational number where it is a rational times 1, sqrt(2), sqrt(3) or sqrt(6)."""
    for index, radicand in enumerate(_ROOTS):
        part = value / radicand
        above, below = math.isqrt(part.numerator), math.isqrt(part.denominator)
        if above * above == part.numerator and below * below == part.denominator:
            parts = [Fraction(0)] * 4
            parts[index] = Fraction(above, below)
            return Exact.surd(*parts)
    return None


def find_root(value: Exact) -> Exact | None:
    """Return the root of `value` that is not negative, None where it is no number of the field.

    With s = D^2 value, an integer combination of the roots, x = sqrt(s) is an algebraic integer: its traces
    with 1, sqrt(2), sqrt(3), sqrt(6) are whole numbers, found from the roots of the conjugates of s. The
    square is compared exactly, so nothing rests on the digits.
    """
    if not value:
        return ZERO
    surd = value.coefficient("")
    if value.is_rational:
        return _find_rational_root(surd[0]) if surd[0] > 0 else None
    below = math.lcm(*(part.denominator for part in surd))
    whole = [int(part * below * below) for part in surd]
    digits = max(len(str(abs(part))) for part in whole)
    with decimal.localcontext(decimal.Context(prec=digits + _GUARD_DIGITS)):
        bases = [Decimal(radicand).sqrt() for radicand in _ROOTS]
        conjugates = [
            sum(
                (s * Decimal(part) * base for s, part, base in zip(signs, whole, bases, strict=True)),
                Decimal(),
            )
            for signs in _SIGNS
        ]
        if min(conjugates) < 0:
            return None
        roots = [conjugate.sqrt() for conjugate in conjugates]
        for turns in itertools.product((1, -1), repeat=3):
            turned = [turn * root for turn, root in zip((1, *turns), roots, strict=True)]
            parts = [_find_part(turned, index, bases[index], below) for index in range(4)]
            found = Exact.surd(*parts)
            if found * found == value:
                return found
    return None


def _find_part(roots: list[Decimal], index: int, base: Decimal, below: int) -> Fraction:
    """Return the coefficient of the root `index`, from its trace, which is a whole number."""
    trace = sum((signs[index] * root for signs, root in zip(_SIGNS, roots, strict=True)), Decimal()) * base
    return Fraction(int(trace.to_integral_value()), 4 * _ROOTS[index] * below)
