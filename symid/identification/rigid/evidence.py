"""What speaks for a fit of a rigid robot: prediction, consistency, physics; all from its condensed logs.

SettingsStudy, values of the fit -> `Evidence`.

    prediction    100 |y - Y x_(-f)| / max(|y|, |Y x|) of every joint in the scoring band, f the row's fold
    consistency   two estimates from different rows: halves of a log, a log and others, slow and fast rows,
                  the band taken and half of it; `agree` says same, different, or inconclusive
    physics       rotor inertias, friction and mass matrices that no robot has, surely (p below the alarm)
                  and not small; then the fit is bounded, and what that leaves counts

Joints at rest and joints without a torque count nowhere. Of several logs, whole logs are held out where each
of them determines the parameters well enough to be compared with the others.

Supported: torque, momentum and filtered rows with any estimator; it is judged by least squares, or
instruments, of torque rows within the same band.
Not supported: evidence for power and energy rows.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.identification import diagnostics, estimators, judge, regression
from symid.identification.judge import POLICY, Agreement
from symid.identification.regression import BlockFit, ThinMotion, fit_sums
from symid.identification.rigid.scale import JointScale, compare_scales
from symid.identification.rigid.settings_choice import SettingsStudy
from symid.joint_models import is_braking
from symid.robot import Robot

_POSES = 60
"""Of the logs, at which mass matrices are looked at."""


def collect_evidence(
    library: Library,
    study: SettingsStudy,
    values: FloatArray,
    covariance: FloatArray,
    *,
    whole: bool = True,
    robot: Robot | None = None,
    transmission: FloatArray | None = None,
) -> estimators.Evidence:
    """Return the evidence for a fit's values (p,); `whole` whether all of them are identifiable.

    Without the `robot` no bodies that exist are tried, nor is gravity as a cause. `transmission` (n, n) as in
    `Recording`.
    """
    names, logs = [joint.name for joint in library.card.joints], study.logs
    tests, logwise = list_tests(library, study, names)
    folds = study.fit.folds[logs.fold]
    if logwise:
        runs = np.unique(logs.log).tolist()
        others = [study.fit_blocks(logs.log != run) for run in runs]
        folds = np.stack([entry.values for entry in others])[logs.log]
    motion, gravity = logs.motion, None
    followed = diagnostics.FollowedLogs.follow(library, motion, logs.fold)
    # Not where gravity is a part of the fit itself.
    if robot is not None and library.tangents is None:
        found = diagnostics.estimate_gravity(followed, robot)
        turn, spread = np.degrees(found.turn), np.degrees(found.deviation)
        test = build_test("gravity", "", f"{turn:.3g} degrees +- {spread:.2g}", found.difference)
        # Another direction that predicts no better may stand for a zero that is off; one that is not sure, or
        # too small to matter, for anything that a joint with little torque lacks.
        if found.difference.verdict is Agreement.DIFFERENT:
            gravity = diagnostics.suspect_gravity(found, motion)
            pair = diagnostics.fit_motion(followed.columns, motion, logs.fold), followed.fit(gravity)
            if not judge.compare(*(one.losses for one in pair)).p_of_all < POLICY.caution:
                test = replace(test, verdict=Agreement.OPEN.value)
        tests += (test,)
    impossible = list_impossible(library, study, values, covariance, motion if whole else None)
    fastest = (np.abs(part).max(axis=0) for part in (motion.dq, motion.ddq))
    ranges = [part.tolist() for part in (motion.q.min(axis=0), motion.q.max(axis=0), *fastest)]
    evidence = estimators.Evidence(
        joints=list_joints(study, values, folds, names),
        scoring=study.choice.scoring,
        stretches=int(logs.fold.max()) + 1,
        logs=int(logs.log.max()) + 1 if logwise else 0,
        tests=tests,
        impossible=impossible,
        bounded=measure_bounded(study, robot, library) if impossible else 0.0,
        in_proportion=tuple((names[j], names[k]) for j, k in logs.list_proportions()),
        period=logs.repeats,
        covered=tuple(estimators.JointRange(*row) for row in zip(names, *ranges, strict=True)),
    )
    causes: tuple[estimators.Cause, ...] = ()
    odd = bool(impossible) or evidence.unexplained > 100.0 * POLICY.relevance
    odd |= any(entry.held_out > POLICY.usable for entry in evidence.joints)
    odd |= any(entry.verdict == Agreement.DIFFERENT.value for entry in tests)
    # All is tried where something is odd, or gravity differs.
    if odd or gravity is not None:
        every = [] if gravity is None else [gravity]
        every += diagnostics.suspect_logs(followed)
        every += diagnostics.list_mistakes(followed, transmission)
        every += diagnostics.list_terms(followed, study.fit.values)
        causes = diagnostics.find_causes(followed, every, impossible=bool(impossible))
    # No cause explains another scale: one factor on all torques leaves the residual as it is.
    for entry in compare_fit(library, study, values, covariance, robot):
        if entry.is_beyond():
            size = abs(entry.ratio - 1.0)
            differs = judge.Difference(size=size, bound=size, p=0.0)
            tests += (build_test("scale", entry.joint, f"{entry.ratio:.3g} times", differs),)
    return replace(evidence, causes=causes, tests=tests)


def compare_fit(
    library: Library, study: SettingsStudy, values: FloatArray, covariance: FloatArray, robot: Robot | None
) -> tuple[JointScale, ...]:
    """Return the scales of a fit's torques against the robot file, in its logs."""
    own, motion = slice(len(library.card.beta)), study.logs.motion
    states, columns = (motion.q, motion.dq, motion.ddq), study.logs.columns[:, :, own]
    return compare_scales(library.card, robot, states, columns, values[own], covariance[own, own])


def list_joints(
    study: SettingsStudy, values: FloatArray, folds: FloatArray, names: Sequence[str]
) -> tuple[estimators.JointEvidence, ...]:
    """Return what is left of every joint by the fit, and by the fits without each block (b, p)."""
    logs, sums = study.logs, study.logs.scores[1]
    fitted = regression.measure_left(sums, np.broadcast_to(values, folds.shape)).sum(axis=1)
    held = regression.measure_left(sums, folds).sum(axis=1)
    found = []
    for joint, (name, live, table) in enumerate(zip(names, sums.live, sums.squares, strict=True)):
        torque = float(logs.torque[joint])
        if torque <= 0.0:
            continue
        own = values[live]
        model = float(np.einsum("k,bkl,l->", own, table[:, 0, :-1, :-1], own))
        # The larger torque counts: a log almost without one explains nothing.
        size, rows = max(torque, model), sums.counts[joint].sum(axis=0)
        parts = held[joint, -1], held[joint, 0] - held[joint, -1]
        counts = rows[-1], rows[0] - rows[-1]
        moving, slow = (
            100.0 * float(np.sqrt(max(left, 0.0) / count * rows[0] / size)) if count else float("inf")
            for left, count in zip(parts, counts, strict=True)
        )
        used = study.sums.counts[joint].sum(axis=0)
        found.append(
            estimators.JointEvidence(
                joint=name,
                fitted=100.0 * float(np.sqrt(fitted[joint, 0] / size)),
                held_out=100.0 * float(np.sqrt(held[joint, 0] / size)),
                moving=moving,
                slow=slow,
                share=1.0 - float(used[study.classes[joint]] / used[0]),
                torque=float(np.sqrt(torque / rows[0])),
            )
        )
    return tuple(found)


def list_tests(
    library: Library, study: SettingsStudy, names: Sequence[str]
) -> tuple[tuple[estimators.ConsistencyTest, ...], bool]:
    """Return what estimates from different rows say of each other, and whether whole logs can be held out."""
    logs, count, grams = study.logs, len(names), study.logs.list_grams()
    friction = grams.copy()
    inertial = len(library.card.beta)
    friction[:, :inertial] = friction[:, :, :inertial] = 0.0
    found: list[tuple[str, str, int, judge.Difference]] = []

    def compare(
        what: str,
        part: str,
        pair: tuple[BlockFit, BlockFit],
        tables: FloatArray,
        shared: FloatArray | None = None,
    ) -> list[judge.Difference]:
        difference, changes = pair[0].values - pair[1].values, pair[0].changes - pair[1].changes
        if shared is not None:
            difference, changes = shared @ difference, changes @ shared.T
        differences = enumerate(judge.agree(difference, changes, tables, logs.torque))
        told = [(what, part, joint, entry) for joint, entry in differences if logs.torque[joint]]
        found.extend(told)
        return [entry for *_, entry in told]

    runs = np.unique(logs.log).tolist()
    logwise = len(runs) > 1
    for run in runs if logwise else ():
        shared, complete = find_shared(study, logs.log == run)
        pair = study.fit_blocks(logs.log == run), study.fit_blocks(logs.log != run)
        told = compare("logs", str(run + 1), pair, grams, shared)
        logwise &= complete and all(entry.verdict is not Agreement.OPEN for entry in told)
        if len(runs) == 2:
            # The second one with the first says the same.
            break
    if len(runs) == 1:
        half = logs.fold < 0.5 * (logs.fold.max() + 1)
        pair = study.fit_blocks(half), study.fit_blocks(~half)
        compare("halves", "", pair, grams, find_shared(study, half)[0])
    if study.narrow is not None:
        compare("band", "", (study.fit, fit_sums(study.narrow, study.classes, logs.fold)), grams)
    last = logs.limits.shape[1] - 1
    if last:
        pair = study.fit_blocks(None, [0] * count), study.fit_blocks(None, [last] * count)
        compare("slow rows", "", pair, friction)
    chances = judge.adjust_chances([entry.p for *_, entry in found])
    tests = [
        build_test(what, names[joint], part, replace(entry, p=p))
        for (what, part, joint, entry), p in zip(found, chances, strict=True)
    ]
    return tuple(tests), logwise


def build_test(what: str, joint: str, part: str, found: judge.Difference) -> estimators.ConsistencyTest:
    """Return a test with its sizes in percent."""
    size, bound = 100.0 * found.size, 100.0 * found.bound
    return estimators.ConsistencyTest(
        what=what, joint=joint, part=part, verdict=found.verdict.value, size=size, bound=bound, p=found.p
    )


def find_shared(study: SettingsStudy, blocks: NDArray[np.bool_]) -> tuple[FloatArray, bool]:
    """Return the projection (p, p) on what blocks and the others both determine, and whether that is all.

    In a direction where one side has less than `relevance`^2 of all squares, its deviation is some fifty
    times that of both: a joint that rests there, or a load that it never carries.
    """
    one, other = (
        study.sums.join_squares(study.classes, study.fit.weights, part)[:-1, :-1]
        for part in (blocks, ~blocks)
    )
    whole, scales = regression.scale_products(one + other)
    shares, vectors = scipy.linalg.eigh(one * scales[:, None] * scales, whole)
    both = np.minimum(shares, 1.0 - shares) >= POLICY.relevance**2
    kept = vectors[:, both]
    inverse = np.divide(1.0, scales, out=np.zeros_like(scales), where=scales > 0.0)
    # What no row tells of is no part of it.
    complete = int(both.sum()) >= int(np.sum(scales > 0.0))
    return scales[:, None] * (kept @ kept.T @ whole) * inverse, complete


def list_impossible(
    library: Library,
    study: SettingsStudy,
    values: FloatArray,
    covariance: FloatArray,
    motion: ThinMotion | None,
) -> tuple[str, ...]:
    """Return in words what no robot can have, where it is sure and matters for a joint's torque.

    Mass matrices are those along a `motion`, None for none of them.
    """
    card, sums = library.card, study.logs.scores[1]
    deviations = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    sizes = np.zeros(len(values))
    for live, table, torque in zip(sums.live, sums.squares, study.logs.torque, strict=True):
        if torque > 0.0:
            squares = np.diagonal(table[:, 0, :-1, :-1].sum(axis=0)) / torque
            sizes[live] = np.maximum(sizes[live], np.sqrt(squares) * np.abs(values[live]))
    # Deviations that none of so many values falls below by chance.
    limit = -float(scipy.special.ndtri(POLICY.alarm / len(values)))
    found = []
    for place, entry in enumerate((*card.beta, *card.friction)):
        friction = place >= len(card.beta) and is_braking(entry.name)
        rotor = place < len(card.beta) and entry.name.startswith("IA")
        surely = deviations[place] > 0.0 and values[place] < -limit * deviations[place]
        if (friction or rotor) and surely and sizes[place] > POLICY.relevance:
            what = "friction drives the joint" if friction else "a rotor has a negative inertia"
            found.append(f"{entry.name} = {values[place]:.3g} {entry.unit}: {what}")
    if motion is None:
        return tuple(found)
    count = len(card.beta)
    places = np.linspace(0, len(motion.q) - 1, _POSES).astype(int)
    # (t, i, j, k): row i of column j of M at pose t, of each base parameter.
    columns = diagnostics.evaluate_inertia_columns(library, np.ascontiguousarray(motion.q[places]))
    mass = np.stack(list(columns), axis=2)
    matrices = mass @ values[:count]
    least, vectors = np.linalg.eigh((matrices + matrices.swapaxes(1, 2)) / 2.0)
    weakest = vectors[:, :, 0]
    row = np.einsum("ti,tijk,tj->tk", weakest, mass, weakest)
    spreads = np.sqrt(np.maximum(np.einsum("tk,kl,tl->t", row, covariance[:count, :count], row), 0.0))
    bad = int(np.sum(least[:, 0] < -limit * spreads))
    # The largest part of a joint's torque, in root mean squares, that negative inertia takes.
    negative = np.minimum(least, 0.0)
    torques = np.einsum("tij,tj,tkj,tk->ti", vectors, negative, vectors, motion.ddq[places])
    part, torque = (np.sqrt(np.mean(entry**2, axis=0)) for entry in (torques, motion.tau[places]))
    if bad and np.max(part / np.where(torque > 0.0, torque, np.inf)) > POLICY.relevance:
        found.append(f"the mass matrix is not positive definite at {bad} of {_POSES} poses of the logs")
    return tuple(found)


def measure_bounded(study: SettingsStudy, robot: Robot | None, library: Library) -> float:
    """Return the percent of held-out torque that a fit of bodies that exist leaves, mean over joints.

    The fit to all rows is bounded; it is scored as the free fit is, and what that loses when held out is
    added. Without a robot rotors and friction alone are bounded.
    """
    logs, whole = study.logs, study.sums.join_squares(study.classes, study.fit.weights)
    scaled, scales = regression.scale_products(whole)
    triangle = np.linalg.cholesky(scaled).T / np.where(scales > 0.0, scales, np.inf)
    centre = regression.solve_products(whole)
    if robot is not None:
        bounded = estimators.solve_consistent(triangle, centre, estimators.build_bodies(robot)).values
    else:
        # Steps of searched shape values have no bounds.
        names = ["" if entry in library.card.searched else entry.name for entry in library.card.fitted]
        low = [0.0 if is_braking(name) or name.startswith("IA") else -np.inf for name in names]
        bounded = scipy.optimize.lsq_linear(triangle[:, :-1], triangle[:, -1], (low, np.inf)).x
    moving = logs.torque > 0.0
    left, free, held = (
        regression.measure_left(logs.scores[1], values)[:, :, 0].sum(axis=1)[moving] / logs.torque[moving]
        for values in (
            np.broadcast_to(bounded, (len(logs.log), len(bounded))),
            np.broadcast_to(centre, (len(logs.log), len(centre))),
            study.fit.folds[logs.fold],
        )
    )
    return 100.0 * float(np.mean(np.minimum(1.0, np.sqrt(left + np.maximum(held - free, 0.0)))))
