"""URDFs that are wrong: each mistake is told with its place, all of a file at once."""

import pytest

from symid.robot.mjcf_reader import parse_xml_robot, read_xml_robot
from tests.mistakes import refuse, take_mark

KEY, RANGE, REFUSED = "robot.missing-key", "robot.out-of-range", "robot.urdf-refused"


def find_notices(text, **options):
    return refuse(parse_xml_robot, text, "arm.urdf", **options)


def build(*lines):
    return "\n".join(
        ('<robot name="r">', '<link name="a"/><link name="b"/><link name="c"/>', *lines, "</robot>")
    )


def joint(name, parent="a", child="b", inner="", type_="continuous"):
    return (
        f'<joint name="{name}" type="{type_}"><parent link="{parent}"/><child link="{child}"/>{inner}</joint>'
    )


GOOD = joint("j") + joint("k", "b", "c")


def inside(inner, type_="continuous"):
    """Return a good URDF with something more in its first joint."""
    return build(joint("j", inner=inner, type_=type_), joint("k", "b", "c"))


def inertial(inner):
    return build(GOOD).replace('<link name="c"/>', f'<link name="c"><inertial>{inner}</inertial></link>')


def transmission(inner, name="t"):
    return (
        f'<transmission name="{name}"><joint name="j"/><actuator name="m">{inner}</actuator></transmission>'
    )


def reduce(value):
    return f"<mechanicalReduction>{value}</mechanicalReduction>"


# "^" marks the place that is told.
MISTAKES = [
    ("robot.duplicate-joint", build(joint("j"), joint("^j", "b", "c")), "the joint of line 3"),
    ("robot.duplicate-link", build(GOOD, '<link name="^b"/>'), "the link of line 2"),
    ("robot.unknown-name", build(joint("j"), joint("k", "b", "^x")), 'no link "x"'),
    (KEY, build(joint("j"), "^<joint/>"), 'write name="..."'),
    (KEY, build(joint("j"), joint("k", "b", "").replace("<c", "^<c")), 'write link="..."'),
    (KEY, build(joint("j"), '^<joint name="k" type="fixed"><child link="c"/></joint>'), "missing <parent"),
    ("robot.closed-loop", build(GOOD, "^" + joint("m", "a", "c")), "of joint 'k' (line 3)"),
    ("robot.closed-loop", build("^" + GOOD, joint("m", "c", "a")), "of a joint"),
    ("robot.closed-loop", build("^" + joint("j", "b", "c"), joint("k", "c", "b")), "'j', 'k'"),
    ("robot.closed-loop", build(GOOD, '^<loop_joint name="l"/>'), "loop_joint 'l'"),
    (
        "robot.several-roots",
        build(joint("j")).replace('<link name="c"', '^<link name="c"'),
        "link 'c' is the child of no joint",
    ),
    ("robot.no-joints", "^" + build(), "no <joint>"),
    ("robot.no-joints", "^" + inside("", "fixed").replace("continuous", "fixed"), "fixed"),
    ("robot.joint-type", inside("", "^floating"), "--base b"),
    ("robot.joint-type", inside("", "^planar"), "planar"),
    ("robot.joint-type", inside("", "^revolut"), "did you mean revolute"),
    ("robot.bad-number", inside('<origin xyz="^0 0 nan"/>'), 'got "0 0 nan"'),
    ("robot.bad-number", inside('<origin rpy="^0 ${pi} 0"/>'), "xacro"),
    ("robot.bad-number", inside('<origin xyz="^0,5 0 0"/>'), 'got "0,5 0 0"; '),
    ("robot.bad-number", inside('<dynamics damping="^1e99"/>'), 'got "1e99"'),
    ("robot.zero-axis", inside('<axis xyz="^0 0 0"/>'), "no direction"),
    ("robot.unknown-name", inside('<mimic joint="^nobody"/>'), 'no joint "nobody"'),
    (
        "robot.mimic-ring",
        build(joint("j", inner='^<mimic joint="k"/>'), joint("k", "b", "c", '<mimic joint="j"/>')),
        "j -> k -> j",
    ),
    ("robot.two-forms", inside('<mimic joint="k"/>^<mimic joint="k"/>'), "a second <mimic>"),
]


@pytest.mark.parametrize(("code", "text", "words"), MISTAKES)
def test_a_mistake_is_told_with_its_place(code, text, words):
    text, place = take_mark(text)
    notice = next(entry for entry in find_notices(text) if entry.code == code)
    assert (notice.file, (notice.line, notice.column)) == ("arm.urdf", place)
    assert words in notice.text


@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        (inertial("<inertia/>"), KEY, '<mass value="1.5"/>'),
        (inertial('<mass value="-1"/>'), RANGE, "at least 0 kg"),
        (inertial('<mass value="1"/><inertia ixx="one"/>'), "robot.bad-number", 'got "one"'),
        (inertial("</inertial><inertial>"), "robot.two-forms", "a second <inertial>"),
        (inertial('<mass value="1"/><mass value="2"/>'), "robot.two-forms", "a second <mass>"),
        (inside('<child link="c"/>'), "robot.two-forms", "joint 'j': a second <child>"),
        (build(GOOD, transmission(reduce(0))), RANGE, "mechanicalReduction: must"),
        (build(GOOD, transmission(reduce("ten"))), "robot.bad-number", 'got "ten"'),
        (build(GOOD, transmission("<motorInertia>-1</motorInertia>")), RANGE, "motorInertia: "),
        (build(GOOD, transmission(reduce(2) + reduce(3))), "robot.two-forms", "2 and 3"),
        (
            build(GOOD, transmission("<motorInertia>1e-3</motorInertia><rotorInertia>5e-3</rotorInertia>")),
            "robot.two-forms",
            "two rotor inertias that differ, 0.001 and 0.005; keep one",
        ),
        (build(GOOD, transmission(""), transmission("", "u")), "robot.two-forms", "of line 4;"),
    ],
)
def test_mistakes_of_links_and_transmissions(text, code, words):
    assert any(notice.code == code and words in notice.text for notice in find_notices(text))


def test_all_mistakes_of_a_file_are_told_at_once_in_their_order():
    text = build(
        joint("j", inner='<axis xyz="0 0 0"/>'),
        joint("k", "b", "nowhere"),
        joint("l", "b", "c", '<mimic joint="nobody"/><limit lower="low" effort="1" velocity="1"/>'),
    )
    assert [(notice.line, notice.code) for notice in find_notices(text)] == [
        (3, "robot.zero-axis"),
        (4, "robot.unknown-name"),
        (5, "robot.unknown-name"),
        (5, "robot.bad-number"),
    ]


def test_mistakes_in_numbers_do_not_hide_those_of_the_tree():
    text = build(joint("j", inner='<axis xyz="a"/>'))
    assert {notice.code for notice in find_notices(text)} == {"robot.bad-number", "robot.several-roots"}
    text = inside('<origin xyz="a"/>', "planar")
    assert {notice.code for notice in find_notices(text)} == {"robot.bad-number", "robot.joint-type"}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"tip": "d"}, "'d' for the tip"),
        ({"base": "x"}, "'x' for the base"),
        ({"base": "b", "tip": "a"}, "the link 'b'"),
    ],
)
def test_links_to_cut_at_must_exist_and_hang_together(options, words):
    (notice,) = find_notices(build(GOOD), **options)
    assert notice.code == "robot.bad-cut"
    assert words in notice.text


def test_a_cut_must_leave_a_joint():
    (notice,) = find_notices(build(GOOD), base="c")
    assert (notice.code, notice.text) == (
        "robot.no-joints",
        "there is no joint after the link 'c', and a robot needs one that moves",
    )
    still = joint("j", inner='<mimic joint="k" multiplier="0"/>') + joint("k", "b", "c", type_="fixed")
    (notice,) = find_notices(build(still))
    assert notice.code == "robot.no-joints"


@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        ("", "robot.syntax", "no element found"),
        ("<robot>\n<link>", "robot.syntax", "(inside <link>)"),
        ("<robot>&nbsp;</robot>", "robot.syntax", "undefined entity"),
        ("<robot name='a' name='b'/>", "robot.syntax", "duplicate attribute"),
        ("<a>" * 200, REFUSED, "more than 100 deep"),
        ('<!DOCTYPE r [<!ENTITY a "b"><!ENTITY c "&a;&a;">]><robot>&c;</robot>', REFUSED, "<!DOCTYPE"),
        ("<sdf/>", "robot.no-urdf", "<sdf>"),
        ('<robot xmlns:xacro="x"><xacro:include/></robot>', "robot.xacro", "`xacro arm.urdf > "),
    ],
)
def test_what_is_no_urdf_is_refused(text, code, words):
    (notice,) = find_notices(text)
    assert notice.code == code
    assert words in notice.text
    assert notice.line >= 1


def test_columns_count_characters():
    text, place = take_mark(build(joint("jöint", type_="^flöat"), joint("k", "b", "c")))
    (notice,) = find_notices(text)
    assert (notice.line, notice.column) == place == (3, 27)


def test_files_that_cannot_be_read(tmp_path):
    assert refuse(read_xml_robot, tmp_path / "none.urdf")[0].code == "robot.unreadable"
    (tmp_path / "latin.urdf").write_bytes("<robot name='ä'/>".encode("latin-1"))
    assert "UTF-8" in refuse(read_xml_robot, tmp_path / "latin.urdf")[0].text


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        (inside("<axis>0 0 1</axis>"), 3, '"0 0 1", and no xyz; '),
        (inside("<origin>0 0 1</origin>"), 3, 'write <origin xyz="0 0 0.1" rpy="0 0 0"/>'),
        (inertial('<origin>1 0 0</origin><mass value="1"/>'), 2, "<origin"),
    ],
)
def test_numbers_between_tags_are_refused(text, line, words):
    (notice,) = find_notices(text)
    assert (notice.code, notice.line) == ("robot.stray-text", line)
    assert words in notice.text


def test_blanks_around_names_are_explained():
    for old, new, words in (
        ('<link name="c"/>', '<link name="c "/>', '"c "? there is a blank at the end'),
        ('child link="c"', 'child link=" c"', '"c"? there is a blank at the start'),
    ):
        assert words in find_notices(build(GOOD).replace(old, new))[0].text
    assert '"c"? there is a blank' in find_notices(build(GOOD), tip="c ")[0].text


def test_tags_with_a_prefix_are_explained():
    (notice,) = find_notices('<u:robot xmlns:u="x"/>')
    assert "<u:robot>" in notice.text
    text = build(GOOD).replace("<joint ", "<u:joint ").replace("</joint>", "</u:joint>")
    assert "<u:joint>" in find_notices(text)[0].text
