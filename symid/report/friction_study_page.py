"""The page of the friction study.

`FrictionStudy` -> `Page` with the tables of Zhang, Hu and Zou (2021), theirs and ours side by side, all
estimators on one data set, and counterparts of their figures 1, 2 and 6 to 11, for the first seed's draw.

    band = +-2 sqrt(sigma^2 + f' C f)        f: the torque's derivatives by the parameters, C their covariance

Not supported: figures 3 (a flow chart), 4 (a photograph) and 5, the test of poses, which is part of
`symid identify --rows friction` and needs recordings.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from symid.arrays import FloatArray
from symid.identification.friction import (
    FrictionEstimate,
    FrictionSamples,
    compute_sensitivities,
    fit_friction,
)
from symid.joint_models import FrictionLaw, compute_friction_torque, get_law
from symid.report.blocks import Block, Drawing, Table
from symid.report.figures import Line, build_curve_figure, build_line_figure
from symid.report.pages import Page, list_origin
from symid.report.study_text import list_tables, write_check_outcome
from symid.report.verdict import FitVerdict
from symid.study import (
    LAWS,
    SWEEPS,
    TABLE_1,
    TABLE_3,
    EstimatorComparison,
    FrictionCheck,
    FrictionStudy,
    build_gain_scene,
    build_recovery_scene,
    build_sweep_scene,
    draw_samples,
)

_VELOCITY = "velocity (rad/s)"
_TORQUE = "friction torque (N m)"
_POINTS = 1201
_HEIGHT = 330.0


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
        ("8", _draw_course(study.contests[0])),
        ("9", _draw_scatter(two, "two trajectories")),
        ("10", _draw_two_fit(two, near=False)),
        ("10, near standstill", _draw_two_fit(two, near=True)),
        *((f"11, joint {build_gain_scene(k).joint}", _draw_torque(k, seed)) for k in range(len(TABLE_3))),
    )
    return tuple(
        block for name, figure in figures for block in (f"=== Counterpart of Figure {name} ===", figure)
    )


def _list_samples(x: FloatArray, y: FloatArray) -> Line:
    return Line(label="samples", style="cloud", x=x, y=y, joined=False)


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
        Line(label=label, style=style, x=velocity, y=_compute_curve(get_law(name), given, velocity))
        for label, name, given, style in readings[::-1]
    ]
    drawing = build_curve_figure(
        "Improved Stribeck law",
        "Friction torque against velocity by four readings of the improved Stribeck law, joint 1.",
        (_VELOCITY, _TORQUE),
        lines[::-1],
        height=_HEIGHT,
    )
    caption = (
        "The improved Stribeck law with the paper's parameters of joint 1. The paper's formula is not known; "
        "H1 is the reading used here, the others can be chosen by name."
    )
    return Drawing(drawing, caption)


def _draw_stribeck() -> Drawing:
    law, velocity = get_law("stribeck"), np.linspace(1e-6, 0.5, _POINTS)
    coulomb, static, stribeck, viscous = TABLE_1[-1].values
    bump = (static - coulomb) * np.exp(-((velocity / stribeck) ** 2))
    styles = ("first", "second", "third")
    lines = [
        Line(label=row.method, style=style, x=velocity, y=_compute_curve(law, row.values, velocity))
        for row, style in zip(TABLE_1, styles, strict=True)
    ]
    parts = (
        ("Coulomb", "minor", np.full(_POINTS, coulomb)),
        ("Stribeck", "virgin", bump),
        ("viscous", "fourth", viscous * velocity),
    )
    lines += [Line(label=f"{name} part", style=style, x=velocity, y=y) for name, style, y in parts]
    drawing = build_curve_figure(
        "Original Stribeck law",
        "Friction torque against velocity by the three rows of Table 1, and the parts of the last one.",
        (_VELOCITY, _TORQUE),
        lines,
        height=_HEIGHT,
    )
    caption = (
        "The curves of the paper's Table 1, which differ by at most 0.07 N m, and the parts of the last."
    )
    return Drawing(drawing, caption)


def _draw_scatter(samples: FrictionSamples, what: str) -> Drawing:
    drawing = build_curve_figure(
        f"Friction against velocity, {what}",
        f"Samples of friction torque against velocity of joint 1, {what}.",
        (_VELOCITY, _TORQUE),
        [_list_samples(samples.velocity, samples.torque)],
        height=_HEIGHT,
    )
    caption = f"Joint 1, {what}: {samples.count} synthetic samples."
    return Drawing(drawing, caption)


def _build_band(samples: FrictionSamples, found: FrictionEstimate, velocity: FloatArray) -> Line:
    """Return where 95 percent of samples lie by the fit: noise, and doubt of the curve."""
    law, count = get_law(found.law), len(velocity)
    grid = replace(
        samples,
        time=velocity,
        velocity=velocity,
        torque=np.zeros(count),
        extra=np.zeros((count, 0)),
        run=None,
    )
    design = compute_sensitivities(grid, law, found.linear, found.shape)
    doubt = np.einsum("ni,ij,nj->n", design, np.array(found.covariance), design)
    torque = compute_friction_torque(law, grid.inputs, found.linear, found.shape)
    half = 2.0 * np.sqrt(found.sigma**2 + doubt)
    return Line(
        label="band of two deviations",
        style="area",
        x=np.concatenate([velocity, velocity[::-1]]),
        y=np.concatenate([torque + half, (torque - half)[::-1]]),
    )


def _draw_one_fit(samples: FrictionSamples, study: FrictionStudy) -> Drawing:
    law = get_law("stribeck")
    found = fit_friction(samples, law)
    velocity = np.linspace(0.0, float(np.max(samples.velocity)), _POINTS)[1:]
    values = {run.estimator: run.values for run in study.contests[0].runs}
    styles = {"varpro": "predicted", "genetic": "third", "annealing": "virgin"}
    drawing = build_curve_figure(
        "Fit to one trajectory",
        "Samples of joint 1 with the fitted curves of three estimators and a band of two deviations.",
        (_VELOCITY, _TORQUE),
        [
            _build_band(samples, found, velocity),
            _list_samples(samples.velocity, samples.torque),
            *(
                Line(label=name, style=style, x=velocity, y=_compute_curve(law, values[name], velocity))
                for name, style in styles.items()
            ),
        ],
        height=_HEIGHT,
    )
    apart = max(
        float(
            np.max(
                np.abs(_compute_curve(law, entry, velocity) - _compute_curve(law, values["varpro"], velocity))
            )
        )
        for entry in values.values()
    )
    caption = f"All estimators' curves differ by at most {apart:.2g} N m; the band holds 95 % of the samples."
    return Drawing(drawing, caption)


def _draw_course(contest: EstimatorComparison) -> Drawing:
    least = min(run.objective for run in contest.runs if not run.reason)
    names = {"genetic": "genetic algorithm", "annealing": "hybrid with annealing"}
    lines = []
    for run, style in zip(
        [run for run in contest.runs if run.estimator in names], ("first", "second"), strict=True
    ):
        course = np.array(run.history) / least - 1.0
        generation = np.arange(float(len(course)))
        lines.append(Line(label=names[run.estimator], style=style, x=generation, y=course))
    drawing = build_line_figure(
        "Objective against generation",
        "Sum of squares of the best candidate over the least one, less one, against the generation.",
        ("generation", "J / least J - 1"),
        lines,
        logarithmic=True,
        whole=True,
    )
    caption = (
        f"{contest.title}: how far the best candidate lies above the optimum that variable projection finds. "
        "A generation of the hybrid costs two evaluations a candidate."
    )
    return Drawing(drawing, caption)


def _draw_two_fit(samples: FrictionSamples, *, near: bool) -> Drawing:
    """Return fits of all laws to two trajectories: all of it, or what lies near standstill."""
    reach = 0.06 if near else 1.0
    velocity = np.linspace(-reach, reach, _POINTS)
    fits = {name: fit_friction(samples, get_law(name)) for name in LAWS}
    curves = {
        name: compute_friction_torque(get_law(name), {"velocity": velocity}, found.linear, found.shape)
        for name, found in fits.items()
    }
    styles = dict(zip(LAWS, ("fourth", "third", "predicted"), strict=True))
    shown = np.abs(samples.velocity) <= reach
    drawing = build_curve_figure(
        "Fits to two trajectories" + (", near standstill" if near else ""),
        "Samples of joint 1 with the fitted curves of three laws and a band of two deviations.",
        (_VELOCITY, _TORQUE),
        [
            _build_band(samples, fits[LAWS[-1]], velocity),
            _list_samples(samples.velocity[shown], samples.torque[shown]),
            *(Line(label=name, style=styles[name], x=velocity, y=y) for name, y in curves.items()),
        ],
        height=_HEIGHT,
    )
    sums = ", ".join(f"{name} {found.objective:.0f}" for name, found in fits.items())
    caption = f"Joint 1, both directions. Sums of squares in (N m)^2: {sums}. The band is the improved law's."
    return Drawing(drawing, caption)


def _draw_torque(index: int, seed: int) -> Drawing:
    """Return the torque of a joint over one period, as measured and by all laws."""
    scene = build_gain_scene(index)
    samples = draw_samples(scene, np.random.default_rng(seed))
    styles = dict(zip(LAWS, ("fourth", "third", "predicted"), strict=True))
    sums, lines = [], []
    for name in LAWS:
        found = fit_friction(samples, get_law(name))
        torque = compute_friction_torque(get_law(name), samples.inputs, found.linear, found.shape)
        lines.append(Line(label=name, style=styles[name], x=samples.time, y=torque))
        sums.append(found.objective)
    drawing = build_curve_figure(
        f"Torque of joint {scene.joint}",
        f"Torque of joint {scene.joint} over one period, as measured and by three laws.",
        ("time (periods)", "torque (N m)"),
        [_list_samples(samples.time, samples.torque), *lines],
        height=_HEIGHT,
    )
    caption = (
        f"Joint {scene.joint} in the motion of Table 4: in this draw the improved law leaves "
        f"{100.0 * (1.0 - sums[-1] / sums[0]):.1f} % less squared error than Coulomb + viscous and "
        f"{100.0 * (1.0 - sums[-1] / sums[1]):.1f} % less than the original Stribeck law."
    )
    return Drawing(drawing, caption)


def build_friction_study_page(study: FrictionStudy) -> Page:
    """Return all that the page shows."""
    first, last = study.seeds
    draws = (
        ("draws of Table 1", study.agreement[0].draws),
        ("draws of Table 3", study.recovery[0].draws),
        ("draws of Table 4", study.gains[0].draws),
        ("draws of the second robot", study.second[0].draws),
    )
    checks = Table(
        ("claim", "asked", "found", ""),
        [(entry.name, entry.bar, entry.found, write_check_outcome(entry)) for entry in study.checks],
        (0, 1, 2, 3),
        "What is asked of these tables, and what came out; told: nothing to meet, or too few draws to judge.",
    )
    return Page(
        robot="Zhang, Hu and Zou (2021)",
        subject="the tables of joint friction",
        verdict=_judge_checks(study.checks),
        blocks=(
            (
                "Numbers of the paper stand next to ours, which come from synthetic data: the paper's "
                "recordings are not public."
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
            *((name, str(count)) for name, count in draws),
            ("default estimator", "varpro"),
        ),
        origin=list_origin(),
    )


def _judge_checks(checks: Sequence[FrictionCheck]) -> FitVerdict:
    """Return how many claims are met; those that are not, and the predictions, in words."""
    judged = [check for check in checks if check.met is not None]
    missed = [check for check in judged if not check.met]
    told = [check for check in checks if check.met is None]
    headline = (
        f"{len(missed)} of {len(judged)} claims are missed."
        if missed
        else f"All {len(judged)} claims that can be judged are met."
    )
    return FitVerdict(
        level="fair" if missed else "good",
        headline=headline,
        details=tuple(f"{check.name}: {check.found}" for check in (*missed, *told)),
    )
