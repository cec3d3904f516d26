"""Stiffness of joints from the gravity that bends them, with an interval or a reason; encoder alignment.

    tau = [Y | ddtheta | Yf] x             joint torques, rotors of elastic joints, friction: least squares
    gravity = Y(q, 0, 0) beta,             motion = Y(q, dq, ddq) beta - gravity
    theta - q = c gravity + b motion + a ddtheta + s tanh(dtheta / v) + d dtheta + offset,    k = 1 / c

Only gravity gives the torque of a spring an absolute scale. Standard deviations are those of a jackknife over
blocks of time, the rigid robot fitted anew without each; runs are averaged with the inverse of their
variances, and deviations enlarged by the Birge ratio. The interval is that of 95 %.

Supported: rigid and elastic robots, any number of runs; joints without a link encoder are refused by
name; joints that gravity does not load have a compliance of zero.
Not supported: hysteresis and damping; parameters one by one; weights of samples; what torsion changes in the
regressors, which is of second order: positions are those of the motors.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import partial

import numpy as np
import scipy

from symid.arrays import FloatArray, FrozenArrays
from symid.codegen import JointCard, Library
from symid.errors import LogError, Notice
from symid.identification.elastic import regression
from symid.identification.elastic.elimination import get_wide_cutoff
from symid.identification.elastic.options import ElasticOptions
from symid.identification.judge import POLICY, compare, numerics
from symid.identification.regression import fill_load, list_measured_joints, solve_products, solve_scaled
from symid.joint_models import compute_plays
from symid.logs import (
    Alignment,
    Recording,
    align,
    differentiate,
    differentiate_smooth,
    estimate_alignment,
    get_encoders,
    keep_significant,
    shift_link_channel,
    split_blocks,
)
from symid.serialization import name_key

_BLOCKS = POLICY.folds * POLICY.parts
_CUTOFF = 10.0
"""Hz: equations of the rigid robot hold where its joints hardly bend. Twice as much gives encoders in line a
delay of a quarter of a millisecond."""
_PLAYS = 5
"""Plays of the torque, their radii ever farther apart. More of them can follow a zero that is moved."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigidRows:
    """The rigid robot's equations over one recording, at full rate.

    Args:
        gap: (N, n) torsions, low-passed; speed, acceleration: (N, n) of the motors.
        still, whole: (N, n, p) regressors at rest and in motion, of the base parameters.
        extra: (N, n, r) columns of rotors and friction.
        torque: (N, n) measured, low-passed alike.
        blocks: of equal length, for the jackknife.
    """

    gap: FloatArray
    speed: FloatArray
    acceleration: FloatArray
    still: FloatArray
    whole: FloatArray
    extra: FloatArray
    torque: FloatArray
    blocks: tuple[slice, ...]

    def compute_grams(self, design: FloatArray | None = None) -> FloatArray:
        """Return the Gram matrices (blocks, n, k, k) of columns (N, n, k), by default those of the torque."""
        if design is None:
            design = np.concatenate([self.whole, self.extra, self.torque[:, :, None]], axis=2)
        joints = range(design.shape[1])
        return np.array([[design[part, j].T @ design[part, j] for j in joints] for part in self.blocks])


def build_rigid_rows(library: Library, recording: Recording) -> RigidRows:
    """Return the equations of one recording; raise LogError where it has one encoder only."""
    found, period = get_encoders(recording), recording.period
    cutoff = min(_CUTOFF, POLICY.row_band / period)
    low = partial(regression.pass_band, period=period, cutoff=cutoff)
    theta, q = low(found.theta), low(found.q)
    link, rest = np.where(found.present, q, theta), np.zeros_like(theta)
    speed, link_speed = differentiate(theta, period), differentiate(link, period)
    acceleration = differentiate(speed, period)
    (still,) = library.evaluate("torque_regressor", link, rest, rest)
    (whole,) = library.evaluate("torque_regressor", link, link_speed, differentiate(link_speed, period))
    rotors = acceleration[:, :, None] * np.eye(theta.shape[1])
    extra = [rotors if library.card.rotors else rotors[:, :, :0]]
    if library.card.friction:
        # Dry friction changes its sign faster than the low-pass lets pass: friction first, then the filter.
        angle = regression.pass_band(found.theta, period, get_wide_cutoff(period, 0.0))
        known = {"load": recording.load, "temperature": recording.temperature}
        given = library.card.gather_friction_inputs(differentiate(angle, period), q=angle, **known)
        extra.append(low(library.evaluate("friction_regressor", *given)[0]))
    edge = regression.count_edge(period, cutoff) * period
    return RigidRows(
        gap=theta - q,
        speed=speed,
        acceleration=acceleration,
        still=still,
        whole=whole,
        extra=np.concatenate(extra, axis=2),
        torque=low(recording.torque),
        blocks=split_blocks(len(theta), period, edge, (len(theta) * period - 2.0 * edge) / _BLOCKS),
    )


def fit_rigid(grams: FloatArray, weights: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    """Return the parameters x (k,) and the joints' residuals (n,), root sums of squares.

    `grams` (n, k + 1, k + 1) are those of [A_j | tau_j], summed over blocks; `weights` (n,) of the joints are
    those of their residuals, iterated, where None.
    """
    found = np.ones(len(grams)) if weights is None else weights
    for _ in range(numerics.ROUNDS):
        before, x = found, solve_products(np.einsum("j,jkl->kl", found, grams))
        left = np.append(x, -1.0)
        squares = np.maximum(np.einsum("k,jkl,l->j", left, grams, left), 0.0)
        squares = np.maximum(squares, numerics.EXACT * grams[:, -1, -1] + numerics.TINY)
        found = 1.0 / squares
        if weights is not None or np.all(np.abs(found - before) <= numerics.CONVERGED * found):
            break
    return x, np.sqrt(squares)


def _build_loaded_rows(library: Library, logs: Sequence[Recording]) -> tuple[list[RigidRows], FloatArray]:
    """Return the equations of all recordings, and the base parameters (p,) that explain their torque."""
    measured, loaded = list_measured_joints(logs), tuple(logs)
    sought = "load" in library.card.friction_inputs and not all(measured)
    loads = [np.zeros_like(log.position) for log in logs]
    beta, options = np.zeros(len(library.card.beta)), ElasticOptions()
    for _ in range(options.iterations):
        if sought:
            pairs = zip(logs, loads, strict=True)
            loaded = tuple(replace(one, load=fill_load(one.load, load, measured)) for one, load in pairs)
        runs = [build_rigid_rows(library, recording) for recording in loaded]
        x, _ = fit_rigid(np.concatenate([rows.compute_grams() for rows in runs]).sum(axis=0))
        before, beta = beta, x[: len(beta)]
        loads = [rows.whole @ beta for rows in runs]
        if not sought or np.linalg.norm(beta - before) <= options.tolerance * np.linalg.norm(beta):
            break
    return runs, beta


def estimate_torsion_alignment(library: Library, recordings: Sequence[Recording]) -> Alignment:
    """Return delay and offsets of the link encoders, the torsion following the robot's own torques.

    Torques depend on where the links are: they are computed again, the encoders moved, until both converge.

    Raises:
        LogError: see `estimate_alignment`.
    """
    moved = tuple(recordings)
    used, delay = np.zeros((len(recordings), library.card.size)), 0.0
    for _ in range(numerics.ROUNDS):
        runs, beta = _build_loaded_rows(library, moved)
        peak = np.max([np.max(np.abs(rows.whole @ beta), axis=0) for rows in runs], axis=0)
        scale, width = np.where(peak > 0.0, peak, 1.0), _compute_reversal_widths(runs)
        # What the torsion may follow, (N, n, columns), all of one scale: gravity, the torque of motion, plays
        # of their sum, the direction of motion, the acceleration. Torques with a memory of their turning
        # points are what hysteresis follows, and the rest what a fit of torques errs by.
        columns = []
        radii = (1.0 + np.cumsum(np.arange(_PLAYS, dtype=np.float64))) / (_PLAYS * (_PLAYS - 1.0))
        for rows, log in zip(runs, moved, strict=True):
            gravity = rows.still @ beta / scale
            # Rounding at a joint that gravity does not load is no torque, and must not look like a constant.
            gravity = np.where(np.max(np.abs(gravity), axis=0) > numerics.RANK, gravity, 0.0)
            torque = rows.whole @ beta / scale
            plays = np.stack([compute_plays(part, radii) for part in torque.T], axis=1)
            direction = np.tanh(rows.speed / width)
            even = np.abs(torque), torque**2
            # Dampers beside springs follow the change of the torque.
            motion = rows.acceleration, differentiate(torque, log.period)
            plain = (gravity, torque - gravity, *even, torque**3, direction, *motion)
            # Loops of a spring of two stiffnesses are wider on one side: plays have even parts, too.
            columns.append(np.concatenate([np.stack(plain, axis=2), plays, np.abs(plays)], axis=2))
        found = estimate_alignment(recordings, columns)
        offsets = np.nan_to_num(found.offsets, nan=0.0)
        change = max(float(np.max(np.abs(offsets - used))), abs(found.delay - delay))
        if change < numerics.CONVERGED:
            break
        used, delay = offsets, found.delay
        moved = tuple(shift_link_channel(one, found, run=run) for run, one in enumerate(recordings))
    return found


def _align(
    library: Library, recordings: Sequence[Recording]
) -> tuple[tuple[Recording, ...], Alignment, Alignment | None, tuple[Notice, ...]]:
    """Return the recordings in line, the alignment, what of it was taken out, and notices."""
    found = estimate_torsion_alignment(library, recordings)
    kept, moved = keep_significant(found), tuple(recordings)
    notices: tuple[Notice, ...] = ()
    refuted = kept is not None and kept.delay != 0.0 and _refute_delay(library, recordings, kept)
    if kept is not None and refuted:
        kept = replace(kept, delay=0.0) if np.any(np.nan_to_num(kept.offsets)) else None
    if kept is not None:
        moved = tuple(align(recording, kept, run=run) for run, recording in enumerate(recordings))
        notices = tuple(recording.notices[-1] for recording in moved)
    if refuted:
        text = f"the link encoders look {1e3 * found.delay:.3g} ms late, but the motors' torque does not "
        text += "show it: friction of the links or dampers beside springs look alike. The delay was left "
        text += "alone"
        notices = (*notices, Notice(code="log.delay-refuted", text=text))
    pairs = zip(library.card.joints, found.unknown, strict=True)
    names = [repr(card.name) for card, unknown in pairs if unknown]
    if names:
        text = f"joint{'s'[: len(names) > 1]} {', '.join(names)}: the zero offset of the link encoder is not "
        text += "identifiable and was left alone, because the torque of gravity hardly changes in some log. "
        text += "Set the zero with the joint unloaded, or move it to where gravity pulls otherwise"
        notices = (*notices, Notice(code="log.offset-unknown", text=text))
    return moved, found, kept, notices


def _refute_delay(library: Library, recordings: Sequence[Recording], alignment: Alignment) -> bool:
    """Return whether the motors' torque could show a delay of the link encoders, and does not."""
    # Viscous friction of the links and dampers give the same torsion as a delay; the spring's torque on the
    # motor tells them apart: tau = [ddtheta, friction, spring, stops, damper] x, fitted with and without it.
    # Where motor and link move as one, no torque tells a delay from friction: the delay is the likelier.
    apart = moves = 0.0
    for motor, link in map(regression.get_encoder_positions, recordings):
        apart += float(np.mean(np.diff(motor - link, axis=0) ** 2))
        moves += float(np.mean(np.diff(motor, axis=0) ** 2))
    if not any(library.card.yielding) or apart < regression.APART**2 * moves:
        return False
    bases, size, losses = len(library.card.beta), library.card.size, []
    for entry in (replace(alignment, delay=0.0), alignment):
        # The mean square that motor and spring leave of the torque in every part of the runs, relative.
        parts = []
        for run, recording in enumerate(recordings):
            moved = shift_link_channel(recording, entry, run=run)
            signals = regression.prepare_elastic_signals(moved, ElasticOptions())
            rate = partial(differentiate_smooth, period=signals.period)
            design = regression.build_equations(library, signals, rate, np.asarray)
            for joint in range(size):
                torsion, torque = signals.phi[:, joint], signals.tau[:, joint]
                if not np.ptp(torsion) > 0.0 or not np.ptp(torque) > 0.0:
                    continue
                # A damper beside the spring is no delay either.
                basis = regression.build_spring_basis(torsion - torsion.mean(), slice(None)), rate(torsion)
                whole = np.column_stack([design[:, joint, bases:], *basis])
                whole, right = whole[signals.settled :], torque[signals.settled :]
                left = right - whole @ solve_scaled(whole, right, rcond=numerics.RANK)
                parts += [np.mean(part**2) / np.var(torque) for part in np.array_split(left, _BLOCKS)]
        losses.append(np.array(parts)[:, None])
    gain = compare(*losses)
    return not (gain.p_of_all < POLICY.alarm and gain.fall_of_all * (1.0 - POLICY.relevance) > 1.0)


def prepare_aligned(
    library: Library, recordings: Sequence[Recording]
) -> tuple[tuple[Recording, ...], Alignment | None, tuple[Notice, ...]]:
    """Return the recordings with delay and offsets of their link encoders taken out, if there are any.

    What is not significant is left alone, and so is a zero that is not identifiable; notices say so.
    Recordings that are too short for that are returned as they are. Rigid joints get one position.

    Raises:
        LogError: see `estimate_alignment`.
    """
    recordings, joined = regression.join_rigid_joints(library.card, recordings)
    try:
        moved, found, kept, notices = _align(library, recordings)
    except LogError as error:
        if {notice.code for notice in error.notices} != {"log.short-alignment"}:
            raise
        short = (replace(notice, text=f"{notice.text}; it was taken as none") for notice in error.notices)
        return tuple(recordings), None, (*joined, *short)
    notices = (*joined, *notices)
    if kept is not None:
        return moved, kept, notices
    text = f"delay between the encoders: {1e3 * found.delay:.3g} ms (standard deviation "
    text += f"{1e3 * found.delay_std:.2g} ms)"
    if not np.all(np.isnan(found.offsets)):
        largest, deviation = np.nanmax(np.abs(found.offsets)), np.nanmax(found.offset_stds)
        text += f", zero offsets up to {largest:.2g} ({deviation:.2g})"
    notice = Notice(code="log.in-line", text=f"{text}: not significant, nothing was moved")
    return moved, found, (notice, *notices)


def _compute_reversal_widths(runs: Sequence[RigidRows]) -> FloatArray:
    """Return the speeds (n,) in rad/s or m/s over which a change of direction is spread."""
    speeds: FloatArray = np.max([np.max(np.abs(rows.speed), axis=0) for rows in runs], axis=0)
    return POLICY.relevance * np.where(speeds > 0.0, speeds, 1.0)


def _solve_runs(sums: FloatArray, beta: FloatArray) -> FloatArray:
    """Return compliances, and squares of the torsion that gravity explains and leaves: (3, runs, n)."""
    # Gravity and torsion are cleared of nuisances and of the torque of motion first (Frisch and Waugh).
    own = sums.shape[-1] - 2 * len(beta) - 1
    change = scipy.linalg.block_diag(np.eye(own), beta[:, None], beta[:, None], 1.0)
    found = np.zeros((*sums.shape[:2], 3))
    for place in np.ndindex(sums.shape[:2]):
        small = change.T @ sums[place] @ change
        inner = small[: own + 1, : own + 1]
        lengths = np.sqrt(np.maximum(np.diag(inner), 0.0))
        scales = np.where(lengths > 0.0, lengths, 1.0)
        side = small[: own + 1, own + 1 :] / scales[:, None]
        part = np.linalg.lstsq(inner / np.outer(scales, scales), side, rcond=numerics.EXACT)[0]
        cleared = small[own + 1 :, own + 1 :] - side.T @ part
        loading, whole = float(cleared[0, 0]), max(float(cleared[1, 1]), 0.0)
        compliance = explained = 0.0
        if loading > numerics.CONVERGED**2 * float(small[own + 1, own + 1]) and loading > 0.0:
            compliance = float(cleared[0, 1]) / loading
            explained = min(compliance * float(cleared[0, 1]), whole)
        found[place] = compliance, explained, whole - explained
    return found.transpose(2, 0, 1)


class StiffnessVerdict(Enum):
    """How the estimate of a joint's stiffness ended, in words."""

    IDENTIFIED = "identified"
    NO_ENCODER = "there is no link encoder"
    NO_GRAVITY = "gravity does not load this joint, or always equally"
    BELOW_NOISE = "the torsion that gravity explains is smaller than the residual"
    INCONSISTENT = "the runs contradict each other"
    UNCERTAIN = "poorly identifiable: the interval includes a rigid joint"
    VAGUE = UNCERTAIN  # Its name in files of earlier versions.


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointStiffness(FrozenArrays):
    """The spring of one joint.

    Args:
        verdict, reason: what became of it, with numbers; unit: of a stiffness.
        stiffness, interval: N m/rad or N/m where identified, else None.
        compliance, std: of all runs, rad/(N m) or m/N; NaN where nothing was fitted.
        runs, run_stds: of each run.
        explained, left: root mean square of the torsion that gravity explains and of what is left, rad or m.
    """

    joint: str = field(metadata=name_key("name"))
    unit: str
    verdict: StiffnessVerdict
    reason: str
    stiffness: float | None = None
    interval: tuple[float, float] | None = None
    compliance: float = float("nan")
    std: float = field(default=float("nan"), metadata=name_key("compliance_std"))
    runs: FloatArray = field(metadata=name_key("run_compliances"))
    run_stds: FloatArray = field(metadata=name_key("run_compliance_stds"))
    explained: float = field(metadata=name_key("torsion_explained"))
    left: float = field(metadata=name_key("torsion_left"))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StiffnessEstimate:
    """Delay, offsets and the stiffness of every joint; `blocks` are those of the jackknife."""

    robot: str
    alignment: Alignment
    joints: tuple[JointStiffness, ...]
    blocks: int
    notices: tuple[Notice, ...] = ()


def estimate_stiffness(library: Library, recordings: Sequence[Recording]) -> StiffnessEstimate:
    """Return the stiffness of every joint where the recordings identify it, after aligning the encoders.

    Each recording, of both encoders, is a run with zero offsets of its own.

    Raises:
        LogError: a recording has one encoder only, is uneven or too short, or no joint has both encoders.
    """
    moved, alignment, _, notices = _align(library, recordings)
    # The compliance of every joint in every run, (1 + blocks, runs, n): with all blocks, then without each.
    runs, beta = _build_loaded_rows(library, moved)
    widths, count, torsion = _compute_reversal_widths(runs), len(beta), list[FloatArray]()
    for rows in runs:
        nuisances = (np.ones_like(rows.gap), rows.speed, np.tanh(rows.speed / widths), rows.acceleration)
        parts = [np.stack(nuisances, axis=2), rows.whole - rows.still, rows.still, rows.gap[:, :, None]]
        torsion.append(rows.compute_grams(np.concatenate(parts, axis=2)))
    rigid = np.concatenate([rows.compute_grams() for rows in runs])
    whole, norms = fit_rigid(rigid.sum(axis=0))
    sums = np.array([grams.sum(axis=0) for grams in torsion])
    first = _solve_runs(sums, whole[:count])
    compliances = [first[0]]
    owned = ((run, grams) for run, blocks in enumerate(torsion) for grams in blocks)
    for left_out, (run, grams) in zip(rigid, owned, strict=True):
        part = fit_rigid(rigid.sum(axis=0) - left_out, norms**-2.0)[0][:count]
        without = sums.copy()
        without[run] -= grams
        compliances.append(_solve_runs(without, part)[0])
    # Root mean squares (n,) of the torsion that gravity explains and leaves, rad or m; deviation and size of
    # mean (n,) of the gravity torque as parts of the whole torque.
    samples = sum(part.stop - part.start for rows in runs for part in rows.blocks)
    squares = np.sqrt(first[1:].sum(axis=1) / samples)
    still = np.concatenate([rows.still @ whole[:count] for rows in runs])
    torque = np.concatenate([rows.torque for rows in runs])
    size = np.maximum(np.sqrt(np.mean(torque**2, axis=0)), numerics.TINY)
    shares = np.array([np.std(still, axis=0), np.abs(np.mean(still, axis=0))]) / size
    columns = np.array(compliances).transpose(2, 0, 1), squares.T, shares.T, alignment.present
    return StiffnessEstimate(
        robot=library.card.robot,
        alignment=alignment,
        joints=tuple(map(_judge, library.card.joints, *columns)),
        blocks=len(compliances) - 1,
        notices=notices,
    )


def _judge(
    card: JointCard, compliances: FloatArray, squares: FloatArray, shares: FloatArray, present: np.bool_
) -> JointStiffness:
    """Return the spring of a joint, with a link encoder where `present`; arrays as above, of this joint."""
    (explained, left), (loading, steady), unit = squares.tolist(), shares.tolist(), card.position_unit
    runs = run_stds = np.full(compliances.shape[1], np.nan)
    mean = std = low = high = float("nan")
    against: list[tuple[StiffnessVerdict, str]] = []
    if not present:
        explained = left = float("nan")
        text = "its link encoder's channel is constant or a copy: there is no link encoder"
        against.append((StiffnessVerdict.NO_ENCODER, text))
    elif loading <= numerics.CONVERGED:
        explained, load = 0.0, "gravity does not load this joint"
        if steady > numerics.CONVERGED:
            load = "the torque of gravity on this joint does not change"
        text = f"{load}, and torques of acceleration are shared by rotor and link in unknown parts; "
        text += f"{left:.3g} {unit} RMS of its torsion are unexplained"
        against.append((StiffnessVerdict.NO_GRAVITY, text))
    else:
        # Runs are averaged with the inverse of their variances.
        runs, others = compliances[0], compliances[1:]
        n, freedom, chance = len(others), len(runs) - 1, 1.0
        spread = others - others.mean(axis=0)
        covariance = (n - 1) / n * spread.T @ spread
        run_stds = np.sqrt(np.diag(covariance))
        weights = 1.0 / np.maximum(run_stds, numerics.TINY) ** 2
        weights /= weights.sum()
        mean, std = float(weights @ runs), float(np.sqrt(weights @ covariance @ weights))
        if freedom:
            excess = float(np.sum(((runs - mean) / np.maximum(run_stds, numerics.TINY)) ** 2))
            # The Birge ratio; and the chance that equal springs differ so much.
            std, chance = std * max(1.0, excess / freedom) ** 0.5, float(scipy.stats.chi2.sf(excess, freedom))
        half = float(scipy.stats.t.ppf(0.5 + 0.5 * POLICY.confidence, max(1, n - 1))) * std
        low, high = mean - half, mean + half
        if explained <= left:
            text = f"the torsion that gravity explains, {explained:.3g} {unit}, is smaller than the "
            text += f"residual, {left:.3g} {unit} (RMS)"
            against.append((StiffnessVerdict.BELOW_NOISE, text))
        if chance < POLICY.alarm:
            text = "the runs contradict each other: p-value for equal springs"
            against.append((StiffnessVerdict.INCONSISTENT, f"{text} {chance:.2g}"))
        if low <= 0.0:
            text = f"the 95 % interval of the compliance, {low:.3g} to {high:.3g} {unit}/({card.torque_unit})"
            against.append((StiffnessVerdict.UNCERTAIN, f"{text}, includes a rigid joint"))
    reason = "; ".join(text for _, text in against) or (
        f"gravity explains {explained:.3g} {unit} of the torsion, residual {left:.3g} {unit} (RMS); the 95 % "
        "interval is that of the jackknife over blocks of time"
    )
    return JointStiffness(
        joint=card.name,
        unit=f"{card.torque_unit}/{unit}",
        verdict=against[0][0] if against else StiffnessVerdict.IDENTIFIED,
        reason=reason,
        stiffness=None if against else 1.0 / mean,
        interval=None if against else (1.0 / high, 1.0 / low),
        compliance=mean,
        std=std,
        runs=runs,
        run_stds=run_stds,
        explained=explained,
        left=left,
    )
