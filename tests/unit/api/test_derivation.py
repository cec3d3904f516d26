"""The derivation as a result: steps, operations, formulas in text, LaTeX and HTML."""

import pytest

import symid


@pytest.fixture(scope="module")
def robot():
    return symid.load("emps")


@pytest.fixture(scope="module")
def lesson(robot):
    return robot.derivation()


def test_it_prints_every_step_and_the_operations(lesson):
    text = str(lesson)
    for number, step in enumerate(lesson.steps, start=1):
        assert f"{number}. {step.title}\n\n   {step.sentence}" in text
    chosen = [entry for entry in lesson.operations if entry.chosen]
    assert text.count("\n") > len(chosen)
    assert all(f"\n{entry.function} " in text for entry in chosen)
    assert len(lesson.to_dict()["operations"]) == len(lesson.operations) > len(chosen)


def test_a_notebook_gets_formulas(robot, lesson):
    formula = lesson.steps[2].formulas[0]
    latex = rf"{formula.left_latex} &= {formula.latex}"
    assert latex in lesson._repr_latex_()
    assert lesson._repr_latex_().count(r"\textbf") == len(lesson.steps)
    page = lesson._repr_html_()
    assert page.count("<h4>") == len(lesson.steps)
    assert rf"$\displaystyle {formula.left_latex} = {formula.latex}$" in page
    assert "<td" in page
    assert formula.latex in str(robot.derivation(latex=True))
