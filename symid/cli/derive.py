"""`symid derive ROBOT`: the derivation of a robot's dynamics, step by step."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

import click

from symid.cli.inputs import load_robot
from symid.cli.options import cut_options, verb
from symid.cli.output import Answer, Console, format_table

if TYPE_CHECKING:  # this loads SymPy
    from symid.codegen.routes import RouteCount
    from symid.teaching.lesson import Step

__all__ = ["command"]


@click.command("derive")
@click.argument("robot")
@click.option("--latex", is_flag=True, help="Formulas in LaTeX.")
@cut_options
@verb
def command(
    console: Console,
    *,
    robot: str,
    latex: bool,
    base_link: str | None,
    tip_link: str | None,
    snap: float | None,
) -> Answer:
    """Show how the dynamics come about, from the frames to the torques, and what code of them costs.

    Each step is a sentence, its formulas, and what was checked. Behind them stand the operations of
    generated functions; --json has those of every route that was counted, not of the chosen ones alone.
    """
    described = load_robot(robot, base=base_link, tip=tip_link, snap=snap)
    console.progress(f"deriving the dynamics of {described.name}")
    from symid.codegen.routes import find_route_counts
    from symid.teaching.lesson import derive_lesson

    steps = derive_lesson(described)
    console.progress("counting the operations of all routes to code")
    counts = find_route_counts(described)
    parts = [_show_step(number, step, latex=latex) for number, step in enumerate(steps, start=1)]
    result = {
        "robot": described.name,
        "steps": [asdict(step) for step in steps],
        "operations": [_describe_count(entry) for entry in counts],
    }
    return Answer(text="\n\n".join([*parts, _show_counts(counts)]), result=result, warnings=described.notices)


def _describe_count(entry: "RouteCount") -> dict[str, object]:
    return {
        "function": entry.function,
        "route": entry.route,
        "chosen": entry.chosen,
        **asdict(entry.operations),
    }


def _show_counts(counts: Sequence["RouteCount"]) -> str:
    """Return the operations of the chosen routes as a table, the spread of the others beside them."""
    rows = []
    for entry in counts:
        if entry.chosen:
            all_routes = [other.operations for other in counts if other.function == entry.function]
            most = max(other.mul + other.add for other in all_routes)
            own = entry.operations
            rows.append((entry.function, str(own.mul), str(own.add), str(own.trig), str(most), entry.route))
    intro = (
        "Operations of generated functions: products with squares and divisions, sums, sines and cosines.\n"
        "Of the routes that give a function the one with the fewest is written; 'most' has the worst one's "
        "products and sums.\n"
    )
    return intro + format_table(("function", "mul", "add", "trig", "most", "route"), rows, (0, 5))


def _show_step(number: int, step: "Step", *, latex: bool) -> str:
    lines = [f"{number}. {step.title}", "", f"   {step.sentence}"]
    for entry in step.formulas:
        left, right = (entry.left_latex, entry.latex) if latex else (entry.left, entry.text)
        lines.append(f"     {left} = {right}")
    if step.check:
        lines += ["", f"   Checked: {step.check}"]
    return "\n".join(lines)
