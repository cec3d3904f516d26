"""The notebook runs from the first cell to the last, shows what it says, and becomes a page."""

import re

import pytest

from tests.notebooks import read_notebook

nbformat = pytest.importorskip("nbformat", reason="wants the package nbformat")
nbclient = pytest.importorskip("nbclient", reason="wants the package nbclient")
NotebookClient = nbclient.NotebookClient
nbconvert = pytest.importorskip("nbconvert", reason="wants the package nbconvert")
HTMLExporter = nbconvert.HTMLExporter


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("notebook")


@pytest.fixture(scope="module")
def notebook(project, folder, c_compiler):
    assert c_compiler
    made = read_notebook(project / "docs" / "api" / "robot_to_report.py")
    nbformat.validate(made)
    # A cell that fails fails here.
    NotebookClient(made, timeout=120, resources={"metadata": {"path": str(folder)}}).execute()
    return made


def find_shown(notebook, source, kind):
    (cell,) = [entry for entry in notebook.cells if entry.source.strip().endswith(source)]
    (shown,) = [output.data for output in cell.outputs if output.output_type == "execute_result"]
    return shown[kind]


def test_every_cell_of_code_shows_something(notebook):
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert len(code) > 10
    assert all(cell.outputs for cell in code)


def test_results_show_tables_formulas_and_figures(notebook):
    assert find_shown(notebook, "robot.base", "text/html").count("<tr>") > 10
    assert r"\cos{\left(q_{2} \right)}" in find_shown(notebook, "\nmass_matrix", "text/latex")
    assert "ZZR1" in find_shown(notebook, "\nfit", "text/html")
    assert find_shown(notebook, "\nvalidation", "text/html").count("<svg") == 2


def test_files_were_written(notebook, folder):
    names = {path.name for path in folder.iterdir()}
    assert {"identified.urdf", "fit.json", "report.html"} <= names


def test_it_becomes_one_page(notebook):
    page, _ = HTMLExporter().from_notebook_node(notebook)
    assert page.count("<svg") >= 4
    assert not re.search(r"Traceback|SymidError", page)
