"""Studies of simulated robots as tables and as objects for JSON; the friction study has a page too.

`FrictionStudy` -> `Page` with the tables of Zhang, Hu and Zou (2021), theirs and ours side by side, all
estimators on one data set, and counterparts of their figures 1 to 4 and 6 to 11, for the first seed's draw.

    band = +-2 sqrt(sigma^2 + f' C f)        f: the torque's derivatives by the parameters, C their covariance

Of figures 3 and 4 only the captions are public: in their place stand our own hybrid algorithm as a flow
chart, and an arm of the same kind as their platform, with the kinematics of a robot file.
Not supported: figure 5, the test of poses, which needs recordings.
"""

import math
import textwrap
import tomllib
from collections.abc import Mapping, Sequence
from functools import cache
from html import escape
from typing import Any

import numpy as np

from symid import study as studies
from symid.arrays import FloatArray
from symid.environment import locate_resource_folder
from symid.identification import friction
from symid.identification.judge import numerics
from symid.joint_models import FrictionLaw, compute_friction_torque, compute_law_sensitivities, get_law
from symid.report import figures
from symid.report.blocks import Block, Drawing, Table
from symid.report.drawings import place_arm
from symid.report.pages import Page
from symid.report.texts import write_number
from symid.report.verdict import FitVerdict
from symid.robot import read_robot
from symid.study import friction_protocols as paper

_WIDTH = 110
_MARK = "*"
_UNITS = {"vs": "rad/s", "dq0": "rad/s", "fV": "N m s/rad", "gamma": "1"}
"""Of the parameters of friction laws; the others are torques in N m."""
_OTHER_LAWS = ("Coulomb + viscous", "original Stribeck")
_VELOCITY = "velocity (rad/s)"
_POINTS = 1201
_STYLES = dict(zip(paper.LAWS, ("fourth", "third", "predicted"), strict=True))
_PLATFORM, _POSE = "kr30.toml", (0.35, 1.75, -0.3, 0.4, 0.75, 0.0)
"""The arm that is drawn, and its joint angles, rad."""
_RADII = (0.12, 0.11, 0.1, 0.07, 0.065, 0.055)
"""Of its joints as drawn, m."""


@cache
def _load_texts() -> Mapping[str, Mapping[str, str]]:
    path = locate_resource_folder("templates") / "report" / "friction_study.toml"
    return tomllib.loads(path.read_text(encoding="utf-8"))


def _fill(name: str, **given: object) -> dict[str, Any]:
    """Return the texts of a table, or of all figures, with what is given put in."""
    return {key: text.format(paper=paper, **given) for key, text in _load_texts()[name].items()}


def _write_caption(name: str, **given: object) -> str:
    return _load_texts()["figures"][name].format(paper=paper, **given)


def list_tables(study: paper.FrictionStudy) -> tuple[Table, ...]:
    """Return all tables, the paper's in the order of their numbers."""
    return (
        _list_methods(study.agreement[0], study.seeds[0]),
        _list_agreement(study.agreement),
        _list_races(study.races),
        *map(_list_recovery, study.recovery),
        _list_sums(study.gains),
        _list_gains(study.gains),
        *map(_list_contest, study.contests),
        *map(_list_recovery, study.second),
    )


def write_check_outcome(check: paper.FrictionCheck) -> str:
    """Return whether a claim is met, in a word."""
    return "reported" if check.met is None else "met" if check.met else "MISSED"


def _name_columns(names: Sequence[str]) -> tuple[str, ...]:
    return tuple(f"{name} ({_UNITS.get(name, 'N m')})" for name in names)


def _list_methods(study: paper.AgreementStudy, seed: int) -> Table:
    lines = (
        *((f"paper, {row.name}", row.values, ".5g", f"{row.objective:.0f}") for row in paper.TABLE_1),
        *((f"ours, {row.estimator}", row.values, ".5g", f"{row.objective:.4f}") for row in study.rows),
        ("ours, truth", study.truth, ".5g", f"{study.expected:.1f}"),
        ("ours, Cramer-Rao", study.bound, ".2g", ""),
    )
    rows = [(name, *(format(value, form) for value in values), last) for name, values, form, last in lines]
    header = ("method", *_name_columns(study.names), "sum of squares")
    return Table(header, rows, **_fill("methods", study=study, seed=seed))


def _list_agreement(found: Sequence[paper.AgreementStudy]) -> Table:
    rows = []
    for study, row in ((one, row) for one in found for row in one.rows):
        motion, beyond = f"{study.sweep.peak:g} rad/s, {study.sweep.samples}", row.draws * len(study.truth)
        agreed = (f"{row.excess:.1e}", f"{row.agreed} of {row.draws}", f"{row.error:.2f}")
        rows.append((motion, row.estimator, *agreed, f"{row.outside} of {beyond}"))
    header = ("peak, samples", "estimator", "worst excess", "draws within", "farthest", "beyond 3")
    told = _fill("agreement", draws=found[0].draws, racers=", ".join(sorted(paper.RACERS)))
    return Table(header, rows, (0, 1), **told)


def _list_races(races: Sequence[paper.SearchRace]) -> Table:
    rows = []
    for title, cost in ((race.title, cost) for race in races for cost in race.costs):
        whole = (f"{cost.generations:.1f}", f"{cost.evaluations:.0f}")
        near = (f"{cost.near_generations:.1f}", f"{cost.near_evaluations:.0f}")
        rows.append((title, cost.estimator, cost.population, *whole, *near))
    header = ("motion", "search", "candidates", "generations", "evaluations", "near: gen.", "near: eval.")
    findings = "\n".join(f"{race.title}: {race.finding}." for race in races)
    most = 100.0 * paper.NEARNESS
    return Table(header, rows, (0, 1), **_fill("races", draws=races[0].draws, findings=findings, near=most))


def _list_recovery(study: paper.Recovery) -> Table:
    """Return a table with a column for each parameter of a joint of the paper, or of the second robot."""
    second = study.joint in {row.name for row in paper.RV_2SQ}
    lines = [(f"{'published' if second else 'paper'} = truth", "truth", ".5g"), ("ours, mean", "mean", ".5g")]
    lines += [("ours, deviation", "deviation", ".3g"), ("Cramer-Rao", "bound", ".3g")]
    if second:
        lines += [("farthest, in Cramer-Rao", "error", ".2f"), ("draws within 3", "inside", "")]
    else:
        lines += [("deviation / Cramer-Rao", "ratio", ".3f"), ("bias / deviation", "bias", "+.3f")]
    rows: list[tuple[str, ...]] = [
        (name, *(format(getattr(entry, field), form) for entry in study.parameters))
        for name, field, form in lines
    ]
    if second:
        shares = (f"{100.0 * entry.bound / abs(entry.truth):.2g}" for entry in study.parameters)
        rows.insert(4, ("Cramer-Rao, % of value", *shares))
        rows.append(("identifiable", *(("no", "yes")[entry.identifiable] for entry in study.parameters)))
    peaks = " and ".join(f"{peak:g}" for peak in paper.RECOVERY_PEAKS)
    given = {"study": study, "peaks": peaks, "most": 100.0 * paper.NOT_IDENTIFIABLE}
    columns = _name_columns([entry.name for entry in study.parameters])
    told = _fill("second" if second else "recovery", **given)
    return Table((f"{study.draws} draws", *columns), rows, **told)


def _list_sums(found: Sequence[paper.GainStudy]) -> Table:
    sources = ("paper", "ours, scaled", "ours, mean")
    rows = [
        (f"joint {study.joint}, {who}", *(f"{value:.0f}" for value in values))
        for study in found
        for who, values in zip(sources, (study.paper, study.scaled, study.sums), strict=True)
    ]
    header = ("joint", "Coulomb + viscous, calibrated", "original Stribeck, prediction", "improved Stribeck")
    return Table(header, rows, **_fill("sums", study=found[0]))


def _list_gains(found: Sequence[paper.GainStudy]) -> Table:
    rows = []
    for column, name in enumerate(_OTHER_LAWS):
        for study in found:
            gain = (study.viscous, study.stribeck)[column]
            printed = 100.0 * (1.0 - math.sqrt(study.paper[-1] / study.paper[column]))
            values = (gain.paper, gain.mean, gain.deviation, gain.miss, gain.held_out, gain.rms, printed)
            forms = (".1f", ".1f", ".1f", "+.1f", ".1f", ".1f", ".1f")
            rows.append((f"{study.joint}, {name}", gain.role, *map(format, values, forms)))
    misses = "; ".join(f"joint {study.joint}: {study.stribeck.describe_miss()}" for study in found)
    # The gain by the bias alone, joint by joint.
    place = [entry.name for entry in get_law(paper.TABLE_3[0].law).physical].index("fP")
    both = zip(paper.TABLE_3, paper.TABLE_4, strict=True)
    pairs = [(row.values[place] ** 2, other.noise**2) for row, other in both]
    floors = ", ".join(f"{100.0 * bias / (bias + noise):.1f}" for bias, noise in pairs)
    noises = ", ".join(f"{row.noise:g}" for row in paper.TABLE_4)
    header = ("joint, against", "ours is", "paper", "ours", "deviation", "miss", "held out", "in RMS")
    told = _fill("gains", noises=noises, misses=misses, floors=floors)
    return Table((*header, "paper in RMS"), rows, (0, 1), **told)


def _list_contest(contest: paper.EstimatorComparison) -> Table:
    timed = any(math.isfinite(run.seconds) for run in contest.runs)
    rows = list[Sequence[object]]()
    for run in (entry for entry in contest.runs if not entry.reason):
        costs = (run.evaluations, run.solves, run.iterations)
        taken = [f"{1e3 * run.seconds:.0f}"] if timed else []
        rows.append((run.estimator, f"{run.objective:.6f}", f"{run.excess:.1e}", *costs, *taken))
    header = ("estimator", "sum of squares", "excess", "evaluations", "linear problems", "iterations")
    note = ["Excess: over the least sum of squares of all. Every estimator with its defaults."]
    if timed:
        least = "The least of three runs with the uncertainty of the result"
        note.append(f"{_MARK} {least}; differs from run to run.")
    note += [f"{run.estimator} was not run: {run.reason}." for run in contest.runs if run.reason]
    title = f"All estimators on one data set: {contest.title}, {contest.law}, {contest.samples} samples"
    return Table((*header, *([f"ms{_MARK}"] if timed else [])), rows, title=title, note="\n".join(note))


def show_friction_tables(study: paper.FrictionStudy) -> tuple[Block, ...]:
    """Return the tables of joint friction, the paper's and ours, and the claims on ours."""
    checks = ["claims and results"]
    for check in study.checks:
        text = f"{write_check_outcome(check):8}  {check.name}: {check.found} (required: {check.bar})"
        checks.append(textwrap.fill(text, width=_WIDTH, subsequent_indent=" " * 10))
    return (*list_tables(study), "\n".join(checks))


def show_precision(study: "studies.PrecisionStudy") -> tuple[Block, ...]:
    """Return the errors of every method over the Cramer-Rao bound."""
    header = ("method", "mean", "worst", "of", "95 % held, %", "price at most, %", "least eigenvalue")
    rows = []
    for entry in study.methods:
        ratios = (f"{entry.mean_ratio:.3f}", f"{entry.worst_ratio:.3f}", entry.worst)
        percent = (f"{entry.coverage_percent:.1f}", f"{entry.worst_price_percent:.2g}")
        rows.append((entry.method, *ratios, *percent, write_number(entry.least_eigenvalue, ".3g")))
    title = f"{study.robot}: {len(study.names)} parameters, five random excitations of {study.samples} "
    title += f"samples, condition {study.condition:.3g}, {study.seeds} seeds;\n"
    title += "root-mean-square errors over the Cramer-Rao bound"
    return (Table(header, rows, (0, 3), title),)


def show_cutoff(study: "studies.CutoffStudy") -> tuple[Block, ...]:
    """Return the residuals, on the rest of the log, of fits with different cut-offs."""
    header = ("cut-off, Hz", f"torque, 1 in {study.factor}", "torque, all", "momentum")
    rows = [
        (f"{line.cutoff:g}", *(f"{share:.2f}" for share in (line.decimated, line.plain, line.momentum)))
        for line in study.lines
    ]
    title = f"{study.robot}, {study.source}: fitted to the first 60 %, residual of the rest within "
    title += f"{study.band:g} Hz in percent;\nthe cut-off that identify takes is {study.chosen:g} Hz"
    return (Table(header, rows, title=title),)


def show_elastic_study(study: "studies.elastic_methods.ElasticStudy") -> tuple[Block, ...]:
    """Return the errors of every method, a table for each set of logs."""
    head = f"{study.robot}: errors in percent, median and 90th percentile. param: largest of all dynamic "
    head += "parameters; hyst: worse joint on the held-out motion; in range: the same, scaled into the "
    head += "torsion of the logs"
    return (head, *map(_show_dataset, study.studies))


def _show_dataset(entry: "studies.elastic_methods.DatasetStudy") -> Table:
    plural = "s" if entry.seeds > 1 else ""
    title = f"{entry.dataset}, {entry.condition.value}, {entry.seeds} run{plural}"
    if entry.bound == entry.bound:
        title += f"; Cramer-Rao: {entry.bound:.3g} % standard deviation of the least certain parameter, "
        title += f"{entry.spring_bound:.3g} % where the form of the springs is known"
    timed = any(math.isfinite(cell.seconds) for cell in entry.cells)
    rows = []
    for cell in entry.cells:
        spreads = (cell.parameter, cell.hysteresis)
        values = [value for spread in spreads for value in (spread.median, spread.percentile90)]
        texts = ["-" if value == math.inf else f"{value:.3g}" for value in (*values, cell.excited.median)]
        seconds = [f"{cell.seconds:.2f}"] if timed else []
        rows.append([cell.method, *texts, *seconds, _join_counts(cell.choices or cell.outcomes)])
    heading = ["method", "param", "90th", "hyst", "90th", "in range", *(["s"] if timed else []), "outcome"]
    return Table(heading, rows, title=title)


def _join_counts(counts: Sequence[tuple[str, int]]) -> str:
    return ", ".join(word if len(counts) == 1 else f"{word} {count}" for word, count in counts)


def show_foreign(study: "studies.foreign_truths.ForeignStudy") -> tuple[Block, ...]:
    """Return the automatic choice on every truth, then the errors of all methods."""

    def write(value: float) -> str:
        return f"{value:.3g}" if math.isfinite(value) else "-"

    sized = any(entry.size != 1.0 for entry in study.truths)
    names = [f"{entry.truth} x {entry.size:g}" if sized else entry.truth for entry in study.truths]
    chosen = []
    for name, entry in zip(names, study.truths, strict=True):
        cell = entry.cells[0]
        errors = (write(cell.worst.median), f"{write(cell.z_rms)} ({write(cell.z_most)})")
        words = (_join_counts(cell.verdicts), _join_counts(cell.choices), entry.best)
        near = (f"{count} of {entry.seeds}" for count in (entry.near, entry.near_best))
        chosen.append((name, *errors, write(cell.spring.median), *words, write(entry.ratio.median), *near))
    header = ("truth", "worst", "z rms (max)", "spring", "verdict", "chosen", "best", "ratio", "near")
    methods, tables = [cell.method for cell in study.truths[0].cells], []
    for place, title in enumerate(("worst parameter, percent", "spring torque, percent")):
        rows = [
            [name, *(write((cell.worst, cell.spring)[place].median) for cell in entry.cells)]
            for name, entry in zip(names, study.truths, strict=True)
        ]
        tables.append(Table(["truth", *methods], rows, title=title))
    note = "worst: parameter error in percent of the largest of its kind; z: errors over stated deviations; "
    note += "spring: its torque on the held-out motion in percent; best: method of the least median error; "
    note += "ratio: error of the choice over the least one of all methods in the same run; near: runs where "
    note += "that is at most 1.2; near best: runs where the choice is at most 1.2 times as far off as the "
    note += "best method"
    title = f"{study.arm}: automatic choice on hidden models, medians over {study.truths[0].seeds} seeds"
    return (Table((*header, "near best"), chosen, left=(0, 4, 5, 6), title=title, note=note), *tables)


def show_tracking(study: "studies.elastic_methods.TrackingStudy") -> tuple[Block, ...]:
    """Return the tracking errors with every model, and which differences are significant."""
    heading = ["case", *(f"{name} rms/mrad" for name in study.joints)]
    rows = [[case, *(f"{1e3 * spread.median:.4g}" for spread in spreads)] for case, spreads in study.rms]
    differences = []
    for entry in study.comparisons:
        mean, low, high = (f"{1e3 * getattr(entry.difference, name):.4g}" for name in ("mean", "low", "high"))
        named = (f"{entry.first} less {entry.second}", entry.joint)
        differences.append((*named, mean, f"{low} .. {high}", entry.difference.verdict))
    return (
        f"{study.robot}: tracking of the held-out motion, medians over {study.seeds} seeds",
        Table(heading, rows),
        "paired differences of RMS errors in mrad",
        Table(("difference", "joint", "mean", "95 % interval", "verdict"), differences),
    )


def show_many_joints(result: "studies.elastic_methods.ManyJointsResult") -> Table:
    """Return the residuals of each method on a held-out motion, next to those of the true parameters."""
    rows = [
        [f"{entry.method}{suffix}", *(f"{value:.4f}" for value in values)]
        for entry in result.methods
        for suffix, values in (("", entry.residual), (", true parameters", entry.floor))
    ]
    title = f"{result.robot}, {result.condition.value}: {result.parameters} parameters; residual of the "
    title += "torque of a held-out motion, in percent"
    sizes = f"elimination {result.condition_elimination:.3g}, energy {result.condition_energy:.3g}"
    conditions = f"condition of the column-scaled regressor: {sizes}"
    return Table(["method", *result.joints], rows, title=title, note=conditions)


def build_friction_study_page(study: paper.FrictionStudy) -> Page:
    """Return all that the page shows."""
    seed, last = study.seeds
    one = paper.draw_samples(paper.build_sweep_scene(paper.SWEEPS[0]), np.random.default_rng(seed))
    two = paper.draw_samples(paper.build_recovery_scene(0), np.random.default_rng(seed))
    counterparts = (
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
        *(
            (f"11, joint {paper.build_gain_scene(k).joint}", _draw_torque(k, seed))
            for k in range(len(paper.TABLE_3))
        ),
    )
    titled = ((f"=== Counterpart of Figure {name} ===", figure) for name, figure in counterparts)
    drawn = [block for pair in titled for block in pair]
    rows = [(check.name, check.bar, check.found, write_check_outcome(check)) for check in study.checks]
    texts = _load_texts()["page"]
    checks = Table(("claim", "required", "result", "outcome"), rows, (0, 1, 2, 3), texts["checks"])
    names = ("Table 1", "Table 3", "Table 4", "the second robot")
    draws = [part[0].draws for part in (study.agreement, study.recovery, study.gains, study.second)]
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
        lead=_draw_one_fit(one, study),
        next_step=(
            "symid identify ROBOT LOG --rows friction",
            "Identify friction laws from logs of your own",
        ),
        blocks=(
            texts["synthetic"],
            f"Table 4: {paper.CALIBRATION}",
            "== Claims ==",
            checks,
            "== Tables ==",
            *list_tables(study),
        ),
        more=("== Counterparts of the paper's figures ==", *drawn),
        settings=(
            ("seeds", f"{seed} to {last}"),
            *((f"draws of {name}", str(count)) for name, count in zip(names, draws, strict=True)),
            ("default estimator", "varpro"),
        ),
    )


def _draw(caption: str, lines: Sequence[figures.Line], across: str = _VELOCITY) -> Drawing:
    return figures.build_curve_figure(caption, (across, "friction torque (N m)"), lines, height=330.0)


def _list_samples(x: FloatArray, y: FloatArray) -> figures.Line:
    return figures.Line("samples", "cloud", x, y, joined=False)


def _compute_curve(law: FrictionLaw, values: Sequence[float], velocity: FloatArray) -> FloatArray:
    linear, shape = law.from_physical(values)
    return compute_friction_torque(law, {"velocity": velocity}, linear, shape)


def _draw_improved() -> Drawing:
    values = paper.TABLE_3[0].values
    velocity = np.linspace(-0.12, 0.12, _POINTS)
    readings = (
        ("H1: bias, straight line within dq0", "improved-stribeck", values, "predicted"),
        ("H2: bias at rest only", "improved-stribeck-h2", values, "sixth"),
        ("H3: bias, no zone", "improved-stribeck-h3", values[:-1], "third"),
        ("H4: origin at dq0", "improved-stribeck-h4", values, "fourth"),
    )
    lines = [
        figures.Line(label, style, velocity, _compute_curve(get_law(name), given, velocity))
        for label, name, given, style in readings
    ]
    return _draw(_write_caption("improved"), lines)


def _draw_stribeck() -> Drawing:
    law, velocity = get_law("stribeck"), np.linspace(1e-6, 0.5, _POINTS)
    coulomb, static, stribeck, viscous = paper.TABLE_1[-1].values
    lines = [
        figures.Line(row.name, style, velocity, _compute_curve(law, row.values, velocity))
        for row, style in zip(paper.TABLE_1, figures.STYLES, strict=False)
    ]
    lines += figures.list_lines(
        velocity,
        ("Coulomb part", "minor", np.full(_POINTS, coulomb)),
        ("Stribeck part", "virgin", (static - coulomb) * np.exp(-((velocity / stribeck) ** 2))),
        ("viscous part", "fourth", viscous * velocity),
    )
    return _draw(_write_caption("stribeck"), lines)


def _draw_hybrid() -> Drawing:
    caption = _write_caption("hybrid")
    chart = (locate_resource_folder("templates") / "report" / "annealing.svg").read_text(encoding="utf-8")
    options = {"population": paper.POPULATION, "cooling": paper.COOLING, "converged": numerics.CONVERGED}
    return Drawing("".join(chart.splitlines()).format(caption=escape(caption), **options), caption)


def _draw_platform() -> Drawing:
    """Return an arm of the kind that the paper identified, joint by joint along its frames."""
    robot = read_robot(locate_resource_folder("robots") / _PLATFORM)
    links, frames = place_arm(robot, _POSE)
    joints = []
    # Tools come after the links of joints.
    for number, (link, frame, radius) in enumerate(zip(links[:-1], frames, _RADII, strict=True), 1):
        style = "second" if number <= len(paper.TABLE_3) else "first"
        # A joint stands amid what lies along its axis.
        joints.append(figures.ArmJoint(0.5 * (link[1] + link[2]), frame[:3, 2], str(number), style, radius))
    caption = _write_caption("platform", file=_PLATFORM, what=robot.description.partition(" on ")[0])
    return figures.build_arm_figure(caption, links, joints)


def _draw_scatter(samples: friction.FrictionSamples, what: str) -> Drawing:
    caption = _write_caption("scatter", what=what, count=samples.count)
    return _draw(caption, [_list_samples(samples.velocity, samples.torque)])


def _build_band(found: friction.FrictionEstimate, velocity: FloatArray) -> figures.Line:
    """Return where 95 percent of samples lie by the fit: noise, and uncertainty of the curve."""
    law, inputs = get_law(found.law), {"velocity": velocity}
    design = compute_law_sensitivities(law, inputs, found.linear, found.shape)
    uncertainty = np.einsum("ni,ij,nj->n", design, np.array(found.covariance), design)
    torque = compute_friction_torque(law, inputs, found.linear, found.shape)
    half = 2.0 * np.sqrt(found.sigma**2 + uncertainty)
    outline = np.concatenate([torque + half, (torque - half)[::-1]])
    return figures.Line("band of two deviations", "area", np.concatenate([velocity, velocity[::-1]]), outline)


def _draw_one_fit(samples: friction.FrictionSamples, study: paper.FrictionStudy) -> Drawing:
    law = get_law("stribeck")
    velocity = np.linspace(0.0, float(np.max(samples.velocity)), _POINTS)[1:]
    curves = {run.estimator: _compute_curve(law, run.values, velocity) for run in study.contests[0].runs}
    styles = {"varpro": "predicted", "genetic": "third", "annealing": "virgin"}
    lines = [figures.Line(name, style, velocity, curves[name]) for name, style in styles.items()]
    apart = max(float(np.max(np.abs(curve - curves["varpro"]))) for curve in curves.values())
    band = _build_band(friction.fit_friction(samples, law), velocity)
    cloud = _list_samples(samples.velocity, samples.torque)
    return _draw(_write_caption("one_fit", apart=apart), [band, cloud, *lines])


def _draw_convergence(contest: paper.EstimatorComparison) -> Drawing:
    least = min(run.objective for run in contest.runs if not run.reason)
    names = {"genetic": ("genetic algorithm", "first"), "annealing": ("hybrid with annealing", "second")}
    runs = [(names[run.estimator], np.array(run.history)) for run in contest.runs if run.estimator in names]
    lines = [figures.Line(*name, np.arange(float(len(y))), y / least - 1.0) for name, y in runs]
    caption = _write_caption("convergence", title=contest.title)
    labels = ("generation", "J / least J - 1")
    return figures.build_line_figure(caption, labels, lines, logarithmic=True, whole=True)


def _fit_laws(
    samples: friction.FrictionSamples, x: FloatArray, velocity: FloatArray
) -> tuple[list[figures.Line], list[friction.FrictionEstimate]]:
    """Return the curves of all laws over `x` (V,), at velocities (V,) in rad/s, and their fits."""
    fits = [friction.fit_friction(samples, get_law(name)) for name in paper.LAWS]
    inputs = {"velocity": velocity}
    curves = (compute_friction_torque(get_law(fit.law), inputs, fit.linear, fit.shape) for fit in fits)
    lines = [figures.Line(name, _STYLES[name], x, y) for name, y in zip(paper.LAWS, curves, strict=True)]
    return lines, fits


def _draw_two_fit(samples: friction.FrictionSamples, *, near: bool) -> Drawing:
    reach = 0.06 if near else 1.0
    velocity = np.linspace(-reach, reach, _POINTS)
    shown = np.abs(samples.velocity) <= reach
    lines, fits = _fit_laws(samples, velocity, velocity)
    sums = ", ".join(f"{name} {fit.objective:.0f}" for name, fit in zip(paper.LAWS, fits, strict=True))
    cloud = _list_samples(samples.velocity[shown], samples.torque[shown])
    return _draw(_write_caption("two_fit", sums=sums), [_build_band(fits[-1], velocity), cloud, *lines])


def _draw_torque(index: int, seed: int) -> Drawing:
    scene = paper.build_gain_scene(index)
    samples = paper.draw_samples(scene, np.random.default_rng(seed))
    lines, fits = _fit_laws(samples, samples.time, samples.velocity)
    viscous, stribeck = (100.0 * (1.0 - fits[-1].objective / fit.objective) for fit in fits[:2])
    caption = _write_caption("torque", joint=scene.joint, viscous=viscous, stribeck=stribeck)
    return _draw(caption, [_list_samples(samples.time, samples.torque), *lines], "time (periods)")
