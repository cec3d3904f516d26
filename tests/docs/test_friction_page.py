"""The page on friction: its example runs and finds the model that made the motion."""

import re

import numpy as np
import pytest


def test_the_example_of_one_axis(project, capsys):
    text = (project / "docs" / "friction.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"^```python\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    names = {}
    exec(compile(block, "friction.md", "exec"), names)  # noqa: S102  the page's own example
    assert names["chosen"] == names["rich"]
    assert np.array(names["fit"].values) == pytest.approx(names["truth"], rel=0.02, abs=0.02)
    lines = capsys.readouterr().out.splitlines()
    assert lines[2].startswith("asymmetric + drift {'M': ")
    assert float(lines[3].removesuffix(" m")) < 1e-3
