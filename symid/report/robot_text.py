"""What is no fit as text, objects for JSON and warnings.

Base parameters, derivations, generated code, drafted and exported robot files, checked logs, exciting
trajectories, payloads -> blocks, plain types, notices.
"""

import html
import re
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from symid import dynamics, logs
from symid.environment import show_path
from symid.errors import Notice, shorten_names
from symid.joint_models import name_shape, name_values
from symid.notation import INERTIAL
from symid.report.blocks import Block, Table, write_html
from symid.robot import Robot
from symid.serialization import describe_record

if TYPE_CHECKING:
    from symid.codegen import GeneratedFolder, RouteCount
    from symid.dynamics import BaseParameters, ParameterChange, Payload
    from symid.excitation import OptimisedExcitation
    from symid.identification import FileExport
    from symid.identification.rigid import LogExcitation, LogsCheck
    from symid.lessons import Step
    from symid.logs import Draft, JointSummary, LogTiming, Recording


_WIDTH = 100
_CELL = 64
"""Letters of a sum in a table."""
_SHOWN = 12
"""Singular values on either side of the rank."""
_VERDICTS = ("identifiable", "poorly identifiable", "not identifiable", "refused")
_FAR = 3.0


def show_base(robot: Robot, base: "BaseParameters") -> tuple[Block, ...]:
    """Return a headline with the counts, every parameter with its reason, and what was eliminated."""
    head, eliminated = _summarise_base(robot, base)
    parameters, friction = _describe_parameters(robot, base)
    gone = [f"{names}\n{_wrap_reason(reason)}" for names, reason in eliminated]
    return (
        *(head, *map(_show_parameter, parameters)),
        *(("friction parameters", *map(_show_parameter, friction)) if friction else ()),
        *(("eliminated", *gone) if gone else ()),
    )


def list_base(robot: Robot, base: "BaseParameters") -> tuple[Block, ...]:
    """Return the counts, the names of other parameters, and a table of groupings without reasons."""
    (head, eliminated), (parameters, friction) = (
        _summarise_base(robot, base),
        _describe_parameters(robot, base),
    )
    names = {
        "friction": [str(entry["name"]) for entry in friction],
        "eliminated": [name for group, _ in eliminated for name in group.split(", ")],
    }
    lines = [head, *(f"{what}: {shorten_names(part)}" for what, part in names.items() if part)]
    rows = [
        (entry["name"], _cut_sum(str(entry["form"] or entry["expression"])), entry["unit"], entry["value"])
        for entry in parameters
    ]
    header = ("parameter", "groups", "unit", "value")
    known = len(header) - all(row[-1] is None for row in rows)
    return ("\n".join(lines), Table(header[:known], [row[:known] for row in rows], (0, 1, 2)))


def _cut_sum(text: str) -> str:
    """Return the first terms of a long sum, and how many more there are."""
    signs = [found.start() for found in re.finditer(r" [+-] ", text)]
    if len(text) <= _CELL or not signs:
        return text
    cut = max((place for place in signs if place <= _CELL), default=signs[0])
    return f"{text[:cut]} ... ({sum(place >= cut for place in signs)} more)"


def tabulate_base(robot: Robot, base: "BaseParameters") -> tuple[Block, ...]:
    """Return the same as tables, for pages wider than a terminal."""
    head, eliminated = _summarise_base(robot, base)
    parameters, friction = _describe_parameters(robot, base)
    rows = [
        (entry["name"], entry["expression"], entry["form"] or entry["value"], entry["unit"], entry["reason"])
        for entry in (*parameters, *friction)
    ]
    header = ("parameter", "groups", "value", "unit", "why")
    gone = [Table(("eliminated", "why"), eliminated, left=(0, 1))] if eliminated else []
    return (head, Table(header, rows, left=(0, 1, 3, 4)), *gone)


def _summarise_base(robot: Robot, base: "BaseParameters") -> tuple[str, list[tuple[str, str]]]:
    """Return the counts; what was eliminated, with reasons: parameters of one reason together."""
    whole = base.count + sum(e.label[1] in (*INERTIAL, *dynamics.DRIVE_PARAMETERS) for e in base.eliminated)
    names: dict[str, list[str]] = {}
    for entry in base.eliminated:
        names.setdefault(entry.reason, []).append(entry.name)
    head = f"{robot.name}: {base.count} base parameter{'s'[: base.count != 1]} of {whole}"
    return head, [(", ".join(group), reason) for reason, group in names.items()]


def describe_base(robot: Robot, base: "BaseParameters") -> dict[str, object]:
    """Return the base parameters as `symid base --json` gives them."""
    parameters, friction = _describe_parameters(robot, base)
    return {
        "robot": robot.name,
        "count": base.count,
        "parameters": parameters,
        "friction": friction,
        "eliminated": [{"name": entry.name, "reason": entry.reason} for entry in base.eliminated],
        # Changes of the parameters that nothing shows, exact coefficients as text.
        "null_space": [
            {dynamics.write_label(robot, label): str(coefficient) for label, coefficient in change}
            for change in base.null_space
        ],
    }


def write_base_latex(robot: Robot, base: "BaseParameters") -> str:
    """Return every parameter with what it groups as aligned formulas."""
    from sympy import Add, Symbol, latex

    lines = []
    for entry in (*base.parameters, *base.friction):
        letters = {label: Symbol(dynamics.write_label(robot, label)) for label, _ in entry.terms}
        names = {symbol: dynamics.write_name_latex(str(symbol)) for symbol in letters.values()}
        total = Add(*(factor * letters[label] for label, factor in entry.terms), evaluate=False)
        lines.append(
            rf"{dynamics.write_name_latex(entry.name)} &= {latex(total, symbol_names=names, order='none')}"
        )
    return "$$\\begin{aligned}" + r" \\ ".join(lines) + "\\end{aligned}$$"


def _describe_parameters(
    robot: Robot, base: "BaseParameters"
) -> tuple[list[dict[str, object]], list[dict[str, object]]]:
    values = dynamics.compute_parameter_values(robot, base)
    forms = dynamics.derive_parameter_formulas(robot, base)
    found: list[dict[str, object]] = [
        {
            "name": entry.name,
            "expression": entry.expression,
            "reason": entry.reason,
            "unit": dynamics.get_label_unit(robot, entry.label),
            "joint": dynamics.get_owner(robot, entry.label),
            "value": values.get(entry.name),
            "form": str(forms[entry.name]).replace("**", "^") if entry.name in forms else None,
        }
        for entry in (*base.parameters, *base.friction)
    ]
    return found[: len(base.parameters)], found[len(base.parameters) :]


def _show_parameter(entry: Mapping[str, object]) -> str:
    """Return a parameter in two lines: what it groups, and why."""
    value = None if entry["value"] is None else f"{entry['value']:.6g}"
    parts = dict.fromkeys((entry["name"], entry["expression"]))
    text = " = ".join(str(part) for part in (*parts, entry["form"], value) if part is not None)
    return f"{text}  [{entry['unit']}]\n{_wrap_reason(str(entry['reason']))}"


def _wrap_reason(text: str) -> str:
    return textwrap.fill(text, width=_WIDTH, initial_indent="    ", subsequent_indent="    ")


def describe_derivation(
    robot: str, steps: Sequence["Step"], counts: Sequence["RouteCount"]
) -> dict[str, object]:
    """Return a derivation as `symid derive --json` gives it, with the operations of every route."""
    operations = [describe_record(entry) for entry in counts]
    for entry in operations:
        entry.update(entry.pop("operations"))
    return {"robot": robot, "steps": [describe_record(step) for step in steps], "operations": operations}


def show_derivation(
    steps: Sequence["Step"], counts: Sequence["RouteCount"], *, latex: bool = False
) -> tuple[Block, ...]:
    """Return the steps as paragraphs, formulas in text or LaTeX, and the table of operations."""
    paragraphs = []
    for number, step in enumerate(steps, start=1):
        lines = [f"{number}. {step.title}", "", f"   {step.sentence}"]
        sides = ((e.left_latex, e.latex) if latex else (e.left, e.text) for e in step.formulas)
        lines += [f"     {left} = {right}" for left, right in sides]
        lines += ["", f"   Checked: {step.check}"] if step.check else []
        paragraphs.append("\n".join(lines))
    return (*paragraphs, _show_counts(counts))


def write_derivation_latex(steps: Sequence["Step"]) -> str:
    """Return titles and formulas as aligned equations."""
    lines = []
    for number, step in enumerate(steps, start=1):
        lines.append(rf"&\textbf{{{number}. {step.title}}}")
        lines += [rf"{entry.left_latex} &= {entry.latex}" for entry in step.formulas]
    return "$$\\begin{aligned}" + " \\\\ ".join(lines) + "\\end{aligned}$$"


def write_derivation_html(steps: Sequence["Step"], counts: Sequence["RouteCount"]) -> str:
    """Return the derivation for a notebook, which sets the formulas."""
    parts = []
    for number, step in enumerate(steps, start=1):
        parts.append(f"<h4>{number}. {html.escape(step.title)}</h4><p>{html.escape(step.sentence)}</p>")
        formulas = (rf"$\displaystyle {entry.left_latex} = {entry.latex}$" for entry in step.formulas)
        parts += [f"<p>{html.escape(formula)}</p>" for formula in formulas]
        if step.check:
            parts.append(f"<p>Checked: {html.escape(step.check)}</p>")
    return "".join((*parts, write_html((_show_counts(counts),))))


def _show_counts(counts: Sequence["RouteCount"]) -> Table:
    """Return the operations of the chosen routes as a table, the worst of the others beside them."""
    most: dict[str, int] = {}
    for entry in counts:
        size = entry.operations.mul + entry.operations.add
        most[entry.function] = max(size, most.get(entry.function, 0))
    rows = [
        (one.function, own.mul, own.add, own.trig, most[one.function], one.route)
        for one, own in ((entry, entry.operations) for entry in counts if entry.chosen)
    ]
    title = (
        "Operations of generated functions: products with squares and divisions, sums, sines and cosines.\n"
        "The route with the fewest operations is written; 'most' has products and sums of the worst one."
    )
    return Table(("function", "mul", "add", "trig", "most", "route"), rows, (0, 5), title)


def summarise_code(made: "GeneratedFolder") -> str:
    """Return the folder, what was done, and how its self-test went."""
    state = "nothing has changed" if made.unchanged else f"{len(made.files)} files"
    head = f"{made.folder}: {state}, self-test {made.record.selftest}"
    if made.record.runner:
        head += f" with {made.record.runner} {made.record.flags}".rstrip()
    return head


def show_code(made: "GeneratedFolder") -> tuple[Block, ...]:
    """Return a headline, and the operations and sizes of every function."""
    counted, measured = ("mul", "add", "trig"), ("code", "stack") if made.record.sizes else ()
    sizes = {name: describe_record(size) for name, size in made.record.sizes.items()}
    rows = [
        (name, *(counts[key] for key in counted), *(sizes[name][key] for key in measured if name in sizes))
        for name, counts in made.operations.items()
    ]
    guide = show_path(made.folder / "README.md")
    text = f"next: {guide} says how to use it; symid export ROBOT -o FILE.h writes its parameters"
    return (
        summarise_code(made),
        Table(("function", *counted, *measured), rows),
        *(["code and stack in bytes; batches in manifest.json"] if sizes else []),
        *(f"spring: {summarise_code(spring)}" for spring in made.springs),
        *([text] if made.manifest["target"] == "c" else []),
    )


def describe_code(robot: str, made: "GeneratedFolder") -> dict[str, object]:
    """Return what was written as `symid generate --json` gives it."""
    record = made.record
    return {
        "robot": robot,
        "target": made.manifest["target"],
        "folder": str(made.folder),
        "files": [str(path) for path in made.files],
        "operations": made.operations,
        "selftest": record.selftest,
        "runner": record.runner,
        "flags": record.flags,
        "sizes": {name: describe_record(size) for name, size in record.sizes.items()},
        "unchanged": made.unchanged,
        "springs": [str(spring.folder) for spring in made.springs],
    }


def summarise_draft(robot: Robot) -> str:
    """Return name and number of joints."""
    return f"{robot.name}, {len(robot.joints)} joint{'s'[: len(robot.joints) != 1]}"


def show_draft(draft: "Draft") -> tuple[Block, ...]:
    """Return the robot, and the columns and units of its log."""
    head, part = summarise_draft(draft.robot), draft.log
    if part is None:
        return (head,)
    preset = "" if part.robot.log.preset is None else f" (columns of {part.robot.log.preset})"
    read = part.read.items()
    rows = [(name, ", ".join(entry.columns), ", ".join(part.units[name])) for name, entry in read]
    return (head, Table(("quantity", "columns", "unit"), rows, (0, 1, 2), f"log: {part.file}{preset}"))


def describe_draft(draft: "Draft") -> dict[str, object]:
    """Return robot, joints and log as `symid new --json` gives them."""
    joints = [{"name": joint.name, "kind": joint.kind.value} for joint in draft.robot.joints]
    part = draft.log
    log = part and {
        "file": part.file,
        "preset": part.robot.log.preset,
        "columns": {name: list(entry.columns) for name, entry in part.read.items()},
        "units": {name: ", ".join(part.units[name]) for name in part.read},
        "unused": list(part.unused),
    }
    given = {"log": log} if log else {}
    return {"robot": draft.robot.name, "joints": joints, **given, "notices": len(draft.notices)}


def show_export(found: "FileExport") -> tuple[Block, ...]:
    """Return what was written and where, and how bodies were found or which laws joints have."""
    lines = [f"{found.format}: {show_path(found.file)}"]
    lines += [] if found.standard is None else [found.standard.outcome.value]
    lines += [f"all else as in {found.rewritten}"] if found.rewritten else []
    if found.costs:
        parts = (f"{entry.joint} {entry.percent:.2g} %" for entry in found.costs)
        lines.append(f"torque that these bodies add to the residual: {', '.join(parts)}")
    if found.scales:
        parts = (f"{entry.joint} {entry.ratio:.3g}" for entry in found.scales)
        lines.append(f"torque, identified / robot file: {', '.join(parts)}")
    if found.friction is not None:
        laws = found.friction.laws
        pairs = ((joint, laws[joint], entry.law) for joint, entry in found.friction.values.items())
        lines += [f"{joint}: {law}{f' as {written}' * (law != written)}" for joint, law, written in pairs]
    return ("\n".join(lines),)


def describe_export(found: "FileExport") -> dict[str, object]:
    """Return the export as `symid export --json` gives it."""
    if found.friction is not None:
        written = {
            joint: {
                "law": found.friction.laws[joint],
                "model": values.law,
                "values": name_values(values),
                "shape": name_shape(values),
                "smoothing": values.smoothing,
            }
            for joint, values in found.friction.values.items()
        }
        head = {"file": str(found.file), "robot": found.robot.name}
        return {**head, "written": written, "kept": dict(found.friction.kept)}
    bodies = found.standard and {
        "largest_change": max(map(abs, found.standard.residual.tolist()), default=0.0),
        "blamed": found.standard.blamed,
        "not_identified": found.missing,
        "torque_ratio": {entry.joint: entry.ratio for entry in found.scales},
        "cost_percent": {entry.joint: entry.percent for entry in found.costs},
    }
    head = {"file": str(found.file), "format": found.format, "robot": found.robot.name}
    how = {"elastic": any(found.robot.elastic), "outcome": found.outcome}
    return {**head, **how, **(bodies or {}), "left_out": found.left_out}


def summarise_robot(robot: Robot) -> str:
    """Return name, joints and convention."""
    others = {"urdf": "URDF", "mjcf": "MJCF", "origin": "frames by origin"}
    convention = others.get(robot.convention, f"{robot.convention} DH")
    return f"{robot.name}, {robot.size} joint{'s'[: robot.size != 1]}, {convention}"


def show_robot_check(robot: Robot, checked: "LogsCheck", *, brief: bool = False) -> tuple[Block, ...]:
    """Return what was read, the joints of every log, and the identifiability; if `brief` where it lacks."""
    head = f"{robot.path}: {summarise_robot(robot)}: no mistakes"
    if not checked.logs:
        return (head,)
    header = ("log", "samples", "duration/s", "period/s", "velocity", "second encoder")
    rows = list[Sequence[object]]()
    for log, timing in ((entry.recording, entry.timing) for entry in checked.logs):
        channels = (log.velocity is not None, logs.get_second_encoder_side(log))
        rows.append((log.source, timing.samples, timing.duration, log.period, *channels))
    blocks: list[Block] = [Table(header, rows, (0, 5), head)]
    blocks += [show_joints(log.recording.source, log.joints) for log in checked.logs]
    if checked.copy is not None:
        file, notice = checked.copy
        blocks.append(f"{show_path(file)}: {notice.text}")
    found = checked.excitation
    if found is not None:
        verdicts = [entry.verdict for entry in found.parameters]
        counts = ", ".join(f"{verdicts.count(name)} {name}" for name in _VERDICTS if name in verdicts)
        first = max(0, found.rank - _SHOWN // 2)
        shown = [f"{value:.2g}" for value in found.singular[first : first + _SHOWN]]
        shown.insert(found.rank - first, "|")
        text = (
            f"Identifiability: {counts}; condition {found.condition:.3g}\n"
            f"singular values of the scaled matrix about its rank {found.rank} of {len(found.singular)}: "
            f"{'... ' if first else ''}{' '.join(shown)}"
        )
        if brief:
            weak = tuple(entry for entry in found.parameters if entry.verdict != _VERDICTS[0])
            found = replace(found, parameters=weak)
        blocks += [text, *[show_identifiable(found, "std/%")] * bool(found.parameters)]
    return tuple(blocks)


def show_identifiable(
    found: "LogExcitation", name: str, write: Callable[[float], object] = float, title: str = ""
) -> Table:
    """Return the verdict on every parameter, with the deviation to expect, called `name`, and the reason."""
    rows = [(e.name, e.verdict, write(e.relative_std_percent), e.reason) for e in found.parameters]
    return Table(("parameter", "verdict", name, "why"), rows, (0, 1, 3), title)


def describe_robot_check(robot: Robot, checked: "LogsCheck") -> dict[str, object]:
    """Return what was found as `symid check --json` gives it."""
    joints = [{"name": e.name, "kind": e.kind.value, "friction": e.friction.law} for e in robot.joints]
    found: dict[str, object] = {
        "robot": robot.name,
        "file": robot.path,
        "convention": robot.convention,
        "joints": joints,
        "logs": [describe_log(log.recording, log.timing, log.joints) for log in checked.logs],
    }
    if checked.copy is not None:
        file, notice = checked.copy
        found["resampled"] = {"file": str(file), "text": notice.text}
    if checked.excitation is not None:
        names = [joint.name for joint in robot.axes]
        found["dynamics"] = [
            {
                "file": check.source,
                "signs": [{**describe_record(entry), "joint": names[entry.joint]} for entry in check.signs],
                "causes": [describe_record(cause) for cause in check.causes],
                "torque_delay": check.delay and {**describe_record(check.delay), "late": check.delay.late},
            }
            for check in checked.dynamics
        ]
        found["excitation"] = describe_record(checked.excitation)
    return found


def describe_log(
    recording: "Recording", timing: "LogTiming", joints: "tuple[JointSummary, ...]"
) -> dict[str, object]:
    """Return what the log itself says, without the robot's dynamics."""
    return {
        "file": recording.source,
        "samples": timing.samples,
        "duration": timing.duration,
        "period": recording.period,
        "has_velocity": recording.velocity is not None,
        "second_encoder": logs.get_second_encoder_side(recording),
        "timing": {**describe_record(timing), "even": timing.even},
        "joints": [describe_record(joint) for joint in joints],
    }


def show_joints(source: str, joints: "tuple[JointSummary, ...]") -> Table:
    """Return the table of a log's joints."""
    header = ("joint", "from", "to", "top speed", "unit", "step", "still/%", "rms torque", "peak")
    rows = []
    for joint in joints:
        motion = (
            joint.low,
            joint.high,
            joint.speed,
            joint.unit,
            joint.step or None,
            100.0 * joint.standstill,
        )
        rows.append((joint.name, *motion, joint.torque, joint.peak, 100.0 * joint.saturated))
    return Table((*header, "at peak/%"), rows, (0, 4), source)


def list_remarks(robot: Robot, found: "OptimisedExcitation", seed: int) -> tuple[str, ...]:
    """Return what stands at the head of a trajectory's file."""
    sizes = f"{found.condition:.4g}, best of random ones {found.random_condition:.4g}"
    return (
        f"{robot.name}: {found.trajectory.source}, seed {seed}",
        f"condition number of the scaled regressor {sizes}",
        f"margin to every limit: at least {1.0 - max(margin.share or 0.0 for margin in found.margins):.1%}",
    )


def describe_excitation(robot: Robot, found: "OptimisedExcitation", seed: int) -> dict[str, object]:
    """Return the trajectory as `symid excite --json` gives it."""
    harmonics = (found.coefficients.shape[1] - 1) // 2
    return {
        "robot": robot.name,
        "trajectory": found.trajectory.source,
        "duration": found.trajectory.duration,
        "harmonics": harmonics,
        "seed": seed,
        "factor": found.factor,
        **describe_record(found),
        "joints": [
            {"name": joint.name, "centre": centre, "sines": row[:harmonics], "cosines": row[harmonics:]}
            for joint, (centre, *row) in zip(robot.axes, found.coefficients.tolist(), strict=True)
        ],
        "limits": [
            {
                **describe_record(margin),
                "share_percent": None if margin.share is None else 100.0 * margin.share,
                "allowed_percent": 100.0 * margin.allowed,
            }
            for margin in found.margins
        ],
    }


def describe_gain(factor: float) -> str:
    """Return how much smaller a condition number is than that of the best random trajectory."""
    return f"{factor:.2f} times smaller" if factor >= 1.0 else "no smaller"


def show_excitation(found: "OptimisedExcitation") -> tuple[Block, ...]:
    """Return the figures of a trajectory, the part of each limit that it uses, and clearances."""
    known = [margin for margin in found.margins if margin.share is not None]
    shares = {(margin.kind, margin.name): f"{margin.share:.1%}" for margin in known}
    kinds, names = (tuple(dict.fromkeys(key[place] for key in shares)) for place in (0, 1))
    rows = [[name, *(shares.get((kind, name)) for kind in kinds)] for name in names]
    head = (
        f"{found.trajectory.source}, {found.trajectory.duration:g} s\n"
        f"condition number of the regressor (column-scaled): {found.condition:.4g}\n"
        f"  best of the random feasible trajectories {found.random_condition:.4g}, their median "
        f"{found.random_median:.4g}; {describe_gain(found.factor)} than the best\n"
        f"information per parameter (mean logarithm): {found.information:.4g}, most of the random ones "
        f"{found.random_information:.4g}"
    )
    title = "part of each limit that is used, at most:"
    places = [[margin.name, margin.value] for margin in found.margins if margin.share is None]
    clearances = [Table(("place", "least clearance/m"), places)] if places else []
    return (head, Table(("joint", *kinds), rows, title=title), *clearances)


def describe_payload(robot: str, found: "Payload") -> dict[str, object]:
    """Return the payload as `symid payload --json` gives it."""
    by_name = {entry.name: entry for entry in found.quantities}
    return {
        "robot": robot,
        **describe_record(found),
        "mass": by_name["mass"].value,
        "com": [by_name[name].value for name in ("cx", "cy", "cz")],
        "inertia": {name[1:]: entry.value for name, entry in by_name.items() if name.startswith("J")},
        "standard": dict(zip(INERTIAL, found.standard.tolist(), strict=True)),
    }


def show_payload(robot: str, found: "Payload") -> tuple[Block, ...]:
    """Return the table of identifiable quantities, and the others with the reasons."""
    head = (
        f"{robot}: payload on the link of joint {found.joint!r}\n"
        "in the link frame of the robot file; inertia about the centre of mass"
    )
    rows = [(e.name, e.value, e.std, e.unit) for e in found.quantities if e.value is not None]
    refused = "\n".join(f"refused: {e.name}: {e.reason}" for e in found.quantities if e.value is None)
    large = f"standard deviations are multiplied by {found.scale:.3g}, because chi^2 is too large"
    texts = filter(None, (refused, large * (found.scale > 1.0)))
    return (head, Table(("quantity", "value", "std", "unit"), rows, (0, 3)), *texts)


def _list_changes(changes: Sequence["ParameterChange"]) -> str:
    return ", ".join(
        f"{entry.name} from {entry.before:.4g} to {entry.after:.4g} ({entry.deviations:+.2g} std)"
        for entry in changes
    )


def warn_payload(found: "Payload") -> tuple[Notice, ...]:
    """Return the warnings of a payload."""
    texts = {}
    refused = [entry.name for entry in found.quantities if entry.value is None]
    if refused:
        names = ", ".join(refused)
        texts["refused"] = f"not identifiable: {names}; do not enter guessed values in a controller"
    if found.unexplained and found.doubtful:
        texts["other-changes"] = (
            f"base parameters changed as no payload explains: {_list_changes(found.unexplained)}. Something "
            "else changed between the logs, or friction and filters bias one of them; use the same motions"
        )
    if found.friction:
        changes = f"friction changed: {_list_changes(found.friction)}"
        texts["friction-changed"] = f"{changes}; gear friction grows with load and falls with temperature"
    if found.moved > _FAR:
        texts["inconsistent"] = (
            f"the nearest physically consistent body is {found.moved:.2g} standard deviations away from the "
            "change of the base parameters: something else changed between the logs"
        )
    return tuple(Notice(code=f"payload.{code}", text=text) for code, text in texts.items())
