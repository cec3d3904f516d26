"""The rules of axe-core for pages that everybody can read, as a package from PyPI brings them."""

from importlib.util import find_spec
from pathlib import Path

import pytest

PLAIN = (
    "for (const node of document.querySelectorAll('.katex')) "
    "node.replaceWith(node.querySelector('annotation').textContent)"
)
"""Formulas as their LaTeX: the rules look at every box of a formula otherwise, for a minute a page."""


def list_findings(browser):
    """Return the rules that the open page breaks, each with the first element that does."""
    package = find_spec("axe_playwright_python")
    if package is None:
        pytest.skip("axe-core is not here: make test-browser installs it")
    browser.run(PLAIN)
    rules = Path(package.origin).with_name("axe.min.js").read_text(encoding="utf-8")
    browser.run(f"{rules};1")
    return browser.run(
        "axe.run(document, { resultTypes: ['violations'] }).then((found) => "
        "found.violations.map((one) => [one.id, one.nodes[0].html.slice(0, 200)]))"
    )
