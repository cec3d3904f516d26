import xml.etree.ElementTree as ET
from itertools import pairwise

import numpy as np
import pytest

from symid.report import study_text
from symid.report.figures import (
    ArmJoint,
    Axis,
    Line,
    Mark,
    build_arm_figure,
    build_axis,
    build_curve_figure,
    build_line_figure,
    build_mark_figure,
    format_tick,
    thin_curve,
)
from symid.study import friction_protocols

SVG = "{http://www.w3.org/2000/svg}"


def parse(figure):
    assert "nan" not in figure.svg
    return ET.fromstring(figure.svg)  # noqa: S314  our own text


def read_points(element):
    return np.array([tuple(map(float, point.split(","))) for point in element.get("points").split()])


def list_texts(root):
    return [entry.text for entry in root.iter(f"{SVG}text")]


def list_kind(root, tag, kind):
    """Return elements of a class."""
    return [entry for entry in root.iter(f"{SVG}{tag}") if entry.get("class") == kind]


def get_height(root):
    return float(root.get("viewBox").split()[3])


RAMP = np.arange(2.0)


def find_distances(points, x, y):
    """Return how far each of points (N, 2) lies from the polyline x, y."""
    start = np.column_stack([x[:-1], y[:-1]])
    along = np.column_stack([x[1:], y[1:]]) - start
    lengths = np.maximum(np.sum(along**2, axis=1), 1e-300)
    offset = points[:, None] - start
    share = np.clip(np.sum(offset * along, axis=2) / lengths, 0.0, 1.0)
    return np.linalg.norm(offset - share[..., None] * along, axis=2).min(axis=1)


def test_a_script_reads_time_and_values_from_the_points():
    time = np.linspace(0.0, 25.0, 1001)
    values = 30.0 * np.sin(2.0 * time) + 1e3
    line = Line("measured <1>", "measured", time, values)
    figure = build_line_figure("How much?", ("time (s)", "torque (N m)"), [line])
    root = parse(figure)
    assert figure.live
    assert root.get("data-unit") == "N m"
    assert root.find(f"{SVG}polyline").get("data-label") == "measured <1>"
    left, top, right, bottom, x0, x1, y0, y1 = map(float, root.get("data-frame").split())
    x, y = read_points(root.find(f"{SVG}polyline")).T
    # A hundredth of the unit of the drawing, rounded.
    assert np.abs(x0 + (x - left) / (right - left) * (x1 - x0) - time).max() < 0.0051 * 25.0 / 470.0
    assert np.abs(y0 + (bottom - y) / (bottom - top) * (y1 - y0) - values).max() < 0.0051 * 66.0 / 165.0
    assert not build_line_figure("How much?", ("velocity (rad/s)", "torque (N m)"), [line]).live
    assert not build_mark_figure("How much?", "N m", [Mark("one", 1.0)]).live


def test_a_thinned_curve_keeps_its_shape_its_corners_and_few_points():
    angle = np.linspace(0, 6 * np.pi, 20_001)
    x, y = 400 + 300 * np.cos(angle), 200 + 90 * np.sin(angle) * np.exp(-0.05 * angle)
    thin_x, thin_y = thin_curve(x, y)
    assert len(thin_x) < 400
    assert (thin_x[0], thin_y[0], thin_x[-1], thin_y[-1]) == (x[0], y[0], x[-1], y[-1])
    assert find_distances(np.column_stack([x, y])[::7], thin_x, thin_y).max() < 0.15
    corners = np.array([[0.0, 0.0], [50.0, 80.0], [20.0, 10.0], [50.0, 80.0], [0.0, 0.0]])
    steps = np.linspace(0, 1, 1001)[:, None]
    parts = [a + steps[1:] * (b - a) for a, b in pairwise(corners)]
    x, y = np.vstack([corners[:1], *parts]).T
    np.testing.assert_allclose(np.column_stack(thin_curve(x, y)), corners, atol=1e-12)
    rng = np.random.default_rng(2)
    x, y = rng.uniform(0, 800, (2, 30_000))
    assert len(thin_curve(x, y)[0]) == 2000
    assert len(thin_curve(x[:2], y[:2])[0]) == 2
    x, y = thin_curve(np.full(100, 3.0), np.full(100, 4.0))
    assert (len(x), set(x), set(y)) == (2, {3.0}, {4.0})


def test_curves_turn_back_and_stay_in_their_frame():
    angle = np.linspace(0, 2 * np.pi, 500)
    x, y = np.cos(angle), np.sin(angle)
    lines = [Line("measured <1>", "measured", 5 * x, y), Line("truth", "truth", 4 * x, 0.8 * y)]
    root = parse(build_curve_figure("Loops", ("torsion (mrad)", "torque (N m)"), lines))
    assert root.find(f"{SVG}title").text == "Loops"
    assert {"torsion (mrad)", "torque (N m)", "measured <1>"} <= set(list_texts(root))
    first, _ = (read_points(line) for line in root.iter(f"{SVG}polyline"))
    steps = np.diff(first[:, 0])
    assert steps.min() < 0.0 < steps.max()
    assert np.all((first > [74, 14]) & (first < [546, get_height(root) - 46]))


def test_a_logarithmic_axis_has_equal_lengths_for_equal_ratios():
    x = np.arange(1.0, 5.0)
    line = Line(label="change", style="first", x=x, y=10.0 ** -np.array([1.0, 3.0, 5.0, 7.0]), markers=True)
    root = parse(build_line_figure("t", ("iteration", "change"), [line], logarithmic=True, whole=True))
    points = read_points(root.find(f"{SVG}polyline"))
    np.testing.assert_allclose(np.diff(points[:, 1], 2), 0, atol=0.21)
    assert len(list(root.iter(f"{SVG}circle"))) == 4
    assert set(list_texts(root)) == {*"1234", "iteration", "change", "0.01", "10⁻⁴", "10⁻⁶"}
    some = Line("a", "first", np.arange(4.0), np.array([1.0, 0.0, -1.0, 2.0]))
    lines = [some, Line("b", "second", RAMP, np.zeros(2))]
    (line,) = parse(build_line_figure("t", ("x", "y"), lines, logarithmic=True)).iter(f"{SVG}polyline")
    assert len(read_points(line)) == 2


def test_ticks_are_round_whole_axes_count_and_a_single_value_has_an_axis():
    for low, high, kind, count, expected in (
        (1e-7, 3.0, {"logarithmic": True}, 5, (1e-6, 1e-4, 1e-2, 1.0)),
        (0.9, 60.0, {"logarithmic": True}, 5, (1.0, 2.0, 5.0, 10.0, 20.0, 50.0)),
        (0.5, 200.0, {"logarithmic": True}, 5, (1.0, 10.0, 100.0)),
        (0.0, 1.0, {}, 5, (0, 0.2, 0.4, 0.6, 0.8, 1.0)),
        (-3.0, 17.0, {}, 5, (0, 5, 10, 15)),
        (0.9, 3.1, {"whole": True}, 8, (1.0, 2.0, 3.0)),
        (0.9, 2.1, {"whole": True}, 8, (1.0, 2.0)),
    ):
        assert Axis(low=low, high=high, **kind).choose_ticks(count) == pytest.approx(expected)
    axis = build_axis([np.array([0.4])], 0.05, logarithmic=True)
    assert axis.low < 0.4 < axis.high
    assert axis.choose_ticks(5)
    # Powers of ten are written as such.
    for value, text in ((1e-6, "10⁻⁶"), (2e5, "2×10⁵"), (0.001, "0.001"), (100.0, "100")):  # noqa: RUF001
        assert format_tick(value, logarithmic=True) == text


def test_values_in_rows_mark_the_choice_on_an_axis_of_their_kind():
    marks = [Mark("linear & plain", 8.0, "8"), Mark("two-step", 0.5, "0.5", chosen=True)]
    root = parse(build_mark_figure("Errors", "error (%)", [*marks, Mark("single", 2.0, "2")]))
    marks = [float(mark.get("cx")) for mark in root.iter(f"{SVG}circle")]
    ratios = np.log([8.0 / 0.5, 8.0 / 2.0])
    assert (marks[0] - marks[1]) / (marks[0] - marks[2]) == pytest.approx(ratios[0] / ratios[1], abs=0.01)
    kinds = [mark.get("class") for mark in root.iter(f"{SVG}circle")]
    assert kinds == ["mark other", "mark chosen", "mark other"]
    assert {"linear & plain", "8", "error (%)"} <= set(list_texts(root))
    assert all(0 < mark < 560 for mark in marks)
    near = [Mark("a", 1.0), Mark("b", 2.0)]
    assert "0" in list_texts(parse(build_mark_figure("t", "error (%)", near)))
    parse(build_mark_figure("t", "x", [Mark("a", 0.0), near[1]]))


def test_dense_rows_have_a_line_at_their_limit():
    marks = [Mark(label=f"p{k}", value=10.0**k) for k in range(-2, 5)]
    plain = parse(build_mark_figure("t", "x", marks))
    dense = parse(build_mark_figure("t", "x", marks, dense=True, limit=2.0))
    (line,) = list_kind(dense, "line", "line virgin")
    places = [float(mark.get("cx")) for mark in dense.iter(f"{SVG}circle")]
    assert places[2] < float(line.get("x1")) < places[3]
    assert get_height(dense) < get_height(plain)
    assert not list_kind(plain, "line", "line virgin")


def test_long_legends_take_more_rows_and_constants_have_figures():
    def measure(labels):
        lines = [Line(label, "first", RAMP, RAMP) for label in labels]
        return get_height(parse(build_line_figure("t", ("x", "y"), lines)))

    one, two, many = map(measure, (["one"], ["one", "two"], [f"a long label {n}" for n in range(8)]))
    assert one < two < many
    line = Line(label="a", style="first", x=np.ones(3), y=np.full(3, 2.0))
    for logarithmic in (False, True):
        parse(build_line_figure("t", ("x", "y"), [line], logarithmic=logarithmic))
    parse(build_curve_figure("t", ("x", "y"), [line]))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("values", [(1e-308, 1.0), (1e-306, 1e306), (1e305, 1e308), (-1e308, 1e308)])
def test_values_at_the_ends_of_what_numbers_hold_are_drawn_or_left_out(values):
    entries = [Mark(label="a long name of a row" * 3, value=value) for value in values]
    line = Line(label="", style="first", x=np.arange(2.0), y=np.array(values))
    for figure in (
        build_mark_figure("t", "x", entries),
        build_line_figure("t", ("x", "y"), [line]),
        build_line_figure("t", ("x", "y"), [line], logarithmic=True),
    ):
        parse(figure)
        assert "inf" not in figure.svg


def test_the_flow_chart_has_its_steps_and_arrows_that_end_at_their_heads():
    chart = study_text._draw_hybrid()
    root = parse(chart)
    texts = list_texts(root)
    assert {"genetic algorithm", "a child of every parent,", "no", "yes", "T becomes 0.6 T"} <= set(texts)
    assert f"{friction_protocols.POPULATION} candidates an unknown," in texts
    assert texts.count("\N{LESS-THAN OR EQUAL TO} 1e-06?") == 1
    assert root.find(f"{SVG}title").text == chart.caption
    # A line stops at the middle of its head's base.
    lines = [read_points(entry) for entry in root.iter(f"{SVG}polyline")]
    heads = list(map(read_points, list_kind(root, "polygon", "head")))
    for line, head in zip(lines, heads, strict=True):
        np.testing.assert_allclose(line[-1], head[1:].mean(axis=0), atol=0.1)
    # Every arrow ends at a box, a question or an end.
    rectangles = [entry for entry in root.iter(f"{SVG}rect") if entry.get("class").startswith("box")]
    sizes = [tuple(float(entry.get(name)) for name in ("x", "y", "width", "height")) for entry in rectangles]
    asked = [read_points(entry) for entry in root.iter(f"{SVG}polygon") if "box" in entry.get("class")]
    sizes += [(*part.min(axis=0), *np.ptp(part, axis=0)) for part in asked]
    for x, y in (head[0] for head in heads):
        assert any(a <= x <= a + wide and b <= y <= b + high for a, b, wide, high in sizes)


def test_an_arm_is_drawn_from_a_side_and_from_above():
    """Lengths across the view are kept, upright ones shortened by the cosine of the tilt."""
    up, across = np.array([0.0, 0.0, 1.0]), np.array([np.sin(np.radians(62)), np.cos(np.radians(62)), 0.0])
    links = [np.array([0.0 * up, up]), np.array([up, up + across])]
    joints = [ArmJoint(up, up, "1", "first", 0.1), ArmJoint(up + across, up, "2", "second", 0.1)]
    root = parse(build_arm_figure("an arm", links, joints))
    first, second = map(read_points, list_kind(root, "polyline", "limb"))
    upright, level = np.diff(first, axis=0)[0], np.diff(second, axis=0)[0]
    assert upright[0] == pytest.approx(0.0, abs=0.1)
    assert upright[1] < 0.0
    assert level[1] == pytest.approx(0.0, abs=0.1)
    assert -upright[1] / level[0] == pytest.approx(np.cos(np.radians(16)), rel=2e-3)
    drums = list(map(read_points, list_kind(root, "polygon", "box first")))
    # An upright drum is two radii wide, its near end lies within its outline.
    assert np.ptp(drums[0][:, 0]) == pytest.approx(0.2 * level[0], rel=0.02)
    assert drums[1][:, 1].max() < drums[0][:, 1].max()
    assert list_texts(root) == ["1", "2"]
    assert len(list_kind(root, "polygon", "ground")) == 1
    assert len(list_kind(root, "polygon", "box second")) == 2
