"""Lessons in a headless Chromium: what a reader sees is what the library computes; nothing is asked for."""

import re
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import symid
from symid.joint_models import Elasticity, compute_hysteresis_torque, run_element
from symid.robot import load_robot
from tests.browser.chromium import list_findings

pytestmark = pytest.mark.browser

LINKS = ("two_link", "two_link_symbols", "two_link_elastic")
ROBOTS = (*LINKS, "scara", "puma560", "panda", "quadruped", "ppr")

CUT_OFF = (
    "[...document.querySelectorAll('.formula .set, .bar output')]"
    ".filter((x) => x.scrollWidth > x.clientWidth + 2)"
)


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("lessons")


@pytest.fixture
def visit(browser, folder):
    """Return what opens the page of a robot, and is the browser."""

    def open_page(name, width=1280, *, dark=False):
        path = folder / f"{name}.html"
        if not path.exists():
            symid.load(name).write_lesson(path, exercises=6, seed=2)
        browser.size(width, 900, dark=dark)
        browser.open(path)
        return browser

    return open_page


LESSON = "window.lesson.identification"
ELEMENT = "(() => { const b = document.querySelector(%r).getBoundingClientRect(); return [%s]; })()"


@pytest.mark.parametrize("name", ROBOTS)
def test_a_page_is_quiet_and_nothing_is_cut_off(visit, name):
    for width, dark in ((1280, False), (400, False), (1280, True)):
        browser = visit(name, width, dark=dark)
        assert browser.run("document.fonts.ready.then(() => document.querySelectorAll('.katex').length)") > 20
        assert browser.messages == []
        assert [url for url in browser.requests if not url.startswith(("file:", "data:"))] == []
        assert browser.run("document.querySelectorAll('.katex-error').length") == 0
        assert browser.run("document.documentElement.scrollWidth") <= width
        assert browser.run("document.querySelectorAll('.katex-mathml math').length") > 20
        if width == 1280:
            assert browser.run(f"{CUT_OFF}.length") == 0
        assert browser.run(f"{CUT_OFF}.filter((x) => x.matches('output')).length") == 0
        if width == 400 or dark:
            assert list_findings(browser) == []


@pytest.mark.parametrize("name", ROBOTS)
def test_matrices_of_the_page_are_those_of_the_library(visit, name):
    browser = visit(name)
    robot = symid.load(name)
    library = robot.compile()
    rng = np.random.default_rng(3)
    beta = np.array(browser.run("LESSON_DATA.beta"))
    for _ in range(3):
        q = rng.uniform(-1.0, 1.0, robot.description.freedom)
        browser.run(f"window.lesson.move({q.tolist()})")
        # Formulas are held against generated code in the page, that against the library here.
        assert browser.run("window.lesson.worst") < 1e-9
        assert np.abs(np.array(browser.run("window.lesson.mass")) - library.mass_matrix(q, beta)).max() < 1e-9
        assert np.abs(np.array(browser.run("window.lesson.gravity")) - library.gravity(q, beta)).max() < 1e-9


def test_sliders_move_the_arm(visit):
    browser = visit("two_link_symbols")
    shown = "document.querySelector('[data-name=M1_1]').textContent"
    before = browser.run(shown)
    browser.run(
        "(() => { const x = document.querySelectorAll('aside .slider input')[1]; x.value = 0; "
        "x.dispatchEvent(new Event('input')); })()"
    )
    after = browser.run(shown)
    library = symid.load("two_link_symbols").compile()
    q = np.array(browser.run("window.lesson.state.q"))
    assert abs(q[1]) < 1e-9
    assert before != after
    value = library.mass_matrix(q, library.beta)[0, 0]
    assert after == f"= {float(f'{value:.4g}'):g} kg m²"


def test_a_torsion_that_is_dragged_gives_the_torque_of_the_joint_model(visit):
    browser = visit("two_link_elastic")
    elasticity = load_robot("two_link_elastic").joints[0].elasticity
    assert isinstance(elasticity, Elasticity)
    browser.run("(() => { const spring = window.lesson.springs[0]; spring.reset(); })()")
    for goal in (0.012, -0.004, 0.009, -0.015, 0.02):
        browser.run(f"window.lesson.springs[0].stepTo({goal})")
    trail = np.array(browser.run("window.lesson.springs[0].one.trail"))
    torque = compute_hysteresis_torque(elasticity, trail[:, 0])
    assert np.abs(trail[:, 1] - torque).max() < 1e-12
    rest, *stored = run_element(replace(elasticity, damping=0.0), np.append(0.0, trail[:, 0])).stored
    assert np.abs(trail[:, 3] - (np.array(stored) - rest)).max() < 1e-12
    assert np.all(np.diff(trail[:, 2] - trail[:, 3]) > -1e-6)


def test_the_loop_follows_the_mouse(visit):
    browser = visit("two_link_elastic")
    browser.run("document.querySelector('[data-widget=hysteresis]').scrollIntoView({ block: 'center' })")
    box = ELEMENT % ("[data-widget=hysteresis] svg", "b.x, b.y, b.width, b.height")
    x, y, width, height = browser.run(box)
    browser.run("window.lesson.springs[0].reset()")
    browser.drag([(x + share * width, y + height / 2) for share in (0.5, 0.7, 0.9, 0.4, 0.4)])
    trail = np.array(browser.run("window.lesson.springs[0].one.trail"))
    assert trail[:, 0].max() > 0.01
    assert trail[-1, 0] < 0.0


def test_formulas_are_copied_as_c(visit, tmp_path):
    """A program of copied formulas gives the numbers that stand beside them."""
    browser = visit("two_link_symbols")
    copied = browser.run(
        "[...document.querySelectorAll('.formula')]"
        ".filter((x) => x.querySelector('[data-name]') && x.dataset.sympy)"
        ".map((x) => [x.querySelector('[data-name]').dataset.name, writeC(x.dataset.sympy), "
        "x.querySelectorAll('.copy button').length])"
    )
    assert len(copied) > 8
    assert all(count == 3 for *_, count in copied)
    values = browser.run("Object.entries(window.lesson.values)")
    taken = {name for name, *_ in copied}
    letters = "".join(f"double {name} = {value!r};" for name, value in values if name not in taken)
    lines = "".join(f'printf("%.17g\\n", (double)({text}));' for _, text, _ in copied)
    source, head = tmp_path / "copied.c", "#include <math.h>\n#include <stdio.h>\nint main(void)"
    source.write_text(f"{head} {{ {letters} {lines} return 0; }}\n")
    subprocess.run(["cc", "-o", tmp_path / "copied", source, "-lm"], check=True, capture_output=True)
    done = subprocess.run([tmp_path / "copied"], check=True, capture_output=True, text=True)
    shown = dict(values)
    for (name, *_), line in zip(copied, done.stdout.splitlines(), strict=True):
        assert float(line) == pytest.approx(shown[name], rel=1e-12, abs=1e-15)


def test_exercises_are_marked(browser, tmp_path):
    page = symid.load("two_link_symbols").write_lesson(tmp_path / "page.html", exercises=10, seed=3)
    browser.size(1280, 900)
    browser.open(page.path)
    assert browser.messages == []
    assert browser.run("LESSON_EXERCISES.length") == 10
    formulas = browser.run("LESSON_EXERCISES.map((one) => [Boolean(one.formula), one.answer])")
    answer = (
        "(() => { const box = document.getElementById('exercise-%d'), input = box.querySelector('input'); "
        "input.value = %r; box.querySelector('button').click(); "
        "return box.querySelector('.verdict').textContent; })()"
    )
    marked = 0
    for place, (is_formula, right) in enumerate(formulas, start=1):
        if is_formula:
            for typed, verdict in (
                (right, "right"),
                (right.replace("*", " ").replace("  ", "^"), "right"),
                (f"{right} + 0.001", "not yet"),
                ("cos(q1) cos(q2)", "not yet; put in q"),
                ("h", 'write out what "h" stands for'),
                (f"{right} + (", "the formula is not finished"),
            ):
                found = browser.run(answer % (place, typed))
                assert found == verdict or (verdict.endswith(" q") and found.startswith(verdict))
            assert "no letter of this lesson" in browser.run(answer % (place, "xyzzy"))
            marked += 1
    assert marked
    place = browser.run("LESSON_EXERCISES.findIndex((one) => one.number !== undefined)")
    number = browser.run(f"LESSON_EXERCISES[{place}].number")
    note = browser.run(f"LESSON_EXERCISES[{place}].note")
    for typed in (f"{number:.4g}", f"{number:.4g} {note}", f"{number:.4g}{note.replace(' ', '')}"):
        assert browser.run(answer % (place + 1, typed)) == "right"
    assert browser.run(answer % (place + 1, f"{number:.4g} ({note})")) == "right"
    assert browser.run(answer % (place + 1, f"{number * 1.05:.4g}")) == "not yet"
    assert browser.run(answer % (place + 1, "q1")) == 'put in the numbers of the question for "q1"'
    # On paper everything that folds is open but the answers, which are not there.
    browser.run("window.dispatchEvent(new Event('beforeprint'))")
    opened = (
        "[...document.querySelectorAll('main details')].map((x) => [Boolean(x.closest('.exercise')), x.open])"
    )
    assert {tuple(pair) for pair in browser.run(opened)} == {(True, False), (False, True)}
    browser.call("Emulation.setEmulatedMedia", media="print")
    try:
        shown = (
            "[...document.querySelectorAll('.exercise details')].filter((x) => x.checkVisibility()).length"
        )
        assert browser.run(shown) == 0
    finally:
        browser.call("Emulation.setEmulatedMedia", media="")


ENGLISH = r"\b(the|of|and|with|is|are|that|by|its|from|to|for|which|this|turns|link|joint|torque|as|answer)\b"
SHOWN = (
    "(() => { const body = document.body.cloneNode(true); "
    "body.querySelectorAll('.tex, script, style, code, math, .katex').forEach((x) => x.remove()); "
    "const labels = [...document.querySelectorAll('[aria-label]')].map((x) => x.getAttribute('aria-label')); "
    "return [body.textContent, ...labels, document.title].join(' | '); })()"
)


@pytest.mark.parametrize("name", ["ppr", "two_link_elastic", "scara"])
def test_a_german_page_has_no_english_on_it(browser, tmp_path, name):
    page = symid.load(name).write_lesson(tmp_path / "page.html", exercises=6, seed=2, lang="de")
    browser.size(1280, 900)
    browser.open(page.path)
    assert browser.messages == []
    assert browser.run("document.documentElement.lang") == "de"
    browser.run("document.querySelectorAll('button.show').forEach((x) => x.click())")
    press(browser, "nur dieses Gelenk bewegt sich")
    shown = (
        browser.run(SHOWN)
        .replace(name.replace("_", " "), "")
        .replace(symid.load(name).description.description, "")
    )
    found = re.search(rf".{{30}}{ENGLISH}.{{30}}", shown, re.IGNORECASE | re.DOTALL)
    assert not found, found
    place = browser.run("LESSON_EXERCISES.findIndex((one) => one.formula)") + 1
    box = f"document.querySelector('#exercise-{place}')"
    for typed, verdict in (("(", "nicht zu Ende"), ("xyzzy", "kein Formelzeichen"), ("0", "noch nicht")):
        browser.run(f"{box}.querySelector('input').value = {typed!r}; {box}.querySelector('button').click()")
        assert verdict in browser.run(f"{box}.querySelector('.verdict').textContent")


ROW = '[[joint]]\nkind = "{}"\nalpha = {}\na = {}\nd = {}\n'
ROWS = (("revolute", -np.pi / 2, 0.1, 0.3), ("revolute", np.pi / 2, 0.25, 0.15), ("prismatic", 0.4, 0.2, 0.1))


def test_the_frames_of_the_table_are_drawn_where_the_matrices_say(browser, tmp_path):
    """Products of A = Rz(theta) Tz(d) Tx(a) Rx(alpha) in NumPy, from the base on."""
    text = 'name = "arm"\nconvention = "standard"\ngravity = [0, 0, -9.81]\n'
    (tmp_path / "arm.toml").write_text(text + "".join(ROW.format(*row) for row in ROWS))
    robot = symid.load(tmp_path / "arm.toml")
    browser.size(1280, 900)
    browser.open(robot.write_lesson(tmp_path / "a.html", notation="siciliano", lang="de").path)
    q = [0.3, -0.7, 0.2]
    browser.run(f"window.lesson.move({q})")
    drawn = browser.run("listFrames(computePoses(window.lesson.state.q), true)")
    assert [one["number"] for one in drawn] == [0, 1, 2, 3]
    pose = np.eye(4)
    for one, (kind, alpha, a, d), angle in zip(drawn[1:], ROWS, q, strict=True):
        turn, move = (0.0, d + angle) if kind == "prismatic" else (angle, d)
        (ct, st), (ca, sa) = ((np.cos(x), np.sin(x)) for x in (turn, alpha))
        pose = pose @ np.array(
            [
                [ct, -st * ca, st * sa, a * ct],
                [st, ct * ca, -ct * sa, a * st],
                [0, sa, ca, move],
                [0, 0, 0, 1],
            ]
        )
        assert np.abs(np.array(one["R"]) - pose[:3, :3]).max() < 1e-9
        assert np.abs(np.array(one["p"]) - pose[:3, 3]).max() < 1e-9
    shown = browser.run("[...document.querySelectorAll('.widget svg')].slice(0, 2).map((x) => x.textContent)")
    assert ["x0" in text for text in shown] == [True, False]
    texts = browser.run("document.querySelector('[data-widget=skew]').textContent")
    assert "dB/dt \N{MINUS SIGN} 2C in dieser Stellung" in texts
    # Numbers beside formulas have commas.
    values = browser.run("[...document.querySelectorAll('.value')].map((x) => x.textContent)")
    assert any("," in value for value in values)
    assert not any("." in value or "-" in value for value in values)
    # Other notations have modified rows alone, and one drawing.
    browser.open(robot.write_lesson(tmp_path / "b.html", notation="craig").path)
    assert browser.run("document.querySelectorAll('[data-widget=rows]').length") == 0


LINES = (
    "[...document.querySelectorAll('aside svg line')].filter((x) => x.getAttribute('opacity') === '0.75')"
    ".map((x) => ['x1', 'y1', 'x2', 'y2', 'stroke-width'].map((key) => Number(x.getAttribute(key))))"
)


def test_a_prismatic_link_is_drawn_along_its_axis(visit):
    """The line from the guide to the link has the direction of z, wherever the joint stands."""
    browser = visit("scara")
    for d in (0.0, 0.15, -0.3):
        browser.run(f"window.lesson.move([0.3, 0.5, 0.2, {d}])")
        lines = browser.run(LINES)
        thin = min(line[4] for line in lines)
        (rod,) = [line for line in lines if line[4] == thin]
        # The stroke is upright, and so it is in the picture.
        assert rod[0] == pytest.approx(rod[2], abs=0.2)
        assert (abs(rod[1] - rod[3]) > 1.0) == (d != 0.0)


PRESS = (
    "[...document.querySelectorAll('[data-widget=identification] button')].find((x) => x.textContent === %r)"
)


def press(browser, *labels):
    """Press buttons of the section on identification, and wait for what follows."""
    for label in labels:
        browser.run(f"{PRESS % label}.click()")
        browser.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


def build_rows(browser, library, count):
    """Return the weighted rows of so many samples of the page's motion, by SciPy and the library."""
    plan = browser.run("window.lesson.identification.plan")
    points = np.array(plan["points"])
    motion = CubicSpline(
        np.linspace(0.0, plan["seconds"], points.shape[1] + 1),
        np.hstack([points, points[:, :1]]).T,
        bc_type="periodic",
    )
    times = np.arange(count) / 50.0
    rows = library.torque_regressor(motion(times), motion(times, 1), motion(times, 2))
    rows = rows / np.array(plan["noise"])[:, None]
    return rows.reshape(-1, rows.shape[-1])


def find_seen(rows):
    """Return which columns the rank needs: without them it falls."""
    lengths = np.linalg.norm(rows, axis=0)
    scaled = np.linalg.qr(rows / np.where(lengths > 1e-12 * lengths.max(), lengths, np.inf), mode="r")
    rank = np.linalg.matrix_rank(scaled, tol=1e-8)
    others = [np.delete(scaled, k, axis=1) for k in range(rows.shape[1])]
    return rank, [np.linalg.matrix_rank(other, tol=1e-8) < rank for other in others]


@pytest.mark.parametrize("name", ["two_link", "scara", "panda", "ppr"])
def test_a_motion_identifies_what_the_regressor_of_the_library_says(visit, name):
    browser = visit(name)
    library = symid.load(name).compile()
    for labels in ((), ("joint 2", "only this joint moves"), ("joint 1", "only this joint moves")):
        press(browser, *labels)
        browser.run(f"{LESSON}.plan.noise[0] = 0.03; {LESSON}.start()")
        for share in (1.0, 0.4):
            count = browser.run(f"{LESSON}.goTo(Math.round({share} * countSamples())); {LESSON}.sums.count")
            rows = build_rows(browser, library, count)
            rank, seen = find_seen(rows)
            assert browser.run(f"{LESSON}.sums.now.rank") == rank
            assert browser.run(f"{LESSON}.sums.now.seen") == seen
            lengths = np.linalg.norm(rows, axis=0)
            lengths[lengths == 0.0] = 1.0
            expected = np.linalg.norm(np.linalg.pinv(rows / lengths, rcond=1e-9), axis=1) / lengths
            finite = "deviations.map((x) => (x === Infinity ? 0 : x))"
            found = np.array(browser.run(f"{LESSON}.sums.now.{finite}"))
            assert found[seen] == pytest.approx(expected[seen], rel=1e-9)
    assert (rank < rows.shape[1]) == (name != "two_link")
    unseen = "document.querySelector('.unseen')"
    told = browser.run(f"{unseen}.hidden ? '' : {unseen}.textContent")
    for text in (f"({seen.count(False)})", "is at rest, so link"):
        assert (text in told) == (rank < rows.shape[1])


def test_deviations_fall_as_a_motion_is_played_and_points_are_dragged(visit):
    browser = visit("two_link")
    steps = (f"{LESSON}.goTo({count}); {LESSON}.sums.now.deviations" for count in (100, 300, 500))
    shown = list(map(browser.run, steps))
    assert np.all(np.diff(shown, axis=0) < 0.0)
    press(browser, "play the motion")
    assert browser.run(f"{LESSON}.sums.count") < 200
    browser.run(
        "document.querySelector('[data-widget=identification] circle').scrollIntoView({ block: 'center' })"
    )
    middle = "b.x + b.width / 2, b.y + b.height / 2"
    x, y = browser.run(ELEMENT % ("[data-widget=identification] circle", middle))
    before = browser.run(f"{LESSON}.plan.points[0]")
    browser.drag([(x, y), (x, y - 20), (x, y - 40), (x, y - 40)])
    browser.run("new Promise((done) => setTimeout(done, 200))")
    first, *rest = browser.run(f"{LESSON}.plan.points[0]")
    assert first > before[0] + 0.3
    assert rest == before[1:]
    assert browser.run(f"{LESSON}.sums.count") == 500


def test_the_motion_of_a_log_is_one_to_play(browser, tmp_path):
    robot = symid.load("two_link")
    path = robot.simulate(duration=6.0, seed=1).log.save(tmp_path / "run.npz")
    browser.size(1280, 900)
    browser.open(robot.write_lesson(tmp_path / "lesson.html", log=path).path)
    press(browser, "the motion of run.npz")
    count = browser.run(f"{LESSON}.sums.count")
    assert count == 291
    samples = np.array(browser.run("D.log.samples"))
    rows = robot.compile().torque_regressor(*samples.transpose(1, 0, 2)) / 0.1
    rows = rows.reshape(-1, rows.shape[-1])
    assert browser.run(f"{LESSON}.sums.now.rank") == rows.shape[1]
    expected = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    assert browser.run(f"{LESSON}.sums.now.deviations") == pytest.approx(expected, rel=1e-9)
    assert browser.run("document.documentElement.scrollWidth") <= 1280
    assert list_findings(browser) == []
    press(browser, "only this joint moves")
    assert browser.run(f"{LESSON}.plan.log") is False
    assert browser.messages == []
