"""The page of the friction study.

`FrictionStudy` -> `Page` with the tables of Zhang, Hu and Zou (2021), theirs and ours side by side, all
estimators on one data set, and counterparts of their figures 1 to 4 and 6 to 11, for the first seed's draw.

    band = +-2 sqrt(sigma^2 + f' C f)        f: the torque's derivatives by the parameters, C their covariance

Of figures 3 and 4 only the captions are public: in their place stand our own hybrid algorithm as a flow
chart, and an arm of the same kind as their platform, with the kinematics of a robot file.

Not supported: figure 5, the test of poses, which is part of `symid identify --rows friction` and needs
recordings.
"""

from collections.abc import Sequence

import numpy as np

from symid.arrays import FloatArray
from symid.environment import locate_resource_folder
from symid.identification.friction import (
    FrictionEstimate,
    FrictionOptions,
    FrictionSamples,
    compute_law_sensitivities,
    fit_friction,
)
from symid.joint_models import FrictionLaw, compute_friction_torque, get_law
from symid.report.blocks import Block, Drawing, tabulate
from symid.report.drawings import place_arm
from symid.report.figures import (
    STYLES,
    ArmJoint,
    Arrow,
    Box,
    Line,
    build_arm_figure,
    build_curve_figure,
    build_flow_chart,
    build_line_figure,
    list_lines,
)
from symid.report.pages import Page
from symid.report.study_text import list_tables, write_check_outcome
from symid.report.verdict import FitVerdict
from symid.robot import read_robot
from symid.study import (
    CALIBRATION,
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
        ("3", _draw_hybrid()),
        ("4", _draw_platform()),
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


_LEFT, _RIGHT, _GUTTER, _ACROSS = 190.0, 650.0, 420.0, 860.0
"""Middles of the columns of the flow chart, a way between them, and its width."""
_ROWS = tuple(70.0 + 76.0 * row for row in range(6))
_HALF, _EDGE, _OUTSIDE = 23.0, 150.0, 16.0
"""Half a box, up and across; a way about the columns."""


def _draw_hybrid() -> Drawing:
    """Return our hybrid algorithm as a flow chart, with its default options."""
    options = FrictionOptions().annealing
    plain = (
        ("end", f"{options.population} candidates an unknown,", "at random between the bounds"),
        ("step", "J of every candidate;", "temperature T = worst J \N{MINUS SIGN} best J"),
        ("step", "parents: the better one of two,", "drawn as often as there are candidates"),
        ("step", "a child of every parent,", "by a crossover of all candidates"),
        ("step", "of parents and children", "the best half survives"),
    )
    annealing = (
        ("step", "a neighbour of every survivor,", "J changes by dJ"),
        (
            "question",
            "dJ < 0, or a random number of 0 to 1",
            "< exp(\N{MINUS SIGN}dJ / T)? (the best: dJ < 0)",
        ),
        ("step", "the neighbour takes", "the survivor's place"),
        ("step", f"T becomes {options.cooling:g} T"),
        (
            "question",
            "(worst J \N{MINUS SIGN} best J) / best J",
            f"\N{LESS-THAN OR EQUAL TO} {options.tolerance:g}?",
        ),
        ("end", "the best candidate"),
    )
    boxes = [
        Box((_LEFT, y), tuple(text), "first", kind) for y, (kind, *text) in zip(_ROWS, plain, strict=False)
    ]
    boxes += [
        Box((_RIGHT, y), tuple(text), "second" if y < _ROWS[4] else "first", kind)
        for y, (kind, *text) in zip(_ROWS, annealing, strict=True)
    ]
    titles = (
        ((_LEFT, 26.0), "genetic algorithm"),
        ((_RIGHT, 26.0), "simulated annealing, which the hybrid adds"),
    )
    caption = (
        "Our hybrid of a genetic algorithm with simulated annealing, `annealing`, with its default "
        f"options; it also ends after {options.generations} generations. Of the paper's flow chart only the "
        "caption is public, so its algorithm may differ. The genetic algorithm alone leaves out the four "
        "steps of annealing."
    )
    return build_flow_chart(caption, boxes, _list_arrows(), titles, _ROWS[5] + 40.0, width=_ACROSS)


def _list_arrows() -> list[Arrow]:
    """Return the ways between the steps of the hybrid: down both columns, across, and back."""
    answers, low, end = {1: "yes", 4: "yes"}, _ROWS[5] - 5.0, _ACROSS - _OUTSIDE

    def lead_down(x: float, row: int, label: str = "") -> Arrow:
        return Arrow(((x, _ROWS[row] + _HALF), (x, _ROWS[row + 1] - _HALF)), label)

    first, last = (_LEFT + _EDGE, _ROWS[4]), (_RIGHT - _EDGE, _ROWS[0])
    across = (first, (_GUTTER, _ROWS[4]), (_GUTTER, _ROWS[0]), last)
    kept = ((_RIGHT + _EDGE, _ROWS[1]), (end, _ROWS[1]), (end, _ROWS[3]), (_RIGHT + _EDGE, _ROWS[3]))
    begin = _GUTTER + 40.0
    back = (
        *((_RIGHT - _EDGE, _ROWS[4]), (begin, _ROWS[4]), (begin, low)),
        *((_OUTSIDE, low), (_OUTSIDE, _ROWS[2]), (_LEFT - _EDGE, _ROWS[2])),
    )
    return [
        *(lead_down(_LEFT, row) for row in range(4)),
        *(lead_down(_RIGHT, row, answers.get(row, "")) for row in range(5)),
        Arrow(across),
        Arrow(kept, "no"),
        Arrow(back, "no"),
    ]


_PLATFORM, _POSE = "kr30.toml", (0.35, 1.75, -0.3, 0.4, 0.75, 0.0)
"""The arm that is drawn, and its joint angles, rad."""
_RADII = (0.12, 0.11, 0.1, 0.07, 0.065, 0.055)
"""Of its joints as drawn, m."""


def _draw_platform() -> Drawing:
    """Return an arm of the kind that the paper identified, joint by joint along its frames."""
    robot = read_robot(locate_resource_folder("robots") / _PLATFORM)
    links, frames = place_arm(robot, _POSE)
    joints = []
    for number, (link, frame, radius) in enumerate(zip(links, frames, _RADII, strict=True), 1):
        style = "second" if number <= len(TABLE_3) else "first"
        # A joint stands amid what lies along its axis.
        joints.append(ArmJoint(0.5 * (link[1] + link[2]), frame[:3, 2], str(number), style, radius))
    caption = (
        "A serial robot with several joints is all that is public of the paper's platform: neither its maker "
        f"nor its dimensions. Drawn is an arm of this kind, with the kinematics of robots/{_PLATFORM} "
        f"({robot.description.partition(' on ')[0]}); joints 1 to 3, whose friction the tables have, are "
        "orange. No number of this page depends on it."
    )
    return build_arm_figure(caption, links, joints)


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
        f"{100.0 * (1.0 - sums[-1] / sums[1]):.1f} % less than the original Stribeck law. The first gain is "
        "calibrated by the noise, the second a prediction."
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
        numbers=(
            (f"{judged - len(missed)} of {judged}", "claims of the paper met, of those that can be judged"),
            (f"{study.recovery[0].draws}", "draws of the noise for each joint"),
            (str(len(reported)), "results reported without a requirement"),
        ),
        lead=_draw_one_fit(draw_samples(build_sweep_scene(SWEEPS[0]), np.random.default_rng(first)), study),
        next_step=(
            "symid identify ROBOT LOG --rows friction",
            "Identify friction laws from logs of your own",
        ),
        blocks=(
            (
                "The paper's values are next to ours, which come from synthetic data: the paper's recordings "
                "are not public."
            ),
            "Table 4: " + CALIBRATION,
            "== Claims ==",
            checks,
            "== Tables ==",
            *list_tables(study),
        ),
        more=("== Counterparts of the paper's figures ==", *draw_study(study)),
        settings=(
            ("seeds", f"{first} to {last}"),
            ("draws of Table 1", str(study.agreement[0].draws)),
            ("draws of Table 3", str(study.recovery[0].draws)),
            ("draws of Table 4", str(study.gains[0].draws)),
            ("draws of the second robot", str(study.second[0].draws)),
            ("default estimator", "varpro"),
        ),
    )
