"""Identification of elastic joints: recordings of both encoders to dynamics, friction and hysteresis.

    Recording -> signals -> rows -> methods -> choice -> estimate, residuals, warnings

Supported: several recordings; one method, or an automatic choice among those that take moments; friction that
reads the load of the links: measured, or computed and iterated with a fit that needs no springs; robots that
have rigid joints, too, whose two positions are the same.
Not supported: delays between channels and offsets of encoders (align the recordings first); one encoder only.
"""

import json
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np
import scipy

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.errors import IdentifiabilityError, Notice, UsageError, shorten_names
from symid.identification.diagnostics import build_warning, warn_of_mass_matrix
from symid.identification.elastic import effects, estimate, methods, regression
from symid.identification.elastic.options import ElasticOptions, NlpOptions
from symid.identification.elastic.together import calm_torsions, compute_spring_torques, filter_spring
from symid.identification.estimators import FittedLaw, Residual, list_parameters
from symid.identification.judge import POLICY, numerics
from symid.identification.regression import check_joints, warn_of_energy
from symid.ipopt import Ending
from symid.joint_models import FrictionValues
from symid.logs import Recording, differentiate

if TYPE_CHECKING:
    from symid.identification.elastic.nlp import NlpGraph


def _list_springs(
    work: methods.ElasticEquations, fit: estimate.MethodFit, refused: Mapping[int, Notice]
) -> Iterator[estimate.SpringEstimate]:
    """Yield the spring of every elastic joint, and how far it was excited."""
    problem, count = work.problem, work.problem.sizes[0]
    card, signals = problem.library.card, problem.signals
    wide = calm_torsions(work.wide, problem, fit)
    # What rows show, and the whole; sums of parameters that cannot be told apart have none.
    spreads = [part[:count, :count] for part in (fit.shown, fit.covariance) if part is not None]
    finite = len(spreads) == 2 and bool(np.all(np.isfinite(spreads)))
    for joint, (entry, elasticity) in enumerate(zip(card.joints, fit.elasticity, strict=True)):
        if not problem.gives[joint]:
            continue
        phi, stated = [part.phi[:, joint] for part in signals], card.elasticity[joint]
        torques = [regression.compute_joint_torque(elasticity, part, joint) for part in signals]
        # A stop is sure to have slipped once the torsion's range exceeds twice its threshold.
        span = max(float(np.ptp(part)) for part in phi)
        slipped = [stop.threshold for stop in elasticity.stops if 2.0 * stop.threshold <= span]
        torque_std, slope_std = None, None
        if joint not in refused and finite:
            sides = zip(wide.filtered, filter_spring(wide, elasticity, joint), strict=True)
            torque_std, slope_std = estimate.measure_spring_spread(
                elasticity,
                partial(filter_spring, wide, joint=joint),
                [rows.design[:, joint, :count] for rows in wide.filtered],
                [rows.compute_link_side(fit.chi)[:, joint] - own for rows, own in sides],
                spreads[1],
                shown=spreads[0],
            )
        yield estimate.SpringEstimate(
            joint=entry.name,
            torque_unit=entry.torque_unit,
            position_unit=entry.position_unit,
            elasticity=elasticity,
            torsion=float(np.abs(np.concatenate(phi)).max()),
            excited=max(slipped, default=0.0),
            torque=max(float(np.abs(torque).max()) for torque in torques),
            truth=stated if stated is not None and stated.initial_stiffness is not None else None,
            identifiable=joint not in refused,
            reason=refused[joint].text if joint in refused else "",
            torque_std=torque_std,
            slope_std=slope_std,
        )


def _check_recordings(library: Library, recordings: Sequence[Recording]) -> Mapping[int, Notice]:
    """Return, by joint, why its torsion cannot be used; for raised errors see `prepare_methods`."""
    card = library.card
    if not any(card.yielding):
        text = f"the robot {card.robot!r} has no elastic joints: state [joint.elasticity] for those that are "
        text += "elastic, or identify it as a rigid robot"
        raise UsageError(Notice(code="usage.not-elastic", text=text))
    if not recordings:
        raise UsageError(Notice(code="usage.no-log", text="no log was given: name at least one"))
    check_joints(library, recordings)
    if all(np.all(np.ptp(recording.torque, axis=0) == 0.0) for recording in recordings):
        text = "the measured torque of every joint is zero, or the same number, throughout: check the torque "
        text += "columns of the log and their factors"
        raise IdentifiabilityError(Notice(code="elastic.no-torque", text=text))
    found = []
    for motor, link in map(regression.get_encoder_positions, recordings):
        noise = np.hypot(regression.measure_noise(motor), regression.measure_noise(link))
        found.append([*(np.std(values, axis=0) for values in (motor, link, motor - link)), noise])
    motors, links, torsions, noises = np.swapaxes(found, 0, 1)
    # Noise in a torsion makes springs softer by its part of the torsion's power.
    least = noises / np.sqrt(POLICY.relevance)
    if np.all(np.maximum(motors, links) <= least):
        text = "no joint moves in these logs beyond the noise of its encoders: record motions in which every "
        text += "joint accelerates, turns both ways and carries load"
        raise IdentifiabilityError(Notice(code="elastic.standstill", text=text))
    below_noise = np.all(torsions <= least, axis=0)
    # Of a constant, rounding leaves a deviation.
    sides = zip(*map(regression.get_encoder_positions, recordings), strict=True)
    motor_moves, link_moves = (np.any([np.ptp(side, axis=0) > 0.0 for side in own], axis=0) for own in sides)
    hidden, lost = {}, []
    for joint, entry in enumerate(card.joints):
        if not card.yielding[joint]:
            continue
        if motor_moves[joint] != link_moves[joint]:
            side, other = ("link", "motor") if motor_moves[joint] else ("motor", "link")
            text = f"joint {entry.name!r}: the {side} encoder never changes while that of the {other} does, "
            text += "so that its spring is not identifiable; check the column"
            hidden[joint] = Notice(code="elastic.dead-encoder", text=text)
            # A link may be locked on purpose. A motor's torque without its motion spoils all equations.
            if np.any(links[:, joint] > least[:, joint]) and not motor_moves[joint]:
                lost.append(hidden[joint])
        elif below_noise[joint]:
            text = f"joint {entry.name!r}: its spring is not identifiable: the torsion scatters by "
            text += f"{torsions[:, joint].max():.2g} {entry.position_unit}, the noise of the encoders by "
            text += f"{noises[:, joint].max():.2g} {entry.position_unit}. Load it more, use finer encoders, "
            text += "or describe the joint as rigid"
            hidden[joint] = Notice(code="elastic.no-torsion", text=text)
    if lost or len(hidden) == sum(card.yielding):
        raise IdentifiabilityError(*(lost or hidden.values()))
    return hidden


def warn_of_fit(
    work: methods.ElasticEquations, fit: estimate.MethodFit, refused: Collection[int] = ()
) -> tuple[Notice, ...]:
    """Return warnings about the result; nothing of springs that are `refused`, by joint."""
    library = work.problem.library
    notices: list[Notice] = []
    if fit.outcome not in {Ending.SOLVED, Ending.CONVERGED}:
        notices.append(build_warning("elastic.outcome", method=fit.method, outcome=fit.outcome.value))
    # Infinite deviations are refused by name.
    unknown = list_unknown_parameters(work, fit)
    if unknown:
        notices.append(build_warning("elastic.not-identifiable", names=shorten_names(unknown)))
    percents = 100.0 * methods.compute_relative_deviations(work, fit)
    names = np.array([card.name for card in regression.list_parameter_cards(library.card)])
    wide = names[(percents > POLICY.uncertain) & (percents < np.inf)]
    poor = shorten_names(name for name in wide if name not in unknown)
    if poor:
        notices.append(build_warning("elastic.poorly-identifiable", percent=POLICY.uncertain, names=poor))
    poses = [Recording(time=part.time, position=part.q, torque=part.tau) for part in work.problem.signals]
    return (
        *notices,
        *(warn_of_energy(work.problem.sizes[1]) if fit.method in methods.ENERGY_METHODS else ()),
        *_warn_of_springs(work, fit, refused),
        *warn_of_mass_matrix(library, fit.beta, poses),
    )


def list_unknown_parameters(work: methods.ElasticEquations, fit: estimate.MethodFit) -> dict[str, str]:
    """Return the parameters whose deviation exceeds their value and what is little, with the reason.

    Little is what gives a harmless part of its joint's torque in motions like those of the fastest joint:
    what surely lies below is known to be about zero, and a joint that hardly moves makes nothing little.
    """
    if fit.covariance is None:
        return {}
    card, signals = work.problem.library.card, work.problem.signals
    deviations = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    torque = np.sqrt(np.mean(np.concatenate([part.tau for part in signals]) ** 2, axis=0))
    loads = dict(zip((joint.name for joint in card.joints), torque.tolist(), strict=True))
    rates = [np.stack([part.dtheta, differentiate(part.dtheta, part.period)]) for part in signals]
    speed, pull = np.max([np.sqrt(np.mean(rate**2, axis=1)).max(axis=1) for rate in rates], axis=0).tolist()
    # What a parameter of each unit is multiplied by in the torque, RMS, at the fastest joint.
    motions = {
        "kg m^2": pull + speed**2,
        **dict.fromkeys(("kg m", "kg"), max(scipy.constants.g, pull)),
        **dict.fromkeys(("N m s/rad", "N s/m"), speed),
    }
    unknown = {}
    cards = regression.list_parameter_cards(card)
    for entry, value, deviation in zip(cards, fit.chi.tolist(), deviations.tolist(), strict=True):
        # A coupled drive has no load of its own.
        load = loads.get(entry.joint, max(loads.values()))
        little = POLICY.relevance * load / motions.get(entry.unit, 1.0)
        if max(abs(value), little) < deviation < np.inf:
            unknown[entry.name] = (
                f"not identifiable: its standard deviation of {deviation:.3g} exceeds its value of "
                f"{value:.3g} {entry.unit}"
            )
    return unknown


def _warn_of_springs(
    work: methods.ElasticEquations, fit: estimate.MethodFit, refused: Collection[int]
) -> Iterator[Notice]:
    """Yield springs without stiffness, and stops whose state was not known when the rows of a log began."""
    cards = work.problem.library.card.joints
    for joint, (card, spring) in enumerate(zip(cards, fit.elasticity, strict=False)):
        if joint in refused or not work.problem.gives[joint]:
            continue
        if not spring.stiffness:
            text = f"joint {card.name!r}: k0, the stiffness left when all stops slip, is at its bound of "
            text += "zero, which no robot file can have. Load the joint more, to both sides, or use fewer "
            text += "stops"
            yield Notice(code="elastic.no-stiffness", text=text)
        for signals in work.problem.signals:
            phi = signals.phi[:, joint]
            most = float(np.max(np.abs(regression.compute_joint_torque(spring, signals, joint))))
            span, before = float(np.ptp(phi)), float(np.ptp(phi[: signals.settled + 1]))
            pairs = ((stop.threshold, stop.threshold * (stop.stiffness or 0.0)) for stop in spring.stops)
            late = {
                radius: felt
                for radius, felt in pairs
                if felt > POLICY.relevance * most and before < 2.0 * radius <= 0.95 * span
            }
            if late:
                radius, torque = max(late), sum(late.values())
                samples = [regression.locate_settled(phi, radius), signals.settled]
                end, start = (signals.time[samples] - signals.time[0]).tolist()
                text = f"joint {card.name!r}: the state of its stop at {radius:.3g} {card.position_unit} is "
                text += f"known from {end:.3g} s on, but equations begin at {start:.3g} s: until then its "
                text += f"torque may be wrong by up to {torque:.3g} {card.torque_unit}. Begin logs with the "
                text += "largest load to both sides"
                yield Notice(code="elastic.not-converged", text=text)


def prepare_methods(
    library: Library,
    recordings: Sequence[Recording],
    options: ElasticOptions,
    *,
    echo: Mapping[str, object] | None = None,
    friction: Mapping[str, FrictionValues] | None = None,
    adopt: Callable[[Sequence[FittedLaw]], Library] | None = None,
) -> Callable[[str | methods.Maker], estimate.ElasticEstimate]:
    """Return what identifies by "automatic" or as `fit_method`: equations are built, each fitted, once.

    `recordings` are one or more, each with the positions of motors and links; `echo` are further settings to
    keep with the result. Where that of joints surely is not their `friction`, `adopt` returns the functions
    of the robot with other laws; laws stay where it is None.

    Raises:
        UsageError: the robot is not elastic, no recording is given, or windows or thresholds do not fit.
        LogError: a recording lacks an encoder, has another number of joints, is too short or uneven.
        IdentifiabilityError: nothing moves, no torque is measured, a motor's encoder never changes, all
            torsions are below the noise of the encoders, or no spring explains any joint's torque.
    """
    hidden = _check_recordings(library, recordings)
    work = _build_equations(library, recordings, options)
    found: effects.MotorFriction | None = None
    if friction is not None:
        given = work.wide.signals, work.edge, work.band.chi[: len(library.card.beta)], friction
        found = effects.choose_laws(library, *given, candidates=effects.MOTOR_LAWS if adopt else ())
        if found.laws or found.drifting:
            adopted = adopt(found.laws) if adopt is not None and found.laws else library
            steady = []
            for log, part, drift in zip(recordings, work.wide.signals, found.drift, strict=True):
                change = [np.interp(log.time, part.time, column) for column in drift.T]
                steady.append(replace(log, torque=log.torque - np.column_stack(change)))
            work = _build_equations(adopted, steady, options, found.beta)

    @cache
    def spring() -> tuple[estimate.MethodFit, tuple[str, ...]]:
        return methods.choose_springs(work, fit("weighted"), hidden)

    @cache
    def fit(method: str | methods.Maker) -> estimate.MethodFit:
        start = None
        if method == "simultaneous":
            start = spring()[0]
        elif method == "nlp" and work.problem.options.moves_stops:
            start = fit("weighted")
        return methods.fit_method(work, method, start)

    def identify(method: str | methods.Maker) -> estimate.ElasticEstimate:
        automatic = method == "automatic"
        names: tuple[str | methods.Maker, ...] = methods.AUTOMATIC_METHODS if automatic else (method,)
        if automatic and any(kind not in ("", "linear") for kind in spring()[1]):
            # The one-shot problem has no such springs; a hidden torsion has none to rely on.
            names = tuple(name for name in names if name != "nlp")
            names = names if hidden else (*names, "simultaneous")
        fits = [fit(name) for name in names]
        if not automatic:
            _, ratio = methods.find_contradiction(work, fits[0])
            choice = methods.MethodSelection(fit=fits[0], reason="the method was given", contradiction=ratio)
        else:
            choice, (sprung, kinds) = methods.choose_fit(work, fits), spring()
            # The kinds of springs are those for `weighted`: stops and knees that suit one method suit all.
            if choice.fit.method == "weighted":
                choice = replace(choice, fit=sprung)
            elif choice.fit.method == "linear-spring" or (any(kinds) and choice.fit.method != "simultaneous"):
                choice = replace(choice, fit=methods.choose_springs(work, choice.fit, hidden)[0])
        # As JSON would give them back, with the cut-offs that were chosen.
        cutoffs = [part.cutoff for part in work.problem.signals]
        grid = [entry.thresholds.tolist() for entry in work.problem.springs]
        stated = method if isinstance(method, str) else fits[0].method
        settings = {**(echo or {}), "method": stated, **asdict(options), "cutoffs": cutoffs, "grid": grid}
        settings["rate"] = work.problem.options.filter_rate
        left_out = {"nlp": options.nlp == NlpOptions(), "known": not options.known}
        settings = {name: value for name, value in settings.items() if not left_out.get(name)}
        sources = [recording.source for recording in recordings]
        settings = json.loads(json.dumps(settings))
        result = _build_estimate(work, choice, fits, hidden, settings=settings, sources=sources)
        if found is None or friction is None:
            return result
        notices = (*result.notices, *_tell_friction(library, found, friction))
        evidence = None if result.evidence is None else replace(result.evidence, drifting=found.drifting)
        return replace(result, laws=found.laws, evidence=evidence, notices=notices)

    return identify


def _tell_friction(
    library: Library, found: effects.MotorFriction, stated: Mapping[str, FrictionValues]
) -> Iterator[Notice]:
    """Yield which laws were taken in place of those stated, and whose friction drifts."""
    for law in found.laws:
        why = "" if law.selection is None else law.selection.verdict
        text = f"joint {law.joint!r}: its friction is {law.law}, not {stated[law.joint].law} as the robot "
        text += f"file has it. {why} State the law in the robot file to keep it, or name one with --friction"
        yield Notice(code="elastic.friction-law", text=text)
    if found.drifting:
        largest = np.max([np.abs(part).max(axis=0) for part in found.drift], axis=0)
        sizes = ", ".join(
            f"{card.name} by up to {size:.2g} {card.torque_unit}"
            for card, size in zip(library.card.joints, largest, strict=True)
            if card.name in found.drifting
        )
        text = f"friction changes during the logs, as that of drives that warm up, from its mean: {sizes}. "
        text += "The change was subtracted from the torques, and parameters are those of the mean: record "
        text += "when the drives are warm, or state a law that reads their temperature"
        yield Notice(code="elastic.friction-drift", text=text)


def _build_estimate(
    work: methods.ElasticEquations,
    choice: methods.MethodSelection,
    fits: Sequence[estimate.MethodFit],
    hidden: Mapping[int, Notice],
    *,
    settings: Mapping[str, object],
    sources: Sequence[str],
) -> estimate.ElasticEstimate:
    problem, fit = work.problem, choice.fit
    library = problem.library
    cards, joints = regression.list_parameter_cards(library.card), library.card.joints
    design = methods.build_linear_rows(work, fit).design
    identifiable, condition = estimate.measure_identifiability(design, problem.known)
    # F[tau_J] by the motor equation, and what the springs leave of it; the same of the energy, J.
    target = problem.compute_motor_side(fit.chi)
    left = target - np.concatenate(compute_spring_torques(problem, fit))
    errors = problem.supplied - problem.compute_work(fit.elasticity) - problem.design @ fit.chi
    # Why springs are refused, by joint; those of `hidden` have a torsion that cannot be used.
    springs, contradicted = dict(hidden), methods.list_contradicted(work)
    evidence = methods.weigh_evidence(work, fit, choice.contradiction, contradicted[0])
    # A spring must explain more of the motors' side than a good model leaves; the links' side says nothing of
    # a joint where the encoder of another one is dead.
    limit = 100.0 - POLICY.good
    shares = 100.0 * np.std(left, axis=0) / np.maximum(np.std(target, axis=0), numerics.TINY)
    for joint, (card, share) in enumerate(zip(joints, shares.tolist(), strict=True)):
        good = fit.elasticity[joint].initial_stiffness and share < limit
        if problem.gives[joint] and joint not in springs and not good:
            text = f"joint {card.name!r}: no spring explains its torque: the best has a residual of "
            text += f"{share:.0f} % (limit {limit:g} %). Check sign and factor of the torque and whether the "
            text += "encoders of motor and link are swapped; else load the joint more, or try another method"
            springs[joint] = Notice(code="elastic.no-spring", text=text)
    springs = dict(sorted(springs.items()))
    if len(springs) == sum(problem.gives):
        energy = warn_of_energy(problem.sizes[1]) if fit.method in methods.ENERGY_METHODS else ()
        raise IdentifiabilityError(*springs.values(), *energy)
    columns = zip(joints, left.T, problem.stack_filtered()[1].T, strict=True)
    residual = [Residual.measure(card.name, own, whole, card.torque_unit) for card, own, whole in columns]
    warnings = (*warn_of_fit(work, fit, springs), *_tell_known(work, contradicted))
    # Rotors of rigid joints have a place in chi only.
    shown = np.flatnonzero(~regression.mark_rigid_rotors(library.card)).tolist()
    covariance = None if fit.covariance is None else np.asarray(fit.covariance)[np.ix_(shown, shown)]
    text = "not identifiable: these motions do not separate it from others"
    mixed = (card.name for card, known in zip(cards, identifiable, strict=True) if not known)
    refused = list_unknown_parameters(work, fit) | dict.fromkeys(mixed, text)
    return estimate.ElasticEstimate(
        robot=library.card.robot,
        signature=library.card.signature,
        friction=tuple(joint.friction for joint in joints),
        method=fit.method,
        reason=choice.reason,
        parameters=list_parameters([cards[k] for k in shown], fit.chi[shown], covariance),
        springs=tuple(_list_springs(work, fit, springs)),
        residual=tuple(residual),
        energy=Residual.measure("all joints", errors, problem.supplied, "J"),
        condition=condition,
        outcome=fit.outcome,
        history=fit.history,
        trials=tuple(
            estimate.MethodTrial(
                method=entry.method,
                outcome=entry.outcome,
                error=choice.errors.get(entry.method),
                values=tuple(map(float, entry.chi[shown])),
            )
            for entry in fits
        ),
        sources=tuple(sources),
        settings=settings,
        refused=(
            *((card.name, refused[card.name]) for card in cards if card.name in refused),
            *((f"spring of {joints[joint].name}", entry.text) for joint, entry in springs.items()),
        ),
        covariance=() if covariance is None else tuple(map(tuple, covariance.tolist())),
        effects=work.effects,
        evidence=evidence,
        notices=(*springs.values(), *choice.notices, *fit.notices, *warnings),
    )


def _tell_known(
    work: methods.ElasticEquations, contradicted: tuple[float, Sequence[tuple[str, float, float]]]
) -> Iterator[Notice]:
    """Yield which dynamic parameters were known, and whether the logs contradict them."""
    cards = regression.list_parameter_cards(work.problem.library.card)
    told = np.isfinite(work.problem.known) & ~regression.mark_rigid_rotors(work.problem.library.card)
    names = [card.name for card, known in zip(cards, told, strict=True) if known]
    if not names:
        return
    text = f"{len(names)} dynamic parameters were known and not identified: {', '.join(names)}"
    yield Notice(code="elastic.known", text=text)
    ratio, far = contradicted
    if far:
        units = {card.name: card.unit for card in cards}
        alone = ", ".join(f"{name} {value:.4g} +- {std:.2g} {units[name]}" for name, value, std in far)
        text = f"known parameters contradict the logs ({ratio:.3g} times the limit), which alone give "
        text += f"{alone}. Check loads and scales of the torque, or remove these from the known ones; else "
        text += "the others are wrong by as much"
        yield Notice(code="elastic.known-contradicted", text=text)


def build_one_shot(library: Library, recordings: Sequence[Recording], options: ElasticOptions) -> "NlpGraph":
    """Return the one-shot problem of the recordings as expressions, starting at its own optimum.

    Raises:
        UsageError, LogError, IdentifiabilityError: as `prepare_methods`, apart from springs without effect.
    """
    from symid.identification.elastic.nlp import build_nlp_graph

    _check_recordings(library, recordings)
    work = _build_equations(library, recordings, options)
    return build_nlp_graph(methods.fit_one_shot(work), work.wide, options.nlp)


def _build_equations(
    library: Library,
    recordings: Sequence[Recording],
    options: ElasticOptions,
    beta: FloatArray | None = None,
) -> methods.ElasticEquations:
    """Return the equations; loads that friction reads are measured, or those of a fit that agrees.

    `beta` (p,) are parameters that it begins with, zeros where None.
    """
    beta = np.zeros(len(library.card.beta)) if beta is None else beta
    loaded = regression.fill_motor_loads(library, recordings, beta)
    for _ in range(options.iterations if loaded != tuple(recordings) else 0):
        work = methods.build_elastic_equations(library, loaded, options)
        before, beta = beta, work.band.chi[: len(beta)]
        loaded = regression.fill_motor_loads(library, recordings, beta)
        # What is left of the difference is as much smaller again as friction is smaller than the load.
        if np.linalg.norm(beta - before) <= POLICY.relevance * np.linalg.norm(beta):
            break
    return methods.build_elastic_equations(library, loaded, options)
