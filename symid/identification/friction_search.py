"""Identification of a rigid robot whose friction laws, or their shape values, are to be found.

Robot, recordings, "auto" or the name of a law -> an `Estimate` with the laws found, and their robot.

    plain friction -> laws chosen on held-out torque -> robot with these laws -> fit of everything -> ...

The fit has one more column for each shape value s, the change of the torque with it; so shape values have
deviations of their own, and those of all other parameters count them in. It is repeated about the values
found until they stay, with the loads that the estimate gives where none were measured.

Supported: all kinds of rows; estimators that are linear in the torque.
Not supported: estimators that simulate the robot; elastic joints; laws with a state, which stay those of the
robot file.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from symid.codegen import Library, ModelCard, ParameterCard, compute_model_signature
from symid.errors import Notice, UsageError
from symid.identification.estimators import Estimate, FittedLaw
from symid.identification.regression import fill_loads
from symid.identification.rigid import (
    CANDIDATES,
    PLAIN,
    FrictionChoice,
    choose_laws,
    identify_parameters,
    plan_fit,
)
from symid.joint_models import (
    NO_FRICTION,
    FrictionValues,
    get_friction_law,
    get_law,
    name_shape,
    name_values,
)
from symid.logs import Recording
from symid.notation import join_name
from symid.robot import Processing, Robot

AUTO = "auto"
"""In place of a law's name: each joint's law is chosen on held-out torque."""
_REPEATS = 4
_STILL, _SMALL = 1.0, 0.03
"""Standard deviations, and part of a shape value, within which columns that are linear about it are exact."""
_SAME_LOAD = 3e-3
"""Relative change of the loads that is none."""


def needs_search(name: str | None) -> bool:
    """Return whether the friction asked for leaves a law, or shape values, to be found.

    Raises:
        UsageError: there is no such law.
    """
    if name is None or name == NO_FRICTION:
        return False
    if name == AUTO:
        return True
    law = get_law(name)
    # A law with a state is that of the robot file, bristles and shape.
    return bool(law.shape) and not law.memory


def describe_states(robot: Robot, name: str | None) -> tuple[Notice, ...]:
    """Return a notice on what becomes of friction with a state, if there is some; `name` as in a search."""
    laws = ((joint.name, get_friction_law(joint.friction)) for joint in robot.axes)
    bent = [(joint, law) for joint, law in laws if law is not None and law.memory]
    if not bent:
        return ()
    if name == AUTO or (name is not None and not get_law(name).memory):
        names = ", ".join(f"{joint}: {law.name}" for joint, law in bent)
        text = (
            f"friction with a state ({names}) gives way to a static law, as no search chooses one with a "
            "state; leave --friction out to keep it"
        )
        return (Notice(code="identify.friction-replaced", text=text),)
    kept = []
    for joint, law in bent:
        values = ", ".join(entry.name for entry in (*law.shape, *law.memory))
        kept.append(f"{joint}: {law.name} with its {values}")
    text = (
        "friction with a state is fitted as its curve of steady sliding; shape and state values stay those "
        f"of the robot file ({'; '.join(kept)})"
    )
    return (Notice(code="identify.friction-state", text=text),)


def refuse_states(robot: Robot, what: str) -> None:
    """Refuse, by a UsageError, friction with a state where `what` fits equations along a simulated motion."""
    laws = ((joint.name, get_friction_law(joint.friction)) for joint in robot.axes)
    bent = ", ".join(f"{joint}: {law.name}" for joint, law in laws if law is not None and law.memory)
    if bent:
        text = (
            f"{what} compares a simulated motion with equations of steady sliding, and friction with a state "
            f"({bent}) moves otherwise at reversals; choose another estimator, such as wls"
        )
        raise UsageError(Notice(code="usage.friction-state", text=text))


def search_friction(
    robot: Robot,
    recordings: Sequence[Recording],
    name: str,
    prepare: Callable[[Robot], Library],
    *,
    progress: Callable[[str], None] = lambda _: None,
    **options: Any,  # noqa: ANN401 - those of `identify_parameters` from `rows` on
) -> tuple[Estimate, Robot, Library]:
    """Return the estimate, the robot with its laws, and the robot's functions.

    Args:
        robot: whose joints have a friction law to be found; its couplings keep theirs.
        recordings: at least one, all of this robot.
        name: of a law for all joints, or "auto".
        prepare: returns the compiled functions of a robot.
        progress: takes a short text.
        options: of the fit.

    Raises:
        UsageError, LogError, IdentifiabilityError: as for `identify_parameters`.
    """
    plain = _set_friction(robot, {joint.name: FrictionValues(law=PLAIN) for joint in robot.axes})
    progress("choosing friction laws" if name == AUTO else f"fitting the friction law {name}")
    choice = choose_laws(
        prepare(plain),
        recordings,
        robot.processing,
        gears=[joint.drive.gear for joint in robot.axes],
        names=CANDIDATES if name == AUTO else (get_law(name).name,),
    )
    found = _set_friction(robot, {law.joint: law.friction for law in choice.joints})
    beta, plan, estimate = choice.beta, None, None
    for _ in range(_REPEATS):
        library = _open_shapes(prepare(found), found)
        loaded = fill_loads(library, recordings, robot.processing, beta)
        rows, estimator = options.get("rows", "torque"), options.get("estimator")
        if plan is None:
            plan = plan_fit(library, loaded, robot.processing, rows=rows, estimator=estimator)
            plan = replace(plan, laws_chosen=name == AUTO)
        estimate = identify_parameters(library, loaded, robot.processing, plan=plan, **options)
        still = _moves_little(estimate, library.card)
        found = _move_friction(found, estimate)
        new = estimate.assemble([entry.name for entry in library.card.beta])
        known = "load" not in library.card.friction_inputs or all(one.load is not None for one in recordings)
        if still and (known or float(np.linalg.norm(new - beta)) <= _SAME_LOAD * float(np.linalg.norm(new))):
            break
        beta = new
    if estimate is None:
        raise AssertionError
    return _record_laws(estimate, found, robot, library, choice), found, library


def _set_friction(robot: Robot, friction: Mapping[str, FrictionValues]) -> Robot:
    joints = tuple(
        replace(joint, friction=friction.get(joint.name, joint.friction)) for joint in robot.joints
    )
    return replace(robot, joints=joints)


def _list_shape_cards(robot: Robot) -> list[ParameterCard]:
    """Return the shape values of all joints with a coordinate, in the order of the joints."""
    found = []
    for number, joint in enumerate(robot.joints, start=1):
        if joint.mimic is not None or joint.friction.law == NO_FRICTION:
            continue
        law = get_law(joint.friction.law)
        for entry, value in zip(law.shape, joint.friction.shape, strict=True):
            name = join_name(entry.name, number)
            unit = entry.unit_prismatic if joint.prismatic else entry.unit
            found.append(
                ParameterCard(
                    name=name,
                    expression=name,
                    unit="" if unit == "1" else unit,
                    reason=f"shape value of the friction law {law.name}",
                    joint=joint.name,
                    value=value,
                )
            )
    return found


def _open_shapes(library: Library, robot: Robot) -> Library:
    """Return the library with all shape values of its joints to be fitted."""
    return Library(replace(library.card, searched=tuple(_list_shape_cards(robot))), library.engine)


def _moves_little(estimate: Estimate, card: ModelCard) -> bool:
    found = {entry.name: entry for entry in estimate.parameters}
    pairs = [(found[entry.name], entry.value or 0.0) for entry in card.searched if entry.name in found]
    return all(
        abs(entry.value - before) <= min(_STILL * entry.std, _SMALL * abs(before)) for entry, before in pairs
    )


def _move_friction(robot: Robot, estimate: Estimate) -> Robot:
    """Return the robot with the friction of an estimate; what it refuses keeps its value."""
    known = {entry.name: entry.value for entry in estimate.parameters} | dict(estimate.unresolved)
    joints = []
    for number, joint in enumerate(robot.joints, start=1):
        friction = joint.friction
        if joint.mimic is None and friction.law != NO_FRICTION and friction.values is not None:
            law = get_law(friction.law)
            values, shape = (
                tuple(
                    float(known.get(join_name(entry.name, number), old))
                    for entry, old in zip(entries, olds, strict=True)
                )
                for entries, olds in ((law.linear, friction.values), (law.shape, friction.shape))
            )
            # A value that the rows do not hold must stay one that a law can have.
            shape = tuple(
                min(max(new, 0.2 * old, entry.lower), entry.upper)
                for new, old, entry in zip(shape, friction.shape, law.shape, strict=True)
            )
            joint = replace(joint, friction=replace(friction, values=values, shape=shape))  # noqa: PLW2901
        joints.append(joint)
    return replace(robot, joints=tuple(joints))


def _record_laws(
    estimate: Estimate, robot: Robot, stated: Robot, library: Library, choice: FrictionChoice
) -> Estimate:
    """Return the estimate with its laws, and the signature of the robot that has them."""
    selections = {law.joint: law.selection for law in choice.joints}
    laws = []
    for number, joint in enumerate(robot.joints, start=1):
        if joint.name not in selections:
            continue
        law = get_law(joint.friction.law)
        laws.append(
            FittedLaw(
                joint=joint.name,
                law=law.name,
                shape=joint.friction.shape,
                names=tuple(join_name(entry.name, number) for entry in law.shape),
                smoothing=joint.friction.smoothing,
                selection=selections[joint.name],
            )
        )
    card, truth = library.card, _list_truths(robot, stated)
    parameters = tuple(
        replace(entry, truth=truth.get(entry.name)) if entry.name in own else entry
        for own in [{one.name for one in card.friction}]
        for entry in estimate.parameters
    )
    grouped = [(entry.name, entry.expression) for entry in (*card.beta, *card.friction)]
    return replace(
        estimate,
        laws=tuple(laws),
        parameters=parameters,
        signature=compute_model_signature(robot, grouped),
    )


def _list_truths(robot: Robot, stated: Robot) -> dict[str, float]:
    """Return the values of the robot file's friction, where the law found is its own."""
    found: dict[str, float] = {}
    for number, (joint, own) in enumerate(zip(robot.joints, stated.joints, strict=True), start=1):
        if own.friction.law == joint.friction.law:
            pairs = name_values(own.friction) | name_shape(own.friction)
            found |= {join_name(name, number): value for name, value in pairs.items()}
    return found


def identify_loaded(
    library: Library,
    recordings: Sequence[Recording],
    processing: Processing,
    fit: Callable[[Sequence[Recording]], Estimate],
) -> Estimate:
    """Return the estimate of `fit`, with loads that follow from it where friction reads some.

    The first fit has no load, so that what friction takes of it is left to the other parameters.
    """
    if "load" not in library.card.friction_inputs or all(one.load is not None for one in recordings):
        return fit(recordings)
    names = [entry.name for entry in library.card.beta]
    without = [
        one if one.load is not None else replace(one, load=np.zeros_like(one.position)) for one in recordings
    ]
    beta = fit(without).assemble(names)
    for _ in range(_REPEATS):
        estimate = fit(fill_loads(library, recordings, processing, beta))
        new = estimate.assemble(names)
        moved = float(np.linalg.norm(new - beta)) / max(float(np.linalg.norm(new)), 1e-300)
        beta = new
        if moved <= _SAME_LOAD:
            break
    return estimate


def refuse_search(name: str, why: str) -> UsageError:
    """Return the error that a law cannot be searched here."""
    text = (
        f"the friction law {name!r} leaves values to be found, which {why}; name a law without shape values"
    )
    return UsageError(Notice(code="usage.friction-search", text=text))
