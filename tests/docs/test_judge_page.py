"""The page of the judge: its table is the policy in use."""

import re
from dataclasses import asdict

from symid.identification.judge import POLICY
from symid.logs.checks import OVERLOAD
from tests.pages import DOCS


def test_the_table_is_the_policy():
    text = (DOCS / "judge.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \| ([\d.]+) \|", text.partition("## All numbers")[2], re.MULTILINE)
    assert [(name, float(value)) for name, value in rows] == [
        (name, float(value)) for name, value in asdict(POLICY).items()
    ]
    assert POLICY.overload == OVERLOAD, "logs warn by the number of verdicts"
