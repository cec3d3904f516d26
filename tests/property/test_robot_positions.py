"""The scanner finds every value of any TOML text where `tomllib` reads the same value."""

import tomllib

from hypothesis import given, strategies as st

from symid.robot.toml_values import Scanner

BARE_KEYS = st.from_regex(r"[A-Za-z0-9_-]{1,6}", fullmatch=True)
QUOTED_KEYS = st.sampled_from(['"a.b"', "'c # d'", '"e\\"]f"', "'='", '"\\u00e9"', '""'])
KEYS = st.one_of(BARE_KEYS, QUOTED_KEYS)
SCALARS = st.one_of(
    st.integers(-(10**6), 10**6).map(str),
    st.sampled_from(["1_000", "0x1F", "-1.5e-3", "6.0", "true", "false", "inf", "-0.0"]),
    st.sampled_from(["1979-05-27T07:32:00Z", "1979-05-27 07:32:00", "1979-05-27", "07:32:00"]),
    st.sampled_from(['"plain"', '"a # no comment"', '"quote \\" ] } , \\\\"', "'literal \\'", '""', "''"]),
    st.sampled_from(
        ['"""two\nlines"""', "'''raw \\ \n]'''", '"""ends in quotes"""""', '"""a\\"""b"""', "''''x'''''"]
    ),
)
GAPS = st.sampled_from(["", " ", "\t", "  "])
BREAKS = st.sampled_from(["", " ", "\n", " # ] } , comment\n  ", "\n\n\t"])


def _array(values: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    elements = st.lists(st.tuples(BREAKS, values, BREAKS), max_size=4)
    return st.builds(
        lambda parts, end, comma: (
            "["
            + ",".join(before + value + after for before, value, after in parts)
            + ("," if comma and parts else "")
            + end
            + "]"
        ),
        elements,
        BREAKS,
        st.booleans(),
    )


def _inline(values: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    pairs = st.lists(st.tuples(KEYS, GAPS, values), max_size=3, unique_by=lambda pair: pair[0])
    return st.builds(
        lambda parts, gap: (
            "{" + gap + ", ".join(f"{key}{space}={space}{value}" for key, space, value in parts) + gap + "}"
        ),
        pairs,
        GAPS,
    )


VALUES = st.recursive(SCALARS, lambda inner: st.one_of(_array(inner), _inline(inner)), max_leaves=6)
PAIRS = st.builds(
    lambda keys, gap, value, end: f"{gap}{(gap + '.' + gap).join(keys)}{gap}={gap}{value}{gap}{end}\n",
    st.lists(KEYS, min_size=1, max_size=3),
    GAPS,
    VALUES,
    st.sampled_from(["", " # a comment = [1]", "\n# another"]),
)
NAMES = st.lists(st.sampled_from(["a", "b", "'c d'", "joint"]), min_size=1, max_size=3)
HEADERS = st.builds(
    lambda keys, double, gap: (
        f"{gap}{'[[' if double else '['}{gap}{'.'.join(keys)}{gap}{']]' if double else ']'} # x\n"
    ),
    NAMES,
    st.booleans(),
    GAPS,
)
DOCUMENTS = st.lists(st.one_of(PAIRS, PAIRS, HEADERS), max_size=10)


def _keep_valid(statements: list[str]) -> str:
    """Return the statements, in order, that together are valid TOML."""
    text = ""
    for statement in statements:
        try:
            tomllib.loads(text + statement)
        except tomllib.TOMLDecodeError:
            continue
        text += statement
    return text


def _walk(value, path=()):
    yield path, value
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        yield from _walk(inner, (*path, key))


@given(DOCUMENTS)
def test_every_value_and_key_stands_where_its_place_says(statements):
    text = _keep_valid(statements)
    places = Scanner(text).scan_document()
    found = {path: value for path, value in _walk(tomllib.loads(text)) if path}
    assert set(places.values) == set(found)
    lines = text.split("\n")
    for path, value in found.items():
        place = places.values[path]
        rest = "\n".join([lines[place.line - 1][place.column - 1 :], *lines[place.line :]])
        assert rest.startswith(place.text)
        if not isinstance(value, dict | list):
            read = tomllib.loads(f"value = {place.text}")["value"]
            assert (type(read), repr(read)) == (type(value), repr(value))
        if isinstance(path[-1], str):
            key = places.keys[path]
            assert lines[key.line - 1][key.column - 1 :].startswith(key.text)
            assert next(iter(tomllib.loads(f"{key.text} = 1"))) == path[-1]
