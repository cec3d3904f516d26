"""The notebooks of the documentation run to their last cells, prove what they say, and show it."""

import ast
import re

import pytest

pytest.importorskip("nbformat", reason="wants the package nbformat")

from tests.notebooks import read_notebook
from tests.simulations import share_simulations

NAMES = ("two_links", "panda_parameters", "springs", "log_to_feedforward", "rows")


def run_cells(notebook):
    """Run the cells of code in this process, as a kernel would; return what each shows, as HTML or text."""
    names, shown = {}, []
    for cell in notebook.cells:
        if cell.cell_type != "code":
            continue
        tree = ast.parse(cell.source)
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, "cell", "exec"), names)  # noqa: S102  what a kernel does
        if last is not None:
            value = eval(compile(ast.Expression(last.value), "cell", "eval"), names)  # noqa: S307  likewise
            html = getattr(value, "_repr_html_", None)
            shown.append((html() if html else None) or repr(value))
    return shown


@pytest.mark.parametrize("name", NAMES)
def test_a_notebook_runs_and_proves_what_it_says(name, project, tmp_path, monkeypatch, capsys):
    path = project / "docs" / "notebooks" / f"{name}.py"
    monkeypatch.chdir(tmp_path)
    share_simulations(monkeypatch)
    notebook = read_notebook(path)
    shown = run_cells(notebook)
    capsys.readouterr()
    code = [cell.source for cell in notebook.cells if cell.cell_type == "code"]
    text = [cell.source for cell in notebook.cells if cell.cell_type == "markdown"]
    assert sum("assert " in cell for cell in code) >= 2
    assert any("<svg" in html for html in shown)
    assert text[0].startswith("# ")
    assert "**To do**" in text[-1]
    assert notebook.cells[0].cell_type == "markdown"


def test_the_page_names_them_all(project):
    page = (project / "docs" / "notebooks.md").read_text(encoding="utf-8")
    files = {path.stem for path in (project / "docs" / "notebooks").glob("*.py")}
    assert files == set(NAMES)
    assert all(f"notebooks/{name}.ipynb" in page and f"notebooks/{name}.html" in page for name in NAMES)


@pytest.mark.usefixtures("c_compiler")
def test_that_of_the_api_shows_tables_formulas_and_figures_and_becomes_one_page(project, tmp_path):
    nbformat, nbclient, nbconvert = (
        pytest.importorskip(name, reason=f"wants the package {name}")
        for name in ("nbformat", "nbclient", "nbconvert")
    )
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
