"""Identification of a rigid robot whose friction laws, or their shape values, are to be found.

Robot, recordings, "auto" or the name of a law, of all joints or joint by joint -> an `Estimate` with the laws
found, and their robot. Joints that are not named keep law and shape values of the robot file.

    plain friction -> laws chosen on held-out torque -> robot with these laws -> fit of everything -> ...

The fit has one more column for each shape value s, the change of the torque with it, so that shape values
have deviations of their own. It is repeated about the values found until they stay, with the loads that the
estimate gives where none were measured. Where a last step leads farther than such a column is straight, the
values are those of a fit without it: their deviations then say that the rows hardly know s.

A law that was chosen gives way where the plain one surely predicts held-out torque of the whole robot better
(`judge.compare`).

Supported: all kinds of rows. Not supported: estimators that simulate the robot; elastic joints; laws with a
state, which stay those of the robot file.
"""

import math
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import scipy

from symid import joint_models
from symid.arrays import FloatArray
from symid.codegen import Library, ParameterCard, compute_model_signature
from symid.errors import Notice, UsageError
from symid.identification import regression, rigid
from symid.identification.estimators import Estimate, FittedLaw
from symid.identification.friction import AUTO
from symid.identification.judge import POLICY, adjust_chances, compare, numerics
from symid.logs import Recording
from symid.notation import join_name
from symid.robot import Processing, Robot, suggest_names


class _Result(NamedTuple):
    """A fit, the robot about whose shape values it is, and its functions.

    `refit` fits a robot whose shape values stay to the same recordings; `measure` returns the losses
    (parts, n) of held-out torque that functions leave.
    """

    estimate: Estimate
    robot: Robot
    library: Library
    refit: Callable[[Robot], Estimate]
    measure: Callable[[Library], FloatArray]


_NEXT = re.compile(r",(?=[^,=]*=)")
"""Before a joint's name: commas stand in names of laws as well."""


def read_joint_laws(
    friction: str | Mapping[str, str] | None,
    robot: Robot,
    further: Sequence[str] = (AUTO, joint_models.NO_FRICTION),
) -> str | dict[str, str] | None:
    """Return a law for all joints, or those of single joints by name; a UsageError names all mistakes.

    `friction` is a law, joints with their laws, or a text such as "elbow=stribeck,wrist=auto"; `further` are
    words that are allowed beside laws.
    """
    if friction is None or (isinstance(friction, str) and "=" not in friction):
        return friction
    if isinstance(friction, str):
        given = [tuple(part.strip() for part in one.split("=", 1)) for one in _NEXT.split(friction)]
    else:
        given = list(friction.items())
    joints = {joint.name: joint for joint in robot.axes}
    mistakes, wrong = [], {"joint": False, "law": False}
    found = dict[str, str]()
    for joint, law in given:
        if joint not in joints:
            wrong["joint"] = True
            hint = suggest_names(str(joint), joints, before="; ")
            mistakes.append(f"friction of joint {joint!r}: no such joint{hint or '.'}")
        elif joint in found:
            mistakes.append(f"friction of joint {joint!r} is given twice; give it once.")
        hint = f"expected the name of a law, got {law!r}"
        if isinstance(law, str):
            hint = "" if law in further else joint_models.describe_unknown_law(law)
        if hint:
            wrong["law"] = True
            if not hint.endswith("?"):
                hint += suggest_names(str(law), further, before="; ") or "."
            mistakes.append(f"friction of joint {joint!r}: {hint}")
        elif joint in joints and law not in further and (known := joint_models.get_law(law)).memory:
            # A law with a state is that of the robot file, or none.
            if known.name != joints[joint].friction.law:
                values = ", ".join(entry.name for entry in (*known.shape, *known.memory))
                text = f"{law!r} needs {values}, which no option gives; write it into the robot file."
                mistakes.append(f"friction of joint {joint!r}: {text}")
            continue
        found[joint] = law
    if mistakes:
        allowed = [f"joints are {', '.join(joints)}"] if wrong["joint"] else []
        allowed += [f"laws are {joint_models.list_known_laws(*further)}"] if wrong["law"] else []
        mistakes[-1] = " ".join([mistakes[-1], *(f"Allowed {entry}." for entry in allowed)])
    UsageError.refuse(mistakes, code="usage.joint-friction")
    return found or None


def needs_search(friction: str | Mapping[str, str] | None) -> bool:
    """Return whether the friction asked for leaves a law, or shape values, to be found."""
    if isinstance(friction, Mapping):
        return bool(friction)
    if friction is None or friction == joint_models.NO_FRICTION:
        return False
    if friction == AUTO:
        return True
    law = joint_models.get_law(friction)
    # A law with a state is that of the robot file, bristles and shape.
    return bool(law.shape) and not law.memory


def _list_states(robot: Robot) -> dict[str, joint_models.FrictionLaw]:
    laws = {joint.name: joint_models.get_friction_law(joint.friction) for joint in robot.axes}
    return {name: law for name, law in laws.items() if law is not None and law.memory}


def describe_states(robot: Robot, friction: str | Mapping[str, str] | None) -> tuple[Notice, ...]:
    """Return notices on what becomes of friction with a state; `friction` as in a search."""
    kept, replaced, notices = list[str](), list[str](), list[Notice]()
    for name, law in _list_states(robot).items():
        wanted = friction.get(name) if isinstance(friction, Mapping) else friction
        static = wanted in {AUTO, joint_models.NO_FRICTION}
        if static or (wanted is not None and not joint_models.get_law(wanted).memory):
            replaced.append(f"{name}: {law.name}")
        else:
            kept.append(f"{name}: {law.name} with its {', '.join(e.name for e in (*law.shape, *law.memory))}")
    if replaced:
        text = f"friction with a state ({', '.join(replaced)}) gives way to a static law, as no search "
        text += "chooses one with a state; leave --friction out to keep it"
        notices.append(Notice(code="identify.friction-replaced", text=text))
    if kept:
        text = "friction with a state is fitted as its curve of steady sliding; shape and state values stay "
        text += f"those of the robot file ({'; '.join(kept)})"
        notices.append(Notice(code="identify.friction-state", text=text))
    return tuple(notices)


def refuse_states(robot: Robot, what: str) -> None:
    """Refuse, by a UsageError, friction with a state where `what` fits equations along a simulated motion."""
    if bent := ", ".join(f"{name}: {law.name}" for name, law in _list_states(robot).items()):
        text = f"{what} compares a simulated motion with equations of steady sliding, and friction with a "
        text += f"state ({bent}) moves otherwise at reversals; choose another estimator, such as wls"
        raise UsageError(Notice(code="usage.friction-state", text=text))


def search_friction(
    robot: Robot,
    recordings: Sequence[Recording],
    friction: str | Mapping[str, str],
    prepare: Callable[[Robot], Library],
    *,
    progress: Callable[[str], None] = lambda _: None,
    **options: Any,  # noqa: ANN401 - those of `identify_parameters` from `rows` on
) -> tuple[Estimate, Library]:
    """Return the estimate with its laws, and the functions of the robot that has them.

    `friction` is a law for all joints or "auto", or those of single joints by name; couplings keep theirs.
    """
    axes = {joint.name: joint for joint in robot.axes}
    names = friction if isinstance(friction, Mapping) else dict.fromkeys(axes, friction)
    plain = set_friction(robot, dict.fromkeys(axes, joint_models.FrictionValues(law=rigid.PLAIN)))
    progress(f"finding friction laws ({', '.join(dict.fromkeys(names.values()))})")
    # The laws that each joint's is chosen from, or the friction that it keeps.
    wishes: dict[str, rigid.Wish] = {name: joint.friction for name, joint in axes.items()}
    for name, law in names.items():
        if law == joint_models.NO_FRICTION:
            wishes[name] = joint_models.FrictionValues()
        else:
            wishes[name] = rigid.CANDIDATES if law == AUTO else (joint_models.get_law(law).name,)
    gears, rotors = [joint.drive.gear for joint in robot.axes], regression.list_coupled_rotors(robot)
    logs = prepare(plain), recordings, robot.processing
    choice = rigid.choose_laws(*logs, gears=gears, wishes=tuple(wishes.values()), rotors=rotors)
    found = set_friction(robot, {law.joint: law.friction for law in choice.joints})
    known = all(regression.list_measured_joints(recordings))

    rows, estimator = options.get("rows", "torque"), options.get("estimator")

    def settle(found: Robot, loaded: Sequence[Recording], library: Library) -> rigid.FitPlan:
        """Return settings of a fit, which are found once."""
        plan = rigid.plan_fit(library, loaded, robot.processing, rows=rows, estimator=estimator)
        kept = _keep_slow_rows(plan, found, choice.motion.slowest)
        return plan if kept == plan else study(kept, loaded, library)

    def study(plan: rigid.FitPlan, loaded: Sequence[Recording], library: Library) -> rigid.FitPlan:
        """Return the plan with what parts of the logs say of the library's parameters at its settings."""
        if plan.study is None:
            return plan
        again = rigid.plan_fit(library, loaded, plan.processing, rows=rows, estimator=plan.estimator)
        return replace(plan, study=again.study and replace(again.study, choice=plan.study.choice))

    def fit_once(plan: rigid.FitPlan, loaded: Sequence[Recording], held: Robot) -> Estimate:
        library = prepare(held)
        own = study(plan, loaded, library)
        return rigid.identify_parameters(library, loaded, robot.processing, plan=own, **options)

    def fit(found: Robot) -> _Result:
        """Return the fit of a robot with the laws found, repeated until shape values and loads stay."""
        beta, plan, best, left = choice.beta, None, None, numerics.ROUNDS
        while True:
            left -= 1
            library = prepare(found)
            # The shape values of the joints asked for are fitted, too.
            library = Library(replace(library.card, searched=_list_searched(found, names)), library.engine)
            loaded = regression.fill_loads(library, recordings, robot.processing, beta)
            if plan is None:
                plan = settle(found, loaded, library)
            estimate = rigid.identify_parameters(library, loaded, robot.processing, plan=plan, **options)
            before, refit = _list_bent(found), partial(fit_once, plan, loaded)
            # Where a step of shape values helps no more, others would lead away; loads settle by themselves.
            percent = estimate.mean_relative_percent
            if best is not None and before and percent > best.estimate.mean_relative_percent:
                return _hold_shape(best, best.robot, estimate)
            begun, found = found, _move_friction(found, estimate)
            after, deviations = _list_bent(found), {entry.name: entry.std for entry in estimate.parameters}
            # Within a deviation, or where columns that are linear about a value, times others, are exact.
            still = all(
                abs(after[name] - value) <= max(deviations.get(name, math.inf), POLICY.relevance * abs(value))
                for name, value in before.items()
            )
            new = estimate.assemble([entry.name for entry in library.card.beta])
            stays = known or "load" not in library.card.friction_inputs or _agree(new, beta)
            measure = partial(_measure_losses, recordings=loaded, processing=plan.processing)
            best = _Result(estimate, begun, library, refit, measure)
            if not left or (still and stays):
                return _hold_shape(best, found, estimate)
            beta = new

    result = fit(found)
    if (plain := _make_plain(found, _list_chosen(found, names))) != found and result.estimate.evidence:
        progress(f"comparing with {rigid.PLAIN}")
        choice, result = _give_up_worse(choice, names, fit, result, result.measure(prepare(plain)))
    estimate, found, library = result[:3]
    laws = rigid.compare_friction(choice, {joint.name: joint.friction for joint in found.axes})
    estimate = replace(estimate, notices=(*choice.notices, *laws, *estimate.notices))
    return _record_laws(estimate, found, robot, library, choice, names), library


def _keep_slow_rows(plan: rigid.FitPlan, robot: Robot, slowest: FloatArray) -> rigid.FitPlan:
    """Return the plan with rows that show how laws bend (POLICY.bend), no slower than `slowest` (n,).

    Speeds that are stated stay.
    """
    chosen, kept = plan.processing.standstill, list[str]()
    if not isinstance(chosen, tuple) or "standstill" not in robot.processing.left_open:
        return plan
    speeds = list(chosen)
    for place, (joint, slow) in enumerate(zip(robot.axes, slowest, strict=True)):
        law = joint_models.get_friction_law(joint.friction)
        shape = zip(joint.friction.shape, law.shape if law else (), strict=False)
        bends = [value for value, entry in shape if entry.unit == "rad/s"]
        if bends and (least := max(slow, POLICY.bend * min(bends))) < speeds[place]:
            speeds[place] = float(f"{least:.3g}")
            kept.append(f"{joint.name} {speeds[place]:.3g}")
    if not kept:
        return plan
    text = "slow samples that show how the friction law bends are kept from these speeds on: "
    text += f"{', '.join(kept)}"
    note = Notice(code="identify.automatic", text=text)
    settings = replace(plan.processing, standstill=tuple(speeds))
    return replace(plan, processing=settings, notices=(*plan.notices, note))


def _hold_shape(result: _Result, held: Robot, later: Estimate) -> _Result:
    """Return a fit and the robot that it found, with the deviations of a `later` fit.

    Where a step leads farther than columns are straight, its values are those about the shape of `held`.
    """
    about, estimate = _list_bent(result.robot), result.estimate
    steps = {entry.name: entry for entry in estimate.parameters if entry.name in about}
    near = (
        abs(one.value - about[name]) <= POLICY.relevance * abs(about[name]) for name, one in steps.items()
    )
    if not all(near):
        fitted, values = result.refit(held), _list_bent(held)
        shape = {entry.name for entry in result.library.card.searched}
        kept = (replace(one, value=values[name]) for name, one in steps.items() if name in shape)
        refused = (one for one in estimate.refused if one[0] in shape)
        estimate = replace(
            fitted, parameters=(*fitted.parameters, *kept), refused=(*fitted.refused, *refused)
        )
    estimate = _take_deviations(estimate, later)
    return result._replace(estimate=estimate, robot=_move_friction(held, estimate))


def _take_deviations(estimate: Estimate, later: Estimate) -> Estimate:
    """Return the estimate with the covariance of a `later` one, whose columns are those about its values."""
    if not later.covariance:
        return estimate
    stds = {entry.name: entry.std for entry in later.parameters}
    moved = tuple(replace(entry, std=stds.get(entry.name, entry.std)) for entry in estimate.parameters)
    # What the later one does not resolve has its deviation alone.
    own = [place for place, entry in enumerate(moved) if entry.name in stds]
    order = [[*stds].index(moved[place].name) for place in own]
    covariance = np.diag([entry.std**2 for entry in moved])
    covariance[np.ix_(own, own)] = np.array(later.covariance)[np.ix_(order, order)]
    return replace(estimate, parameters=moved, covariance=tuple(map(tuple, covariance.tolist())))


def _list_searched(robot: Robot, names: Collection[str]) -> tuple[ParameterCard, ...]:
    found = list[ParameterCard]()
    for number, joint in enumerate(robot.joints, start=1):
        if joint.name in names and joint.friction.law != joint_models.NO_FRICTION:
            reason = f"shape value of the friction law {joint.friction.law}"
            entries = joint_models.get_law(joint.friction.law).shape
            for entry, value in zip(entries, joint.friction.shape, strict=True):
                name = join_name(entry.name, number)
                unit = {"1": ""}.get(entry.unit, entry.unit_prismatic if joint.prismatic else entry.unit)
                own = ParameterCard(name=name, expression=name, unit=unit, reason=reason, joint=joint.name)
                found.append(replace(own, value=value))
    return tuple(found)


def _list_bent(robot: Robot) -> dict[str, float]:
    """Return the values of laws with a shape by name: of the shape, and those that its columns hold."""
    found = dict[str, float]()
    for number, joint in enumerate(robot.joints, start=1):
        if shape := joint_models.name_shape(joint.friction):
            values = shape | joint_models.name_values(joint.friction)
            found |= {join_name(name, number): value for name, value in values.items()}
    return found


def _agree(values: FloatArray, before: FloatArray) -> bool:
    """Return whether parameters of bodies differ by less than matters for loads."""
    return float(np.linalg.norm(values - before)) <= POLICY.relevance * float(np.linalg.norm(values))


def _measure_losses(library: Library, recordings: Sequence[Recording], processing: Processing) -> FloatArray:
    """Return the losses (parts, n) of held-out torque of all rows, within the scoring band."""
    band = regression.measure_scoring_band(recordings)
    cutoff = processing.filter_cutoff or 0.4 / recordings[0].period
    bands = [band * 2.0**k for k in range(-regression.condensing.SCORING, 1)]
    logs = regression.CondensedLogs(library, recordings, processing, bands, cutoff)
    return logs.measure_losses(regression.fit_sums(logs.scores[1], [0] * library.card.size, logs.fold))


def _list_chosen(robot: Robot, names: Mapping[str, str]) -> list[str]:
    """Return the joints whose laws were chosen, and are others than the plain one."""
    return [
        joint.name
        for joint in robot.axes
        if names.get(joint.name) == AUTO and joint.friction.law not in {rigid.PLAIN, joint_models.NO_FRICTION}
    ]


def _make_plain(robot: Robot, joints: Collection[str]) -> Robot:
    values = (0.0,) * len(joint_models.get_law(rigid.PLAIN).linear)
    law = joint_models.FrictionValues(law=rigid.PLAIN, values=values)
    return set_friction(robot, dict.fromkeys(joints, law))


def _give_up_worse(
    choice: rigid.FrictionChoice,
    names: Mapping[str, str],
    fit: Callable[[Robot], _Result],
    found: _Result,
    usual: FloatArray,
) -> tuple[rigid.FrictionChoice, _Result]:
    """Return choice and fit without laws that plain ones, with losses `usual` (parts, n), surely surpass."""
    chosen, given_up, texts = _list_chosen(found.robot, names), list[str](), list[str]()
    while kept := [name for name in chosen if name not in given_up]:
        test = compare(found.measure(found.library), usual)
        places = {joint.name: place for place, joint in enumerate(found.robot.axes)}
        chances = adjust_chances([float(test.p[places[name]]) for name in kept])
        worse = list[str]()
        for name, chance in zip(kept, chances, strict=True):
            own, fall = found.robot.axes[places[name]].friction.law, test.fall[places[name]]
            if chance < POLICY.caution and fall > 1.0 + POLICY.relevance:
                worse.append(name)
                texts.append(f"{name}: {own} has {fall:.3g} times the squared residual")
        if not worse:
            break
        given_up += worse
        found = fit(_make_plain(found.robot, given_up))
    if not given_up:
        return choice, found
    said = "; ".join(texts)
    text = f"{rigid.PLAIN} was taken where it predicts held-out torque of the whole robot better ({said})"
    joints = []
    for law in choice.joints:
        if law.joint in given_up and law.selection is not None:
            verdict = f"{law.selection.verdict} In fits of the whole robot {rigid.PLAIN} predicts better."
            law = replace(law, selection=replace(law.selection, chosen=rigid.PLAIN, verdict=verdict))  # noqa: PLW2901
        joints.append(law)
    note = Notice(code="identify.plain-friction", text=text)
    return replace(choice, joints=tuple(joints), notices=(*choice.notices, note)), found


def set_friction(robot: Robot, friction: Mapping[str, joint_models.FrictionValues]) -> Robot:
    """Return the robot with other friction of joints, by name."""
    joints = (replace(joint, friction=friction.get(joint.name, joint.friction)) for joint in robot.joints)
    return replace(robot, joints=tuple(joints))


def _move_friction(robot: Robot, estimate: Estimate) -> Robot:
    """Return the robot with the friction of an estimate; what it refuses keeps its value."""
    known = {entry.name: entry.value for entry in estimate.parameters} | dict(estimate.unresolved)
    deviations = {entry.name: entry.std for entry in estimate.parameters}
    sure, joints = float(scipy.special.ndtri(1.0 - POLICY.alarm)), []
    for number, joint in enumerate(robot.joints, start=1):
        friction = joint.friction
        if joint.mimic is None and friction.law != joint_models.NO_FRICTION and friction.values is not None:
            law = joint_models.get_law(friction.law)
            olds = zip((*law.linear, *law.shape), (*friction.values, *friction.shape), strict=True)
            found = [float(known.get(join_name(entry.name, number), old)) for entry, old in olds]
            moved = list[float]()
            for new, old, entry in zip(found[len(law.linear) :], friction.shape, law.shape, strict=True):
                # Its column is straight to a factor of two; a longer step that may be chance leads nowhere.
                near = min(max(new, 0.5 * old), 2.0 * old)
                doubt = sure * deviations.get(join_name(entry.name, number), 0.0)
                moved.append(old if near != new and abs(new - old) <= doubt else near)
            limits = zip(moved, law.shape, strict=True)
            shape = tuple(min(max(value, entry.lower), entry.upper) for value, entry in limits)
            friction = replace(friction, values=tuple(found[: len(law.linear)]), shape=shape)
            joint = replace(joint, friction=friction)  # noqa: PLW2901
        joints.append(joint)
    return replace(robot, joints=tuple(joints))


def _record_laws(  # noqa: PLR0917 - the parts of one search
    estimate: Estimate,
    robot: Robot,
    stated: Robot,
    library: Library,
    choice: rigid.FrictionChoice,
    names: Collection[str],
) -> Estimate:
    """Return the estimate with its laws, and the signature of the robot that has them."""
    selections = {law.joint: law.selection for law in choice.joints}
    laws = tuple(
        FittedLaw(
            joint=joint.name,
            law=joint.friction.law,
            shape=joint.friction.shape,
            names=tuple(join_name(name, number) for name in joint_models.list_shape_names(joint.friction)),
            smoothing=joint.friction.smoothing,
            selection=selections[joint.name],
        )
        for number, joint in enumerate(robot.joints, start=1)
        if joint.name in names
    )
    # The values of the robot file's friction, where the law found is its own.
    truth: dict[str, float] = {}
    for number, (joint, before) in enumerate(zip(robot.joints, stated.joints, strict=True), start=1):
        if before.friction.law == joint.friction.law:
            pairs = joint_models.name_values(before.friction) | joint_models.name_shape(before.friction)
            truth |= {join_name(name, number): value for name, value in pairs.items()}
    card = library.card
    friction = {one.name for one in card.friction}
    parameters = tuple(
        replace(entry, truth=truth.get(entry.name)) if entry.name in friction else entry
        for entry in estimate.parameters
    )
    grouped = [(entry.name, entry.expression) for entry in (*card.beta, *card.friction)]
    signature = compute_model_signature(robot, grouped)
    return replace(estimate, laws=laws, parameters=parameters, signature=signature)


def identify_loaded(
    library: Library,
    recordings: Sequence[Recording],
    processing: Processing,
    fit: Callable[[Sequence[Recording]], Estimate],
) -> Estimate:
    """Return the estimate of `fit`, with loads that follow from it where friction reads some.

    The first fit has no load, so that what friction takes of it is left to the other parameters.
    """
    measured = regression.list_measured_joints(recordings)
    if "load" not in library.card.friction_inputs or all(measured):
        return fit(recordings)
    names = [entry.name for entry in library.card.beta]
    loads = [regression.fill_load(one.load, np.zeros_like(one.position), measured) for one in recordings]
    without = [replace(one, load=load) for one, load in zip(recordings, loads, strict=True)]
    beta = fit(without).assemble(names)
    for _ in range(numerics.ROUNDS):
        estimate = fit(regression.fill_loads(library, recordings, processing, beta))
        new = estimate.assemble(names)
        still, beta = _agree(new, beta), new
        if still:
            break
    return estimate


def refuse_search(friction: str | Mapping[str, str], why: str) -> UsageError:
    """Return the error that laws cannot be searched here."""
    text = f"the friction law {friction!r} leaves values to be identified, which {why}"
    text += "; name a law without shape values"
    if isinstance(friction, Mapping):
        listed = ", ".join(f"{key}={law}" for key, law in friction.items())
        text = f"friction of single joints ({listed}) is found from the logs, which {why}"
        text = f"{text}; write these laws into the robot file"
    return UsageError(Notice(code="usage.friction-search", text=text))
