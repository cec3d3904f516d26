"""Lines of text from figures.

Input: times, counts and verdicts. Output: tables.
"""

from collections.abc import Mapping, Sequence

from gates import Verdict, find_best

__all__ = ["format_figures", "format_ratios", "format_verdicts"]

Figures = Mapping[tuple[str, str], float]


def _align(rows: Sequence[Sequence[str]]) -> str:
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = []
    for row in rows:
        cells = [c.rjust(w) if k else c.ljust(w) for k, (c, w) in enumerate(zip(row, widths, strict=True))]
        lines.append("  ".join(cells).rstrip())
    return "\n".join(lines)


def _list_functions(figures: Figures) -> list[str]:
    return list(dict.fromkeys(function for _, function in figures))


def format_figures(title: str, figures: Figures) -> str:
    """Return a table with a line a function and a column a contender."""
    labels = list(dict.fromkeys(label for label, _ in figures))
    rows = [[title, *labels]]
    for function in _list_functions(figures):
        cells = [figures.get((label, function)) for label in labels]
        rows.append([function, *("-" if value is None else f"{value:.0f}" for value in cells)])
    return _align(rows)


def format_ratios(title: str, figures: Figures, compilers: Sequence[str]) -> str:
    """Return Pinocchio and the traced one over ours, of the best builds and compiler by compiler."""
    pairs = [("Pinocchio", family) for family in ("C99", "ours", "batch")]
    pairs += [("SX", "ours"), ("SX-constant", "ours")]
    rows = [[title, *(f"{a}/{b}" for a, b in pairs), *(f"C99 by {name}" for name in compilers)]]
    for function in _list_functions(figures):
        cells = [(find_best(figures, a, function), find_best(figures, b, function)) for a, b in pairs]
        for c in compilers:
            mine = {key: value for key, value in figures.items() if key[0].endswith(f" {c}")}
            cells.append((find_best(mine, "Pinocchio", function), find_best(mine, "C99", function)))
        rows.append([function, *(f"{a / b:.2f}" if a and b else "-" for a, b in cells)])
    return _align(rows)


def format_verdicts(verdicts: Sequence[Verdict]) -> str:
    """Return a line a gate."""
    rows = [["gate", "ratio", "least", "aim", "found", ""]]
    for verdict in verdicts:
        gate = verdict.gate
        numbers = [
            "-" if value is None else f"{value:.2f}" for value in (gate.least, gate.aim, verdict.ratio)
        ]
        rows.append([f"{gate.robot} {gate.function}", f"{gate.above}/{gate.below}", *numbers, verdict.word])
    return _align(rows)
