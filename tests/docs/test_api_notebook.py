"""The notebook runs from the first cell to the last, shows what it says, and becomes a page."""

import re

import pytest

from tests.notebooks import read_notebook

nbformat = pytest.importorskip("nbformat", reason="wants the package nbformat")
nbclient = pytest.importorskip("nbclient", reason="wants the package nbclient")
nbconvert = pytest.importorskip("nbconvert", reason="wants the package nbconvert")


@pytest.mark.usefixtures("c_compiler")
def test_it_runs_shows_tables_formulas_and_figures_and_becomes_one_page(project, tmp_path):
    notebook = read_notebook(project / "docs" / "api" / "robot_to_report.py")
    nbformat.validate(notebook)
    # A cell that fails fails here.
    nbclient.NotebookClient(notebook, timeout=120, resources={"metadata": {"path": str(tmp_path)}}).execute()
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert len(code) > 10
    assert all(cell.outputs for cell in code)

    def find_shown(source, kind):
        (cell,) = (entry for entry in code if entry.source.strip().endswith(source))
        (shown,) = (output.data for output in cell.outputs if output.output_type == "execute_result")
        return shown[kind]

    assert find_shown("robot.base", "text/html").count("<tr>") > 10
    assert r"\cos{\left(q_{2} \right)}" in find_shown("\nmass_matrix", "text/latex")
    assert "ZZR1" in find_shown("\nfit", "text/html")
    assert find_shown("\nvalidation", "text/html").count("<svg") == 2
    assert {"identified.urdf", "fit.json", "report.html"} <= {path.name for path in tmp_path.iterdir()}
    page, _ = nbconvert.HTMLExporter().from_notebook_node(notebook)
    assert page.count("<svg") >= 4
    assert not re.search(r"Traceback|SymidError", page)
