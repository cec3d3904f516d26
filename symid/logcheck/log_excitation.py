"""What logs can tell of every base parameter, before an identification is asked for it.

Input: quick fits of the logs. Output: `Excitation`: a verdict and a reason for each parameter, the singular
values of the scaled matrix, the rank among them.

    expected deviation   s sqrt(diag (A'A)^-1),  A and s of rows weighted by the scatter of their joint

Supported: several logs of one robot.
Not supported: a verdict on bias: a term that the model lacks is not seen here.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.errors import Notice
from symid.logcheck.log_fit import LogFit, solve_rows
from symid.rows.identifiability import WHOLE_MODEL, RankRule, ScaledSpectrum, find_spectrum

__all__ = ["Excitation", "ParameterVerdict", "describe_excitation", "find_excitation"]

_WELL, _VAGUE = 10.0, 100.0
_LARGE_CONDITION = 1e3
_SHOWN = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterVerdict:
    """What logs say of one parameter: "told", "vague", "not told" or "refused", the reason where not told.

    `relative_std_percent` is the deviation that an identification may be expected to have, of the value.
    """

    name: str
    verdict: str
    relative_std_percent: float
    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Excitation:
    """Verdicts on all parameters; singular values (falling, largest 1), rank, condition up to the rank."""

    parameters: tuple[ParameterVerdict, ...]
    singular: tuple[float, ...]
    rank: int
    condition: float

    def list_names(self, *verdicts: str) -> tuple[str, ...]:
        """Return the names of the parameters with one of these verdicts."""
        return tuple(entry.name for entry in self.parameters if entry.verdict in verdicts)

    @property
    def empty(self) -> bool:
        """Return whether the logs tell nothing."""
        return not self.list_names("told", "vague")

    @property
    def poor(self) -> bool:
        """Return whether the logs tell too few parameters for a model of the whole robot."""
        told = len(self.parameters) - len(self.list_names("refused"))
        return self.empty or told < WHOLE_MODEL * len(self.parameters)


def find_excitation(
    fits: Sequence[LogFit], joints: Sequence[str], rule: RankRule | None = None
) -> Excitation:
    """Return what the logs behind `fits` tell, `joints` the names of the robot's joints."""
    rule = rule or RankRule()
    matrix, values = _stack(fits)
    spectrum = find_spectrum(matrix, rule.zero)
    seen = spectrum.singular > rule.singular * spectrum.singular[0]
    hidden = spectrum.directions[~seen]
    share = np.sum(hidden**2, axis=0)
    solution, deviations = _find_deviations(matrix, values, spectrum, seen)
    names = fits[0].names
    resting = [name for index, name in enumerate(joints) if all(index not in fit.moving for fit in fits)]
    verdicts = []
    for index, name in enumerate(names):
        if spectrum.lengths[index] == 0.0 or share[index] > rule.share:
            reason = _explain_hidden(index, names, spectrum.lengths, hidden, resting)
            verdicts.append(
                ParameterVerdict(
                    name=name, verdict="refused", relative_std_percent=float("inf"), reason=reason
                )
            )
            continue
        percent = 100.0 * deviations[index] / max(abs(solution[index]), 1e-300)
        verdict = "told" if percent <= _WELL else "vague" if percent <= _VAGUE else "not told"
        reason = "" if verdict == "told" else "it is small beside the noise, or hardly excited"
        verdicts.append(
            ParameterVerdict(name=name, verdict=verdict, relative_std_percent=float(percent), reason=reason)
        )
    largest = spectrum.singular[0] or 1.0
    rank = int(np.sum(seen))
    return Excitation(
        parameters=tuple(verdicts),
        singular=tuple(float(value) for value in spectrum.singular / largest),
        rank=rank,
        condition=float(largest / spectrum.singular[rank - 1]) if rank else float("inf"),
    )


def _stack(fits: Sequence[LogFit]) -> tuple[FloatArray, FloatArray]:
    """Return the rows of all moving joints of all logs, each weighted by the scatter of its residual."""
    plain = [_list_rows(fit, np.ones(fit.tau.shape[1])) for fit in fits]
    first = solve_rows(np.vstack([part[0] for part in plain]), np.concatenate([part[1] for part in plain]))
    squares = _add([(fit.keep * (fit.tau - fit.rows @ first)) ** 2 for fit in fits])
    sizes, counts = _add([(fit.keep * fit.tau) ** 2 for fit in fits]), _add([fit.keep for fit in fits])
    scatter = np.sqrt(np.maximum(squares, 1e-12 * sizes) / np.maximum(counts, 1.0))
    weights = 1.0 / np.where(scatter > 0.0, scatter, 1.0)
    parts = [_list_rows(fit, weights) for fit in fits]
    return np.vstack([part[0] for part in parts]), np.concatenate([part[1] for part in parts])


def _list_rows(fit: LogFit, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return matrix and values; a joint at rest may be held by dry friction, so its rows stay out."""
    joints = list(fit.moving)
    factor = (fit.keep * weights)[:, joints].ravel()
    kept = factor > 0.0
    matrix = fit.rows[:, joints].reshape(-1, fit.rows.shape[2])[kept]
    return matrix * factor[kept, None], fit.tau[:, joints].ravel()[kept] * factor[kept]


def _add(parts: Sequence[FloatArray]) -> FloatArray:
    """Return the sums (n,) over the samples of all parts (N, n)."""
    total: FloatArray = np.vstack(parts).sum(axis=0)
    return total


def _find_deviations(
    matrix: FloatArray, values: FloatArray, spectrum: ScaledSpectrum, seen: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray]:
    """Return the fit (p,) over the directions seen, and its standard deviations."""
    basis = spectrum.scales[:, None] * spectrum.directions[seen].T
    inner = basis / spectrum.singular[seen]
    solution: FloatArray = inner @ (inner.T @ (matrix.T @ values))
    errors = values - matrix @ solution
    freedom = max(1, len(values) - int(np.sum(seen)))
    deviations: FloatArray = np.sqrt(float(errors @ errors) / freedom * np.sum(inner**2, axis=1))
    return solution, deviations


def _explain_hidden(
    index: int, names: tuple[str, ...], lengths: FloatArray, hidden: FloatArray, resting: list[str]
) -> str:
    still = f"; at rest: {', '.join(resting)}" if resting else ""
    if lengths[index] == 0.0:
        return f"it acts on no torque of this log{still}"
    partners = np.abs(hidden.T @ hidden[:, index])
    partners[index] = 0.0
    others = [names[k] for k in np.argsort(-partners, kind="stable") if partners[k] > 1e-4][:4]
    return f"it acts only together with {', '.join(others)}{still}"


def describe_excitation(found: Excitation, file: str = "") -> tuple[Notice, ...]:
    """Return notices on what the logs cannot tell, and on a bad condition."""
    notices = []
    refused = [entry for entry in found.parameters if entry.verdict == "refused"]
    if refused:
        listed = "; ".join(f"{entry.name}: {entry.reason}" for entry in refused[:_SHOWN])
        more = f"; and {len(refused) - _SHOWN} more" if len(refused) > _SHOWN else ""
        text = (
            f"{len(refused)} of {len(found.parameters)} parameters cannot be told from these logs "
            f"({listed}{more}); move every joint with accelerations of its own; "
            "`symid excite` makes such motions"
        )
        notices.append(("log.not-excited", text))
    faint = found.list_names("not told")
    if faint:
        text = (
            f"{len(faint)} parameters drown in the noise ({', '.join(faint[:_SHOWN])}"
            f"{', ...' if len(faint) > _SHOWN else ''}): expected deviations are above {_VAGUE:g} % of "
            "the value; faster or longer motions tell more, or leave them out"
        )
        notices.append(("log.faint-parameters", text))
    if found.condition > _LARGE_CONDITION:
        text = (
            f"the condition number is {found.condition:.3g}: combinations of parameters are hardly "
            "excited, and noise in them is amplified; use a motion made by `symid excite`"
        )
        notices.append(("log.condition", text))
    return tuple(Notice(code=code, text=text, file=file) for code, text in notices)
