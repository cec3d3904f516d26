"""Configuration of Sphinx."""

from symid import __version__

project = "symid"
author = "the symid developers"
release = version = __version__

extensions = ["myst_parser"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build"]
myst_heading_anchors = 3

html_theme = "furo"
html_title = f"symid {release}"
