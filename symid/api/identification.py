"""Further results of identification: stiffness of joints, payload of a robot, the open one-shot problem.

`Stiffness`: joint by joint, with delay and offsets of encoders; `PayloadResult`: mass, centre of mass and
inertia, from fits or logs with the payload and without it; `OneShotProblem`: dynamics and springs of elastic
joints as expressions, whose methods return new problems; `OneShotSolution`: its optimum, values by name.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from math import inf
from os import PathLike, fspath
from pathlib import Path
from typing import Any, TypeAlias, final

import numpy as np

from symid import dynamics, identification, joint_models, report, robot as robots
from symid.api import hysteresis
from symid.api.dynamics import RobotDynamics
from symid.api.log import Log, Logged, LogLike
from symid.api.result import PagedResult, Result, SavedResult
from symid.arrays import FloatArray
from symid.errors import EstimateError, Notice
from symid.identification import elastic
from symid.notation import INERTIAL
from symid.serialization import describe_record

CasadiExpression: TypeAlias = Any
_FAR = 3.0
"""Deviations between the nearest body and least squares beyond which something else changed."""


@final
class Stiffness(PagedResult, SavedResult):
    """The stiffness of every joint with 95 % intervals, and delay and offsets of the encoders.

    Attributes:
        estimate: the full result.
        notices: warnings and notes on the robot, its logs and the result.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link_elastic")
        >>> found = robot.identify_stiffness(robot.simulate(duration=6.0, seed=1).log)
        >>> sorted(found.joints)
        ['elbow', 'shoulder']
    """

    estimate: "elastic.StiffnessEstimate"
    notices: tuple[Notice, ...] = ()

    @property
    def joints(self) -> "dict[str, elastic.JointStiffness]":
        """Return the result of every joint by its name."""
        return {entry.joint: entry for entry in self.estimate.joints}

    def _save(self, file: Path) -> Path:
        return identification.write_result("stiffness", self.estimate, file, {**self.to_dict(), "file": file})

    def _build_page(self) -> "report.Page":
        return report.result_pages.build_stiffness_page(self.estimate, self.notices)

    def summarise(self) -> str:
        """Return the joints with a stiffness."""
        names = [name for name, entry in self.joints.items() if entry.stiffness is not None]
        return f"{self.estimate.robot}: stiffness of {', '.join(names) or 'no joint'}"

    def blocks(self) -> "tuple[report.Block, ...]":
        """Return delay, offsets and stiffness."""
        return report.texts.show_stiffness(self.estimate)

    def _describe(self) -> dict[str, object]:
        return report.texts.describe_stiffness(self.estimate)


def load_stiffness(path: str | PathLike[str]) -> Stiffness:
    """Return the stiffness that `Stiffness.save` or `symid identify --method stiffness -o` wrote to `path`.

    Raises:
        EstimateError: there is no such file, or it holds something else; it names all mistakes.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link_elastic")
        >>> found = robot.identify_stiffness(robot.simulate(duration=6.0, seed=1).log)
        >>> symid.load_stiffness(found.save("stiffness.json")).to_dict() == found.to_dict()
        True
    """
    found = identification.read_stiffness(Path(fspath(path)))
    return Stiffness(estimate=found, notices=found.notices)


def load_other(path: str | PathLike[str]) -> "Stiffness | PayloadResult | hysteresis.ElementFit | None":
    """Return the stiffness of joints, payload or element with hysteresis that a file holds; None of others.

    Raises:
        EstimateError: it is one of them with mistakes; all are named.
    """
    file = Path(fspath(path))
    if identification.is_kind(file, "stiffness"):
        return load_stiffness(file)
    if identification.is_kind(file, "payload"):
        return load_payload(file)
    return hysteresis.load(file) if hysteresis.is_saved(file) else None


PayloadSide: TypeAlias = "identification.GivenResult | LogLike | Sequence[LogLike]"
"""One side: a fit or its file, or logs."""


@final
class PayloadResult(PagedResult, SavedResult):
    """The payload of a robot, in the link frame of the robot file; a physically consistent body.

    Attributes:
        product: the payload with standard deviations, and the quantities that are not identifiable.
        carrier: the robot, whose links name flanges; None where it is not known.

    Example:
        >>> import symid
        >>> from pathlib import Path
        >>> robot = symid.load("two_link")
        >>> heavy = robot.path.read_text().replace("mass = 1.9", "mass = 2.9")
        >>> Path("carrying.toml").write_text(heavy) == len(heavy)
        True
        >>> loaded = symid.load("carrying.toml").simulate(duration=4.0, seed=2).log
        >>> found = robot.payload(loaded, robot.simulate(duration=4.0, seed=1).log)
        >>> found.joint, round(found["mass"].value, 1)
        ('elbow', 1.0)
    """

    product: "identification.PayloadFinding"
    carrier: "robots.Robot | None" = None

    @property
    def payload(self) -> "dynamics.Payload":
        """Return the full result."""
        return self.product.payload

    @property
    def joint(self) -> str:
        """Return the joint whose link carries it."""
        return self.payload.joint

    def __getitem__(self, name: str) -> "dynamics.PayloadQuantity":
        """Return mass, cx, cy, cz, Jxx, Jxy, Jxz, Jyy, Jyz or Jzz, with deviation or reason."""
        return {entry.name: entry for entry in self.payload.quantities}[name]

    @property
    def mass(self) -> float:
        """Return the mass in kg."""
        return self._get_value("mass")

    @property
    def com(self) -> FloatArray:
        """Return the centre of mass in m: (3,), NaN where it is not identifiable."""
        return np.array([self._get_value(name) for name in ("cx", "cy", "cz")])

    @property
    def inertia(self) -> FloatArray:
        """Return the inertia about the centre of mass in kg m^2: (3, 3), NaN where it is not identifiable."""
        rows = (("Jxx", "Jxy", "Jxz"), ("Jxy", "Jyy", "Jyz"), ("Jxz", "Jyz", "Jzz"))
        return np.array([[self._get_value(name) for name in row] for row in rows])

    def _get_value(self, name: str) -> float:
        value = self[name].value
        return float("nan") if value is None else float(value)

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return warnings: quantities that are not identifiable, other changes between both sides."""
        found, texts = self.payload, dict[str, str]()
        refused = [entry.name for entry in found.quantities if entry.value is None]
        if refused:
            names = ", ".join(refused)
            texts["refused"] = f"not identifiable: {names}; do not enter guessed values in a controller"
        unexplained, friction = (
            ", ".join(
                f"{entry.name} from {entry.before:.4g} to {entry.after:.4g} ({entry.deviations:+.2g} std)"
                for entry in changes
            )
            for changes in (found.unexplained, found.friction)
        )
        if unexplained and found.doubtful:
            texts["other-changes"] = (
                f"base parameters changed as no payload explains: {unexplained}. Something else changed "
                "between the logs, or friction and filters bias one of them; use the same motions"
            )
        if friction:
            text = f"friction changed: {friction}; gear friction grows with load and falls with temperature"
            texts["friction-changed"] = text
        if found.moved > _FAR:
            texts["inconsistent"] = (
                f"the nearest physically consistent body is {found.moved:.2g} standard deviations away from "
                "the change of the base parameters: something else changed between the logs"
            )
        warnings = (Notice(code=f"payload.{code}", text=text) for code, text in texts.items())
        return tuple(dict.fromkeys((*self.product.notices, *warnings)))

    def _build_page(self) -> "report.Page":
        return report.result_pages.build_payload_page(self.product.robot, self.payload, self.notices)

    def summarise(self) -> str:
        """Return the mass and the link."""
        return f"{self.product.robot}: {self.mass:.4g} kg on the link of joint {self.joint!r}"

    def blocks(self) -> "tuple[report.Block, ...]":
        """Return the tables of identified and of refused quantities, with the reasons."""
        found = self.payload
        head = f"{self.product.robot}: payload on the link of joint {found.joint!r}\n"
        head += "in the link frame of the robot file; inertia about the centre of mass"
        rows = [(e.name, e.value, e.std, e.unit) for e in found.quantities if e.value is not None]
        refused = "\n".join(f"refused: {e.name}: {e.reason}" for e in found.quantities if e.value is None)
        large = f"standard deviations are multiplied by {found.scale:.3g}, because chi^2 is too large"
        texts = filter(None, (refused, large * (found.scale > 1.0)))
        return (head, report.Table(("quantity", "value", "std", "unit"), rows, (0, 3)), *texts)

    def _describe(self) -> dict[str, object]:
        values = {entry.name: entry.value for entry in self.payload.quantities}
        return {
            "robot": self.product.robot,
            **describe_record(self.payload),
            "mass": values["mass"],
            "com": [values[name] for name in ("cx", "cy", "cz")],
            "inertia": {name[1:]: value for name, value in values.items() if name.startswith("J")},
            "standard": dict(zip(INERTIAL, self.payload.standard.tolist(), strict=True)),
        }

    def for_controller(
        self, controller: str, frame: "identification.FlangeFrame" = None
    ) -> "identification.PayloadCommand":
        """Return the payload as a controller takes it, with the text to enter there.

        Args:
            controller: "ur" (URScript) or "franka" (libfranka, franka_ros2, end effector of Desk).
            frame: the flange of the controller: a link of the URDF, fixed to the one with the payload, or
                x, y, z, roll, pitch, yaw in the frame of that one (m, rad); by default that frame itself.

        Raises:
            UsageError: there is no such controller, link or frame.
            IdentifiabilityError: mass or centre of mass are not identified.
            EstimateError: the controller takes no such inertia.
        """
        return identification.build_payload_command(self.carrier, self.payload, controller, frame)

    def _save(self, file: Path) -> Path:
        return identification.write_result("payload", self.product, file, self.to_dict())


def load_payload(path: str | PathLike[str], robot: "RobotDynamics | None" = None) -> PayloadResult:
    """Return the payload that `PayloadResult.save` or `symid payload -o` wrote to `path`.

    The `robot` is the one that carries it; only `for_controller` with a link as flange needs it.

    Raises:
        EstimateError: there is no such file, or it holds something else, or a payload of another robot; it
            names all mistakes.

    Example:
        >>> import symid
        >>> symid.load_payload("payload.json")
        Traceback (most recent call last):
        symid.errors.EstimateError: payload.json: cannot be read: ...
    """
    found = identification.read_payload(Path(fspath(path)))
    if robot is not None and robot.name != found.robot:
        text = f"the payload is of the robot {found.robot!r}, not of {robot.name!r}"
        raise EstimateError(Notice(code="estimate.signature", text=text, file=str(path)))
    return PayloadResult(product=found, carrier=None if robot is None else robot.description)


def list_payload_side(side: PayloadSide) -> "identification.GivenSide":
    """Return one side of a payload: a fit, files or recordings."""
    entries = side if isinstance(side, Sequence) and not isinstance(side, str) else (side,)
    found = (entry.log if isinstance(entry, Logged) else entry for entry in entries)
    return tuple(entry.recording if isinstance(entry, Log) else entry for entry in found)


@final
class OneShotProblem(Result):
    """Dynamics, friction and springs of elastic joints in one problem, all of CasADi expressions (MX).

    Minimised is half the mean square of the residuals, in units of their noise, plus terms that are added.
    All quantities are in SI units.

    Attributes:
        robot: the robot.
        graph: the problem itself.
        remarks: notices on the robot and its logs.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link_elastic")
        >>> problem = robot.one_shot(robot.simulate(duration=4.0, seed=1).log)
        >>> list(problem.variables)[:3], problem.cost.shape
        (['ZZR1', 'MXR1', 'MY1'], (1, 1))
        >>> larger = problem.add_variable("kc", lower=0.0)
        >>> larger = larger.add_torque("elbow", lambda motion: larger["kc"] * motion.phi**3)
        >>> solution = larger.solve()
        >>> solution["kc"] >= 0.0
        True
    """

    robot: RobotDynamics
    graph: "elastic.nlp.NlpGraph"
    remarks: tuple[Notice, ...] = ()

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return the notices on the robot and its logs."""
        return self.remarks

    @property
    def variables(self) -> Mapping[str, Any]:
        """Return the unknowns by name, symbols: parameters, weights and slopes of springs, those added."""
        return {name: entry.symbol for name, entry in self.graph.variables.items()}

    @property
    def cost(self) -> CasadiExpression:
        """Return what is minimised, an expression (1, 1)."""
        return self.graph.cost

    @property
    def constraints(self) -> tuple[tuple[float, Any, float], ...]:
        """Return the constraints that were added: lower limit, expression, upper limit."""
        return self.graph.constraints

    @property
    def rows(self) -> int:
        """Return the number of rows M: a term ((x - z) / s)^2 / (2 M) counts as a measurement z +- s of x."""
        return self.graph.rows

    def __getitem__(self, name: str) -> CasadiExpression:
        """Return the symbol of the variable called `name`.

        Raises:
            UsageError: there is none; the message gives the nearest names.
        """
        return elastic.nlp.get_variable(self.graph, name)

    def add_variable(
        self, name: str, *, start: float = 0.0, lower: float = -inf, upper: float = inf
    ) -> "OneShotProblem":
        """Return the problem with a further unknown.

        Args:
            name: not that of another variable.
            start: where the search begins, in SI units.
            lower: its lower bound.
            upper: its upper bound.

        Raises:
            UsageError: the name is taken, or the start is not between the bounds.
        """
        return replace(self, graph=elastic.nlp.add_variable(self.graph, name, start, lower, upper))

    def add_torque(
        self, joint: str, torque: "Callable[[elastic.nlp.ElasticMotion], Any]", *, side: str = "spring"
    ) -> "OneShotProblem":
        """Return the problem with a further torque in a joint, parallel to its spring or to motor friction.

        Args:
            joint: its name.
            torque: a function of the joint's motion along a log, with `q`, `dq`, `theta`, `dtheta`, `phi`,
                `dphi` and `play(threshold)`, (N, 1) each; returns the torque (N, 1), N m or N.
            side: "spring", positive where it pulls the link along, or "motor", positive where it brakes.

        Raises:
            UsageError: no such joint or side; not one number a sample; symbols that are no variables.
        """
        return replace(self, graph=elastic.nlp.add_torque(self.graph, joint, torque, side))

    def add_term(self, term: CasadiExpression) -> "OneShotProblem":
        """Return the problem with `term`, a scalar expression of its variables, added to the cost.

        Raises:
            UsageError: not a scalar, or with symbols that are no variables.
        """
        return replace(self, graph=elastic.nlp.add_term(self.graph, term))

    def add_constraint(
        self, expression: CasadiExpression, *, lower: float = -inf, upper: float = inf
    ) -> "OneShotProblem":
        """Return the problem with the constraint lower <= expression <= upper.

        Args:
            expression: a scalar expression of the variables.
            lower: its lower limit.
            upper: its upper limit; the same as the lower one for an equation.

        Raises:
            UsageError: no limit, not a scalar, or with symbols that are no variables.
        """
        return replace(self, graph=elastic.nlp.add_constraint(self.graph, expression, lower, upper))

    def solve(self) -> "OneShotSolution":
        """Return the optimum next to where the variables start.

        Raises:
            SolverError: the constraints contradict each other, or Ipopt gives no usable numbers.
        """
        return OneShotSolution(problem=self, answer=elastic.nlp.solve_nlp_graph(self.graph))

    def summarise(self) -> str:
        """Return robot and sizes."""
        sizes = f"{len(self.graph.variables)} variables, {self.rows} rows"
        return f"{self.robot.name}: {sizes}, {len(self.graph.constraints)} added constraints"

    def blocks(self) -> "tuple[report.Block, ...]":
        """Return the sizes and the table of variables."""
        rows = [(name, one.start, one.lower, one.upper) for name, one in self.graph.variables.items()]
        return (self.summarise(), report.Table(("variable", "start", "lower", "upper"), rows))

    def _describe(self) -> dict[str, object]:
        bounds = [
            {"name": name, "start": one.start, "lower": one.lower, "upper": one.upper}
            for name, one in self.graph.variables.items()
        ]
        return {"robot": self.robot.name, "rows": self.rows, "variables": bounds}


@final
class OneShotSolution(Result):
    """The optimum of a one-shot problem, values by name in SI units.

    Attributes:
        problem: what was solved.
        answer: values, objective, how the search ended.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link_elastic")
        >>> problem = robot.one_shot(robot.simulate(duration=4.0, seed=1).log)
        >>> solution = problem.add_constraint(problem["IA1"], upper=0.2).solve()
        >>> solution.active, solution["IA1"] <= 0.2
        ((True,), True)
    """

    problem: OneShotProblem
    answer: "elastic.nlp.NlpAnswer"

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return those of the problem, and a warning where the search did not converge."""
        if self.converged:
            return self.problem.notices
        text = f"nlp did not converge: {self.answer.reason}; its last point may be far off, try other methods"
        return (*self.problem.notices, Notice(code="elastic.nlp-not-converged", text=text))

    @property
    def converged(self) -> bool:
        """Return whether the search ended at an optimum."""
        return self.answer.outcome.converged

    @property
    def values(self) -> Mapping[str, float]:
        """Return the values of all variables by name."""
        return self.answer.values

    @property
    def objective(self) -> float:
        """Return the cost at the optimum."""
        return self.answer.objective

    @property
    def active(self) -> tuple[bool, ...]:
        """Return which of the added constraints are at a limit, in their order."""
        return self.answer.active

    @property
    def springs(self) -> "Mapping[str, joint_models.Elasticity]":
        """Return the spring of every joint by its name, without torques that were added."""
        return dict(zip(self.problem.graph.joints, self.answer.springs, strict=True))

    def __getitem__(self, name: str) -> float:
        """Return the value of the variable called `name`.

        Raises:
            UsageError: there is none; the message gives the nearest names.
        """
        elastic.nlp.get_variable(self.problem.graph, name)
        return self.answer.values[name]

    def summarise(self) -> str:
        """Return robot, outcome and cost."""
        return f"{self.problem.robot.name}: {self.answer.outcome.value}, cost {self.objective:.6g}"

    def blocks(self) -> "tuple[report.Block, ...]":
        """Return the outcome, the table of values, and the added constraints."""
        values = report.Table(("variable", "value"), list(self.values.items()))
        if not self.active:
            return self.summarise(), values
        tried = zip(self.problem.constraints, self.answer.levels, self.active, strict=True)
        rows = [
            (number, lower, level, upper, "yes" if active else "no")
            for number, ((lower, _, upper), level, active) in enumerate(tried, start=1)
        ]
        header = ("constraint", "lower", "value", "upper", "active")
        return self.summarise(), values, report.Table(header, rows)

    def _describe(self) -> dict[str, object]:
        tried = zip(self.answer.levels, self.active, strict=True)
        return {
            "robot": self.problem.robot.name,
            "outcome": self.answer.outcome.name.lower(),
            "reason": self.answer.reason,
            "cost": self.objective,
            "values": dict(self.values),
            "constraints": [{"value": level, "active": active} for level, active in tried],
        }
