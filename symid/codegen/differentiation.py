"""Derivatives of values in a table, written into the same table.

Input: references to values and to what they are derived by. Output: references to the derivatives.

Forward: one pass per direction; backward: one pass per value, all derivatives at once (Griewank and
Walther 2008).

Supported: sums, products, quotients, sine and cosine.
Not supported: other operations on the way; they are refused by name.
"""

from collections.abc import Iterable, Mapping, Sequence

from symid.codegen.instructions import Op
from symid.codegen.values import ValueTable

__all__ = ["find_gradient", "find_rates", "find_rates_along"]

Step = tuple[int, Op, tuple[int, ...]]


def _find_slopes(table: ValueTable, number: int, op: Op, args: tuple[int, ...]) -> tuple[int, ...]:
    """Return the derivative of an instruction by each of its arguments."""
    one = table.constant(1.0)
    if op is Op.ADD:
        return one, one
    if op is Op.SUB:
        return one, -one
    if op is Op.MUL:
        return args[1], args[0]
    if op is Op.DIV:
        return table.div(one, args[1]), -table.div(number, args[1])
    if op is Op.SIN:
        return (table.apply(Op.COS, args[0]),)
    if op is Op.COS:
        return (-table.apply(Op.SIN, args[0]),)
    message = f"no derivative of {op.value}: write it with sums, products, sine and cosine"
    raise TypeError(message)


def _find_reached(
    users: Mapping[int, Sequence[int]], steps: Sequence[Step], seeds: Iterable[int]
) -> list[int]:
    """Return the indices of the steps that depend on `seeds`, in order."""
    reached: set[int] = set()
    waiting = list(seeds)
    while waiting:
        for index in users.get(waiting.pop(), ()):
            if index not in reached:
                reached.add(index)
                waiting.append(steps[index][0])
    return sorted(reached)


def find_rates_along(
    table: ValueTable, values: Sequence[int], directions: Sequence[Mapping[int, int]]
) -> list[list[int]]:
    """Return, for each direction, the derivatives of `values` where each input moves by its seed.

    Constants stay where they are.
    """
    zero = table.constant(0.0)
    steps = table.walk(values)
    users: dict[int, list[int]] = {}
    for index, (_, op, args) in enumerate(steps):
        for ref in () if op is Op.INPUT else args:
            users.setdefault(abs(ref), []).append(index)
    results = []
    for seeds in directions:
        moving = {
            ref: seed for ref, seed in seeds.items() if not table.is_constant(ref) and abs(seed) != zero
        }
        rates = {abs(ref): seed if ref > 0 else -seed for ref, seed in moving.items()}
        for index in _find_reached(users, steps, tuple(rates)):
            number, op, args = steps[index]
            if number in rates:
                continue
            total = zero
            for ref, slope in zip(args, _find_slopes(table, number, op, args), strict=True):
                rate = rates.get(abs(ref), zero)
                total = table.add(total, table.mul(slope, rate if ref > 0 else -rate))
            rates[number] = total
        results.append([rates.get(ref, zero) if ref > 0 else -rates.get(-ref, zero) for ref in values])
    return results


def find_rates(table: ValueTable, values: Sequence[int], seeds: Mapping[int, int]) -> list[int]:
    """Return the derivatives of `values` in one direction; see `find_rates_along`."""
    return find_rates_along(table, values, [seeds])[0]


def find_gradient(table: ValueTable, value: int, inputs: Sequence[int]) -> list[int]:
    """Return the derivatives of `value` by each of `inputs`; by a constant it is zero."""
    zero = table.constant(0.0)
    slopes = {abs(value): table.constant(1.0 if value > 0 else -1.0)}
    for number, op, args in reversed(table.walk([value])):
        outer = slopes.get(number, zero)
        if op in (Op.INPUT, Op.CONSTANT) or abs(outer) == zero:
            continue
        for ref, inner in zip(args, _find_slopes(table, number, op, args), strict=True):
            change = table.mul(outer, inner if ref > 0 else -inner)
            slopes[abs(ref)] = table.add(slopes.get(abs(ref), zero), change)
    return [
        zero if table.is_constant(ref) else slopes.get(abs(ref), zero) * (1 if ref > 0 else -1)
        for ref in inputs
    ]
