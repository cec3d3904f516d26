"""A lesson as a notebook: valid, executed, with live objects; its cells check what its text states."""

import json

import pytest

import symid
from symid.cli.main import run
from symid.lessons import get_book, page, write_lesson_notebook
from symid.robot import load_robot

nbformat = pytest.importorskip("nbformat", reason="wants the package nbformat")


def write(name, folder, **letters):
    return write_lesson_notebook(load_robot(name), get_book(**{"name": "symid", **letters}), None, folder)


@pytest.fixture
def unexecuted(monkeypatch):
    monkeypatch.setattr(page, "_execute", lambda *_: None)


def list_code(text):
    return ["".join(cell["source"]) for cell in json.loads(text)["cells"] if cell["cell_type"] == "code"]


@pytest.fixture(scope="module")
def executed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("notebook")
    path = symid.load("two_link_symbols").derivation().ipynb(folder / "lesson.ipynb", notation="craig")
    return nbformat.read(path, as_version=4)


def test_it_is_executed_and_shows_formulas_with_the_letters_of_the_book(executed):
    nbformat.validate(executed)
    cells = [cell for cell in executed.cells if cell.cell_type == "code"]
    assert len(cells) == 8
    assert [cell.execution_count for cell in cells] == list(range(1, 9))
    assert all(output.output_type == "execute_result" for cell in cells for output in cell.outputs)
    shown = [output.data for cell in cells for output in cell.outputs]
    assert sum("text/latex" in data for data in shown) >= 5
    assert any(r"L_{1}^{2} m_{2}" in data.get("text/latex", "") for data in shown)
    # Nothing that differs from run to run.
    assert all("execution" not in cell.metadata for cell in executed.cells)
    text = "\n".join(cell.source for cell in executed.cells if cell.cell_type == "markdown")
    assert r"G_{2} = m_{2} \, l_{\mathrm{c}2} \, g \, c_{12} \tag{" in text
    assert "Craig" in text
    assert "| joint | name |" in text


@pytest.mark.parametrize("name", ["ppr", "scara", "two_link_elastic"])
@pytest.mark.usefixtures("unexecuted")
def test_cells_of_every_kind_of_robot_run(name, tmp_path):
    text, done = write(name, tmp_path)
    assert not done
    names = {}
    for cell in list_code(text):
        exec(compile(cell, "cell", "exec"), names)  # noqa: S102  what a kernel does
    assert "skew" in names


def test_long_sums_break_at_their_outermost_level():
    group = r"(a_{1} \, b_{1} - c_{1})"
    terms = [rf"x_{{{k}}} \, {group}" for k in range(20)]
    text = page._break_lines(f"M_{{11}} = {' + '.join(terms)}")
    body = text.removeprefix(r"\begin{aligned} M_{11} &= ").removesuffix(r" \end{aligned}")
    lines = body.split(r" \\ &\quad {} ")
    assert len(lines) > 2
    assert " ".join(lines) == " + ".join(terms)
    assert all(line.count("(") == line.count(")") for line in lines)
    assert page._break_lines("a = b + c") == "a = b + c"


def test_without_a_kernel_a_note_says_so(unexecuted, tmp_path, capsys):
    """The note is lesson.not-executed."""
    path = tmp_path / "a.ipynb"
    assert run(["derive", "two_link", "--ipynb", str(path)]) == 0
    assert "pip install 'symid[notebook]'" in capsys.readouterr().err
    assert all(not cell["outputs"] for cell in json.loads(path.read_text())["cells"] if "outputs" in cell)


def test_exercises_need_a_page_and_cells_that_fail_stop_it(tmp_path, monkeypatch):
    with pytest.raises(symid.UsageError, match="part of a page"):
        symid.load("emps").write_lesson(tmp_path / "a.ipynb", exercises=3)
    # The notice is lesson.cell.
    monkeypatch.setattr(page, "_list_code", lambda *_: iter(["1/0"]))
    with pytest.raises(symid.GenerationError, match="ZeroDivisionError"):
        symid.load("emps").write_lesson(tmp_path / "a.ipynb")
    assert not (tmp_path / "a.ipynb").exists()
