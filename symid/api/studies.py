"""Studies: comparisons of methods by many identifications of simulated robots with known parameters.

Robot, number of noise draws -> `Study`, or `FrictionTables` for those of a paper.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Generic, TypeVar, final

from symid import report
from symid.api.result import Progress, Result, check_count, ignore
from symid.environment import report_count
from symid.errors import Notice
from symid.serialization import describe_record

if TYPE_CHECKING:
    from symid.report import Block
    from symid.study import ForeignStudy, FrictionStudy

T_co = TypeVar("T_co", covariant=True)


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Study(Result, Generic[T_co]):
    """The result of a study.

    Attributes:
        title: the study and the robot, in words.
        product: the numbers.
        tables: the printed form.
        described: the numbers in plain types.
        notices: warnings and notes on the robot and its logs.

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
    notices: tuple[Notice, ...] = ()

    def summarise(self) -> str:
        """Return the study and the robot."""
        return self.title

    def blocks(self) -> "tuple[Block, ...]":
        """Return its tables."""
        return self.tables

    def to_dict(self) -> dict[str, object]:
        """Return the numbers in plain types."""
        return dict(self.described)


def list_seeds(seeds: int, seed: int) -> range:
    """Return `seeds` consecutive seeds, starting with `seed`.

    Raises:
        UsageError: `seeds` is not positive, or `seed` is negative.
    """
    check_count("seeds", seeds, least=1)
    check_count("seed", seed)
    return range(seed, seed + seeds)


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class FrictionTables(Result):
    """The tables of Zhang, Hu and Zou (2021) on joint friction, with our results beside theirs.

    Attributes:
        product: the numbers.

    Example:
        >>> import symid
        >>> tables = symid.study_friction_tables(seeds=2)  # doctest: +SKIP
        >>> tables.save("tables.html")  # doctest: +SKIP
    """

    product: "FrictionStudy"

    def save(self, path: str | PathLike[str]) -> Path:
        """Write one page with all tables and figures to `path`, and return the path.

        Raises:
            OutputError: the file cannot be written.
        """
        return report.write_page(Path(path), report.build_friction_study_page(self.product))

    def summarise(self) -> str:
        """Return the number of claims that are met."""
        judged = [check.met for check in self.product.checks if check.met is not None]
        return f"friction tables: {sum(judged)} of {len(judged)} claims met"

    def blocks(self) -> "tuple[Block, ...]":
        """Return all tables, and the claims."""
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
    """Return the tables of a paper on joint friction, with our results beside theirs.

    Args:
        seeds: number of noise draws, at least two; some tables use fewer.
        seed: the first one.
        jobs: number of processes; one for each core by default. A script starts them below `if __name__ ==
            "__main__":`.
        timed: measure the time of each estimator, which differs from run to run.
        progress: called with a short text at each stage, and with the number of finished tasks.

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


def study_foreign(
    *,
    arm: str = "2r",
    truths: Sequence[str] = (),
    sizes: Sequence[float] = (1.0,),
    seeds: int = 3,
    seed: int = 1,
    jobs: int | None = None,
    share: float = 1.0,
    progress: Progress = ignore,
) -> "Study[ForeignStudy]":
    """Compare the methods for elastic joints on arms with hidden models that are not those of symid.

    The arms are simulated by code of their own, with Bouc-Wen springs, LuGre friction, torque ripple and
    others. Each truth takes half a minute, and each draw of its noise as much again.

    Args:
        arm: "2r", planar, or "3r", spatial.
        truths: names of hidden models; all if empty.
        sizes: factors of what is foreign in them.
        seeds: draws of the noise.
        seed: the first one.
        jobs: number of processes; one for each core by default. A script starts them below `if __name__ ==
            "__main__":`.
        share: of the full length of the logs.
        progress: called with the number of finished tasks.

    Raises:
        UsageError: an unknown arm or truth, a size or a share out of range.

    Example:
        >>> import symid
        >>> symid.study_foreign(truths=["rust"])
        Traceback (most recent call last):
        symid.errors.UsageError: unknown truth 'rust': choose from family, bouc-wen, asymmetric-bouc-wen, ...
    """
    from symid.study import TRUTHS, study_foreign

    numbers = list_seeds(seeds, seed)
    found = study_foreign(
        numbers,
        report.judge_fit,
        arm=arm,
        truths=tuple(truths) or tuple(TRUTHS),
        sizes=sizes,
        share=share,
        jobs=jobs,
        progress=report_count(progress),
    )
    return Study(
        title=f"hidden models of {found.arm}",
        product=found,
        tables=report.show_foreign(found),
        described={**describe_record(found), "seeds": list(numbers)},
    )
