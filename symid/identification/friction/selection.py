"""The choice of a friction law of one joint: which one predicts held-out rows best.

FrictionSamples, laws -> LawSelection.

Each recording is cut into stretches, which are left out in turn and scored in parts. Laws are compared as in
the whole robot (`rigid.search_laws`): of columns R Phi at nodes of the shape values beside R X, sums of
products are enough for every fit without a stretch. Of the identifiable laws the plainest is taken that the
best one does not surely predict better than. The best and the one taken are fitted to all rows with full
effort; where that refuses a parameter of theirs, they are not taken.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.errors import IdentifiabilityError, Notice, SymidError
from symid.identification import rigid
from symid.identification.estimators import LawSelection, LawTrial, MotionResidual, find_phases
from symid.identification.friction import joint_fit, presliding
from symid.identification.friction.estimators import fit_friction
from symid.identification.friction.joint_fit import FrictionEstimate, FrictionSamples
from symid.identification.friction.searches import FrictionOptions, build_problem
from symid.joint_models import FrictionLaw, get_law

CANDIDATE_LAWS = (
    *("coulomb-viscous", "coulomb-viscous-offset", "asymmetric", "tustin+offset", "stribeck+offset"),
    *("lorentzian+offset", "improved-stribeck", "asymmetric-stribeck", "cubic+offset", "power-law+offset"),
    *("stribeck+cubic+offset", "load-dependent+offset", "stribeck-exponent+offset", "makkar+offset"),
)
"""Laws among which `auto` chooses, from plain to rich."""


def predict_rows(samples: FrictionSamples, law: FrictionLaw, estimate: FrictionEstimate) -> FloatArray:
    """Return the torques (M,) in N m or N that an estimate predicts of the rows of `samples`."""
    if law.memory:
        friction = samples.pass_columns(presliding.simulate_presliding(samples, law, estimate)[:, None])[:, 0]
    else:
        friction = samples.pass_law(law, estimate.shape) @ np.asarray(estimate.linear)
    return np.asarray(friction + samples.rows.extra @ np.asarray(estimate.other))


def measure_motion(
    samples: FrictionSamples,
    law: FrictionLaw,
    estimate: FrictionEstimate,
    *,
    unit: str,
    kept: NDArray[np.bool_],
) -> MotionResidual:
    """Return the residual of all rows in motion, at reversal and at rest; those not `kept` (m,) too."""
    rows = samples.rows
    errors = rows.torque - predict_rows(samples, law, estimate)
    phases = find_phases(rows.time, rows.velocity, rows.run)
    return MotionResidual.measure(samples.joint, unit, errors, phases, int(np.sum(~kept)))


def select_law(
    samples: FrictionSamples,
    names: Sequence[str] = CANDIDATE_LAWS,
    *,
    look_up: Callable[[str], FrictionLaw] = get_law,
    options: FrictionOptions | None = None,
) -> tuple[LawSelection, FrictionEstimate]:
    """Return the choice among laws by their names, and the fit of the one taken to all rows.

    `look_up` returns a law by its name. Raises UsageError for an unknown law, IdentifiabilityError where no
    law can be fitted or there are too few rows to hold some out.
    """
    options, rows = options or FrictionOptions(), samples.rows
    parts, fold = joint_fit.cut_parts(rows)
    laws, failed = list[FrictionLaw](), list[LawTrial]()
    for law in list(map(look_up, names)):
        try:
            build_problem(samples, law, options)
        except SymidError as error:
            unknowns = len(law.linear) + len(law.shape)
            failed.append(LawTrial(law=law.name, unknowns=unknowns, reason=error.notices[0].text))
        else:
            laws.append(law)
    if not laws:
        reasons = "; ".join(dict.fromkeys(trial.reason for trial in failed))
        text = f"joint {samples.joint!r}: no law can be fitted to this log: {reasons}"
        raise IdentifiabilityError(Notice(code="friction.no-law", text=text))

    def tabulate(wanted: Sequence[rigid.Wanted], _: FloatArray | None) -> list[rigid.JointTable]:
        given = (samples.inputs, samples.pass_columns, rows.extra, rows.torque, parts, fold)
        return [rigid.tabulate_rows(wanted[0], *given)]

    speeds = np.abs(rows.velocity[rows.velocity != 0.0])
    wanted = [(law, shape) for law in laws for shape in rigid.list_shape_nodes(law, speeds)]
    search = rigid.search_laws(tabulate, [wanted], [speeds])
    trials, fits = list(search.trials[0]), dict[int, FrictionEstimate]()
    while True:
        choice = rigid.choose_trial(trials)
        # The best is what the others are compared with, so it is fitted as well.
        unknown = {choice.best, choice.taken} - fits.keys()
        if not unknown:
            break
        for place in unknown:
            law = look_up(trials[place].law.name)
            fits[place] = fit_friction(samples, law, options=options)
            refused = dict(fits[place].refused)
            weak = tuple(entry.name for entry in law.physical if entry.name in refused)
            trials[place] = trials[place]._replace(weak=weak or trials[place].weak)
    unit = "N" if samples.prismatic else "N m"
    selection = rigid.describe_choice(search.tables[0], trials, choice, "the torque", unit)
    beside = rows.extra.shape[1]
    counts = {one.law.name: (one.fitted, len(rows.torque), one.unknowns + beside) for one in trials}
    listed = [
        replace(trial, aicc=joint_fit.compute_criteria(*counts[trial.law])[0]) for trial in selection.trials
    ]
    return replace(selection, trials=(*listed, *failed)), fits[choice.taken]


def select_memory(
    samples: FrictionSamples, static: FrictionLaw, options: FrictionOptions | None = None
) -> tuple[LawSelection, FrictionEstimate] | None:
    """Return the choice among laws with a state at all rows, and the fit of the one taken.

    None where none of them surely predicts the rows held out better than the law `static`, or none can be
    fitted.
    """
    rows, estimate = samples.rows, fit_friction(samples, static, options=options)
    parts, fold = joint_fit.cut_parts(rows)
    design = joint_fit.compute_sensitivities(samples, static, estimate.linear, estimate.shape)
    fits = [presliding.MemoryFit(estimate, design, rows.torque - predict_rows(samples, static, estimate))]

    def hold_out(fit: presliding.MemoryFit) -> FloatArray:
        steps, _ = presliding.leave_out(fit.design, fit.left, parts, fold)
        pairs = zip(parts, steps[fold], strict=True)
        errors = (fit.left[part] - fit.design[part] @ step for part, step in pairs)
        return np.array([float(error @ error) for error in errors])

    losses = [hold_out(fits[0])]
    for name in presliding.MEMORY_LAWS:
        law = get_law(f"{name}+offset")
        if law.shape and min(map(np.sum, losses)) == losses[0].sum():
            # Where no memory helps, none whose level falls does.
            break
        try:
            found = presliding.fit_memory(samples, law)
            if "offset" in dict(found.estimate.refused):
                # Gravity about one pose is a constant, too.
                found = presliding.fit_memory(samples, get_law(name))
        except IdentifiabilityError:
            continue
        if not found.estimate.refused:
            fits.append(found)
            losses.append(hold_out(found))
    unknowns = [one.design.shape[1] for one in fits]
    taken, _, _ = rigid.choose_plainest(np.array(losses), unknowns, [len(one.estimate.shape) for one in fits])
    if not taken:
        return None
    whole, beside = float(np.sum(rows.torque**2)), rows.extra.shape[1]
    trials = [
        LawTrial(
            law=one.estimate.law,
            unknowns=count - beside,
            fitted_percent=100.0 * float(np.sqrt(one.estimate.objective / whole)),
            held_percent=100.0 * float(np.sqrt(loss.sum() / whole)),
            held_rms=float(np.sqrt(loss.sum() / len(rows.torque))),
            aicc=one.estimate.aicc,
        )
        for one, loss, count in zip(fits, losses, unknowns, strict=True)
    ]
    own, plain, unit = trials[taken], trials[0], "N" if samples.prismatic else "N m"
    verdict = f"On all samples, slow ones too, the held-out residual of {own.law} is {own.held_percent:.3g} "
    verdict += f"% ({own.held_rms:.3g} {unit} RMS); that of {plain.law}, the best law without a state, "
    verdict += f"{plain.held_percent:.3g} %."
    trials.sort(key=lambda trial: trial.held_rms or math.inf)
    selection = LawSelection(trials=tuple(trials), chosen=own.law, verdict=verdict, blocks=len(parts))
    return selection, fits[taken].estimate
