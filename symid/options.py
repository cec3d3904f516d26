# ruff: noqa: RUF009  `option` makes a field, which no record shares
"""Options of a procedure as a record: each field says its unit, its limits, and what the command line shows.

Record class -> checks, and the options of the command line; values -> record, all mistakes at once.

    class MoveOptions(Options):         # a frozen dataclass with slots
        speed: float = option(1.0, "Speed of the tool.", METHOD, number(above=0.0), "M/S")

A call of the API takes what is used every day as keywords, and the record for the rest; see `merge`.

Supported: numbers with limits, whole numbers, words of a list, flags, texts, files, and tuples of these.
Not supported: rules on several fields at once; those are checked where the fields are used.
Loads nothing heavy: the command line reads the records before it knows what to do.
"""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import Field, dataclass, field, fields, replace
from os import PathLike
from typing import Any, Literal, TypeAlias, TypeVar

from symid.errors import Notice, UsageError
from symid.notation import HYSTERESIS_MODELS

INPUT, PROCESSING, MODEL, METHOD, OUTPUT = "Input", "Processing", "Model", "Method", "Output"
"""Headings in the help of a verb."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """What the values of an option are; None is accepted where it is the default.

    Args:
        name: "number", "whole", "words", "flag", "text", "file", "identifier", or "numbers": a list, one for
            each joint.
        least, most: limits of a number. open: the least is refused itself.
        words: allowed ones. beside: what the command line takes as well, for another procedure.
        many: a tuple of such values; the command line takes the option several times.
    """

    name: str
    least: float = -math.inf
    most: float = math.inf
    open: bool = False
    words: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()
    many: bool = False

    def describe_mistake(self, value: object) -> str:
        """Return what was expected in place of `value`; empty if it is accepted."""
        if self.many:
            each = replace(self, many=False)
            return next(filter(None, map(each.describe_mistake, value)), "")  # type: ignore[call-overload]  # a tuple
        match self.name:
            case "number" | "percent":
                number = hasattr(value, "__float__") and not isinstance(value, bool)
                if number and math.isfinite(value) and self._is_within(value):  # type: ignore[arg-type]  # a number
                    return ""
                limit = f"above {self.least:g}" if self.open else f"of {self.least:g} or more"
                limit += f", {self.most:g} at most" if self.most < math.inf else ""
                return f"a finite number{f' {limit}' if self.least > -math.inf else ''}"
            case "whole":
                whole = hasattr(value, "__index__") and not isinstance(value, bool)
                good = whole and self._is_within(value)  # type: ignore[arg-type]  # a whole number
                return "" if good else f"a whole number of {self.least:g} or more"
            case "words":
                return "" if value in self.words else f"one of {', '.join(map(repr, self.words))}"
            case "identifier":
                good = isinstance(value, str) and bool(re.fullmatch(r"[A-Za-z]\w*", value, re.ASCII))
                return "" if good else "letters, digits and underscores, with a letter first, such as tool_a"
            case "numbers":
                good = isinstance(value, tuple) and all(isinstance(entry, int | float) for entry in value)
                return "" if good else "a list of numbers, one a joint"
        return ""

    def _is_within(self, value: float) -> bool:
        return (self.least < value if self.open else self.least <= value) and value <= self.most


def number(
    least: float = -math.inf, most: float = math.inf, *, above: float | None = None, many: bool = False
) -> Kind:
    """Return the kind of finite numbers from `least`, or above `above`, to `most`."""
    first = least if above is None else above
    return Kind(name="number", least=first, most=most, open=above is not None, many=many)


def whole(least: int = 0) -> Kind:
    """Return the kind of whole numbers from `least`."""
    return Kind(name="whole", least=least)


def words(*allowed: str, beside: Sequence[str] = ()) -> Kind:
    """Return the kind of words of a list."""
    return Kind(name="words", words=allowed, beside=tuple(beside))


FLAG, TEXT, FILE, NUMBERS = (Kind(name=name) for name in ("flag", "text", "file", "numbers"))
FOUND = Kind(name="file", words=("exists",))
"""A file that the command line refuses where it does not exist."""
ABOVE, NOT_BELOW = number(above=0.0), number(0.0)


def check_value(name: str, value: object, kind: Kind) -> None:
    """Refuse an argument that is not of its kind by a UsageError; None is accepted."""
    expected = "" if value is None else kind.describe_mistake(value)
    if expected:
        raise UsageError(Notice(code="usage.range", text=f"{name}={value!r}: expected {expected}"))


@dataclass(frozen=True, slots=True, kw_only=True)
class Option:
    """What a field of a record is.

    Args:
        meaning: text in the help. group: its heading. metavar: the name of its value in the help.
        flag: name on the command line; empty where that has no such option, None for that of the field.
        shown: whether the help shows the default.
        code: of the notice that refuses a value.
    """

    meaning: str
    group: str
    kind: Kind
    metavar: str | None = None
    flag: str | None = None
    shown: bool = True
    code: str = "usage.range"

    def name_flag(self, name: str) -> str:
        """Return the name on the command line of the field called `name`."""
        return f"--{name.replace('_', '-')}" if self.flag is None else self.flag


Value: TypeAlias = Any
"""What a field of a record holds; the record says its type."""


def option(
    default: Value, meaning: str, group: str, kind: Kind, metavar: str | None = None, **more: Value
) -> Value:
    """Return a field of a record; `more` are `flag`, `shown` and `code` of `Option`."""
    about = Option(meaning=meaning, group=group, kind=kind, metavar=metavar, **more)
    return field(default=default, metadata={"option": about})


def _below(group: str) -> Callable[..., Value]:
    """Return what makes fields below a heading, as `option` without its `group`."""

    def build(default: Value, meaning: str, kind: Kind, metavar: str | None = None, **more: Value) -> Value:
        return option(default, meaning, group, kind, metavar, **more)

    return build


_input, _processing, _model, _method, _output = map(_below, (INPUT, PROCESSING, MODEL, METHOD, OUTPUT))


def inner(default: Value, meaning: str, kind: Kind = TEXT, **more: Value) -> Value:
    """Return a field of a record that the command line does not have."""
    return option(default, meaning, "", kind, flag="", **more)


def share(record: "type[Options]", name: str) -> Value:
    """Return the field of another record."""
    entry = record.__dataclass_fields__[name]
    return field(default=entry.default, metadata=entry.metadata)


def list_options(record: "type[Options]") -> dict[str, Option]:
    """Return the options of a record by the names of its fields, in their order."""
    return {entry.name: entry.metadata["option"] for entry in fields(record)}


def list_flags(record: "type[Options]") -> dict[str, str]:
    """Return the fields of a record by names of the command line, as in {"period": "control_period"}."""
    flags = {name: entry.name_flag(name) for name, entry in list_options(record).items()}
    return {flag.removeprefix("--").replace("-", "_"): name for name, flag in flags.items() if flag}


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Options of a procedure; its fields are made with `option`."""

    def __init_subclass__(cls) -> None:
        """List the fields with their meanings in the docstring, before its example."""
        own = {name: entry for name, entry in vars(cls).items() if isinstance(entry, Field)}
        # A class with slots is made twice; the second time its fields are gone and the text is there.
        if own and cls.__doc__:
            entries = {**getattr(cls, "__dataclass_fields__", {}), **own}.items()
            listed = "".join(f"        {name}: {_explain(entry)}\n" for name, entry in entries)
            text, mark, example = cls.__doc__.partition("\n    Example:")
            cls.__doc__ = f"{text.rstrip()}\n\n    Attributes:\n{listed}{mark}{example}"

    def __post_init__(self) -> None:
        """Turn numbers of NumPy into Python's own and lists into tuples; refuse wrong values, all at once."""
        mistakes = []
        for entry in fields(self):
            given = getattr(self, entry.name)
            about: Option = entry.metadata["option"]
            kind = about.kind
            value = given.tolist() if hasattr(given, "tolist") else given
            if kind.many and isinstance(value, int | float | str):
                value = (value,)
            listed = kind.many or kind.name == "numbers"
            if listed and isinstance(value, Sequence) and not isinstance(value, str):
                value = tuple(part.tolist() if hasattr(part, "tolist") else part for part in value)
            if value is not given:
                object.__setattr__(self, entry.name, value)
            expected = "" if value is None and entry.default is None else kind.describe_mistake(value)
            if expected:
                text = f"{entry.name}={value!r}: expected {expected}"
                mistakes.append(Notice(code=about.code, text=text))
        if mistakes:
            raise UsageError(*mistakes)


_UNITS = {"HZ": "Hz", "RAD/S": "rad/s", "RAD": "rad or m", "MB": "MB", "KG": "kg", "S": "s"}


def _explain(entry: "Field[Any]") -> str:
    """Return what a field means, with its unit or its words, if it has any."""
    about: Option = entry.metadata["option"]
    text = " ".join(about.meaning.split())
    if about.kind.name == "words":
        text += f" One of {', '.join(about.kind.words)}."
    unit = _UNITS.get(about.metavar or "")
    return text if unit is None or f" {unit}." in text or f"({unit})" in text else f"{text} In {unit}."


R = TypeVar("R", bound=Options)


def merge(options: R | None, default: R, **given: object) -> R:
    """Return options with the keywords that a call was given; None stands for one that was not."""
    return replace(options or default, **{name: value for name, value in given.items() if value is not None})


_UNSTATED = "where the robot file states none"


@dataclass(frozen=True, slots=True, kw_only=True)
class ExciteOptions(Options):
    """Options of `RobotModel.excite`: what is searched for, within which limits, with how much effort.

    Example:
        >>> import symid
        >>> symid.ExciteOptions(jerk=200.0).velocity
        2.0
    """

    harmonics: int = _method(5, "Number of harmonics of each joint.", whole(1), "N")
    period: float = _method(10.0, "Length of the trajectory, s.", ABOVE, "S")
    criterion: Literal["condition", "d-optimal"] = _method(
        "condition",
        "Minimise the condition number of the column-scaled regressor, or maximise the information.",
        words("condition", "d-optimal"),
    )
    weight: float = _method(
        0.1, "Weight of the information; the condition number alone favours tiny motions.", NOT_BELOW
    )
    moving: bool = _method(False, "Let it start and end in motion instead of at rest.", FLAG)
    start: Sequence[float] | None = _method(
        None, "Pose at the start and at the end, rad or m.", NUMBERS, "Q1,Q2,..."
    )
    share: float = _model(0.95, "Part of every limit that may be used.", number(above=0.0, most=1.0))
    sweep: float = _model(1.0, f"Position limit on either side of zero {_UNSTATED}, rad or m.", ABOVE)
    velocity: float = _model(2.0, f"Velocity limit {_UNSTATED}, rad/s or m/s.", ABOVE)
    acceleration: float = _model(10.0, f"Acceleration limit {_UNSTATED}, rad/s^2 or m/s^2.", ABOVE)
    jerk: float | None = _model(None, f"Jerk limit {_UNSTATED}, rad/s^3 or m/s^3.  [default: none]", ABOVE)
    workspace: str | PathLike[str] | None = _input(
        None, "File (.toml) of spheres and planes that bound the links.", FOUND, "FILE"
    )
    torsion: float | None = _model(None, "Largest torsion of elastic joints, rad or m.", ABOVE, "RAD")
    stiffness: Sequence[float] | None = _model(
        None,
        "Stiffness of all joints for --torsion; replaces that of the robot file, N m/rad or N/m.",
        NUMBERS,
        "K1,K2,...",
    )
    deviations: Sequence[float] | None = _method(
        None,
        "Standard deviations of the torque noise, one a joint, N m or N.  [default: all equal]",
        NUMBERS,
        "S1,S2,...",
    )
    candidates: int = _method(
        1000, "Number of random feasible trajectories to start from and to compare with.", whole(1), "N"
    )
    starts: int = _method(10, "Number of candidates that are optimised.", whole(1), "N")
    seed: int = _method(1, "Random seed.", whole(), "N")


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulateOptions(Options):
    """Options of `RobotModel.simulate`: the motion, the sensors, the control.

    Example:
        >>> import symid
        >>> options = symid.SimulateOptions(control_period=0.002)
        >>> symid.load("two_link").simulate("ta", duration=0.5, options=options).q.shape
        (251, 2)
    """

    scale: float = _method(
        1.0, "Factor on the trajectory's amplitudes.", ABOVE, "FACTOR", code="usage.trajectory-scale"
    )
    joint: int = _method(1, "Number of the joint that tb moves, without mimic joints.", whole(1))
    duration: float | None = _method(
        None,
        "Length of the experiment, s.  [default: that of the trajectory]",
        ABOVE,
        "S",
        code="usage.trajectory",
    )
    noise: float | None = _model(
        None,
        "Standard deviation of the torque sensors, N m or N.  [default: 0.05; of an elastic robot 2 % "
        "of each joint's RMS torque]",
        NOT_BELOW,
        "N",
    )
    clean: bool = _model(False, "Simulate perfect sensors: no noise, no encoder steps.", FLAG)
    delay: float = _model(
        0.0,
        "Elastic robots only: delay of the link encoders relative to the motor encoders, s.",
        number(),
        "S",
        shown=False,
    )
    offset: float = _model(
        0.0,
        "Elastic robots only: reading of the link encoders at zero, rad or m.",
        number(),
        "RAD",
        shown=False,
    )
    bandwidth: float | None = _method(
        None,
        "Bandwidth of the gains, Hz.  [default: 12, or less where the loops would not be stable; the gains "
        "of the robot file]",
        ABOVE,
        "HZ",
    )
    control_period: float | None = _method(
        None,
        "Period of control and log, s.  [default: 0.001; of an elastic robot with --clean 0.0002]",
        ABOVE,
        "S",
        flag="--period",
    )
    stiffness: Sequence[float] | None = _method(
        None, "Own position gains, N m/rad or N/m; with --damping.", NUMBERS, "K1,K2,..."
    )
    damping: Sequence[float] | None = _method(
        None, "Own velocity gains, N m s/rad or N s/m.", NUMBERS, "D1,D2,..."
    )
    seed: int = _method(1, "Random seed.", whole(), "N")


Precision = Literal["double", "float"]
"""Type of the numbers in C."""
Target = Literal["c", "python", "casadi", "js"]


@dataclass(frozen=True, slots=True, kw_only=True)
class GenerateOptions(Options):
    """All that fixes generated code besides the robot."""

    target: Target = _output(
        "c",
        "What to write: a C library, a module of NumPy or JavaScript, or CasADi functions, their C and a "
        "loader.",
        words("c", "python", "casadi", "js"),
        code="usage.target",
    )
    precision: Precision = _output(
        "double", "Type of all numbers in C.", words("double", "float"), code="usage.precision"
    )
    parameters: Literal["base", "standard", "internal"] = _model(
        "base",
        "Arguments of the functions: base parameters beta, all standard parameters pi about the frames of "
        "the robot file, or pi_internal about symid's own frames.",
        words("base", "standard", "internal"),
        code="usage.parameters",
    )
    constant: bool = _model(False, "Use the robot file's values as constants in the functions.", FLAG)
    trigonometry: Literal["own", "library"] = _output(
        "own",
        "Sines in C: own code for all angles at once, or calls of the C library.",
        words("own", "library"),
        code="usage.trigonometry",
    )
    functions: tuple[str, ...] | None = _output(
        None,
        "Write only this function; may be repeated.",
        Kind(name="text", many=True),
        "NAME",
        flag="--function",
    )
    friction_laws: bool = _output(False, "Add all static friction laws to the C library.", FLAG)
    states: int = inner(100, "Number of random states in the self-test.", whole(1), code="usage.states")
    seed: int = inner(1, "Of the generator that draws them.", whole())

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            UsageError: a value that is not offered, or that the target does not have.
        """
        Options.__post_init__(self)
        if self.functions == ():
            text = "functions: no name given; name at least one, or leave the option out for all"
            raise UsageError(Notice(code="usage.functions", text=text))
        if self.target == "c":
            return
        if self.friction_laws:
            text = f"friction laws are written in C only; leave them out for target {self.target!r}"
            raise UsageError(Notice(code="usage.friction-laws", text=text))
        plain = {"precision": "double", "trigonometry": "own"}
        given = [key for key, value in plain.items() if getattr(self, key) != value]
        if given:
            text = f"{', '.join(given)}: only C has the choice; leave it out for target {self.target!r}"
            raise UsageError(Notice(code="usage.precision", text=text))


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportOptions(Options):
    """Options of `Fit.export`."""

    precision: Precision = _output(
        "double",
        "Type of the numbers in a C header: that of the generated library.",
        words("double", "float"),
        code="usage.export-precision",
    )
    name: str | None = _output(
        None,
        "In a C header: how its names begin, such as tool_a, so that one program can include several.  "
        "[default: that of the generated library]",
        Kind(name="identifier"),
        "NAME",
        code="usage.export-name",
    )
    accept: bool = _output(False, "Write the file although the verdict on ESTIMATE is wrong.", FLAG)
    limit: float | None = _output(
        None,
        "Percent of each joint's torque that the bodies may differ from ESTIMATE by, where none have its "
        "values; default: 2, or 0.14 times the held-out residual where that is more.",
        Kind(name="percent", least=0.0),
        "PERCENT",
    )
    ratio: float | None = _output(
        None,
        "Times that the torque of a joint may be larger or smaller than by the robot file's values, or "
        "larger than its limit.  [default: 3, and 1.5 for the limit]",
        number(1.0),
        "FACTOR",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class LogOptions(Options):
    """How logs are read, besides the map of the robot file."""

    sample_rate: float | None = _input(
        None, "Sample rate of logs without times; it replaces their times.", ABOVE, "HZ", shown=False
    )


_ROWS = ("torque", "momentum", "filtered", "power", "energy")


@dataclass(frozen=True, slots=True, kw_only=True)
class RigidOptions(Options):
    """Options of rows and estimators; None, or nothing, where not given. See `IdentifyOptions`."""

    rows: str | None = _method(
        None,
        "Equations built from measurements; friction: a friction law for every joint that moves.  "
        "[default: torque]",
        words(*_ROWS, beside=("friction",)),
        code="usage.unknown-rows",
    )
    estimator: str | None = _method(
        None,
        "Estimator of the parameters: ols, wls, filtered-instrumental, gls, huber, ridge, consistent, "
        "sequential, output-error or instrumental; with --rows friction varpro or nlp.  "
        "[default: chosen from the logs, varpro]",
        TEXT,
        "NAME",
    )
    partial: bool = _method(
        False, "Fit the identifiable parameters, even if they are less than three quarters of all.", FLAG
    )
    overlap: float | None = _method(
        None,
        "Momentum and energy equations: part of a window shared with the next one. [default: 0]",
        number(0.0, 0.95),
        "PART",
    )
    prior: object = _method(
        None,
        "Ridge: an earlier estimate as prior, or robot for the robot file's values.  [default: robot]",
        TEXT,
        "ESTIMATE",
    )
    prior_percent: float | None = _method(
        None,
        "Ridge: standard deviation of the prior, in percent of the robot file's values, or as a factor "
        "on an estimate's deviations.  [default: 20 %; 1]",
        ABOVE,
        "X",
        flag="--prior-deviation",
        code="usage.prior",
    )
    prior_factor: float | None = option(
        None,
        "Ridge: factor on the deviations of an estimate as prior; 1 by default.",
        "",
        ABOVE,
        flag="--prior-deviation",
        code="usage.prior",
    )
    prior_weight: float | None = _method(
        None,
        "Ridge: 1 to use the prior's deviations as stated, 0 for no prior.  [default: cross-validated]",
        NOT_BELOW,
        "W",
        code="usage.prior",
    )
    start: object = _method(
        None,
        "Output error and instrumental: an estimate of the same model as initial values.  [default: a "
        "fit of the same logs]",
        TEXT,
        "ESTIMATE",
    )
    period: tuple[float, ...] = _processing(
        (),
        "Period of a repeated motion (s), one for all logs or one for each: average over the periods "
        "(--rows friction), or use their differences as noise (--estimator gls).",
        number(above=0.0, many=True),
        "S",
    )
    window: float | None = _method(None, "Window of a momentum, filtered or energy equation (s).", ABOVE, "S")

    def list_given(self) -> tuple[str, ...]:
        """Return the options that were given, as the command line calls them, the windows' length apart."""
        known = list_options(RigidOptions)
        order = dict.fromkeys(("rows", "estimator", "period", "overlap", *known))
        given = (name for name in order if getattr(self, name) not in (None, (), False))
        return tuple(known[name].name_flag(name) for name in given if name != "window")


@dataclass(frozen=True, slots=True, kw_only=True)
class PayloadOptions(Options):
    """Options of `RobotModel.payload`."""

    joint: str | None = _model(
        None, "Joint of the link with the payload.  [default: the last joint]", TEXT, "NAME"
    )
    mass: float | None = _model(
        None, "Known mass, for example from a balance; it reduces the other uncertainties.", ABOVE, "KG"
    )
    rows: Literal["torque", "momentum"] = _method(
        "torque", "Equations built from logs: torques, or momentum over windows.", words("torque", "momentum")
    )
    estimator: Literal["ols", "wls"] = _method(
        "wls",
        "Least squares for logs: ordinary, or weighted by the noise of each joint.",
        words("ols", "wls"),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class HysteresisOptions(Options):
    """What a fit of an element with hysteresis is asked for."""

    model: str = _method("auto", "Model of the element.  [default: auto]", words("auto", *HYSTERESIS_MODELS))
    passive: bool | None = _method(None, "Only elements from which no motion gets work.", FLAG)

    def __post_init__(self) -> None:
        """Take names in any case and with underscores; raise a UsageError for a model that is none."""
        name = self.model.lower().replace("_", "-")
        if name not in {"auto", *HYSTERESIS_MODELS}:
            text = f"unknown hysteresis model {self.model!r}. Known: auto, {', '.join(HYSTERESIS_MODELS)}"
            raise UsageError(Notice(code="usage.unknown-hysteresis", text=text))
        object.__setattr__(self, "model", name)


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetOptions(Options):
    """Options of `symid.fleet.run`."""

    executor: Literal["serial", "processes", "dask"] | None = _method(
        None,
        "Where jobs run: in this process, in processes, or on Dask's workers.  [default: processes, or dask "
        "with --cluster]",
        words("serial", "processes", "dask"),
    )
    workers: int | None = _method(None, "Number of processes.  [default: one for each core]", whole(1), "N")
    cluster: str | None = _method(None, "Address of Dask's scheduler; local starts one.", TEXT, "ADDRESS")
    seconds: float | None = _method(None, "Seconds that a job may take.", ABOVE, "S", flag="--time-limit")
    megabytes: int | None = _method(
        None, "Memory for the data of one job.", whole(1), "MB", flag="--memory-limit"
    )
    again: bool = _method(False, "Run jobs again that crashed, or came to a limit.", FLAG)
    level: float = _method(0.05, "Share of false alarms among the alarms.", number(0.0, 1.0), "X")
    control: Literal["benjamini-hochberg", "holm"] = _method(
        "benjamini-hochberg",
        "How many comparisons are accounted for; holm: any false alarm is as rare as --level.",
        words("benjamini-hochberg", "holm"),
    )


Numbers = str | float | Sequence[float]
"""One number, several, or a text such as "1,2"."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DraftOptions(Options):
    """Options of `symid.new_robot`; its keywords win over them.

    Example:
        >>> import symid
        >>> symid.DraftOptions(gear=[100.0, 50.0]).gear
        [100.0, 50.0]
    """

    base: str | None = _input(
        None, "URDF, MJCF: the link at which the robot starts.  [default: its root]", TEXT, "LINK"
    )
    tip: str | None = _input(
        None, "URDF, MJCF: the link at which it ends; branches are cut off.", TEXT, "LINK"
    )
    convention: Literal["modified", "standard"] | None = _input(
        None, "DH convention of the table.", words("modified", "standard"), code="usage.call"
    )
    gravity: str | Sequence[float] | None = _input(
        None,
        "Gravity in the base frame, m/s^2, in place of the file's, or unknown: identify finds it.",
        TEXT,
        "X,Y,Z",
    )
    rotors: bool = _model(False, "Give every drive a rotor with unknown inertia.", FLAG)
    gear: Numbers | None = _model(
        None, "Motor turns per joint turn, one for each joint or one for all.", TEXT, "N,..."
    )
    torque_constant: Numbers | None = _model(
        None, "Torque constant at the motor, N m/A, one for each joint or one for all.", TEXT, "K,..."
    )
