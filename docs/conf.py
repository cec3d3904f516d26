"""Configuration of Sphinx."""

from sphinx.application import Sphinx

from symid import __version__

project = "symid"
author = "the symid developers"
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


def setup(app: Sphinx) -> None:
    """Tell Sphinx what to do with signatures."""
    app.connect("autodoc-process-signature", hide_constructor)
