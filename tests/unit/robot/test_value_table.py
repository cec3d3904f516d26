"""Tables of values that others publish: columns, guesses, all mistakes at once."""

import pytest

from symid.errors import EstimateError, Notice, UsageError
from symid.robot.parameter_values import TableColumns, read_value_table
from tests.mistakes import refuse


def read_name(text):
    if text.startswith("bad"):
        raise UsageError(Notice(code="usage.unreadable-group", text=f"{text} is no group"))
    return text.upper()


def read(tmp_path, text, **columns):
    path = tmp_path / "table.csv"
    path.write_text(text, encoding="utf-8")
    return read_value_table(path, TableColumns(**columns), read_name)


def test_columns_are_chosen_by_name(tmp_path):
    text = "base_parameter,ols,ols_std_percent,wls,wls_std_percent\na,2.0,10,-4.0,5\nb + c,1e-3,1,0,3\n"
    found = read(tmp_path, text, value="wls")
    assert [(row.line, row.text, row.name, row.value) for row in found.rows] == [
        (2, "a", "A", -4.0),
        (3, "b + c", "B + C", 0.0),
    ]
    assert [row.deviation for row in found.rows] == [pytest.approx(0.2), None]  # percent of zero say nothing
    assert found.columns == TableColumns(
        name="base_parameter", value="wls", deviation="wls_std_percent", percent=True
    )
    found = read(tmp_path, text, value="ols", deviation="wls_std_percent", percent=False)
    assert [row.deviation for row in found.rows] == [5.0, 3.0]


@pytest.mark.parametrize(
    ("heading", "expected"),
    [
        ("parameter;value;std", ("parameter", "value", "std", False)),
        ("what;x;sigma [%]", ("what", "x", "sigma [%]", True)),
        ("Name;Estimate;Std Dev", ("Name", "Estimate", None, False)),
        ("group;value;comment", ("group", "value", None, False)),
    ],
)
def test_columns_are_guessed_where_there_is_no_other(tmp_path, heading, expected):
    last = "text" if "comment" in heading else "0.5"
    if heading.startswith("Name"):
        heading, expected = heading.replace("Std Dev", "stddev"), (*expected[:2], "stddev", False)
    found = read(tmp_path, f'# someone\'s table\n\n{heading}\n"a"; 1.5; {last}\n').columns
    assert (found.name, found.value, found.deviation, found.percent) == expected


@pytest.mark.parametrize(
    ("heading", "message"),
    [
        ("name,ols,wls", "--value .* ols, wls; .*--value COLUMN"),
        ("name,value,std,std_percent", "--deviation .* std, std_percent"),
        ("one,two,three", None),
        ("name,value,relative_std", "column 'relative_std' .*--deviation-unit"),
    ],
)
def test_what_could_be_several_columns_is_asked_for(tmp_path, heading, message):
    line = ",".join(["a", "1.0", "2.0", "3.0"][: heading.count(",") + 1])
    with pytest.raises(UsageError, match=message or "--value .* two, three") as caught:
        read(tmp_path, f"{heading}\n{line}\n")
    assert caught.value.notices[0].code == "usage.table-column"


def test_a_column_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(UsageError, match=r"--value wls: .* name, ols"):
        read(tmp_path, "name,ols\na,1\n", value="wls")
    with pytest.raises(UsageError, match=r"--value .* name, note"):
        read(tmp_path, "name,note\na,b\n")


def test_all_mistakes_are_told_with_their_lines(tmp_path):
    text = "name,value,std\na,1_0,0.1\nbad,1,nan\nc,2\n# d\n a ,3,-1\ne,1e101,x\nf,1,1\nf,2,1\n"
    notices = refuse(read, tmp_path, text, error=EstimateError)
    assert [(notice.line, notice.code) for notice in notices] == [
        (2, "table.not-a-number"),
        (3, "usage.unreadable-group"),
        (3, "table.not-a-number"),
        (4, "table.line-length"),
        (6, "table.not-a-number"),
        (7, "table.not-a-number"),
        (7, "table.not-a-number"),
        (9, "table.repeated"),
    ]
    assert all(notice.file.endswith("table.csv") for notice in notices)
    assert "'std': '-1'" in notices[4].text


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("", "table.header"),
        ("# nothing\n", "table.header"),
        ("a,1.0,2.0\nb,1,2\n", "table.header"),
        ("name,value,value\na,1,2\n", "table.header"),
        ("name,value,std\na,,\n", "table.no-rows"),
        ("name,value,std\n", "table.no-rows"),
        (f"name,value\n{'a' * 140_000},1\n", "table.unreadable"),
    ],
)
def test_what_is_no_table(tmp_path, text, code):
    columns = {"name": "name" if "name" in text else None, "value": "value" if text else None}
    assert [notice.code for notice in refuse(read, tmp_path, text, error=EstimateError, **columns)] == [code]


@pytest.mark.parametrize(
    ("text", "words"), [("name;value;std\na;3,2;0.1\n", "'3,2'"), ("name,value,std\na,3,1.1 %\n", "'1.1 %'")]
)
def test_columns_of_numbers_that_cannot_be_read_are_not_passed_over(tmp_path, text, words):
    """Without its column of deviations a table would be compared as if it had none."""
    (notice,) = refuse(read, tmp_path, text, error=EstimateError)
    assert (notice.code, notice.line) == ("table.not-a-number", 2)
    assert words in notice.text


def test_rows_without_any_cell_or_value_are_none_and_the_minus_of_print_is_a_minus(tmp_path):
    """Spreadsheets write what lies below a table as separators alone."""
    minus = "\N{MINUS SIGN}"
    found = read(tmp_path, f"name;value;std\na;{minus}3.5e{minus}2;0.1\n;;\n ; ;\nb;2;\nc;;\n;\n")
    assert [(row.name, row.value, row.deviation) for row in found.rows] == [
        ("A", -0.035, 0.1),
        ("B", 2, None),
    ]
    assert found.empty == ((6, "c"),)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(EstimateError, match="No such file"):
        read_value_table(tmp_path / "none.csv", TableColumns(), read_name)
    (tmp_path / "bytes.csv").write_bytes(b"name,value\n\xff,1\n")
    with pytest.raises(EstimateError, match="not UTF-8 text") as caught:
        read_value_table(tmp_path / "bytes.csv", TableColumns(), read_name)
    assert caught.value.notices[0].code == "table.unreadable"
