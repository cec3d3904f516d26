"""A derivation, step by step, in text, LaTeX and HTML, with what code of it costs.

Input: the steps, and the operations of all routes to code. Output: blocks, dictionaries, LaTeX, HTML.
"""

import html
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

from symid.report.blocks import Block, Table, format_table, write_html

if TYPE_CHECKING:  # these load SymPy
    from symid.codegen.routes import RouteCount
    from symid.teaching.lesson import Step

__all__ = ["describe_derivation", "show_derivation", "write_derivation_html", "write_derivation_latex"]

_INTRO = (
    "Operations of generated functions: products with squares and divisions, sums, sines and cosines.\n"
    "Of the routes that give a function the one with the fewest is written; 'most' has the worst one's "
    "products and sums."
)


def describe_derivation(
    robot: str, steps: Sequence["Step"], counts: Sequence["RouteCount"]
) -> dict[str, object]:
    """Return a derivation as `symid derive --json` gives it, with the operations of every route."""
    return {
        "robot": robot,
        "steps": [asdict(step) for step in steps],
        "operations": [
            {
                "function": entry.function,
                "route": entry.route,
                "chosen": entry.chosen,
                **asdict(entry.operations),
            }
            for entry in counts
        ],
    }


def show_derivation(
    steps: Sequence["Step"], counts: Sequence["RouteCount"], *, latex: bool = False
) -> tuple[Block, ...]:
    """Return the steps as paragraphs, formulas in text or LaTeX, and the table of operations."""
    paragraphs = (_show_step(number, step, latex=latex) for number, step in enumerate(steps, start=1))
    return (*paragraphs, _show_counts(counts))


def write_derivation_latex(steps: Sequence["Step"]) -> str:
    """Return titles and formulas as aligned equations."""
    lines = []
    for number, step in enumerate(steps, start=1):
        lines.append(rf"&\textbf{{{number}. {step.title}}}")
        lines += [rf"{entry.left_latex} &= {entry.latex}" for entry in step.formulas]
    return "$$\\begin{aligned}" + " \\\\ ".join(lines) + "\\end{aligned}$$"


def write_derivation_html(steps: Sequence["Step"], counts: Sequence["RouteCount"]) -> str:
    """Return the derivation for a notebook, which sets the formulas."""
    parts = []
    for number, step in enumerate(steps, start=1):
        parts.append(f"<h4>{number}. {html.escape(step.title)}</h4><p>{html.escape(step.sentence)}</p>")
        formulas = (rf"$\displaystyle {entry.left_latex} = {entry.latex}$" for entry in step.formulas)
        parts += [f"<p>{html.escape(formula)}</p>" for formula in formulas]
        if step.check:
            parts.append(f"<p>Checked: {html.escape(step.check)}</p>")
    return "".join((*parts, write_html((_show_counts(counts),))))


def _show_step(number: int, step: "Step", *, latex: bool) -> str:
    lines = [f"{number}. {step.title}", "", f"   {step.sentence}"]
    for entry in step.formulas:
        left, right = (entry.left_latex, entry.latex) if latex else (entry.left, entry.text)
        lines.append(f"     {left} = {right}")
    if step.check:
        lines += ["", f"   Checked: {step.check}"]
    return "\n".join(lines)


def _show_counts(counts: Sequence["RouteCount"]) -> Table:
    """Return the operations of the chosen routes as a table, the worst of the others beside them."""
    rows = []
    for entry in counts:
        if entry.chosen:
            all_routes = [other.operations for other in counts if other.function == entry.function]
            most = max(other.mul + other.add for other in all_routes)
            own = entry.operations
            rows.append((entry.function, own.mul, own.add, own.trig, most, entry.route))
    return format_table(("function", "mul", "add", "trig", "most", "route"), rows, (0, 5), _INTRO)
