"""A bare element as people read it: its verdict, numbers with intervals, the models that were tried.

`HysteresisRecord` -> `FitVerdict`, blocks, plain types; the same of what it predicts of another recording.

Supported: text, HTML and JSON through `blocks`. Not supported: figures.
"""

from dataclasses import asdict

from symid.identification.hysteresis import HysteresisRecord, HysteresisTrial
from symid.joint_models import describe_inverse
from symid.report.blocks import Block, Table, select_fields
from symid.report.verdict import FitVerdict, rate_output

_POOR = 0.5
"""Of its value: a deviation beyond it leaves not even the first digit."""
_NORMAL = 1.96


def judge_element(record: HysteresisRecord) -> FitVerdict:
    """Return what an element is worth, from what it predicts of samples that were left out."""
    level = rate_output(record.held_out)
    headline = (
        f"{record.model} with {record.candidates[0].count} parameters leaves {record.held_out:.3g} % of the "
        "output unexplained, held out."
    )
    details = [
        f"Held out: every eighth of the recording in turn; the fit itself leaves {record.fitted:.3g} %."
    ]
    if not record.timed:
        details.append("No time was given: models that depend on the speed were not tried.")
    remedy = "Plot output against input, and check columns, signs and units."
    remedy = "" if level in {"good", "usable"} else remedy
    return FitVerdict(level=level, headline=headline, details=tuple(details), remedy=remedy)


def judge_element_trial(trial: HysteresisTrial) -> FitVerdict:
    """Return what an element predicts of another recording."""
    headline = f"{trial.error:.3g} % of the output of this recording is left unexplained, means removed."
    details = []
    if trial.beyond > 0.0:
        text = (
            f"{100.0 * trial.beyond:.3g} % of its samples lie beyond the input of the fit, where the element"
        )
        details.append(f"{text} extrapolates.")
    return FitVerdict(level=rate_output(trial.error), headline=headline, details=tuple(details))


def show_element(record: HysteresisRecord) -> tuple[Block, ...]:
    """Return the tables and sentences on an element."""
    shown = [entry for entry in record.parameters if not entry.name.endswith("least")]
    known = [entry for entry in shown if 0.0 < entry.deviation <= _POOR * abs(entry.value)]
    rows = [
        (entry.name, f"{entry.value:.5g}", f"{entry.deviation:.2g}", f"{low:.5g} to {high:.5g}")
        for entry in known
        for low, high in [(entry.value - _NORMAL * entry.deviation, entry.value + _NORMAL * entry.deviation)]
    ]
    poor = [entry.name for entry in shown if entry.deviation > _POOR * abs(entry.value)]
    fixed = [f"{entry.name} = {entry.value:g}" for entry in shown if not entry.deviation and entry.value]
    lists = (("Poorly identifiable, not shown", poor), ("Fixed", fixed))
    note = "\n".join(f"{head}: {', '.join(names)}." for head, names in lists if names)
    form = f" ({record.form})" if record.form else ""
    table = Table(
        header=("parameter", "value", "std", "95 % interval"),
        rows=rows,
        title=f"{record.model}{form}",
        note=note,
    )
    tried = Table(
        header=("model", "form", "parameters", "passive", "fitted %", "held out %", "+-"),
        rows=[
            (
                entry.model,
                entry.form,
                entry.count,
                "yes" if entry.passive else "no",
                f"{entry.fitted:.3g}",
                f"{entry.held_out:.3g}",
                f"{entry.spread:.2g}",
            )
            for entry in record.candidates
        ],
        left=(0, 1, 3),
        title="Models that were tried",
        picked=0,
    )
    reason = describe_inverse(record.elasticity)
    inverse = f"There is none: {reason}." if reason else "It exists, for every output."
    passive = "no motion" if record.passive else "some motions may"
    passive = f"{passive} get{'s' if record.passive else ''} work out of the element."
    facts = f"Inverse: {inverse}\nPassivity: {passive}\nStart: {_STARTS[record.start]}."
    return (table, tried, facts)


_STARTS = {
    "zero": "at rest at input zero, moved to the first sample",
    "fresh": "at rest at the first sample",
    "below": "come to the first sample from below",
    "above": "come to the first sample from above",
}


def describe_element(record: HysteresisRecord) -> dict[str, object]:
    """Return an element in plain types."""
    plain = select_fields(
        record,
        "model form start passive fitted held_out samples span speed output timed",
    )
    plain["parameters"] = [asdict(entry) for entry in record.parameters]
    plain["candidates"] = [asdict(entry) for entry in record.candidates]
    return {**plain, "inverse": describe_inverse(record.elasticity) or None}
