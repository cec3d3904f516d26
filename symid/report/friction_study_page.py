"""The page of the friction study.

`FrictionStudy` -> `Page` with the tables of Zhang, Hu and Zou (2021), theirs and ours side by side, all
estimators on one data set, and counterparts of their figures 1, 2 and 6 to 11, for the first seed's draw.

    band = +-2 sqrt(sigma^2 + f' C f)        f: the torque's derivatives by the parameters, C their covariance

Not supported: figures 3 (a flow chart), 4 (a photograph) and 5, the test of poses, which is part of
`symid identify --rows friction` and needs recordings.
"""

from collections.abc import Sequence

import numpy as np

from symid.arrays import FloatArray
from symid.identification.friction import (
    FrictionEstimate,
    FrictionSamples,
    compute_law_sensitivities,
    fit_friction,
)
from symid.joint_models import FrictionLaw, compute_friction_torque, get_law
from symid.report.blocks import Block, Drawing, tabulate
from symid.report.figures import STYLES, Line, build_curve_figure, build_line_figure, list_lines
from symid.report.pages import Page
from symid.report.study_text import list_tables, write_check_outcome
from symid.report.verdict import FitVerdict
from symid.study import (
    LAWS,
    SWEEPS,
    TABLE_1,
    TABLE_3,
    EstimatorComparison,
    FrictionStudy,
    build_gain_scene,
    build_recovery_scene,
    build_sweep_scene,
    draw_samples,
)

_VELOCITY = "velocity (rad/s)"
_POINTS = 1201
_STYLES = dict(zip(LAWS, ("fourth", "third", "predicted"), strict=True))


def draw_study(study: FrictionStudy) -> tuple[Block, ...]:
    """Return all figures below the names of their counterparts, in the order of the paper."""
    seed = study.seeds[0]
    one = draw_samples(build_sweep_scene(SWEEPS[0]), np.random.default_rng(seed))
    two = draw_samples(build_recovery_scene(0), np.random.default_rng(seed))
    figures = (
        ("1", _draw_improved()),
        ("2", _draw_stribeck()),
        ("6", _draw_scatter(one, "one trajectory, one direction")),
        ("7", _draw_one_fit(one, study)),
        ("8", _draw_convergence(study.contests[0])),
        ("9", _draw_scatter(two, "two trajectories")),
        ("10", _draw_two_fit(two, near=False)),
        ("10, near standstill", _draw_two_fit(two, near=True)),
        *((f"11, joint {build_gain_scene(k).joint}", _draw_torque(k, seed)) for k in range(len(TABLE_3))),
    )
    return tuple(
        block for name, figure in figures for block in (f"=== Counterpart of Figure {name} ===", figure)
    )


def _draw(caption: str, lines: Sequence[Line], across: str = _VELOCITY) -> Drawing:
    return build_curve_figure(caption, (across, "friction torque (N m)"), lines, height=330.0)


def _list_samples(x: FloatArray, y: FloatArray) -> Line:
    return Line("samples", "cloud", x, y, joined=False)


def _compute_curve(law: FrictionLaw, values: Sequence[float], velocity: FloatArray) -> FloatArray:
    linear, shape = law.from_physical(values)
    return compute_friction_torque(law, {"velocity": velocity}, linear, shape)


def _draw_improved() -> Drawing:
    values = TABLE_3[0].values
    velocity = np.linspace(-0.12, 0.12, _POINTS)
    readings = (
        ("H1: bias, straight line within dq0", "improved-stribeck", values, "predicted"),
        ("H2: bias at rest only", "improved-stribeck-h2", values, "sixth"),
        ("H3: bias, no zone", "improved-stribeck-h3", values[:-1], "third"),
        ("H4: origin at dq0", "improved-stribeck-h4", values, "fourth"),
    )
    lines = [
        Line(label, style, velocity, _compute_curve(get_law(name), given, velocity))
        for label, name, given, style in readings
    ]
    caption = (
        "The improved Stribeck law with the paper's parameters of joint 1. The paper does not print its "
        "formula; H1 is the reading used here, the others can be chosen by name."
    )
    return _draw(caption, lines)


def _draw_stribeck() -> Drawing:
    law, velocity = get_law("stribeck"), np.linspace(1e-6, 0.5, _POINTS)
    coulomb, static, stribeck, viscous = TABLE_1[-1].values
    lines = [
        Line(row.method, style, velocity, _compute_curve(law, row.values, velocity))
        for row, style in zip(TABLE_1, STYLES, strict=False)
    ]
    lines += list_lines(
        velocity,
        ("Coulomb part", "minor", np.full(_POINTS, coulomb)),
        ("Stribeck part", "virgin", (static - coulomb) * np.exp(-((velocity / stribeck) ** 2))),
        ("viscous part", "fourth", viscous * velocity),
    )
    caption = (
        "The curves of the paper's Table 1, which differ by at most 0.07 N m, and the parts of the last."
    )
    return _draw(caption, lines)


def _draw_scatter(samples: FrictionSamples, what: str) -> Drawing:
    caption = f"Joint 1, {what}: {samples.count} synthetic samples."
    return _draw(caption, [_list_samples(samples.velocity, samples.torque)])


def _build_band(found: FrictionEstimate, velocity: FloatArray) -> Line:
    """Return where 95 percent of samples lie by the fit: noise, and uncertainty of the curve."""
    law, inputs = get_law(found.law), {"velocity": velocity}
    design = compute_law_sensitivities(law, inputs, found.linear, found.shape)
    uncertainty = np.einsum("ni,ij,nj->n", design, np.array(found.covariance), design)
    torque = compute_friction_torque(law, inputs, found.linear, found.shape)
    half = 2.0 * np.sqrt(found.sigma**2 + uncertainty)
    return Line(
        label="band of two deviations",
        style="area",
        x=np.concatenate([velocity, velocity[::-1]]),
        y=np.concatenate([torque + half, (torque - half)[::-1]]),
    )


def _draw_one_fit(samples: FrictionSamples, study: FrictionStudy) -> Drawing:
    law = get_law("stribeck")
    velocity = np.linspace(0.0, float(np.max(samples.velocity)), _POINTS)[1:]
    curves = {run.estimator: _compute_curve(law, run.values, velocity) for run in study.contests[0].runs}
    styles = {"varpro": "predicted", "genetic": "third", "annealing": "virgin"}
    lines = [Line(name, style, velocity, curves[name]) for name, style in styles.items()]
    apart = max(float(np.max(np.abs(curve - curves["varpro"]))) for curve in curves.values())
    caption = (
        "Samples of joint 1 with the fitted curves of three estimators. All estimators' curves differ by at "
        f"most {apart:.2g} N m; the band holds 95 % of the samples."
    )
    band = _build_band(fit_friction(samples, law), velocity)
    return _draw(caption, [band, _list_samples(samples.velocity, samples.torque), *lines])


def _draw_convergence(contest: EstimatorComparison) -> Drawing:
    least = min(run.objective for run in contest.runs if not run.reason)
    names = {"genetic": ("genetic algorithm", "first"), "annealing": ("hybrid with annealing", "second")}
    lines = [
        Line(*names[run.estimator], np.arange(float(len(run.history))), np.array(run.history) / least - 1.0)
        for run in contest.runs
        if run.estimator in names
    ]
    caption = (
        f"{contest.title}: objective of the best candidate, relative to the optimum of variable projection. "
        "A generation of the hybrid costs two evaluations a candidate."
    )
    labels = ("generation", "J / least J - 1")
    return build_line_figure(caption, labels, lines, logarithmic=True, whole=True)


def _draw_two_fit(samples: FrictionSamples, *, near: bool) -> Drawing:
    """Return fits of all laws to two trajectories: all of it, or what lies near standstill."""
    reach = 0.06 if near else 1.0
    velocity = np.linspace(-reach, reach, _POINTS)
    shown = np.abs(samples.velocity) <= reach
    lines, sums = [], []
    for name in LAWS:
        law = get_law(name)
        found = fit_friction(samples, law)
        y = compute_friction_torque(law, {"velocity": velocity}, found.linear, found.shape)
        lines.append(Line(name, _STYLES[name], velocity, y))
        sums.append(f"{name} {found.objective:.0f}")
    cloud = _list_samples(samples.velocity[shown], samples.torque[shown])
    caption = (
        f"Joint 1, both directions. Sums of squares in (N m)^2: {', '.join(sums)}. The band is the improved "
        "law's."
    )
    return _draw(caption, [_build_band(found, velocity), cloud, *lines])


def _draw_torque(index: int, seed: int) -> Drawing:
    scene = build_gain_scene(index)
    samples = draw_samples(scene, np.random.default_rng(seed))
    sums, lines = [], [_list_samples(samples.time, samples.torque)]
    for name in LAWS:
        found = fit_friction(samples, get_law(name))
        torque = compute_friction_torque(get_law(name), samples.inputs, found.linear, found.shape)
        lines.append(Line(name, _STYLES[name], samples.time, torque))
        sums.append(found.objective)
    caption = (
        f"Joint {scene.joint} in the motion of Table 4: in this draw the improved law leaves "
        f"{100.0 * (1.0 - sums[-1] / sums[0]):.1f} % less squared error than Coulomb + viscous and "
        f"{100.0 * (1.0 - sums[-1] / sums[1]):.1f} % less than the original Stribeck law."
    )
    return _draw(caption, lines, "time (periods)")


def build_friction_study_page(study: FrictionStudy) -> Page:
    """Return all that the page shows."""
    first, last = study.seeds
    checks = tabulate(
        study.checks,
        "claim=name; required=bar; result=found; outcome",
        (0, 1, 2, 3),
        "Claims and results. Reported: no requirement, or too few draws to judge.",
        outcome=write_check_outcome,
    )
    reported = [check for check in study.checks if check.met is None]
    missed = [check for check in study.checks if check.met is not None and not check.met]
    judged = len(study.checks) - len(reported)
    headline = f"All {judged} claims that can be judged are met."
    if missed:
        headline = f"{len(missed)} of {judged} claims are missed."
    return Page(
        robot="Zhang, Hu and Zou (2021)",
        subject="the tables of joint friction",
        verdict=FitVerdict(
            level="usable" if missed else "good",
            headline=headline,
            details=tuple(f"{check.name}: {check.found}" for check in (*missed, *reported)),
        ),
        blocks=(
            (
                "The paper's values are next to ours, which come from synthetic data: the paper's recordings "
                "are not public."
            ),
            "== Claims ==",
            checks,
            "== Tables ==",
            *list_tables(study),
            "== Figures ==",
            *draw_study(study),
        ),
        settings=(
            ("seeds", f"{first} to {last}"),
            ("draws of Table 1", str(study.agreement[0].draws)),
            ("draws of Table 3", str(study.recovery[0].draws)),
            ("draws of Table 4", str(study.gains[0].draws)),
            ("draws of the second robot", str(study.second[0].draws)),
            ("default estimator", "varpro"),
        ),
    )
