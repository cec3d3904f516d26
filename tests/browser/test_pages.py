"""Pages of results in a headless Chromium: desk, telephone, paper; readable, quiet and complete."""

import base64
import re
from pathlib import Path

import numpy as np
import pytest

import symid
from tests.browser.chromium import list_findings

pytestmark = pytest.mark.browser

WIDE = """[...document.querySelectorAll('body *')].filter((x) => !x.closest('.scroll, svg')
    && x.getBoundingClientRect().right > innerWidth + 1).map((x) => x.outerHTML.slice(0, 80))"""
CUT = "[...document.querySelectorAll('.scroll')].filter((x) => x.scrollWidth > x.clientWidth + 1).length"
CLOSED = """[...document.querySelectorAll('details')].filter((x) => [...x.children].some((one) =>
    one.tagName != 'SUMMARY' && one.getBoundingClientRect().height < 8)).length"""
SMALL = """[...document.querySelectorAll('body *')].filter((x) => x.checkVisibility() && [...x.childNodes]
    .some((n) => n.nodeType == 3 && n.data.trim())).map((x) => { const s = x.ownerSVGElement;
    const k = s ? s.getBoundingClientRect().width / s.viewBox.baseVal.width : 1;
    return [parseFloat(getComputedStyle(x).fontSize) * k, x.textContent.slice(0, 40)] }).filter(
    (x) => x[0] < 9)"""
OUTSIDE = """[...document.querySelectorAll('svg text')].filter((x) => {
    const r = x.getBoundingClientRect(), s = x.ownerSVGElement.getBoundingClientRect();
    return r.width && (r.left < s.left - 1 || r.right > s.right + 1 || r.bottom > s.bottom + 1) })
    .map((x) => x.textContent)"""
FIRST = """['.verdict', '.top figure'].map((x) => document.querySelector(x)).map(
    (x) => x && x.getBoundingClientRect().top)"""
A4 = (794, 1123)
"""Of a page at 96 dots an inch."""


@pytest.fixture(scope="session")
def held_out():
    """Return a fit, and a log that it was not fitted to."""
    robot = symid.load("two_link")
    log, other = (robot.simulate(duration=4.0, seed=seed).log for seed in (1, 2))
    return robot.identify(log), log, other


@pytest.fixture(scope="session")
def folder(tmp_path_factory, held_out):
    folder = tmp_path_factory.mktemp("pages")
    robot, elastic = symid.load("two_link"), symid.load("two_link_elastic")
    fit, log, other = held_out
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
    elastic.identify(motion, method="two-step").report(folder / "elastic.html", validation=motion)
    x = np.sin(np.linspace(0.0, 20.0, 2000)) * np.linspace(0.2, 1.0, 2000)
    y = 2.0 * x + 0.3 * np.tanh(8.0 * np.gradient(x) / np.abs(np.gradient(x)).max())
    symid.hysteresis.fit(x, y, model="prandtl-ishlinskii").report(folder / "hysteresis.html")
    # Of stored fits: rigid, elastic and friction.
    for path in sorted((Path(__file__).resolve().parents[1] / "data" / "fits").glob("*.json")):
        symid.load_fit(path).report(folder / f"{path.stem}.html")
    return folder


@pytest.fixture(scope="session")
def recorded(tmp_path_factory, shared_data):
    """Write the pages of recordings of real robots, with parts or logs that were held out."""
    folder, data = tmp_path_factory.mktemp("recorded"), shared_data
    emps, published = symid.load("emps", settings="published"), {"settings": "published"}
    log, pulses = data / "emps" / "DATA_EMPS.mat", data / "emps" / "DATA_EMPS_PULSES.mat"
    emps.identify(log).report(folder / "emps.html", validation=pulses, **published)
    law = emps.identify_friction(log, model="asymmetric-stribeck")
    law.report(folder / "emps_friction.html", validation=pulses, **published)
    runs = [data / "kr300" / f"run_{name}.npz" for name in "abc"]
    fit = symid.load("kr300").identify(runs[:2], estimator="wls")
    fit.report(folder / "kr300.html", validation=runs[2])
    log = data / "tx40" / "tx40.npz"
    fit = symid.load("tx40").identify(log, estimator="wls", train="0:60%")
    fit.report(folder / "tx40.html", validation=log, test="60%:")
    published = fit.compare(data / "tx40" / "published.csv", value="wls")
    published.report(folder / "tx40_comparison.html")
    stiffness = symid.load("kr300").identify_stiffness(runs[:2])
    stiffness.report(folder / "kr300_stiffness.html")
    return folder


@pytest.fixture
def get_page(request):
    """Return the path of a page; those of recordings are made when one of them is asked for."""

    def get(name):
        return request.getfixturevalue("recorded" if name in RECORDED else "folder") / f"{name}.html"

    return get


RECORDED = ("emps", "emps_friction", "kr300", "kr300_stiffness", "tx40", "tx40_comparison")
PAGES = (
    *RECORDED,
    *("held_out", "comparison", "check", "robot", "excitation", "payload", "stiffness", "elastic"),
    *("hysteresis", "rigid_1", "elastic_1", "friction_1"),
)


@pytest.mark.parametrize("name", PAGES)
def test_a_page_fits_desk_telephone_and_paper(browser, get_page, name):
    path = get_page(name)
    assert path.stat().st_size < 1.5e6
    for width, dark in ((400, False), (400, True), (1280, True), (1280, False)):
        browser.size(width, 900, dark=dark)
        browser.open(path)
        assert browser.run("document.documentElement.scrollWidth") <= width
        assert [browser.run(script) for script in (WIDE, SMALL, OUTSIDE)] == [[], [], []]
        assert browser.messages == []
        assert [url for url in browser.requests if not url.startswith("file:")] == []
        verdict, figure = browser.run(FIRST)
    assert verdict < 300.0
    assert figure is None or figure < 600.0
    browser.size(A4[0] - 98, A4[1])
    browser.open(path)
    browser.call("Emulation.setEmulatedMedia", media="print")
    try:
        assert browser.run(WIDE) == []
        assert browser.run(CUT) == browser.run(CLOSED) == 0
    finally:
        browser.call("Emulation.setEmulatedMedia", media="")


@pytest.mark.parametrize("name", PAGES)
def test_screen_readers_and_keyboards_reach_everything(browser, get_page, name):
    for width, dark in ((1280, False), (400, True)):
        browser.size(width, 900, dark=dark)
        browser.open(get_page(name))
        browser.run("document.querySelectorAll('details').forEach((x) => { x.open = true })")
        assert list_findings(browser) == []


FRONT = """(() => { const main = document.querySelector('main'); let behind = false;
    const first = document.querySelector('#parameters') || main.querySelector(':scope > details');
    for (const x of [...main.children]) { behind = behind || x === first; if (behind) x.remove(); }
    document.querySelector('footer').remove() })()"""
"""Leaves the pages before the appendix."""


def count_printed(browser):
    """Return the number of pages of the document on A4."""
    printed = browser.call("Page.printToPDF", preferCSSPageSize=True, printBackground=True)["data"]
    return len(re.findall(rb"/Type /Page\b", base64.b64decode(printed)))


@pytest.mark.parametrize("name", ["emps", "kr300", "tx40", "held_out", "rigid_1", "friction_1", "hysteresis"])
def test_a_page_is_printed_as_two_pages_and_an_appendix(browser, get_page, name):
    browser.size(A4[0] - 98, A4[1])
    browser.open(get_page(name))
    whole = count_printed(browser)
    browser.run(FRONT)
    assert count_printed(browser) <= min(2, whole)


@pytest.mark.parametrize("name", ["tx40", "held_out", "elastic", "check"])
def test_the_hint_on_cursors_is_given_once(browser, get_page, name):
    browser.size(1280, 900)
    browser.open(get_page(name))
    # Where all figures with a cursor are folded, the first has it.
    browser.run("document.querySelectorAll('details').forEach((x) => { x.open = true })")
    assert browser.run("document.querySelectorAll('.tools').length") > 1
    assert browser.run("document.body.innerText.split('Move to read values').length") == 2


def test_residual_and_loop_stand_below_one_another(browser, folder):
    """Measured and predicted can be told apart: one is wider, and their difference is drawn."""
    for width in (1280, 400):
        browser.size(width, 900)
        browser.open(folder / "hysteresis.html")
        loop, residual = browser.run(
            "[...document.querySelectorAll('.top figure')].map((x) => "
            "(({ left, top, bottom, width }) => [left, top, bottom, width])(x.getBoundingClientRect()))"
        )
        assert residual[0] == pytest.approx(loop[0], abs=1.0)
        assert residual[3] == pytest.approx(loop[3], abs=1.0)
        assert residual[1] > loop[2] - 1.0
        wide, thin = browser.run(
            "['wide', 'predicted'].map((x) => parseFloat(getComputedStyle("
            "document.querySelector('.top polyline.' + x)).strokeWidth))"
        )
        assert wide > 3.0 * thin


BOX = """(() => { const b = document.querySelector('.top svg .plot').getBoundingClientRect();
    return [b.x, b.y, b.width, b.height] })()"""
READ = "document.querySelector('.top .tools span').textContent"
VIEW = "document.querySelector('.top .plot').getAttribute('viewBox').split(' ').map(Number)"
TICKS = "[...document.querySelectorAll('.top .ticks text')].map((x) => x.textContent.replace('\u2212', '-'))"


def press(browser, key):
    for kind in ("keyDown", "keyUp"):
        text = key if len(key) == 1 and kind == "keyDown" else ""
        code = {"ArrowRight": 39, "Escape": 27}.get(key, ord(key[0]))
        browser.call("Input.dispatchKeyEvent", type=kind, key=key, windowsVirtualKeyCode=code, text=text)


def read_cursor(browser):
    """Return time, measured and predicted torque that the cursor reads."""
    text = browser.run(READ).replace("\u2212", "-")
    return [float(number) for number in re.findall(r"-?\d+(?:\.\d+)?(?:e-?\d+)?", text)]


def test_the_cursor_reads_the_data(browser, folder, held_out):
    fit, _, other = held_out
    validation = fit.validate(other).product.validation
    browser.size(1280, 900)
    browser.open(folder / "held_out.html")
    caption = browser.run("document.querySelector('.top figcaption').textContent")
    series = next(entry for entry in validation.series if f"torque of {entry.joint}" in caption)
    size = max(np.ptp(series.measured), np.ptp(series.predicted))
    x, y, width, height = browser.run(BOX)
    for share in (0.1, 0.37, 0.83):
        place = {"x": x + share * width, "y": y + 0.5 * height}
        browser.call("Input.dispatchMouseEvent", type="mouseMoved", **place)
        time, *values = read_cursor(browser)
        since = series.time - series.time[0]
        row = int(np.argmin(np.abs(since - time)))
        assert time == pytest.approx(since[row], abs=1e-3)
        assert time == pytest.approx(share * np.ptp(since), abs=0.02)
        expected = series.measured[row], series.predicted[row]
        assert values == pytest.approx(expected, rel=1e-3, abs=2e-4 * size)


def test_a_drag_zooms_and_keys_go_back(browser, folder):
    browser.size(1280, 900)
    browser.open(folder / "held_out.html")
    whole, ticks = browser.run(VIEW), browser.run(TICKS)
    x, y, width, height = browser.run(BOX)
    browser.drag([(x + share * width, y + 0.5 * height) for share in (0.25, 0.3, 0.5, 0.5)])
    left, _, across, down = browser.run(VIEW)
    assert across == pytest.approx(0.25 * whole[2], rel=0.01)
    assert left == pytest.approx(whole[0] + 0.25 * whole[2], rel=0.01)
    assert down <= whole[3]
    assert browser.run(TICKS) != ticks
    assert browser.run("document.querySelector('.top .tools button').checkVisibility()")
    for count in (1, 2):
        for kind in ("mousePressed", "mouseReleased"):
            place = {"x": x + 9, "y": y + 9, "button": "left", "clickCount": count}
            browser.call("Input.dispatchMouseEvent", type=kind, **place)
    assert browser.run(VIEW) == whole
    assert browser.run(TICKS) == ticks
    # Everything by keys, too: the slider is a stop of the tabulator.
    browser.run("document.querySelector('.top .tools input').focus()")
    first = read_cursor(browser)
    press(browser, "ArrowRight")
    assert read_cursor(browser)[0] > first[0]
    press(browser, "+")
    assert browser.run(VIEW)[2] == pytest.approx(0.5 * whole[2], rel=0.01)
    press(browser, "0")
    assert browser.run(VIEW) == whole
    press(browser, "+")
    browser.run("document.querySelector('.top .tools button').click()")
    assert browser.run(VIEW) == whole
    assert browser.messages == []


def test_figures_are_complete_without_the_script(browser, folder):
    browser.size(1280, 900)
    browser.call("Emulation.setScriptExecutionDisabled", value=True)
    try:
        browser.open(folder / "held_out.html")
        assert browser.run("document.querySelectorAll('.tools').length") == 0
        assert browser.run("document.querySelectorAll('.top svg[data-frame] > polyline').length") == 2
    finally:
        browser.call("Emulation.setScriptExecutionDisabled", value=False)
