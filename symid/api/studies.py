"""Studies: many identifications of simulated robots with a known truth, methods next to each other.

Robot, how many draws of the noise -> `Study`, or `FrictionTables` for those of a paper.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Generic, TypeVar, final

from symid.api.log import LogLike, take_one_log
from symid.api.result import Progress, Result, check_count, ignore
from symid.errors import Notice

if TYPE_CHECKING:
    from symid.api.robot import RobotModel
    from symid.report import Block
    from symid.study import (
        CutoffStudy,
        ElasticStudy,
        FrictionStudy,
        ManyJointsResult,
        PrecisionStudy,
        TrackingStudy,
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


def _report_count(progress: Progress) -> Callable[[int, int], None]:
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


def run_precision(model: "RobotModel", seeds: range, jobs: int | None) -> "Study[PrecisionStudy]":
    """Return errors over the Cramer-Rao bound; see `RobotModel.study_precision`."""
    from symid.report import show_precision
    from symid.study import study_precision

    robot = model.description
    # Made here, with its progress told, before processes look for it.
    _ = model.library
    found = study_precision(
        robot, seeds, backend=model.backend, jobs=jobs, progress=_report_count(model.progress)
    )
    return Study(
        title=f"precision of {robot.name}",
        product=found,
        tables=show_precision(found),
        described=asdict(found),
        told=robot.notices,
    )


def run_cutoff(model: "RobotModel", log: LogLike) -> "Study[CutoffStudy]":
    """Return what fits with different cut-offs predict; see `RobotModel.study_cutoff`."""
    from symid.identification.elastic import build_motor_recording, build_rigid_variant
    from symid.logs import read_one_log
    from symid.report import show_cutoff
    from symid.study import study_cutoff

    robot = model.description
    recording = read_one_log(take_one_log(log), robot)
    rigid = build_rigid_variant(robot) if model.elastic else robot
    library = replace(model, description=rigid).library
    measured = build_motor_recording(recording, robot)
    found = study_cutoff(library, measured, robot.processing, progress=_report_count(model.progress))
    return Study(
        title=f"cut-off of {robot.name}",
        product=found,
        tables=show_cutoff(found),
        described=asdict(found),
        told=(*robot.notices, *recording.notices, *library.notices),
    )


def run_elastic(model: "RobotModel", seeds: range, jobs: int | None, *, timed: bool) -> "Study[ElasticStudy]":
    """Return errors of all methods for elastic joints; see `RobotModel.study_elastic`."""
    from symid.report import describe_elastic_study, show_elastic_study
    from symid.study import study_elastic

    robot = model.description
    _ = model.library
    found = study_elastic(
        robot, seeds, backend=model.backend, jobs=jobs, timed=timed, progress=_report_count(model.progress)
    )
    return Study(
        title=f"methods for the elastic joints of {robot.name}",
        product=found,
        tables=show_elastic_study(found),
        described=describe_elastic_study(found, seeds),
    )


def run_tracking(model: "RobotModel", seeds: range, jobs: int | None) -> "Study[TrackingStudy]":
    """Return how links follow with identified models; see `RobotModel.study_tracking`."""
    from symid.report import show_tracking
    from symid.study import study_tracking

    robot = model.description
    _ = model.library
    found = study_tracking(
        robot, seeds, backend=model.backend, jobs=jobs, progress=_report_count(model.progress)
    )
    return Study(
        title=f"tracking of {robot.name}",
        product=found,
        tables=show_tracking(found),
        described=asdict(found),
    )


def run_six_joints(model: "RobotModel", seeds: range) -> "Study[tuple[ManyJointsResult, ...]]":
    """Return what methods leave of a held-out motion; see `RobotModel.study_six_joints`."""
    from symid.report import describe_many_joints, show_many_joints
    from symid.study import SensorCondition, study_many_joints

    robot, library = model.description, model.library
    found = tuple(
        study_many_joints(robot, library, condition, seed) for seed in seeds for condition in SensorCondition
    )
    return Study(
        title=f"dynamics of the elastic arm {robot.name}",
        product=found,
        tables=tuple(map(show_many_joints, found)),
        described={"runs": [describe_many_joints(result) for result in found]},
        told=tuple(dict.fromkeys(notice for result in found for notice in result.notices)),
    )


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
        from symid.report import write_friction_study_report

        return write_friction_study_report(Path(path), self.product)

    def summarise(self) -> str:
        """Return how many claims are met."""
        judged = [check.met for check in self.product.checks if check.met is not None]
        return f"friction tables: {sum(judged)} of {len(judged)} claims met"

    def blocks(self) -> "tuple[Block, ...]":
        """Return all tables, and what is asked of ours."""
        from symid.report import show_friction_tables

        return show_friction_tables(self.product)

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
        product=study_friction(numbers, jobs=jobs, timed=timed, progress=_report_count(progress))
    )
