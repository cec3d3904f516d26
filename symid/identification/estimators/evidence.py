"""What speaks for an estimate: how its settings were chosen, and what it predicts of held-out stretches.

Records of results, made by `identification` and judged by `report.verdict`; and what a joint does at a row:

    at rest       its mean speed over 0.1 s is below a 500th of its top speed, for 0.1 s or longer
    at reversal   else, slower than a twentieth of its top speed
    in motion     else
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.serialization import name_key

PHASES = ("motion", "reversal", "rest")
_SLOW, _STANDING, _TOP = 0.05, 0.002, 0.99
"""Parts of the top speed, the latter as a quantile of the rows' speeds."""
_SPAN = 0.1
"""s, over which a speed is averaged, and that a rest lasts at least."""


def find_phases(time: FloatArray, velocity: FloatArray, run: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the place in `PHASES` of what a joint does at its rows (m,).

    `time` in s rises within each recording `run` (m,); `velocity` in rad/s or m/s.
    """
    top = float(np.quantile(np.abs(velocity), _TOP)) if len(velocity) else 0.0
    phases = (np.abs(velocity) <= _SLOW * top).astype(np.intp)
    for number in np.unique(run):
        own = np.flatnonzero(run == number)
        steps = np.diff(time[own])
        span = max(3, round(_SPAN / float(np.median(steps)))) if len(steps) else 3
        wide = np.pad(velocity[own], (span // 2, (span - 1) // 2), mode="edge")
        average = np.convolve(wide, np.full(span, 1.0 / span), mode="valid")
        standing = np.abs(average) <= _STANDING * top
        edges = np.flatnonzero(np.diff(np.concatenate([[False], standing, [False]])))
        for first, last in edges.reshape(-1, 2):
            if last - first >= span:
                phases[own[first:last]] = 2
    return phases


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionResidual:
    """What is left of one joint's rows, by what the joint does.

    `rms` in `unit` and `rows` of each of `PHASES`, None where it has no rows; `left_out` of these rows do not
    count in the joint's residual, `whole` is the rms with them.
    """

    joint: str
    unit: str
    rms: tuple[float | None, ...]
    rows: tuple[int, ...]
    left_out: int
    whole: float

    @classmethod
    def measure(
        cls, joint: str, unit: str, errors: FloatArray, phases: NDArray[np.intp], left_out: int = 0
    ) -> "MotionResidual":
        """Return it from the errors (m,) and phases (m,) of all rows."""
        parts = [errors[phases == place] for place in range(len(PHASES))]
        return cls(
            joint=joint,
            unit=unit,
            rms=tuple(float(np.sqrt(np.mean(part**2))) if len(part) else None for part in parts),
            rows=tuple(map(len, parts)),
            left_out=left_out,
            whole=float(np.sqrt(np.mean(errors**2))),
        )


STILL = 1.5
"""Movement up to which an estimate counts as standing still."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """One setting that was tried.

    Args:
        band: Hz, of the rows; instruments: Hz, band of the instruments, 0 for least squares.
        standstill: part of the top speed below which rows are left out.
        held_out: percent of the torque within B/2 and B left unexplained, mean over joints.
        behind: standard errors of the held-out loss behind the best that stands still; infinite for others.
        movement: largest rms over parameters of the difference to an estimate of a lower band, in standard
            deviations of that one.
        states: up to which columns of the log they are used, "position", "velocity" or "acceleration".
    """

    band: float
    instruments: float
    standstill: float
    held_out: tuple[float, ...]
    behind: float
    movement: float
    states: str = "position"

    @property
    def still(self) -> bool:
        """Return whether the estimate does not move with the band."""
        return self.movement <= STILL


@dataclass(frozen=True, slots=True, kw_only=True)
class SettingsChoice:
    """What was chosen: scoring band B in Hz, all candidates, the place of the one taken; top speeds (n,)."""

    scoring: float
    candidates: tuple[Candidate, ...]
    taken: int
    top: tuple[float, ...]

    @property
    def chosen(self) -> Candidate:
        """Return the candidate that was taken."""
        return self.candidates[self.taken]


@dataclass(frozen=True, slots=True, kw_only=True)
class JointEvidence:
    """What is left unexplained of one joint within the scoring band: rms, in percent of that of the torque.

    `fitted` on the rows of the fit by the fit itself; `held_out` by fits without the stretch of the row, of
    all rows, slow ones too; `moving`, `reversing` and `resting` the same of the rows of each phase (infinite
    where there are none), the latter two along the states of the instruments where there are any. `share` is
    the part of the rows that the fit left out as slow, `torque` the rms of the torque in N m or N.
    """

    joint: str
    fitted: float
    held_out: float
    moving: float
    reversing: float = float("inf")
    resting: float
    share: float
    torque: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelTerm:
    """A term that the model lacks.

    `gain` in percent, by which it lowers the held-out squares of a joint; `errors` is how sure that is, in
    standard errors over stretches.
    """

    joint: str
    term: str
    gain: float
    errors: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """What speaks for and against an estimate.

    Args:
        joints: what is left unexplained of each joint that has rows.
        scoring: Hz, within which that was measured.
        stretches: number of held-out stretches; logs: whole logs that were held out, 0 for stretches.
        movement: of the settings chosen, see `Candidate`; 0 where nothing was chosen.
        impossible: what no robot can have, in words.
        missing: terms that would help on held-out rows, the largest first.
        in_proportion: pairs of joints that move in proportion throughout all logs.
        resampled: percent that a quick fit leaves unexplained at even times, and with samples of uneven logs
            as they come; empty where no log was moved to even times.
        code, cause, remedy: the likeliest single mistake in the logs, and what to do; empty for none.
        cured: percent that a quick fit leaves unexplained with the cause undone, infinite where none helps;
            effect: what undoing it does to that fit, in words.
    """

    joints: tuple[JointEvidence, ...]
    scoring: float
    stretches: int
    logs: int = 0
    movement: float = 0.0
    impossible: tuple[str, ...] = ()
    missing: tuple[ModelTerm, ...] = ()
    in_proportion: tuple[tuple[str, str], ...] = ()
    resampled: tuple[float, ...] = ()
    code: str = ""
    cause: str = ""
    remedy: str = ""
    cured: float = float("inf")
    effect: str = ""

    @property
    def held_out(self) -> float:
        """Return the mean over joints of what is left unexplained of held-out rows, in percent."""
        return sum(entry.held_out for entry in self.joints) / len(self.joints)

    @property
    def unexplained(self) -> float:
        """Return the same, each joint counted for 100 % at most: one that needs little torque is noise."""
        return sum(min(100.0, entry.held_out) for entry in self.joints) / len(self.joints)

    @property
    def fitted(self) -> float:
        """Return the mean over joints of what is left unexplained of the rows of the fit, in percent."""
        return sum(entry.fitted for entry in self.joints) / len(self.joints)


@dataclass(frozen=True, slots=True, kw_only=True)
class LawTrial:
    """A law that was tried.

    Args:
        unknowns: the number of the law's parameters.
        fitted_percent: residual of the fit to all rows, |e| / |tau| in percent.
        held_percent: the same of the held-out rows, in percent; held_rms: in N m or N.
        ratio: squared error of the held-out rows, relative to Coulomb, viscous and constant friction.
        behind: mean difference of the squared error from the best law, in its standard errors.
        aicc: of the fit to all rows; reason: why it was not tried, or cannot be taken; else empty.
    """

    law: str
    unknowns: int
    fitted_percent: float | None = None
    held_percent: float | None = None
    held_rms: float | None = None
    ratio: float | None = field(default=None, metadata=name_key("squared_error_ratio"))
    behind: float | None = field(default=None, metadata=name_key("standard_errors_behind"))
    aicc: float | None = None
    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class LawSelection:
    """Trials of all laws; `chosen` is the law taken, `verdict` why, `blocks` how many there were."""

    trials: tuple[LawTrial, ...]
    chosen: str
    verdict: str
    blocks: int
