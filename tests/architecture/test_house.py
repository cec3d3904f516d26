"""The house stays below its limits, no files import each other in a circle, papers name what exists."""

import re

import pytest

from tests.architecture.source import PACKAGE, PROJECT, house

MOST = {
    "files of symid/": 223,
    "lines": 84_305,  # Torques beyond the limits of the joints cap what a fit is worth.
    "imports inside functions": 76,  # SciPy stays away from code that is only looked at again.
    "strings read as a language": 0,
    "lines of tests": 62_454,  # Each warning says what to do, long logs pass in parts: that is tested.
    "kB of DESIGN.md": 10,
    "kB of README.md": 5,
}
"""A change lowers them, or says why not: friction and elastic rooms have thresholds beside the judge."""


@pytest.fixture(scope="module")
def figures():
    return house.measure(PROJECT)


@pytest.mark.parametrize("name", MOST)
def test_the_house_does_not_grow(name, figures):
    assert figures[name] <= MOST[name]


def test_no_files_import_each_other_in_a_circle():
    assert house.find_circles(house.read_modules(PROJECT)) == []


@pytest.mark.parametrize("page", ["DESIGN.md", "CONTRIBUTING.md"])
def test_papers_name_files_that_exist(page):
    rooms = "|".join(sorted(path.name for path in PACKAGE.iterdir() if path.is_dir()))
    text = (PROJECT / page).read_text(encoding="utf-8")
    named = set(
        re.findall(
            rf"`(?:symid/)?((?:{rooms}|rigid|regression|estimators|diagnostics)/[a-z_/]+)(?:\.py)?[`.]", text
        )
    )
    inner = PACKAGE / "identification"
    missing = [
        name
        for name in sorted(named)
        if not any(path.exists() for root in (PACKAGE, inner) for path in (root / name, root / f"{name}.py"))
    ]
    assert not missing
