import math
from dataclasses import fields, replace

import numpy as np
import pytest
from jinja2 import meta

from symid import __version__
from symid.errors import Notice
from symid.identification.rigid.fit import identify_parameters
from symid.identification.rigid.validation import validate_estimate
from symid.report import blocks, pages
from symid.report.blocks import split_sections
from symid.report.figures import TIME, Line, build_line_figure, thin_line
from symid.report.identification_page import build_identification_page
from symid.report.texts import show_estimate
from symid.report.verdict import judge_identification
from symid.robot.description import Processing
from tests.pages import PageReader
from tests.recovery.closed_form import TWO_LINK_TRUTH, build_recording, build_two_link

NOISE = (0.5, 0.2)


@pytest.fixture(scope="module")
def result():
    library = build_two_link()
    processing = Processing(drop_first=5, drop_last=5)
    recordings = [
        build_recording(library, TWO_LINK_TRUTH, seed=seed, noise=NOISE, source=f"<log {seed}>")
        for seed in (0, 7)
    ]
    estimate = identify_parameters(library, recordings[:1], processing)
    estimate = replace(estimate, simulated=True)
    return estimate, validate_estimate(estimate, library, recordings[1], processing)


def test_context_and_template_have_the_same_names():
    environment = pages.build_environment()
    tree = environment.parse(environment.loader.get_source(environment, pages.TEMPLATE)[0])
    made = {"shown": "blocks", "folded": "more", "live": "blocks"}
    found = {made.get(name, name) for name in meta.find_undeclared_variables(tree)}
    assert found == {field.name for field in fields(pages.Page)}


def test_the_page_needs_nothing_else(tmp_path, result):
    estimate, validation = result
    path = pages.write_page(tmp_path / "report.html", build_identification_page(estimate, (validation,)))
    text = path.read_text(encoding="utf-8")
    reader = PageReader(text)
    assert sorted(reader.links) == sorted(f"#{anchor}" for anchor in reader.anchors)
    assert len(set(reader.anchors)) == len(reader.anchors)
    assert reader.tags.count("script") == 1
    assert reader.tags.count("svg") == 5
    assert [entry.name for entry in tmp_path.iterdir()] == ["report.html"]


def test_names_are_escaped_origin_is_told_and_tables_scroll(result):
    estimate, validation = result
    notice = Notice(code="log.converted", text="torque: multiplied by 2", file="a.npz")
    options = {"notices": (notice, notice), "origin": ("robot arm of arm.toml",)}
    text = pages.render_page(build_identification_page(estimate, (validation,), **options))
    assert "&lt;log 7&gt;" in text
    assert "<log 7>" not in text
    assert text.count("a.npz: torque: multiplied by 2") == 1
    assert f"Written by symid {__version__}; robot arm of arm.toml." in text
    # That of the settings breaks its lines.
    assert text.count("<table>") == text.count('<div class="scroll"') + 1 == 7


def find_section(blocks, title):
    """Return the first block below a heading."""
    return blocks[blocks.index(f"== {title} ==") + 1]


def test_every_parameter_is_shown_or_its_refusal_said(result):
    estimate, validation = result
    page = build_identification_page(estimate, (validation,))
    names, *_, inside = zip(*find_section(page.blocks, "Parameters").rows, strict=True)
    assert list(names) == [entry.name for entry in estimate.parameters]
    assert set(inside) == {True}
    assert ("processing.drop_first", "5") in page.settings
    title = find_section(page.blocks, "Held-out log <log 7>").title
    assert title.endswith(f": {blocks.format_percent(validation.mean_relative_percent)}.")
    partial = replace(estimate, refused=(("Fc2", "it never moved"),))
    page = build_identification_page(partial)
    assert any(getattr(block, "rows", ()) == partial.refused for block in page.blocks)
    assert page.verdict.level == "usable"
    assert find_section(page.blocks, "Held-out logs") == pages.UNTESTED


def test_a_missed_truth_is_counted_named_and_not_good(result):
    estimate, validation = result
    first, *others = estimate.parameters

    def judge(*parameters):
        return judge_identification(replace(estimate, parameters=parameters), (validation,))

    wrong = replace(first, truth=first.value + 10 * first.std)
    verdict = judge(wrong, *others)
    assert any(detail.startswith("11 of 12 true values") for detail in verdict.details)
    assert verdict.level == "usable"
    assert first.name in verdict.headline
    page = build_identification_page(replace(estimate, parameters=(wrong,)))
    assert find_section(page.blocks, "Parameters").rows[0][-1] is False
    assert '<td class="no">no</td>' in pages.render_page(page)
    assert judge(replace(first, truth=first.value + 3.1 * first.std), *others).level == "good"
    assert judge(*(replace(e, truth=e.value + 5 * e.std) for e in estimate.parameters)).level == "doubtful"


def test_values_of_a_robot_file_are_true_only_where_a_log_was_simulated_from_it(result):
    estimate, validation = result
    high = tuple(replace(entry, truth=entry.value + 9.0 * entry.std) for entry in estimate.parameters)
    for simulated in (True, False):
        page = build_identification_page(
            replace(estimate, parameters=high, simulated=simulated), (validation,)
        )
        table, text = find_section(page.blocks, "Parameters"), pages.render_page(page)
        assert table.header[4:] == (["truth", "error", pages._SIGMA] if simulated else ["robot file"])
        assert ('class="no"' in text) == ("true value" in text) == simulated
        assert page.verdict.level == ("doubtful" if simulated else "good")


def test_the_verdict_is_one_sentence_with_the_worst_joint(result):
    estimate, validation = result
    worst = max(validation.residual, key=lambda entry: entry.relative_percent)
    parts = max(estimate.evidence.joints, key=lambda entry: entry.held_out)
    for page, joint, percent, mean in (
        (build_identification_page(estimate, (validation,)), worst.joint, worst.relative_percent, validation),
        (build_identification_page(estimate), parts.joint, parts.held_out, None),
    ):
        told, verdict = page.headline, pages.render_page(page)
        assert told.endswith(f"the worst joint is {joint}, with {blocks.format_percent(percent)}.")
        assert told.count(". ") == 0
        assert "Details of the verdict" in verdict
        whole = estimate.evidence.unexplained if mean is None else mean.mean_relative_percent
        assert blocks.format_percent(whole) in told
        # The same number in the same digits everywhere.
        assert page.numbers[0][0] == blocks.format_percent(whole)
    table = find_section(build_identification_page(estimate, (validation,)).blocks, "Held-out log <log 7>")
    assert table.rows[table.picked][:2] == (worst.joint, blocks.format_percent(worst.relative_percent))


def test_title_author_and_date_stand_at_the_head(result, tmp_path):
    estimate, validation = result
    page = build_identification_page(estimate, (validation,))
    told = replace(page, title="Cell <3>", author="A. & B.", date="2031-05-06")
    text = pages.render_page(told)
    assert "<h1>Cell &lt;3&gt;</h1>" in text
    assert f'<p class="byline">{page.robot}: {page.subject} · A. &amp; B. · 2031-05-06</p>' in text
    assert 'byline">' not in pages.render_page(page)
    assert f"<h1>{page.robot}: {page.subject}</h1>" in pages.render_page(page)


@pytest.mark.parametrize("start", [0.0, 60.25, 1.7e9, -3.0])
def test_time_begins_at_zero(start):
    time = start + np.linspace(0.0, 4.0, 9)
    (line,) = build_line_figure("t", (TIME, "y"), [Line("y", "first", time, time)]).data.lines
    assert line.x == pytest.approx(np.linspace(0.0, 4.0, 9), abs=1e-6)
    assert np.array_equal(line.y, time)
    (other,) = build_line_figure("t", ("number", "y"), [Line("y", "first", time, time)]).data.lines
    assert np.array_equal(other.x, time)


def test_thinning_keeps_peaks():
    rng = np.random.default_rng(3)
    x, y = np.arange(100_000.0), rng.normal(size=100_000)
    y[54_321] = 50
    y[12_345] = -50
    thin_x, thin_y = thin_line(x, y)
    assert len(thin_x) <= 2000
    assert {54_321, 12_345} <= set(thin_x)
    assert np.all(np.diff(thin_x) > 0)
    np.testing.assert_array_equal(thin_y, y[thin_x.astype(int)])


def test_rows_of_another_kind_are_not_good(result):
    estimate, validation = result
    verdict = judge_identification(replace(estimate, rows="energy"), (validation,))
    assert verdict.level == "usable"
    assert verdict.headline.startswith("The residual of held-out logs ")


def test_vague_parameters_are_not_good(result):
    estimate, validation = result
    vague = tuple(replace(entry, truth=None, std=abs(entry.value)) for entry in estimate.parameters)
    worse = replace(estimate, parameters=vague)
    blind = judge_identification(replace(worse, evidence=None), (validation,))
    assert blind.level == "usable"
    assert "uncertain" in blind.headline
    # What held-out stretches show counts for more: deviations say how uncertain a value is.
    verdict = judge_identification(worse, (validation,))
    assert verdict.level == judge_identification(estimate, (validation,)).level
    assert any("uncertain" in sentence.lower() for sentence in verdict.details)


def test_the_log_of_the_fit_is_no_held_out_log(result):
    estimate, held_out = result
    library = build_two_link()
    recording = build_recording(library, TWO_LINK_TRUTH, seed=0, noise=NOISE, source="<log 0>")
    validation = validate_estimate(estimate, library, recording, Processing(drop_first=5, drop_last=5))
    assert validation.fitted
    assert validation.notices[-1].code == "validate.fitted-log"
    verdict = judge_identification(estimate, (validation,))
    untested = judge_identification(estimate, ())
    assert (verdict.level, verdict.headline) == (untested.level, untested.headline)
    assert judge_identification(replace(estimate, evidence=None), (validation,)).level == "usable"
    own, other = (build_identification_page(estimate, (entry,)).blocks for entry in (validation, held_out))
    title = find_section(own, "Log of the fit <log 0>").title
    assert title.partition(".")[0] != find_section(other, "Held-out log <log 7>").title.partition(".")[0]


def test_the_first_screen_has_the_numbers_of_the_result(result):
    estimate, validation = result
    page = build_identification_page(estimate, (validation,))
    worst = max(validation.residual, key=lambda entry: entry.relative_percent)
    assert [value for value, _ in page.numbers] == [
        blocks.format_percent(validation.mean_relative_percent),
        blocks.format_percent(worst.relative_percent),
        f"{len(estimate.parameters)} of {len(estimate.parameters)}",
    ]
    assert worst.joint in page.lead.caption
    untested = build_identification_page(estimate)
    assert untested.numbers[0][0] == blocks.format_percent(estimate.evidence.unexplained)
    blind = build_identification_page(replace(estimate, evidence=None))
    assert blind.numbers[0][0] == blocks.format_percent(estimate.mean_relative_percent)
    for entry in (untested, blind):
        assert "joint by joint" in entry.lead.caption


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (2.76431, 0.00054, "2.7643 ± 0.0005"),
        (2.76431, 0.00024, "2.76431 ± 0.00024"),
        (6.3474, 30.2, "10 ± 30"),
        (20102.3, 347.1, "20100 ± 300"),
        (-1.5, 0.25, "−1.50 ± 0.25"),  # noqa: RUF001  what a reader sees
        (1.234e-9, 1.2e-11, "(1.234 ± 0.012)×10⁻⁹"),  # noqa: RUF001
        (2.5e8, 1.3e6, "(2.500 ± 0.013)×10⁸"),  # noqa: RUF001
        (0.0, 0.01, "0.000 ± 0.010"),
        (3.25, math.inf, "3.25"),
        (-1e-9, math.nan, "−1e−09"),  # noqa: RUF001
        (math.nan, 1.0, "-"),
        (math.inf, 0.1, "-"),
    ],
)
def test_digits_of_value_and_deviation_match(value, std, text):
    assert blocks.format_pair(value, std) == text
    assert str(blocks.Table(("value",), [(text,)])).isascii()


def test_a_terminal_shows_names_as_they_are():
    for name in ("q²", "a−b", "±1 V", "10⁻³"):  # noqa: RUF001
        assert str(blocks.Table(("joint",), [(name,)])).endswith(name)


def test_sections_have_addresses_of_their_own():
    blocks = ("before", "== One: a & b ==", "== one a b ==", "text", "=== below ===", "== \N{DEGREE SIGN} ==")
    sections = split_sections(blocks, ("begin",))
    assert [section.anchor for section in sections] == ["begin-2", "one-a-b", "one-a-b-2", "begin-3"]
    assert [section.title for section in sections] == ["", "One: a & b", "one a b", "\N{DEGREE SIGN}"]
    assert "<h3>below</h3>" in sections[2].body


def test_the_headline_counts_weak_values(result):
    estimate, _ = result
    first, *others = (replace(entry, std=0.01 * abs(entry.value)) for entry in estimate.parameters)
    weak = replace(first, std=abs(first.value))
    sound, poor = (replace(estimate, parameters=(one, *others)) for one in (first, weak))
    assert show_estimate(sound)[0].endswith("all identifiable parameters have values")
    assert show_estimate(poor)[0].endswith(f"; 1 of {len(others) + 1} are poorly identifiable")


def test_parameters_that_group_nothing_are_listed_in_a_line(result):
    alone = [
        replace(entry, expression=entry.name, reason="identifiable on its own")
        for entry in result[0].parameters
    ]
    (text,) = pages.show_groupings(alone[:3])
    assert text == f"Identifiable on its own: {', '.join(entry.name for entry in alone[:3])}."
    groups = replace(alone[0], expression="ZZ1 + 0.25*M2", reason="M2: moves with the link before")
    table, text = pages.show_groupings([groups, alone[1]])
    assert table.rows == [(groups.name, "ZZ1 + 0.25*M2\nM2: moves with the link before")]
    assert groups.name not in text
