"""A diagnosis as tables for people and as an object for programs.

Input: `Diagnosis`. Output: text, dictionaries.
"""

from typing import TYPE_CHECKING

from symid.report.blocks import Block, format_table

if TYPE_CHECKING:  # these load numpy
    from symid.identification.diagnosis import Diagnosis

__all__ = ["describe_diagnosis", "show_diagnosis"]


def describe_diagnosis(diagnosis: "Diagnosis") -> dict[str, object]:
    """Return the diagnosis as `symid report --diagnose --json` gives it."""
    essential, bootstrap, drift = diagnosis.essential, diagnosis.bootstrap, diagnosis.drift
    return {
        "singular_values": list(diagnosis.singular),
        "rank": diagnosis.rank,
        "refit": None if diagnosis.refit is None else {"largest_difference_stds": diagnosis.refit},
        "correlated": [
            {"parameters": [first, second], "correlation": value}
            for first, second, value in diagnosis.correlated
        ],
        "essential": {
            "kept": list(essential.kept),
            "dropped": [
                {"name": entry.name, "deviations": entry.ratio, "price_percent": entry.price_percent}
                for entry in essential.dropped
            ],
            "price_percent": essential.price_percent,
        },
        "bootstrap": {
            "blocks": bootstrap.blocks,
            "replicates": bootstrap.replicates,
            "parameters": [
                {"name": name, "std": std, "low": low, "high": high}
                for name, std, low, high in zip(
                    bootstrap.names,
                    bootstrap.deviations.tolist(),
                    bootstrap.low.tolist(),
                    bootstrap.high.tolist(),
                    strict=True,
                )
            ],
        },
        "drift": {
            "compared": drift.compared,
            "changed": [
                {"name": entry.name, "values": entry.values, "stds": entry.deviations, "chance": entry.chance}
                for entry in drift.changed
            ],
        },
        "structure": [
            {
                "joint": entry.joint,
                "follows": entry.family,
                "share_percent": entry.share_percent,
                "rms": entry.rms,
                "unit": entry.unit,
                "advice": entry.advice,
            }
            for entry in diagnosis.structure
        ],
        "prices": [
            {"what": entry.what, "of": entry.of, "percent": entry.percent} for entry in diagnosis.prices
        ],
    }


def show_diagnosis(diagnosis: "Diagnosis") -> tuple[Block, ...]:
    """Return the diagnosis in a few sentences and a table of what the residual follows."""
    essential, drift = diagnosis.essential, diagnosis.drift
    whole = len(essential.kept) + len(essential.dropped)
    needed = (
        f"{len(essential.kept)} of {whole} parameters are essential; without the others the residual grows "
        f"by {essential.price_percent:.2g} %"
    )
    lines = [f"{diagnosis.rank} of {len(diagnosis.singular)} directions are seen", needed]
    if diagnosis.refit is not None:
        lines.append(f"fitted again, the logs give the estimate to {diagnosis.refit:.1g} standard deviations")
    if len(drift.runs) > 1:
        lines.append(f"{len(drift.changed)} of {drift.compared} parameters differ between the logs")
    lines += [f"price of {entry.what}: {entry.percent:+.3g} % {entry.of}" for entry in diagnosis.prices]
    if diagnosis.structure:
        rows = [
            [entry.joint, entry.family, f"{entry.share_percent:.3g}", entry.rms, entry.unit]
            for entry in diagnosis.structure
        ]
        table = format_table(("joint", "residual follows", "share/%", "rms", "unit"), rows, left=(0, 1, 4))
        return ("\n".join(lines), table)
    return ("\n".join(lines),)
