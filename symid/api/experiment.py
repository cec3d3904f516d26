"""Experiments: an optimal trajectory, a simulated log, and studies of methods by many simulated logs.

Robot, options -> `ExcitedTrajectory`; robot with masses and friction, trajectory, sensors -> `Simulation`, a
log with known true parameters. Robot, number of noise draws -> `Study`, or `FrictionTables` for those of a
paper: identifications of simulated robots with known parameters.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, field
from os import PathLike
from pathlib import Path
from typing import Generic, TypeVar, final

from symid import excitation, report, robot as robots, study as studies
from symid.api.log import Log, Measurements
from symid.api.result import DrawnResult, PagedResult, Progress, RecordResult, Result, ignore
from symid.arrays import FloatArray
from symid.environment import report_count
from symid.errors import Notice
from symid.options import check_value, whole
from symid.serialization import HIDDEN, describe_record

T_co = TypeVar("T_co", covariant=True)


@final
class ExcitedTrajectory(RecordResult, DrawnResult, PagedResult, excitation.OptimisedExcitation):
    """A finite Fourier series of every joint, within all limits at all times.

    Attributes:
        robot: the robot.
        seed: of the random series at the start of the search.
        trajectory: the motion; `evaluate(times)` gives q, dq, ddq, each (N, n), rad or m, /s, /s^2.
        coefficients: the series (n, 2h + 1), rad or m: centre, h sines, h cosines of every joint.
        parameters: names of the regressor's columns.
        condition: the condition number of the torque regressor, its columns scaled to length one.
        information: mean logarithm of the information per parameter.
        random_condition: that of the best random series; `random_median` is the median of all of them, and
            `random_information` that of the most informative one.
        margins: the used part of every limit, and clearances in m.
        runs: the result of the search from every start, the best first.
        notices: warnings and notes on the robot, and on limits that its file does not state.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link")
        >>> found = robot.excite(harmonics=2, period=2.0, candidates=20, starts=1)
        >>> found.coefficients.shape, found.condition < found.random_condition
        ((2, 5), True)
        >>> robot.simulate(found.save("motion.csv", rate=100)).duration
        2.0
    """

    robot: "robots.Robot" = field(metadata=HIDDEN)
    seed: int = field(metadata=HIDDEN)
    notices: tuple[Notice, ...] = field(default=(), metadata=HIDDEN)

    def save(self, path: str | PathLike[str], *, rate: float = 1000.0, periods: int = 1) -> Path:
        """Write t, q, dq, ddq as a .csv that `RobotModel.simulate` follows; return its path.

        Args:
            path: an existing file is overwritten.
            rate: samples a second, Hz.
            periods: number of periods of the trajectory.

        Raises:
            OutputError: the suffix is not .csv, or the file cannot be written.
        """
        sizes, file = f"{self.condition:.4g}, best of random ones {self.random_condition:.4g}", Path(path)
        used = max(margin.share or 0.0 for margin in self.margins)
        remarks = (
            f"{self.robot.name}: {self.trajectory.source}, seed {self.seed}",
            f"condition number of the scaled regressor {sizes}",
            f"margin to every limit: at least {1.0 - used:.1%}",
        )
        excitation.write_trajectory(
            self.trajectory, file, self.robot, rate=rate, periods=periods, remarks=remarks
        )
        return file

    def count_samples(self, *, rate: float = 1000.0, periods: int = 1) -> int:
        """Return the number of samples that `save` writes with this `rate` in Hz and these `periods`."""
        return round(self.trajectory.duration * rate) * periods + 1

    def _build_page(self) -> "report.Page":
        return report.result_pages.build_excitation_page(self.robot, self)

    def _draw(self) -> "tuple[report.Drawing, ...]":
        return report.drawings.draw_excitation(self, self.robot)

    def summarise(self) -> str:
        """Return the robot, the series and its condition number."""
        return f"{self.robot.name}: {self.trajectory.source}; condition number {self.condition:.4g}"

    def blocks(self) -> "tuple[report.Block, ...]":
        """Return its condition number beside those of random series, and the used part of each limit."""
        return report.texts.show_excitation(self)

    def _describe(self) -> dict[str, object]:
        harmonics = (self.coefficients.shape[1] - 1) // 2
        return {
            "robot": self.robot.name,
            "trajectory": self.trajectory.source,
            "duration": self.trajectory.duration,
            "harmonics": harmonics,
            "seed": self.seed,
            "factor": self.factor,
            **describe_record(self),
            "joints": [
                {"name": joint.name, "centre": centre, "sines": row[:harmonics], "cosines": row[harmonics:]}
                for joint, (centre, *row) in zip(self.robot.axes, self.coefficients.tolist(), strict=True)
            ],
            "limits": [
                {
                    **describe_record(margin),
                    "share_percent": None if margin.share is None else 100.0 * margin.share,
                    "allowed_percent": 100.0 * margin.allowed,
                }
                for margin in self.margins
            ],
        }


@final
class Simulation(Measurements):
    """The measured log of a simulated robot.

    Attributes:
        robot: the robot.
        recording: the log, in SI units.
        trajectory: the reference, in words.
        duration: of the trajectory, s.
        seed: of all random numbers.
        energy_gap: error of the energy balance, relative to the work.
        backend: what computed the motion.
        details: noise, controller, largest torsions, in plain types.
        library_notices: warnings and notes on the compiled functions.

    Example:
        >>> import symid
        >>> run = symid.load("two_link").simulate("ta", duration=0.5, seed=1)
        >>> run.tau.shape, run.save("run.npz").name
        ((501, 2), 'run.npz')
    """

    trajectory: str
    duration: float
    seed: int
    energy_gap: float
    backend: str
    details: Mapping[str, object]
    library_notices: tuple[Notice, ...] = ()

    @property
    def log(self) -> Log:
        """Return the log, for `RobotModel.identify`."""
        return Log(recording=self.recording, robot=self.robot)

    @property
    def theta(self) -> FloatArray | None:
        """Return the motor positions (N, n) on the joint side, rad or m; None for a rigid robot."""
        return self.recording.motor_position

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return warnings and notes on the robot, its compiled functions and the log."""
        return (*self.robot.notices, *self.library_notices, *self.recording.notices)

    def summarise(self) -> str:
        """Return the number of samples, the trajectory, and the error of the energy balance."""
        return (
            f"{len(self.time)} samples of {self.trajectory}; "
            f"work, energy and losses agree to {self.energy_gap:.1e} of the work"
        )

    def blocks(self) -> "tuple[report.Block, ...]":
        """Return one line."""
        return (f"{self.robot.name}: {self.summarise()}",)

    def _describe(self) -> dict[str, object]:
        return {
            "robot": self.robot.name,
            "trajectory": self.trajectory,
            "samples": len(self.time),
            "period": self.recording.period,
            "duration": self.duration,
            "seed": self.seed,
            "energy_gap": self.energy_gap,
            "backend": self.backend,
            **self.details,
        }


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
    tables: "tuple[report.Block, ...]"
    described: Mapping[str, object]
    notices: tuple[Notice, ...] = ()

    def summarise(self) -> str:
        """Return the study and the robot."""
        return self.title

    def blocks(self) -> "tuple[report.Block, ...]":
        """Return its tables."""
        return self.tables

    def _describe(self) -> dict[str, object]:
        return dict(self.described)


def list_seeds(seeds: int, seed: int) -> range:
    """Return `seeds` consecutive seeds, starting with `seed`.

    Raises:
        UsageError: `seeds` is not positive, or `seed` is negative.
    """
    check_value("seeds", seeds, whole(1))
    check_value("seed", seed, whole())
    return range(seed, seed + seeds)


@final
class FrictionTables(Study["studies.FrictionStudy"]):
    """The tables of Zhang, Hu and Zou (2021) on joint friction, with our results beside theirs.

    Example:
        >>> import symid
        >>> tables = symid.study_friction_tables(seeds=2)  # doctest: +SKIP
        >>> tables.save("tables.html")  # doctest: +SKIP
    """

    def save(self, path: str | PathLike[str]) -> Path:
        """Write one page with all tables and figures to `path`, and return the path.

        Raises:
            OutputError: the file cannot be written.
        """
        return report.write_page(Path(path), report.study_text.build_friction_study_page(self.product))


def study_friction_tables(
    *,
    seeds: int = 1000,
    seed: int = 0,
    jobs: int | None = None,
    timed: bool = False,
    progress: Progress = ignore,
) -> FrictionTables:
    """Return the tables of a paper on joint friction, with our results beside theirs.

    `seeds` are draws of the noise, at least two; some tables use fewer. With `timed` the time of each
    estimator is measured, which differs from run to run. `seed` and `jobs` are those of
    `RobotModel.study_precision`; `progress` is called with the stage, and the number of finished tasks.

    Raises:
        UsageError: fewer than two draws.

    Example:
        >>> import symid
        >>> symid.study_friction_tables(seeds=1)
        Traceback (most recent call last):
        symid.errors.UsageError: 1 draw: a standard deviation over draws needs two or more
    """
    progress("all estimators on one data set")
    numbers = list_seeds(seeds, seed)
    found = studies.study_friction(numbers, jobs=jobs, timed=timed, progress=report_count(progress))
    met = [check.met for check in found.checks if check.met is not None]
    title = f"friction tables: {sum(met)} of {len(met)} claims met"
    tables = report.study_text.show_friction_tables(found)
    return FrictionTables(title=title, product=found, tables=tables, described=asdict(found))


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
) -> "Study[studies.foreign_truths.ForeignStudy]":
    """Compare the methods for elastic joints on arms with hidden models that are not those of symid.

    The arms are simulated by code of their own, with Bouc-Wen springs, LuGre friction, torque ripple and
    others. Each truth takes half a minute, and each draw of its noise as much again.

    The `arm` is "2r", planar, or "3r", spatial; `truths` are names of hidden models, all if empty, `sizes`
    factors of what is foreign in them, and `share` is that of the full length of the logs. `seeds`, `seed`
    and `jobs` are those of `RobotModel.study_precision`; `progress` is called with the number of finished
    tasks.

    Raises:
        UsageError: an unknown arm or truth, a size or a share out of range.

    Example:
        >>> import symid
        >>> symid.study_foreign(truths=["rust"])
        Traceback (most recent call last):
        symid.errors.UsageError: unknown truth 'rust': choose from family, bouc-wen, asymmetric-bouc-wen, ...
    """
    numbers = list_seeds(seeds, seed)
    found = studies.foreign_truths.study_foreign(
        numbers,
        report.judge_fit,
        arm=arm,
        truths=tuple(truths) or tuple(studies.foreign_truths.TRUTHS),
        sizes=sizes,
        share=share,
        jobs=jobs,
        progress=report_count(progress),
    )
    return Study(
        title=f"hidden models of {found.arm}",
        product=found,
        tables=report.study_text.show_foreign(found),
        described={**describe_record(found), "seeds": list(numbers)},
    )
