"""The order of a program's instructions: depth first, so that few values are alive at a time.

Input: a program in any order. Output: the same instructions in another order.

A table holds its entries as routes came upon them. Code in that order keeps many values for long, which
costs registers in C and whole arrays in NumPy. Here a value is computed when the first that needs it is
next, and of two operands first the one that needs more values itself (Sethi and Ullman 1970, for trees).

Supported: all programs; counts stay what they are.
"""

from symid.codegen.instructions import Instruction, Op, Program

__all__ = ["build_depth_first"]


def _find_operands(instruction: Instruction) -> tuple[int, ...]:
    return () if instruction.op is Op.INPUT else tuple(map(abs, instruction.args))


def _find_needs(program: Program) -> list[int]:
    """Return how many values are alive at once while a value is computed, were none used twice."""
    needs = [0]
    for instruction in program.instructions:
        below = sorted((needs[k] for k in set(_find_operands(instruction))), reverse=True)
        needs.append(max([1, *(need + k for k, need in enumerate(below))]))
    return needs


def _find_order(program: Program) -> list[int]:
    """Return the numbers of the instructions in their new order."""
    needs = _find_needs(program)
    order: dict[int, None] = {}
    for refs in program.outputs:
        for ref in refs:
            waiting = [abs(ref)]
            while waiting:
                number = waiting[-1]
                operands = _find_operands(program.instructions[number - 1])
                missing = [k for k in reversed(operands) if k not in order]
                if missing:
                    # The last one on the stack comes first; of equal needs the first operand.
                    waiting.extend(sorted(missing, key=needs.__getitem__))
                else:
                    order[waiting.pop()] = None
    return list(order)


def build_depth_first(program: Program) -> Program:
    """Return `program` with its instructions in depth-first order."""
    order = _find_order(program)
    renumbered = {old: new for new, old in enumerate(order, start=1)}

    def move(ref: int) -> int:
        return renumbered[ref] if ref > 0 else -renumbered[-ref]

    def rewrite(number: int) -> Instruction:
        instruction = program.instructions[number - 1]
        if instruction.op is Op.INPUT:
            return instruction
        return Instruction(instruction.op, tuple(map(move, instruction.args)), instruction.constant)

    return Program(
        spec=program.spec,
        instructions=tuple(map(rewrite, order)),
        outputs=tuple(tuple(map(move, refs)) for refs in program.outputs),
    )
