"""The policy: every number that decides what is believed of a log, a model or a parameter, in one table.

Settings, laws, causes and verdicts are claims of two forms, "predicts better" and "says the same"; the two
statistics of `statistics` test them, at the levels that stand here. No other number reaches a decision:
what stands elsewhere in the rooms of identification is numerics (tolerances, limits of iterations, grids).

Each entry says what it means, where it is from, and what happens when it is halved or doubled. The alarm
rates of the tests are measured by `benchmarks/judge.py`.
"""

from dataclasses import dataclass, field
from typing import TypeVar

Number = TypeVar("Number", int, float)
"""A count, or a number."""


def _number(value: Number, meaning: str, source: str, changed: str) -> Number:
    found: Number = field(default=value, metadata={"meaning": meaning, "source": source, "changed": changed})
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class Policy:
    """The numbers that decide; `POLICY` has those in use."""

    alarm: float = _number(
        0.01,
        "probability of a false alarm of a test: two estimates differ, or a candidate predicts better; over "
        "all candidates of a family together (Holm 1979)",
        "usual significance level",
        "halved: faults must be a little clearer; doubled: one clean log in fifty is warned of",
    )
    caution: float = _number(
        0.1,
        "probability below which a choice stays on the safe side: the estimator that needs fewer "
        "assumptions, "
        "or the candidate that predicts best",
        "a false alarm costs a little precision here",
        "halved: bias up to two standard deviations may stay; doubled: one choice in five is too wide",
    )
    confidence: float = _number(
        0.95,
        "of the one-sided bound on a difference that must be small before two estimates are called the same",
        "usual",
        "higher: more logs are too short to test; lower: short and noisy logs are called consistent",
    )
    relevance: float = _number(
        0.02,
        "part of a torque, a value or a loss below which a difference does no harm",
        "torque sensors and constants are right to one or two percent",
        "halved: few logs are long enough to be called consistent; doubled: friction may be off by 4 %",
    )
    good: float = _number(
        10.0,
        "relative residual in percent up to which a model is good",
        "sensors and simple friction laws have 2 to 10 % on an arm that is modelled right",
        "a class earlier or later",
    )
    usable: float = _number(
        30.0,
        "the same up to which it is usable",
        "industrial arms with heavy gears and counterbalances reach 15 to 25 %",
        "a class earlier or later",
    )
    lost: float = _number(
        60.0,
        "the same beyond which it is wrong",
        "less than two thirds of the squared torque is explained",
        "a class earlier or later",
    )
    folds: int = _number(
        6,
        "folds of the cross-validation",
        "a sixth less data hardly changes a fit",
        "more time, or poorer fits",
    )
    parts: int = _number(
        4,
        "parts of each fold whose losses are compared: with few of them a test of many hypotheses has "
        "no power",
        "measured: with 6 parts t must exceed 10 for 136 hypotheses, with 24 parts 5",
        "halved: causes are not named; doubled: parts are shorter than the motion's correlation time",
    )
    periods: float = _number(
        2.0,
        "least length of a part, in periods of the scoring band: shorter ones depend on each other",
        "the autocorrelation of a band-limited residual falls within one period",
        "halved: tests give too many alarms; doubled: 10 s of a slow motion cannot be tested",
    )
    fall: float = _number(
        2.0,
        "factor by which correcting a cause must lower the squared residual of its joints, and by which "
        "that of any other explanation must be larger; a band of rows that predicts so much worse than the "
        "best one is not taken",
        "measured: on clean logs false candidates reach 1.6; mistakes that no parameter absorbs reach "
        "2.6 to 187",
        "halved: wrong causes are named; doubled: half of the plain mistakes are not named",
    )
    fall_of_all: float = _number(
        1.5,
        "the same of all joints together",
        "measured with `fall`",
        "lower: a joint is mended at the cost of others",
    )
    row_band: float = _number(
        0.1,
        "part of the sample rate up to which the band of a fit may reach",
        "differences of positions are right within 1 % there; noise of encoders grows with the fourth "
        "power beyond",
        "halved: half of the information of coarse logs; doubled: inertias of coarse logs are biased",
    )
    printed: float = _number(
        3.0,
        "standard deviations by which a printed value may move when it is estimated from other data, or "
        "miss a known value",
        "one in 370 by chance",
        "halved: chance limits verdicts; doubled: wrong standard deviations go unnoticed",
    )
    uncertain: float = _number(
        30.0,
        "standard deviation in percent of the value from which it is poorly identifiable",
        "a value known to a third separates heavy from light",
        "a word in a table earlier or later",
    )
    whole: float = _number(
        0.75,
        "part of the parameters that logs must determine for a model of the whole robot, and that may be "
        "uncertain at most; values that are known to be small beside others of their joint are not",
        "export, validation and control want the whole; real logs of arms leave one in ten to two in three "
        "uncertain, one of a model without friction nine in ten",
        "halved: a third of a robot passes as one; 1: a wrist that rests refuses an arm",
    )
    bend: float = _number(
        0.5,
        "part of the speed at which a friction law bends, from which on slow samples of its joint are kept",
        "at vs / 2 the Stribeck effect is 0.8 of its height, at vs 0.4; measured on an arm with six laws",
        "halved: samples beside standstill bias inertias; doubled: height and speed of the bend are poorly "
        "identifiable, and slow motion is predicted a tenth worse",
    )
    scale: float = _number(
        3.0,
        "times by which torques may differ from those of the robot file's values, either way",
        "masses of a drawing are not wrong by this factor; gears, torque constants and units are",
        "halved: drawings without covers and cables are warned of; doubled: a wrong small gear passes",
    )
    overload: float = _number(
        1.5,
        "times a joint's stated limit that its torque may reach, but for one sample in a hundred",
        "servos exceed stated limits by 10 to 30 % for moments; currents and gears are off by more",
        "1: peaks that drives allow accuse a right unit; doubled: a torque constant that is twice too large "
        "passes",
    )
    drawing: float = _number(
        0.15,
        "standard deviation of bodies from those of a robot file, in parts of mass and radius of gyration; "
        "and of what is mounted at the tip, in parts of the robot's mass and reach",
        "published wrists have their centres off by 0.3 of that radius, payloads reach 0.4 of a robot's mass",
        "halved: wrists and tools that are not drawn pass for wrong gears; doubled: gears that are five "
        "times off pass where a joint carries little",
    )


POLICY = Policy()
