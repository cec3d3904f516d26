# ruff: noqa: RUF009  `option` makes a field, which no record shares
"""Options of identification: base parameters and springs, or laws of friction; loads nothing heavy.

Everything that is not given is None, so that options that belong to another model can be refused.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from symid.identification.elastic import METHODS, ElasticOptions, NlpOptions
from symid.options import (
    ABOVE,
    FILE,
    METHOD,
    MODEL,
    NOT_BELOW,
    PROCESSING,
    TEXT,
    Options,
    RigidOptions,
    inner,
    list_options,
    option,
    share,
    whole,
    words,
)

if TYPE_CHECKING:
    from symid.identification.friction import FrictionOptions
    from symid.identification.stored import GivenResult
    from symid.robot import Robot


class Described(Protocol):
    """An object with a robot, such as a `RobotModel`."""

    @property
    def description(self) -> "Robot":
        """Return the robot."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifyOptions(RigidOptions):
    """Options of `RobotModel.identify`; its keywords win over them.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link")
        >>> options = symid.IdentifyOptions(prior_percent=10.0, prior_weight=1.0)
        >>> len(robot.identify(robot.simulate(seed=1).log, estimator="ridge", options=options))
        12
    """

    prior: "GivenResult | None" = share(RigidOptions, "prior")
    start: "GivenResult | None" = share(RigidOptions, "start")
    cutoff: float | None = option(
        None, "Cut-off frequency of the low-pass filter.", PROCESSING, ABOVE, "HZ", code="usage.bad-setting"
    )
    decimate: int | None = option(None, "Keep one sample in N.", PROCESSING, whole(1), "N")
    drop_first: int | None = option(None, "Number of samples cut off at the start.", PROCESSING, whole(), "N")
    drop_last: int | None = option(None, "Number of samples cut off at the end.", PROCESSING, whole(), "N")
    friction: str | Mapping[str, str] | None = inner(
        None, "The friction law of all joints or of single ones, as for `identify`."
    )
    method: str | None = option(
        None,
        "Elastic joints: the method; stiffness works for any robot.  [default: automatic]",
        METHOD,
        words(*METHODS, beside=("stiffness",)),
        code="usage.elastic-option",
    )
    tolerance: float | None = option(
        None, "Elastic joints: relative change at which an iteration stops.", METHOD, ABOVE
    )
    rate: float | None = option(
        None,
        "Elastic joints: corner frequency of the first-order filter.",
        METHOD,
        ABOVE,
        "RAD/S",
        flag="--lambda",
    )
    threshold_count: int | None = option(
        None,
        "Elastic joints: number of stops of each joint's hysteresis.",
        MODEL,
        whole(),
        "N",
        flag="--thresholds",
    )
    knee_count: int | None = option(
        None, "Elastic joints: number of knees on each side of a spring.", MODEL, whole(), "N", flag="--knees"
    )
    known: "GivenResult | Robot | Described | Mapping[str, float] | None" = option(
        None,
        "With --rows friction or elastic joints: base parameters that are not identified, of an estimate or "
        "of a robot file with values.  [default: they are fitted too]",
        MODEL,
        FILE,
        "FILE",
    )
    thresholds: tuple[tuple[float, ...], ...] | None = inner(
        None, "Elastic joints: places of the stops, one tuple a joint, rad or m, in place of a grid."
    )
    knee_torques: tuple[tuple[float, ...], ...] | None = inner(
        None, "Elastic joints: places of the knees, one tuple a joint of signed torques, N m or N."
    )
    refine: bool | None = inner(None, "Elastic joints: whether places on a grid are optimised.")
    iterations: int | None = inner(None, "Elastic joints: of an iteration, at most.")
    nlp: NlpOptions | None = inner(None, "Of the method nlp.")
    effects: bool | None = inner(
        None, "Elastic joints: whether to find what drives, gears and encoders add, and to take it off."
    )

    def list_elastic(self) -> list[str]:
        """Return the options of elastic joints alone that were given, as the command line calls them."""
        flags = list_options(IdentifyOptions)
        given = [name for name in _ELASTIC if getattr(self, name) is not None]
        return [flags[name].name_flag(name) or f"--{name}" for name in given]

    def build_elastic(self) -> ElasticOptions:
        """Return the options of elastic joints, with the defaults of those that were not given."""
        named = {name: getattr(self, name) for name in (*_ELASTIC, "window")}
        names = {"threshold_count": "stops", "knee_count": "knees"}
        given: Any = {names.get(name, name): value for name, value in named.items() if value is not None}
        return ElasticOptions(**given)


_ELASTIC = (
    *("tolerance", "threshold_count", "knee_count", "rate", "thresholds", "knee_torques"),
    *("refine", "iterations", "nlp", "effects"),
)
"""Names of the options of elastic joints alone."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LawOptions(Options):
    """Options of `RobotModel.identify_friction`; its keywords win over them.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link")
        >>> options = symid.LawOptions(drop_first=100, smoothing=0.01)
        >>> log = robot.simulate(seed=1).log
        >>> sorted(robot.identify_friction(log, model="coulomb-viscous", options=options).joints)
        ['elbow', 'shoulder']
    """

    model: str | Mapping[str, str] | None = option(
        None,
        "With --rows friction: a law, such as stribeck+offset, or auto, chosen on held-out data; or laws of "
        "single joints, as elbow=stribeck,wrist=cubic, with auto for the others.  "
        "[default: auto]",
        MODEL,
        TEXT,
        "NAME",
    )
    estimator: str | None = share(RigidOptions, "estimator")
    known: "GivenResult | Robot | Described | None" = share(IdentifyOptions, "known")
    smoothing: float | None = option(
        None,
        "With --rows friction: speed over which dry friction changes its sign.  [default: 0]",
        MODEL,
        NOT_BELOW,
        "V",
        code="usage.friction-smoothing",
    )
    period: tuple[float, ...] = share(RigidOptions, "period")
    friction: str | None = inner(
        None, "The friction model of all joints in the rigid part, in place of the robot file's."
    )
    cutoff: float | None = share(IdentifyOptions, "cutoff")
    decimate: int | None = share(IdentifyOptions, "decimate")
    drop_first: int | None = share(IdentifyOptions, "drop_first")
    drop_last: int | None = share(IdentifyOptions, "drop_last")
    search: "FrictionOptions | None" = inner(None, "All options of the estimators.")
