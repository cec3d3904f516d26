"""URDFs that are wrong: each mistake is told with its place, all of a file at once."""

import pytest

from symid.errors import RobotError
from symid.robot.urdf_reader import parse_urdf, read_urdf


def refuse(text, **options):
    with pytest.raises(RobotError) as caught:
        parse_urdf(text, "arm.urdf", **options)
    return caught.value.notices


def build(*lines):
    return "\n".join(
        ('<robot name="r">', '<link name="a"/><link name="b"/><link name="c"/>', *lines, "</robot>")
    )


def joint(name, parent="a", child="b", inner="", type_="continuous"):
    return (
        f'<joint name="{name}" type="{type_}"><parent link="{parent}"/><child link="{child}"/>{inner}</joint>'
    )


GOOD = joint("j") + joint("k", "b", "c")


@pytest.mark.parametrize(
    ("text", "code", "place", "words"),
    [
        (build(joint("j"), joint("j", "b", "c")), "robot.duplicate-joint", (4, 'j"'), "the joint of line 3"),
        (build(GOOD, '<link name="b"/>'), "robot.duplicate-link", (4, 'b"'), "the link of line 2"),
        (build(joint("j"), joint("k", "b", "x")), "robot.unknown-name", (4, 'x"'), 'no link "x"'),
        (build(joint("j"), "<joint/>"), "robot.missing-key", (4, "<joint"), 'write name="..."'),
        (build(joint("j"), joint("k", "b", "")), "robot.missing-key", (4, "<child"), 'write link="..."'),
        (
            build(joint("j"), '<joint name="k" type="fixed"><child link="c"/></joint>'),
            "robot.missing-key",
            (4, '<joint name="k"'),
            "missing <parent",
        ),
        (build(GOOD, joint("m", "a", "c")), "robot.closed-loop", (4, "<joint"), "of joint 'k' (line 3)"),
        (build(GOOD, joint("m", "c", "a")), "robot.closed-loop", (3, "<joint"), "of a joint"),
        (
            build(joint("j", "b", "c"), joint("k", "c", "b")),
            "robot.closed-loop",
            (3, "<joint"),
            "'j', 'k'",
        ),
        (build(GOOD, '<loop_joint name="l"/>'), "robot.closed-loop", (4, "<loop_joint"), "loop_joint 'l'"),
        (
            build(joint("j")),
            "robot.several-roots",
            (2, '<link name="c"'),
            "link 'c' is the child of no joint",
        ),
        (build(), "robot.no-joints", (1, "<robot"), "no <joint>"),
        (
            build(joint("j", type_="fixed"), joint("k", "b", "c", type_="fixed")),
            "robot.no-joints",
            (1, "<robot"),
            "fixed",
        ),
        (
            build(joint("j", type_="floating"), joint("k", "b", "c")),
            "robot.joint-type",
            (3, 'floating"'),
            "--base b",
        ),
        (
            build(joint("j", type_="planar"), joint("k", "b", "c")),
            "robot.joint-type",
            (3, 'planar"'),
            "planar",
        ),
        (
            build(joint("j", type_="revolut"), joint("k", "b", "c")),
            "robot.joint-type",
            (3, 'revolut"'),
            "did you mean revolute",
        ),
        (
            build(joint("j", inner='<origin xyz="0 0 nan"/>'), joint("k", "b", "c")),
            "robot.bad-number",
            (3, '0 0 nan"'),
            'got "0 0 nan"',
        ),
        (
            build(joint("j", inner='<origin rpy="0 ${pi} 0"/>'), joint("k", "b", "c")),
            "robot.bad-number",
            (3, '0 ${pi} 0"'),
            "xacro",
        ),
        (
            build(joint("j", inner='<origin xyz="0,5 0 0"/>'), joint("k", "b", "c")),
            "robot.bad-number",
            (3, '0,5 0 0"'),
            'got "0,5 0 0"; ',
        ),
        (
            build(joint("j", inner='<dynamics damping="1e99"/>'), joint("k", "b", "c")),
            "robot.bad-number",
            (3, '1e99"'),
            'got "1e99"',
        ),
        (
            build(joint("j", inner='<axis xyz="0 0 0"/>'), joint("k", "b", "c")),
            "robot.zero-axis",
            (3, '0 0 0"'),
            "no direction",
        ),
        (
            build(joint("j", inner='<mimic joint="nobody"/>'), joint("k", "b", "c")),
            "robot.unknown-name",
            (3, 'nobody"'),
            'no joint "nobody"',
        ),
        (
            build(joint("j", inner='<mimic joint="k"/>'), joint("k", "b", "c", '<mimic joint="j"/>')),
            "robot.mimic-ring",
            (3, '<mimic joint="k"'),
            "j -> k -> j",
        ),
        (
            build(joint("j", inner='<mimic joint="k"/><mimic joint="k"/>'), joint("k", "b", "c")),
            "robot.two-forms",
            (3, '<mimic joint="k"/></joint>'),
            "a second <mimic>",
        ),
    ],
)
def test_a_mistake_is_told_with_its_place(text, code, place, words):
    found = refuse(text)
    notice = next(entry for entry in found if entry.code == code)
    line, begin = place
    assert notice.line == line
    assert text.split("\n")[line - 1][notice.column - 1 :].startswith(begin), str(notice)
    assert words in notice.text
    assert notice.file == "arm.urdf"


def inertial(inner):
    return build(GOOD).replace('<link name="c"/>', f'<link name="c"><inertial>{inner}</inertial></link>')


@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        (inertial("<inertia/>"), "robot.missing-key", '<mass value="1.5"/>'),
        (inertial('<mass value="-1"/>'), "robot.out-of-range", "at least 0 kg"),
        (inertial('<mass value="1"/><inertia ixx="one"/>'), "robot.bad-number", 'got "one"'),
        (
            build(GOOD).replace('<link name="c"/>', '<link name="c"><inertial/><inertial/></link>'),
            "robot.two-forms",
            "a second <inertial>",
        ),
        (inertial('<mass value="1"/><mass value="2"/>'), "robot.two-forms", "a second <mass>"),
        (
            build(joint("j", inner='<child link="c"/>'), joint("k", "b", "c")),
            "robot.two-forms",
            "joint 'j': a second <child>",
        ),
    ],
)
def test_mistakes_of_links(text, code, words):
    assert any(notice.code == code and words in notice.text for notice in refuse(text))


def transmission(inner, name="t"):
    return (
        f'<transmission name="{name}"><joint name="j"/><actuator name="m">{inner}</actuator></transmission>'
    )


@pytest.mark.parametrize(
    ("lines", "code", "words"),
    [
        (
            [transmission("<mechanicalReduction>0</mechanicalReduction>")],
            "robot.out-of-range",
            "mechanicalReduction: must",
        ),
        (
            [transmission("<mechanicalReduction>ten</mechanicalReduction>")],
            "robot.bad-number",
            'mechanicalReduction: expected a finite number, got "ten"',
        ),
        (
            [transmission("<motorInertia>-1</motorInertia>")],
            "robot.out-of-range",
            "motorInertia: ",
        ),
        (
            [
                transmission(
                    "<mechanicalReduction>2</mechanicalReduction><mechanicalReduction>3</mechanicalReduction>"
                )
            ],
            "robot.two-forms",
            "2 and 3",
        ),
        ([transmission(""), transmission("", "u")], "robot.two-forms", "of line 4;"),
    ],
)
def test_mistakes_of_transmissions(lines, code, words):
    assert any(notice.code == code and words in notice.text for notice in refuse(build(GOOD, *lines)))


def test_all_mistakes_of_a_file_are_told_at_once_in_their_order():
    text = build(
        joint("j", inner='<axis xyz="0 0 0"/>'),
        joint("k", "b", "nowhere"),
        joint("l", "b", "c", '<mimic joint="nobody"/><limit lower="low" effort="1" velocity="1"/>'),
    )
    assert [(notice.line, notice.code) for notice in refuse(text)] == [
        (3, "robot.zero-axis"),
        (4, "robot.unknown-name"),
        (5, "robot.unknown-name"),
        (5, "robot.bad-number"),
    ]


def test_mistakes_in_numbers_do_not_hide_those_of_the_tree():
    text = build(joint("j", inner='<axis xyz="a"/>'))
    assert {notice.code for notice in refuse(text)} == {"robot.bad-number", "robot.several-roots"}
    text = build(joint("j", inner='<origin xyz="a"/>', type_="planar"), joint("k", "b", "c"))
    assert {notice.code for notice in refuse(text)} == {"robot.bad-number", "robot.joint-type"}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"tip": "d"}, "'d' for the tip"),
        ({"base": "x"}, "'x' for the base"),
        ({"base": "b", "tip": "a"}, "the link 'b'"),
    ],
)
def test_links_to_cut_at_must_exist_and_hang_together(options, words):
    (notice,) = refuse(build(GOOD), **options)
    assert notice.code == "robot.bad-cut"
    assert words in notice.text


def test_a_cut_must_leave_a_joint():
    (notice,) = refuse(build(GOOD), base="c")
    assert (notice.code, notice.text) == (
        "robot.no-joints",
        "there is no joint after the link 'c', and a robot needs one that moves",
    )
    still = joint("j", inner='<mimic joint="k" multiplier="0"/>') + joint("k", "b", "c", type_="fixed")
    (notice,) = refuse(build(still))
    assert notice.code == "robot.no-joints"


@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        ("", "robot.syntax", "no element found"),
        ("<robot>\n<link>", "robot.syntax", "(inside <link>)"),
        ("<robot>&nbsp;</robot>", "robot.syntax", "undefined entity"),
        ("<robot name='a' name='b'/>", "robot.syntax", "duplicate attribute"),
        ("<a>" * 200, "robot.urdf-refused", "more than 100 deep"),
        (
            '<!DOCTYPE r [<!ENTITY a "b"><!ENTITY c "&a;&a;">]><robot>&c;</robot>',
            "robot.urdf-refused",
            "<!DOCTYPE",
        ),
        ("<sdf/>", "robot.no-urdf", "<sdf>"),
        (
            '<robot xmlns:xacro="x">\n  <xacro:include filename="a"/></robot>',
            "robot.xacro",
            "run `xacro arm.urdf > robot.urdf`",
        ),
    ],
)
def test_what_is_no_urdf_is_refused(text, code, words):
    (notice,) = refuse(text)
    assert notice.code == code
    assert words in notice.text
    assert notice.line >= 1


def test_a_namespace_alone_is_no_xacro():
    assert parse_urdf(build(GOOD).replace("<robot ", '<robot xmlns:xacro="x" ')).size == 2


def test_columns_count_characters():
    (notice,) = refuse(build(joint("jöint", type_="flöat"), joint("k", "b", "c")))
    assert (notice.line, notice.column) == (3, 27)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(RobotError) as caught:
        read_urdf(tmp_path / "none.urdf")
    assert caught.value.notices[0].code == "robot.unreadable"
    (tmp_path / "latin.urdf").write_bytes("<robot name='ä'/>".encode("latin-1"))
    with pytest.raises(RobotError) as caught:
        read_urdf(tmp_path / "latin.urdf")
    assert "UTF-8" in caught.value.notices[0].text


@pytest.mark.parametrize(
    ("inner", "words"),
    [
        (
            "<axis>0 0 1</axis>",
            '"0 0 1", and no xyz; ',
        ),
        ("<origin>0 0 1</origin>", 'write <origin xyz="0 0 0.1" rpy="0 0 0"/>'),
    ],
)
def test_numbers_between_tags_are_refused(inner, words):
    (notice,) = refuse(build(joint("j", inner=inner), joint("k", "b", "c")))
    assert (notice.code, notice.line) == ("robot.stray-text", 3)
    assert words in notice.text


def test_the_place_of_an_inertia_between_tags_is_refused():
    (notice,) = refuse(inertial('<origin>1 0 0</origin><mass value="1"/>'))
    assert notice.code == "robot.stray-text"


def test_two_rotor_inertias_that_differ_are_refused():
    line = transmission("<motorInertia>1e-3</motorInertia><rotorInertia>5e-3</rotorInertia>")
    (notice,) = refuse(build(GOOD, line))
    assert notice.code == "robot.two-forms"
    assert "two rotor inertias that differ, 0.001 and 0.005; keep one" in notice.text


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            '<link name="c"/>',
            '<link name="c "/>',
            '"c "? there is a blank at the end',
        ),
        (
            'child link="c"',
            'child link=" c"',
            '"c"? there is a blank at the start',
        ),
    ],
)
def test_blanks_around_names_are_explained(old, new, words):
    assert words in refuse(build(GOOD).replace(old, new))[0].text


def test_blanks_in_the_name_of_a_tip_are_explained():
    assert '"c"? there is a blank' in refuse(build(GOOD), tip="c ")[0].text


def test_tags_with_a_prefix_are_explained():
    (notice,) = refuse('<u:robot xmlns:u="x"/>')
    assert "<u:robot>" in notice.text
    text = build(GOOD).replace("<joint ", "<u:joint ").replace("</joint>", "</u:joint>")
    assert "<u:joint>" in refuse(text)[0].text
