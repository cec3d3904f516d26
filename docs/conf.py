"""Configuration of Sphinx; lessons and executed notebooks are written beside the pages of HTML."""

import sys
from pathlib import Path

from sphinx.application import Sphinx

import symid
from symid import __version__

FOLDER = Path(__file__).resolve().parent
sys.path.insert(0, str(FOLDER.parent))

project = "symid"
author = "the symid developers"
project_copyright = author
release = version = __version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx.ext.mathjax",
]
# Formulas are typeset by the KaTeX of the lessons: pages need no network.
myst_enable_extensions = ["dollarmath", "deflist", "colon_fence"]
html_static_path = ["_static", "../templates/lesson/katex"]
html_css_files = ["katex.min.css", "pictures.css"]
mathjax_path = "katex.min.js"
mathjax_options = {"defer": "defer"}
html_js_files = ["math.js"]
autodoc_default_options = {"members": True, "member-order": "bysource", "exclude-members": "progress"}
autodoc_preserve_defaults = True
# Types stand in the signatures as they are written; what they need is not loaded.
autodoc_typehints = "signature"
python_maximum_signature_line_length = 100
python_use_unqualified_type_names = True
napoleon_use_ivar = True
# In docstrings one backtick on each side is code.
default_role = "code"
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build"]
myst_heading_anchors = 4

html_theme = "furo"
html_title = f"symid {release}"


def hide_constructor(_app: Sphinx, what: str, *_arguments: object) -> tuple[str, None] | None:
    """Return no signature for classes: readers get their objects from functions."""
    return ("", None) if what == "class" else None


LESSONS = ("two_link", "two_link_symbols", "two_link_elastic", "scara", "puma560", "panda", "quadruped")


def write_lessons(app: Sphinx) -> None:
    """Write the lessons that the pages link to, with exercises."""
    if app.builder.format == "html":
        folder = Path(app.outdir) / "lessons"
        folder.mkdir(parents=True, exist_ok=True)
        for name in LESSONS:
            (folder / f"{name}.exercises.txt").unlink(missing_ok=True)
            symid.load(name).write_lesson(folder / f"{name}.html", exercises=6, force=True)


def write_notebooks(app: Sphinx) -> None:
    """Execute the notebooks, and write each as such and as a page."""
    if app.builder.format != "html":
        return
    import nbformat
    from nbclient import NotebookClient
    from nbconvert import HTMLExporter

    from tests.notebooks import read_notebook

    folder = Path(app.outdir) / "notebooks"
    folder.mkdir(parents=True, exist_ok=True)
    for source in sorted((FOLDER / "notebooks").glob("*.py")):
        notebook = read_notebook(source)
        place = {"metadata": {"path": str(folder)}}
        quiet = ["--IPKernelApp.log_level=50"]
        NotebookClient(notebook, record_timing=False, extra_arguments=quiet, resources=place).execute()
        nbformat.write(notebook, folder / f"{source.stem}.ipynb")
        page, _ = HTMLExporter().from_notebook_node(notebook)
        (folder / f"{source.stem}.html").write_text(page, encoding="utf-8")


def setup(app: Sphinx) -> None:
    """Tell Sphinx what to do with signatures, and what to write besides."""
    app.connect("builder-inited", write_lessons)
    app.connect("builder-inited", write_notebooks)
    app.connect("autodoc-process-signature", hide_constructor)
