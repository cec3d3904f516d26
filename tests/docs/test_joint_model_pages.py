"""The pages on springs and on friction with a memory: the examples of a section run, one after the other."""

import re

import numpy as np
import pytest

BLOCK = re.compile(r"^```python\n(.*?)^```$", re.DOTALL | re.MULTILINE)


def run_section(project, page, first, last):
    """Run the blocks between two headings in one namespace, and return its names."""
    text = (project / "docs" / page).read_text(encoding="utf-8")
    names = {}
    for block in BLOCK.findall(text[text.index(first) : text.index(last)]):
        exec(compile(block, page, "exec"), names)  # noqa: S102  the page's own example
    return names


def test_a_spring_on_its_own(project, capsys):
    names = run_section(project, "elastic.md", "## A spring on its own", "## How it is checked")
    np.testing.assert_allclose(names["back"], names["torsion"], atol=1e-15)
    stored, lost = names["stored"], names["lost"]
    np.testing.assert_allclose(stored - stored[0] + lost, names["work"], atol=1e-14)
    # A cycle of the spring without knees: four times k r (A - r) of each stop.
    loss = 4.0 * (900.0 * 1e-3 * 4e-3 + 400.0 * 3e-3 * 2e-3)
    lines = capsys.readouterr().out.splitlines()
    assert float(lines[1].split()[3]) == pytest.approx(loss, rel=1e-6)
    assert lines[2].startswith("True 1500.0")
    np.testing.assert_allclose(names["again"], names["torsion"], atol=1e-15)


def test_friction_with_a_memory(project, capsys):
    names = run_section(project, "friction_dynamic.md", "# Friction with a memory", "## In C")
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == str(names["equations"].steady)
    assert lines[1].startswith(r"\dot z = ")
    assert lines[2] == "True"
    assert np.abs(names["torque"]).max() < 15.0 + 25.0 * 0.02 + 100.0 * 0.02


def test_a_rig_for_friction_with_a_memory(project, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = run_section(project, "friction_dynamic.md", "# Friction with a memory", "## Identification")
    for kind in ("pulled", "pushed", "steered"):
        run = names[kind]
        gap = run.energy - run.energy[0] - run.work + run.loss
        assert np.abs(gap).max() < 1e-6 * max(run.work.max(), run.energy.max())
    # The spring breaks away between fC and fS, earlier the faster it pulls; 10 N bend the bristles only.
    assert 10.0 < names["pulled"].force.max() < 15.0
    assert names["pushed"].position[-1] < 2e-3
