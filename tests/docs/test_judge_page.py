"""The page of the judge: its table is the policy in use."""

import math
import re
from dataclasses import asdict

from symid.identification.judge import POLICY
from symid.logs.checks import OVERLOAD
from symid.options import ExportOptions, list_options
from tests.pages import DOCS


def test_the_table_is_the_policy():
    text = (DOCS / "judge.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \| ([\d.]+) \|", text.partition("## All numbers")[2], re.MULTILINE)
    assert [(name, float(value)) for name, value in rows] == [
        (name, float(value)) for name, value in asdict(POLICY).items()
    ]
    assert POLICY.overload == OVERLOAD, "logs warn by the number of verdicts"


def test_the_help_of_export_states_its_defaults():
    options = list_options(ExportOptions)
    least, part = 100.0 * POLICY.relevance, math.sqrt(POLICY.relevance)
    assert f"default: {least:g}, or {part:.2f} times the held-out residual" in options["limit"].meaning
    assert f"[default: {POLICY.scale:g}, and {POLICY.overload:g} for the limit]" in options["ratio"].meaning
