"""Identified values beside those of others, group by group.

Input: a robot, an estimate, other estimates or tables of values. Output: `Comparison`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Literal, final

from symid.api.arguments import check_positive
from symid.api.result import Progress, Result, ignore
from symid.errors import Notice, UsageError

if TYPE_CHECKING:  # these load NumPy and SymPy
    from symid.identification.comparison import ChiSquare
    from symid.report.blocks import Block
    from symid.robot.description import Robot
    from symid.tasks.compared import Compared, ComparedValue
    from symid.tasks.compared_side import EstimateSide
    from symid.tasks.identified import GivenResult

__all__ = ["Comparison", "DeviationUnit", "compare_fit"]

DeviationUnit = Literal["absolute", "percent"]

_TABLE_OPTIONS = ("--name", "--value", "--deviation", "--deviation-unit", "--read-as")


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Comparison(Result):
    """An estimate beside one other or several, in the groups of the others.

    Attributes:
        ours: the estimate.
        found: one entry for every other, with all that was found.
        gate: the largest acceptable difference in standard deviations; None for none.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link")
        >>> first, second = (robot.identify(robot.simulate(duration=5.0, seed=seed).log) for seed in (1, 2))
        >>> found = first.compare(second)
        >>> found.judged, found.largest < 6.0
        (12, True)
    """

    ours: "EstimateSide"
    found: "tuple[Compared, ...]"
    gate: float | None = None

    @property
    def others(self) -> tuple["Comparison", ...]:
        """Return the comparisons with every other alone."""
        return tuple(replace(self, found=(entry,)) for entry in self.found)

    @property
    def groups(self) -> "tuple[ComparedValue, ...]":
        """Return the values of both sides in SI units, with their differences, group by group."""
        return tuple(value for entry in self.found for value in entry.values)

    @property
    def judged(self) -> int:
        """Return how many groups have a standard deviation."""
        return sum(entry.comparison.judged for entry in self.found)

    @property
    def largest(self) -> float:
        """Return the largest difference, in standard deviations of both sides together."""
        return max(entry.comparison.largest for entry in self.found)

    def count_within(self, limit: float) -> int:
        """Return how many groups differ by at most `limit` standard deviations of both sides together."""
        return sum(entry.comparison.count_within(limit) for entry in self.found)

    @property
    def chi_square(self) -> "ChiSquare | None":
        """Return d' V^-1 d, d the differences and V the sum of both covariances; None where V is singular.

        Raises:
            UsageError: there are several others, of which each has its own.
        """
        if len(self.found) > 1:
            text = f"chi-square belongs to one other, and there are {len(self.found)}: ask each of `.others`"
            raise UsageError(Notice(code="usage.several-others", text=text))
        return self.found[0].comparison.chi_square

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return what speaks against the deviations, what was left out, how groups may be meant."""
        from symid.report.comparison_text import warn_comparison

        return warn_comparison(self.ours, self.found)

    @property
    def errors(self) -> tuple[Notice, ...]:
        """Return what misses the gate."""
        from symid.tasks.compared import find_missed

        return tuple(notice for entry in self.found for notice in find_missed(entry, self.gate))

    def summarise(self) -> str:
        """Return how many groups agree with how many others."""
        others = ", ".join(entry.other.source.name for entry in self.found)
        within = f"{self.count_within(2.0)} of {self.judged} groups within 2 standard deviations"
        return f"{self.ours.identified.robot.name}: {within} of {others}"

    def blocks(self) -> "tuple[Block, ...]":
        """Return for every other the values of both sides, counts, chi-square, the largest differences."""
        from symid.report.comparison_text import show_comparison

        return show_comparison(self.ours, self.found)

    def to_dict(self) -> dict[str, object]:
        """Return all values, differences and counts in plain types."""
        from symid.report.comparison_text import describe_comparison

        return describe_comparison(self.ours, self.found, self.gate, accepted=self.accepted)


def compare_fit(
    robot: "Robot",
    estimate: "GivenResult",
    others: "Sequence[GivenResult]",
    *,
    name: str | None = None,
    value: str | None = None,
    deviation: str | None = None,
    deviation_unit: DeviationUnit | None = None,
    read_as: Mapping[str, str] | None = None,
    gate: float | None = None,
    progress: Progress = ignore,
) -> Comparison:
    """Return an estimate beside others.

    Args:
        robot: that was identified.
        estimate: itself, or its file.
        others: estimates of the same robot, or files of such, or tables (CSV) of values in SI units that
            somebody else found, in groups of their own: ours are brought to them exactly.
        name: of tables: the column of names or groups; this and the next by the names of the columns.
        value: of tables: the column of values.
        deviation: of tables: the column of standard deviations.
        deviation_unit: of tables: what deviations are in; by the name of their column.
        read_as: of tables: groups to read as another sum, such as {"fv5": "fv5 + fvm6"}.
        gate: the largest acceptable difference in standard deviations.
        progress: told what begins.

    Raises:
        UsageError: no other is given, or a file twice, or options for tables do not fit.
        EstimateError: a file cannot be read, is of another model, or has nothing in common.
    """
    from symid.formats.value_table import TableColumns
    from symid.tasks.compared import check_files, compare_with_estimate, compare_with_table, is_table
    from symid.tasks.compared_side import build_side
    from symid.tasks.identified import find_dynamics

    if not others:
        text = "nothing to compare with was given: name a fit, its file, or a table"
        raise UsageError(Notice(code="usage.no-other", text=text))
    check_positive("gate", gate)
    files = [Path(entry) for entry in others if isinstance(entry, str | PathLike)]
    ours_file = [Path(estimate)] if isinstance(estimate, str | PathLike) else []
    check_files((*ours_file, *files), getattr(estimate, "file", None))
    tables = [path for path in files if is_table(path)]
    asked = dict(zip(_TABLE_OPTIONS, (name, value, deviation, deviation_unit, read_as), strict=True))
    if not tables and any(asked.values()):
        used = ", ".join(option for option, entry in asked.items() if entry)
        text = (
            f"{used}: of tables, and there is none among {', '.join(map(str, files)) or 'fits'}; leave it out"
        )
        raise UsageError(Notice(code="usage.no-table", text=text))
    progress(f"finding the base parameters of {robot.name}")
    ours = build_side(robot, *find_dynamics(estimate))
    percent = None if deviation_unit is None else deviation_unit == "percent"
    columns = TableColumns(name=name, value=value, deviation=deviation, percent=percent)
    readings = {"".join(group.split()): text for group, text in (read_as or {}).items()}
    found = tuple(
        compare_with_table(ours, Path(entry), columns, readings)
        if isinstance(entry, str | PathLike) and Path(entry) in tables
        else compare_with_estimate(ours, build_side(robot, *find_dynamics(entry)))
        for entry in others
    )
    return Comparison(ours=ours, found=found, gate=gate)
