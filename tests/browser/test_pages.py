"""Pages of results in a headless Chromium: desk, telephone, paper; readable, quiet and complete."""

from pathlib import Path

import numpy as np
import pytest

import symid
from tests.browser.axe import list_findings

pytestmark = pytest.mark.browser

WIDE = """[...document.querySelectorAll('body *')].filter((x) => !x.closest('.scroll, svg')
    && x.getBoundingClientRect().right > innerWidth + 1).map((x) => x.outerHTML.slice(0, 80))"""
CUT = "[...document.querySelectorAll('.scroll')].filter((x) => x.scrollWidth > x.clientWidth + 1).length"
SMALL = """[...document.querySelectorAll('body *')].filter((x) => x.checkVisibility() && [...x.childNodes]
    .some((n) => n.nodeType == 3 && n.data.trim())).map((x) => { const s = x.ownerSVGElement;
    const k = s ? s.getBoundingClientRect().width / s.viewBox.baseVal.width : 1;
    return [parseFloat(getComputedStyle(x).fontSize) * k, x.textContent.slice(0, 40)] }).filter(
    (x) => x[0] < 9)"""
FIRST = """['.verdict', '.top figure'].map((x) => document.querySelector(x)).map(
    (x) => x && x.getBoundingClientRect().top)"""
A4 = (794, 1123)
"""Of a page at 96 dots an inch."""


def write_fits(folder, data):
    """Write the pages of stored fits: rigid, elastic and friction."""
    for path in sorted((data / "fits").glob("*.json")):
        symid.load_fit(path).report(folder / f"{path.stem}.html")


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pages")
    robot, elastic = symid.load("two_link"), symid.load("two_link_elastic")
    log, other = (robot.simulate(duration=4.0, seed=seed).log for seed in (1, 2))
    fit = robot.identify(log)
    fit.report(folder / "held_out.html", validation=other)
    fit.compare(robot.identify(other)).report(folder / "comparison.html")
    robot.check(log).report(folder / "check.html")
    symid.load("puma560").check().report(folder / "robot.html")
    robot.excite(harmonics=2, period=2.0, candidates=10, starts=1).report(folder / "excitation.html")
    heavy = folder / "carrying.toml"
    heavy.write_text(robot.path.read_text().replace("mass = 1.9", "mass = 2.9"))
    robot.payload(symid.load(heavy).simulate(duration=4.0, seed=2).log, log).report(folder / "payload.html")
    motion = elastic.simulate(duration=6.0, seed=1).log
    elastic.identify_stiffness(motion).report(folder / "stiffness.html")
    elastic.identify(motion, method="elimination").report(folder / "elastic.html", validation=motion)
    x = np.sin(np.linspace(0.0, 20.0, 2000)) * np.linspace(0.2, 1.0, 2000)
    y = 2.0 * x + 0.3 * np.tanh(8.0 * np.gradient(x) / np.abs(np.gradient(x)).max())
    symid.hysteresis.fit(x, y, model="prandtl-ishlinskii").report(folder / "hysteresis.html")
    write_fits(folder, Path(__file__).resolve().parents[1] / "data")
    return folder


PAGES = (
    *("held_out", "comparison", "check", "robot", "excitation", "payload", "stiffness", "elastic"),
    *("hysteresis", "rigid_1", "elastic_1", "friction_1"),
)


@pytest.mark.parametrize("name", PAGES)
def test_a_page_fits_a_desk_and_a_telephone(browser, folder, name):
    path = folder / f"{name}.html"
    assert path.stat().st_size < 1.5e6
    for width, dark in ((1280, False), (400, True), (400, False), (1280, True)):
        browser.size(width, 900, dark=dark)
        browser.open(path)
        assert browser.run("document.documentElement.scrollWidth") <= width
        assert browser.run(WIDE) == []
        assert browser.run(SMALL) == []
        assert browser.messages == []
        assert [url for url in browser.requests if not url.startswith("file:")] == []
    verdict, figure = browser.run(FIRST)
    assert verdict < 300.0
    assert figure is None or figure < 600.0


@pytest.mark.parametrize("name", PAGES)
def test_nothing_is_cut_off_on_paper(browser, folder, name):
    browser.size(A4[0] - 98, A4[1])
    browser.open(folder / f"{name}.html")
    browser.call("Emulation.setEmulatedMedia", media="print")
    try:
        assert browser.run(WIDE) == []
        assert browser.run(CUT) == 0
        closed = (
            "[...document.querySelectorAll('details')].filter((x) => x.getBoundingClientRect().height < 40)"
        )
        assert browser.run(f"{closed}.length") == 0
    finally:
        browser.call("Emulation.setEmulatedMedia", media="")


@pytest.mark.parametrize("name", PAGES)
def test_screen_readers_and_keyboards_reach_everything(browser, folder, name):
    for width, dark in ((1280, False), (400, True)):
        browser.size(width, 900, dark=dark)
        browser.open(folder / f"{name}.html")
        browser.run("document.querySelectorAll('details').forEach((x) => { x.open = true })")
        assert list_findings(browser) == []
