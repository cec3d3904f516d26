"""Studies: many identifications of simulated robots with a known truth, methods next to each other.

Robot, how many draws of the noise -> `Study`, or `FrictionTables` for those of a paper.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Generic, TypeVar, final

from symid import report
from symid.api.result import Progress, Result, check_count, ignore
from symid.errors import Notice

if TYPE_CHECKING:
    from symid.report import Block
    from symid.study import (
        FrictionStudy,
    )

T_co = TypeVar("T_co", covariant=True)


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Study(Result, Generic[T_co]):
    """What a study found.

    Attributes:
        title: the study and the robot, in words.
        product: the numbers.
        tables: what it is printed as.
        described: the numbers in plain types.
        told: what a reader should know.

    Example:
        >>> import symid
        >>> study = symid.load("two_link").study_precision(seeds=2, jobs=1)
        >>> study
        <Study precision of two_link>
    """

    title: str
    product: T_co
    tables: "tuple[Block, ...]"
    described: Mapping[str, object]
    told: tuple[Notice, ...] = ()

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return what a reader should know of the robot and its logs."""
        return self.told

    def summarise(self) -> str:
        """Return the study and the robot."""
        return self.title

    def blocks(self) -> "tuple[Block, ...]":
        """Return its tables."""
        return self.tables

    def to_dict(self) -> dict[str, object]:
        """Return the numbers in plain types."""
        return dict(self.described)


def report_count(progress: Progress) -> Callable[[int, int], None]:
    """Return what tells how many tasks are done, of how many."""

    def tell(done: int, whole: int) -> None:
        progress(f"{done} of {whole}")

    return tell


def list_seeds(seeds: int, seed: int) -> range:
    """Return so many seeds from the first one on.

    Raises:
        UsageError: there is none, or the first one is negative.
    """
    check_count("seeds", seeds, least=1)
    check_count("seed", seed)
    return range(seed, seed + seeds)


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class FrictionTables(Result):
    """The tables of Zhang, Hu and Zou (2021) on joint friction, theirs and ours side by side.

    Attributes:
        product: the numbers.

    Example:
        >>> import symid
        >>> tables = symid.study_friction_tables(seeds=2)  # doctest: +SKIP
        >>> tables.save("tables.html")  # doctest: +SKIP
    """

    product: "FrictionStudy"

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return nothing: the joints are those of the paper."""
        return ()

    def save(self, path: str | PathLike[str]) -> Path:
        """Write one page with all tables and figures to `path`, in place of an older file; return the path.

        Raises:
            OutputError: the file cannot be written.
        """
        return report.write_page(Path(path), report.build_friction_study_page(self.product))

    def summarise(self) -> str:
        """Return how many claims are met."""
        judged = [check.met for check in self.product.checks if check.met is not None]
        return f"friction tables: {sum(judged)} of {len(judged)} claims met"

    def blocks(self) -> "tuple[Block, ...]":
        """Return all tables, and what is asked of ours."""
        return report.show_friction_tables(self.product)

    def to_dict(self) -> dict[str, object]:
        """Return the numbers in plain types."""
        return asdict(self.product)


def study_friction_tables(
    *,
    seeds: int = 1000,
    seed: int = 0,
    jobs: int | None = None,
    timed: bool = False,
    progress: Progress = ignore,
) -> FrictionTables:
    """Return the tables of a paper on joint friction, its numbers and ours side by side.

    Args:
        seeds: draws of the noise, at least two; some tables take fewer.
        seed: the first one.
        jobs: processes; None for one a core. A script starts them below `if __name__ == "__main__":`.
        timed: whether the time that each estimator takes is measured, which differs from run to run.
        progress: told what begins, and how many tasks are done.

    Raises:
        UsageError: fewer than two draws.

    Example:
        >>> import symid
        >>> symid.study_friction_tables(seeds=1)
        Traceback (most recent call last):
        symid.errors.UsageError: 1 draw: a standard deviation over draws needs two or more
    """
    from symid.study import study_friction

    progress("all estimators on one data set")
    numbers = list_seeds(seeds, seed)
    return FrictionTables(
        product=study_friction(numbers, jobs=jobs, timed=timed, progress=report_count(progress))
    )
