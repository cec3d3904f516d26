"""What elastic models say of a log: torques of every joint by its motor, its link, its spring.

Library, recording, fits -> ElasticTrial.

    motor    F[tau_J] = F[tau] - IA F[ddtheta] - F[Yf] f
    link     F[tau_J] = F[M ddq + C dq + g]
    spring   F[tau_J] = F[spring(theta - q)]

All three, and the torsion that they are drawn over, pass the same filter F, so that no loop comes from it.

Supported: springs with memory, which begins empty with the log; fits without a spring.
Not supported: one encoder only.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.codegen.library import Library
from symid.data.logs import is_fitted
from symid.data.recording import Recording
from symid.elastic.estimate import ElasticEstimate
from symid.elastic.filtered import FilteredRows, build_filtered_rows, filter_smooth
from symid.elastic.fit import ElasticFit
from symid.elastic.options import ElasticOptions
from symid.elastic.signals import ElasticSignals, prepare_elastic_signals
from symid.errors import EstimateError, Notice, UsageError
from symid.estimators.estimate import Residual
from symid.joint.plays import find_hysteresis_torque
from symid.robot.elasticity import Elasticity

__all__ = ["ElasticTrial", "JointTrial", "predict_trial", "try_estimate"]

_FILTERS = ("stops", "rate", "cutoff")
"""Options that signals and rows of a log depend on."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointTrial:
    """One joint: torsion and joint torque by several ways, all filtered alike.

    Args:
        joint: its name; unit of torques, and of the torsion.
        time: (M,) s; torsion: (M,) rad or m.
        motor: (M,) joint torque by the motor equation; link: (M,) by the link equation, N m or N.
        final: (M,) by the identified spring, None where none was found; initial: by the spring of the start.
        truth: (M,) by the true spring, None where it is not known.
    """

    joint: str
    unit: str
    torsion_unit: str
    time: FloatArray
    torsion: FloatArray
    motor: FloatArray
    link: FloatArray
    final: FloatArray | None = None
    initial: FloatArray | None = None
    truth: FloatArray | None = None

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("time", "torsion", "motor", "link", "final", "initial", "truth"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, freeze(getattr(self, name)))

    @property
    def straight(self) -> float:
        """Return the stiffness of the linear spring that explains this log best, N m/rad or N/m."""
        scale = float(self.torsion @ self.torsion)
        return float(self.torsion @ self.motor) / scale if scale else 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElasticTrial:
    """One log under the models; `residuals` are tables of residuals, each with its caption.

    `fitted` tells a log of the fit, which is no test.
    """

    source: str
    joints: tuple[JointTrial, ...]
    residuals: tuple[tuple[str, tuple[Residual, ...]], ...]
    fitted: bool = False

    @property
    def mean_relative_percent(self) -> float:
        """Return the mean over joints of what dynamics of motors and links leave, in percent."""
        return self.means[0]

    @property
    def means(self) -> tuple[float, ...]:
        """Return the mean over joints of the relative residuals of every table, in percent."""
        return tuple(
            float(np.mean([entry.relative_percent for entry in entries])) for _, entries in self.residuals
        )


def try_estimate(
    estimate: ElasticEstimate,
    library: Library,
    recording: Recording,
    *,
    initial: Sequence[Elasticity] = (),
    cutoff: float | None = None,
) -> ElasticTrial:
    """Return what `estimate` says of `recording`, filtered as its own logs were.

    Args:
        estimate: of the same model as the library.
        library: of the robot.
        recording: with both encoders.
        initial: springs of the start, one a joint; empty where they are not at hand.
        cutoff: of the low-pass in Hz in place of the estimate's, 0 for none; None to keep that.

    Raises:
        EstimateError: the estimate's settings cannot be used.
        LogError: the recording lacks an encoder, or is too short.
    """
    return predict_trial(
        library,
        recording,
        _read_options(estimate) if cutoff is None else replace(_read_options(estimate), cutoff=cutoff),
        estimate.build_fit(len(library.card.beta)),
        initial=initial,
        told=[spring.told for spring in estimate.springs],
        truth=[spring.truth for spring in estimate.springs],
        fitted=is_fitted(recording, estimate.sources, estimate.settings),
    )


def _read_options(estimate: ElasticEstimate) -> ElasticOptions:
    found: dict[str, Any] = {name: estimate.settings[name] for name in _FILTERS if name in estimate.settings}
    try:
        return ElasticOptions(**found)
    except (TypeError, UsageError) as error:
        text = f"its settings cannot be used: {error}; identify again"
        raise EstimateError(Notice(code="estimate.settings", text=text)) from error


def predict_trial(
    library: Library,
    recording: Recording,
    options: ElasticOptions,
    final: ElasticFit,
    *,
    initial: Sequence[Elasticity] = (),
    told: Sequence[bool] = (),
    truth: Sequence[Elasticity | None] = (),
    fitted: bool = False,
) -> ElasticTrial:
    """Return what the models say of `recording`; nothing is fitted.

    Args:
        library: of the robot.
        recording: with both encoders.
        options: of the identification; its filters are used.
        final: what was identified.
        initial: springs of the start, one a joint; empty where there are none.
        told: whether the spring of each joint counts as found; empty where all do.
        truth: true springs, one a joint; empty where unknown.
        fitted: whether the log is one of the fit.

    Raises:
        LogError: the recording lacks an encoder, or is too short.
    """
    signals = prepare_elastic_signals(recording, options)
    rows = build_filtered_rows(library, signals, options.rate)
    motor = rows.find_motor_side(np.concatenate([final.rotor, final.friction]))
    link = rows.find_link_side(final.beta)
    torsion = filter_smooth(signals.phi, options.rate, signals.period)[rows.keep]
    springs = final.elasticity
    known = [
        spring if counts else None
        for spring, counts in zip(springs, told or [True] * len(springs), strict=True)
    ]
    sets = [_find_spring_torques(parts, signals, rows, options) for parts in (known, initial, truth)]
    joints = tuple(
        JointTrial(
            joint=card.name,
            unit=card.torque_unit,
            torsion_unit=card.position_unit,
            time=signals.time[rows.keep],
            torsion=torsion[:, index],
            motor=motor[:, index],
            link=link[:, index],
            final=sets[0][index],
            initial=sets[1][index],
            truth=sets[2][index],
        )
        for index, card in enumerate(library.card.joints)
    )
    return ElasticTrial(
        source=recording.source, joints=joints, residuals=_list_residuals(joints, rows), fitted=fitted
    )


def _find_spring_torques(
    springs: Sequence[Elasticity | None], signals: ElasticSignals, rows: FilteredRows, options: ElasticOptions
) -> tuple[FloatArray | None, ...]:
    """Return F[spring(phi)] (M,) of every joint, None where its spring is not known."""
    count = signals.phi.shape[1]
    result: list[FloatArray | None] = [None] * count
    phi, rate = signals.phi, signals.dtheta - signals.dq
    for index, spring in enumerate(springs):
        if spring is not None and spring.initial_stiffness is not None:
            torque = find_hysteresis_torque(spring, phi[:, index], rate[:, index])
            result[index] = filter_smooth(torque, options.rate, signals.period)[rows.keep]
    return tuple(result)


def _list_residuals(
    joints: tuple[JointTrial, ...], rows: FilteredRows
) -> tuple[tuple[str, tuple[Residual, ...]], ...]:
    torque = rows.torque
    tables = [
        (
            "Torque of the motors by the dynamics of motors and links together; no spring takes part.",
            tuple(
                _find_residual(entry, torque[:, index], entry.motor - entry.link)
                for index, entry in enumerate(joints)
            ),
        )
    ]
    known = [(entry, entry.final) for entry in joints if entry.final is not None]
    if known:
        motors = (
            _find_residual(entry, torque[:, index], entry.motor - final)
            for index, (entry, final) in enumerate(known)
        )
        links = (_find_residual(entry, entry.link, entry.link - final) for entry, final in known)
        tables += [
            ("Torque of the motors by their own dynamics and the springs.", tuple(motors)),
            ("Torque of the joints: what the links need, less what the springs say.", tuple(links)),
        ]
    return tuple(tables)


def _find_residual(entry: JointTrial, measured: FloatArray, residual: FloatArray) -> Residual:
    whole = float(np.linalg.norm(measured))
    norm = float(np.linalg.norm(residual))
    return Residual(
        joint=entry.joint,
        norm=norm,
        relative_percent=100.0 * norm / whole if whole else float("inf"),
        std=float(np.std(residual)),
        samples=len(residual),
        unit=entry.unit,
    )
