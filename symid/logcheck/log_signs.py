"""Sign and size of the torques of a log: what a fit of every joint alone makes of them.

Input: `LogFit`. Output: `JointSigns`; notices.

Of each joint the torque is fitted by that joint's own rows, so that a wrong sign elsewhere does no harm. Its
inertia must be positive, and its friction must take work out of the motion. Both as shares of the torque:

    inertia share   mean(M_jj ddq^2) / (rms(ddq) rms(tau))
    friction share  mean(tau_f dq) / (rms(dq) rms(tau))

Supported: joints that move; mean values over the blocks of the log, with the deviation of leaving one out.
Not supported: joints whose torque is nearly all weight: neither share then says anything.
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.library import Library
from symid.errors import Notice
from symid.logcheck.log_fit import LogFit, evaluate_rows, solve_rows
from symid.robot.description import JointKind, Robot

__all__ = ["JointSigns", "describe_signs", "describe_sizes", "find_signs"]

_CLEAR = 0.02
"""Of the torque: a share beyond this, and beyond its own deviations, says something."""
_SURE = 3.0
_GROUPS = 8
_HEAVIEST, _LIGHTEST = 2e4, 1e-4
"""kg at half the reach: no arm moves more, none so little."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JointSigns:
    """What the fit of joint `joint` alone says: shares of inertia and friction, with deviations; `mass`.

    `mass` is the mean inertia M_jj as a mass (kg) at half the robot's reach, or that of a slide itself.
    """

    joint: int
    inertia: float
    inertia_std: float
    friction: float
    friction_std: float
    mass: float

    @property
    def wrong(self) -> bool:
        """Return whether the torque goes against the motion, beyond doubt."""
        shares = ((self.inertia, self.inertia_std), (self.friction, self.friction_std))
        clear = [share for share, std in shares if abs(share) > max(_CLEAR, _SURE * std)]
        return bool(clear) and max(clear) < 0.0


def find_signs(fit: LogFit, library: Library, robot: Robot) -> tuple[JointSigns, ...]:
    """Return shares of inertia and friction of every joint that moves."""
    reach = _find_reach(robot)
    still = np.zeros_like(fit.q)
    weight = evaluate_rows(library, fit.q, still, still)
    found = []
    for joint in fit.moving:
        unit = still.copy()
        unit[:, joint] = 1.0
        column = evaluate_rows(library, fit.q, still, unit)[:, joint] - weight[:, joint]
        column[:, fit.inertial :] = 0.0
        values = np.array([_find_shares(fit, joint, column, left) for left in _list_subsets(fit)])
        whole, parts = values[0], values[1:]
        stds = np.sqrt((len(parts) - 1) / len(parts) * np.sum((parts - parts.mean(axis=0)) ** 2, axis=0))
        size = 1.0 if robot.axes[joint].kind is JointKind.PRISMATIC else (0.5 * reach) ** 2
        found.append(
            JointSigns(
                joint=joint,
                inertia=float(whole[0]),
                inertia_std=float(stds[0]),
                friction=float(whole[1]),
                friction_std=float(stds[1]),
                mass=float(whole[2] / size) if size > 0.0 else float("nan"),
            )
        )
    return tuple(found)


def _list_subsets(fit: LogFit) -> list[np.ndarray[tuple[int, ...], np.dtype[np.intp]]]:
    """Return the samples' indices: all, then all without each of some groups of consecutive ones."""
    whole = np.arange(len(fit.q))
    groups = np.array_split(whole, _GROUPS)
    return [whole, *(np.setdiff1d(whole, group) for group in groups)]


def _find_shares(
    fit: LogFit, joint: int, column: FloatArray, kept: "np.ndarray[tuple[int, ...], np.dtype[np.intp]]"
) -> tuple[float, float, float]:
    kept = kept[fit.keep[kept, joint] > 0.0]
    rows, tau = fit.rows[kept, joint], fit.tau[kept, joint]
    dq, ddq = fit.dq[kept, joint], fit.ddq[kept, joint]
    solution = solve_rows(rows, tau)
    inertia = column[kept] @ solution
    braking = rows[:, fit.inertial :] @ solution[fit.inertial :]
    braking = braking - np.mean(braking)
    size = _find_rms(tau) or 1.0
    acceleration = float(np.mean(inertia * ddq**2)) / ((_find_rms(ddq) or 1.0) * size)
    work = float(np.mean(braking * dq)) / ((_find_rms(dq) or 1.0) * size)
    return acceleration, work, float(np.mean(inertia))


def _find_rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _find_reach(robot: Robot) -> float:
    """Return the sum of the distances between joints in m, at least a tenth of one."""
    symbols = dict(robot.symbols)
    lengths = [
        float(np.linalg.norm([value.to_float(symbols) for value in joint.placement.translation]))
        for joint in robot.joints
    ]
    return max(0.1, sum(lengths))


def describe_signs(signs: tuple[JointSigns, ...], robot: Robot, file: str) -> tuple[Notice, ...]:
    """Return a notice on every joint whose torque goes against its motion."""
    notices = []
    for entry in signs:
        if not entry.wrong:
            continue
        shares = ((entry.inertia, "its inertia comes out negative"), (entry.friction, "friction drives it"))
        told = " and ".join(text for share, text in shares if share < -_CLEAR)
        text = (
            f"the torque of joint {robot.axes[entry.joint].name!r} has the wrong sign: fitted alone, {told}; "
            "turn the sign of its torque or of its position: a factor of -1 in [log.torque] or "
            "[log.position], or the sign of its gear"
        )
        notices.append(Notice(code="log.torque-sign", text=text, file=file))
    return tuple(notices)


def describe_sizes(signs: tuple[JointSigns, ...], robot: Robot, file: str) -> tuple[Notice, ...]:
    """Return a notice where the masses that the torques stand for are those of no robot."""
    clear = [entry for entry in signs if entry.inertia > max(_CLEAR, _SURE * entry.inertia_std)]
    odd = [entry for entry in clear if not _LIGHTEST < entry.mass < _HEAVIEST]
    if not odd:
        return ()
    worst = max(odd, key=lambda entry: abs(np.log(entry.mass)))
    large = worst.mass >= _HEAVIEST
    guess = (
        "are these milliamperes, N mm or degrees? state the unit in [log.torque] and [log.position]"
        if large
        else 'is this the motor side (side = "motor"), or are these N m where kN m is stated?'
    )
    text = (
        f"the torque of joint {robot.axes[worst.joint].name!r} stands for {worst.mass:.2g} kg moved, "
        f"which no robot of this size has; {guess}"
    )
    return (Notice(code="log.torque-size", text=text, file=file),)
