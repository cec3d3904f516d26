"""What a diagnosis looks like on the page of an identification: figures, and tables of texts.

Input: an estimate, its `Diagnosis`. Output: `DiagnosisSection`, whose fields are the template's variables.

Supported: any number of joints and parameters.
Not supported: interaction; figures are drawn once.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from symid.estimators.estimate import Estimate
from symid.identification.diagnosis import Diagnosis
from symid.report.figures import build_curve_figure, build_line_figure
from symid.report.lines import Line
from symid.report.tables import write_digits
from symid.residuals.structure import JointProfiles, Profile

__all__ = ["DiagnosisSection", "ProfileFigures", "build_diagnosis"]

Cells = tuple[tuple[str, ...], ...]
_SHOWN = 20
"""Rows of a table of pairs, at most."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ProfileFigures:
    """The residual of a joint against position, velocity and load, as SVG."""

    joint: str
    position: str
    velocity: str
    load: str


@dataclass(frozen=True, slots=True, kw_only=True)
class DiagnosisSection:
    """The diagnosis as the template shows it: sentences, figures, rows of tables."""

    identifiability: str
    spectrum: str
    correlated: Cells
    ellipse: str
    essential: str
    dropped: Cells
    bootstrap: str
    scatter: Cells
    drift: str
    changed: Cells
    changed_names: tuple[str, ...]
    structure: Cells
    profiles: tuple[ProfileFigures, ...]
    prices: Cells


def build_diagnosis(estimate: Estimate, diagnosis: Diagnosis) -> DiagnosisSection:
    """Return all that the page shows of a diagnosis."""
    essential, bootstrap = diagnosis.essential, diagnosis.bootstrap
    return DiagnosisSection(
        identifiability=_describe_rank(diagnosis),
        spectrum=_draw_spectrum(diagnosis),
        correlated=tuple((a, b, f"{value:.3f}") for a, b, value in diagnosis.correlated[:_SHOWN]),
        ellipse=_draw_ellipse(diagnosis),
        essential=(
            f"{len(essential.kept)} of {len(essential.kept) + len(essential.dropped)} parameters stand out "
            "of the noise. Without the others the residual of the fit grows by "
            f"{essential.price_percent:.2g} %."
        ),
        dropped=tuple(
            (entry.name, f"{entry.ratio:.2g}", f"{entry.price_percent:.2g} %") for entry in essential.dropped
        ),
        bootstrap=(
            f"{bootstrap.blocks} blocks of the logs, drawn {bootstrap.replicates} times: deviations that "
            "hold whatever pattern the residual keeps within a block."
        ),
        scatter=_list_scatter(estimate, diagnosis),
        drift=_describe_drift(diagnosis),
        changed=tuple(
            (
                entry.name,
                *(
                    f"{v:.4g} ± {write_digits(d)}"
                    for v, d in zip(entry.values, entry.deviations, strict=True)
                ),
            )
            for entry in diagnosis.drift.changed
            if len(entry.values) == len(diagnosis.drift.runs)
        ),
        changed_names=("name", *(Path(estimate.sources[run]).name for run in diagnosis.drift.runs)),
        structure=tuple(
            (
                entry.joint,
                entry.family,
                f"{entry.share_percent:.3g} %",
                f"{entry.rms:.3g} {entry.unit}",
                entry.advice,
            )
            for entry in diagnosis.structure
        ),
        profiles=tuple(map(_draw_profiles, diagnosis.profiles)),
        prices=tuple((entry.what, entry.of, f"{entry.percent:+.3g} %") for entry in diagnosis.prices),
    )


def _describe_rank(diagnosis: Diagnosis) -> str:
    seen = diagnosis.singular[: diagnosis.rank]
    ratio = seen[0] / seen[-1]
    hidden = len(diagnosis.singular) - diagnosis.rank
    lost = f" {hidden} more directions are not seen." if hidden else ""
    return (
        f"The logs see {diagnosis.rank} directions of the parameters, the last {ratio:.3g} times less.{lost}"
    )


def _draw_spectrum(diagnosis: Diagnosis) -> str:
    values = np.array(diagnosis.singular)
    number = np.arange(1.0, len(values) + 1.0)
    rank = diagnosis.rank
    lines = [Line(label="seen", style="first", x=number[:rank], y=values[:rank], markers=True)]
    if np.any(values[rank:] > 0.0):
        lines.append(Line(label="not seen", style="second", x=number[rank:], y=values[rank:], markers=True))
    return build_line_figure(
        "Singular values",
        "Singular values of the scaled matrix of the fit in falling order.",
        ("number", "singular value"),
        lines,
        logarithmic=True,
        whole=True,
    )


def _draw_ellipse(diagnosis: Diagnosis) -> str:
    if diagnosis.ellipse is None:
        return ""
    first, second, _ = diagnosis.correlated[0]
    outline = diagnosis.ellipse.trace()
    return build_curve_figure(
        f"{first} and {second}",
        f"Where {first} and {second} lie together with a probability of {diagnosis.ellipse.level:.0%}.",
        (first, second),
        (Line(label="ellipse", style="first", x=outline[:, 0], y=outline[:, 1]),),
    )


def _list_scatter(estimate: Estimate, diagnosis: Diagnosis) -> Cells:
    stated = {entry.name: entry for entry in estimate.parameters}
    found = diagnosis.bootstrap
    dropped = {entry.name for entry in diagnosis.essential.dropped}
    return tuple(
        (
            name,
            f"{stated[name].value:.5g}",
            write_digits(stated[name].std),
            write_digits(deviation),
            f"{low:.4g}",
            f"{high:.4g}",
            "no" if name in dropped else "yes",
        )
        for name, deviation, low, high in zip(
            found.names, found.deviations, found.low, found.high, strict=True
        )
        if name in stated
    )


def _describe_drift(diagnosis: Diagnosis) -> str:
    drift = diagnosis.drift
    if len(drift.runs) < 2:
        return "One log alone tells nothing of drift."
    if not drift.changed:
        return f"{len(drift.runs)} logs tell {drift.compared} parameters alike, within their noise."
    return (
        f"{len(drift.changed)} of {drift.compared} parameters differ between the logs beyond what their "
        "noise allows: the robot changed, or the model misses a term."
    )


def _draw_profiles(entry: JointProfiles) -> ProfileFigures:
    unit, speed = entry.position_unit, f"{entry.position_unit}/s"
    return ProfileFigures(
        joint=entry.joint,
        position=_draw_profile(entry, "position", f"position ({unit})", entry.position),
        velocity=_draw_profile(entry, "velocity", f"velocity ({speed})", entry.velocity),
        load=_draw_profile(entry, "load", f"predicted torque ({entry.unit})", entry.load),
    )


def _draw_profile(entry: JointProfiles, against: str, label: str, profile: Profile) -> str:
    return build_line_figure(
        f"{entry.joint}: residual against {against}",
        f"Mean residual of {entry.joint} in {entry.unit} against {against}, with one deviation either side.",
        (label, f"residual ({entry.unit})"),
        (
            Line(label="mean", style="first", x=profile.centre, y=profile.mean, markers=True),
            Line(
                label="plus deviation", style="second", x=profile.centre, y=profile.mean + profile.deviation
            ),
            Line(
                label="minus deviation", style="third", x=profile.centre, y=profile.mean - profile.deviation
            ),
        ),
    )
