"""Lessons as documents: pdflatex of Debian's smallest TeX sets them without an error, inside the margins."""

import re
import shutil
import subprocess

import pytest

import symid

pytestmark = pytest.mark.tex


@pytest.mark.parametrize(
    ("name", "language"),
    [("two_link", "en"), ("puma560", "en"), ("two_link_elastic", "en"), ("two_link_elastic", "de")],
)
def test_pdflatex_runs_without_an_error(name, language, tmp_path):
    program = shutil.which("pdflatex")
    assert program, "pdflatex is not here: make test-tex says what to install"
    given = {"notation": "siciliano", "lang": language, "exercises": 4}
    symid.load(name).write_lesson(tmp_path / "lesson.tex", **given)
    command = [program, "-recorder", "-interaction=nonstopmode", "-halt-on-error", "lesson.tex"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stdout[-2000:]
    assert (tmp_path / "lesson.pdf").stat().st_size > 20_000
    # Nothing runs out of the page by more than a letter.
    widths = [float(width) for width in re.findall(r"Overfull \\hbox \(([\d.]+)pt", done.stdout)]
    assert max(widths, default=0.0) < 12.0
    record = (tmp_path / "lesson.fls").read_text()
    read = set(re.findall(r"^INPUT \S*/tex/(?:latex|generic)/([\w-]+)/", record, re.MULTILINE))
    # German ones read fonts and hyphens too where the system has them.
    more = {"babel", "babel-german", "lm"} if language == "de" else set()
    assert read <= {*_SMALL.split(), *more}, "texlive-latex-base has not all of these"


_SMALL = (
    "amsfonts amsmath atbegshi-ltx base epstopdf-pkg geometry graphics graphics-cfg graphics-def iftex "
    "l3backend latexconfig tools"
)
"""Folders of macros that Debian's texlive-latex-base brings, with what it depends on."""
