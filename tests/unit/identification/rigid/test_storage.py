import json
from dataclasses import replace
from pathlib import Path

import pytest

from symid.environment import write_file
from symid.errors import EstimateError, OutputError
from symid.identification.rigid.fit import identify_parameters
from symid.identification.stored import read_fit, read_rigid, write_fit
from symid.robot.description import Processing
from tests.recovery.closed_form import TWO_LINK_TRUTH, build_recording, build_two_link
from tests.refusals import raises

FITS = Path(__file__).parents[3] / "data" / "fits"
LIBRARY = build_two_link()
PROCESSING = Processing(drop_first=2, drop_last=2)


@pytest.fixture(scope="module")
def estimate():
    recording = build_recording(LIBRARY, TWO_LINK_TRUTH, noise=(0.1, 0.1))
    return identify_parameters(LIBRARY, [recording], PROCESSING, echo={"log": {"torque": ("tau", 1.0)}})


def spoil(folder, estimate, change):
    """Return the path of a file of the estimate, and its text with its data changed, not yet in the file."""
    path = write_fit(estimate, folder / "estimate.json")
    data = json.loads(path.read_text())
    change(data)
    return path, json.dumps(data)


def test_an_estimate_is_read_as_it_was_written(tmp_path, estimate):
    path = write_fit(estimate, tmp_path / "estimate.json")
    assert read_rigid(path, LIBRARY.card) == estimate
    assert [entry.name for entry in tmp_path.iterdir()] == ["estimate.json"]
    assert write_fit(estimate, tmp_path / "b.json").read_bytes() == path.read_bytes()
    # Infinities survive as null.
    odd = replace(estimate, condition=float("inf"))
    path = write_fit(odd, tmp_path / "estimate.json")
    assert json.loads(path.read_text())["condition"] is None
    assert read_fit(path) == odd


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"{", r"estimate.json:1:2: not JSON"),
        (b"[1]", r"estimate\.json: .* symid"),
        (b'{"format": "symid fit", "version": 9}', "version 9 .* 2, 3, 4, 5, 6$"),
        (b'{"format": "symid estimate", "version": 9}', "version 9 .* 1$"),
        (None, r"estimate\.json: .*: No such file"),
        (b"\xff\xfe\x00", r"estimate\.json: .* text"),
        (b"[" * 100_000, r"estimate\.json"),
        (b'{"format": NaN}', r"estimate\.json"),
        (b"1" * 5000, r"estimate\.json"),
    ],
    ids=["cut", "list", "version", "old version", "missing", "bytes", "deep", "NaN", "long"],
)
def test_other_files_are_refused(tmp_path, content, message):
    path = tmp_path / "estimate.json"
    if content is not None:
        path.write_bytes(content)
    with raises(EstimateError, "estimate.format", match=message):
        read_fit(path)


@pytest.mark.parametrize("kind", ["rigid", "elastic", "friction"])
def test_files_of_version_1_are_read(tmp_path, kind):
    """The files were written by symid 0.1 (commit 1eece39), which had a format for each kind."""
    old = FITS / f"{kind}_1.json"
    data, found = json.loads(old.read_text()), read_fit(old)
    assert (found.kind, found.robot) == (kind, data["robot"])
    if kind == "friction":
        joint = data["joints"][0]["estimate"]
        assert [entry.value for entry in found.joints[0].estimate.parameters] == [
            entry["value"] for entry in joint["parameters"]
        ]
    else:
        assert [entry.value for entry in found.parameters] == [entry["value"] for entry in data["parameters"]]
        assert len(found.friction) == 2
    path = write_fit(found, tmp_path / "new.json")
    assert json.loads(path.read_text())["format"] == "symid fit"
    assert write_fit(read_fit(path), tmp_path / "again.json").read_text() == path.read_text()


def test_a_file_of_version_5_does_not_say_that_its_logs_were_simulated(tmp_path, estimate):
    def change(data):
        data["version"] = 5
        del data["simulated"], data["file"]

    path, text = spoil(tmp_path, replace(estimate, simulated=True), change)
    path.write_text(text)
    assert read_fit(path) == estimate
    path.write_text(text.replace('"version": 5', '"version": 6'))
    with pytest.raises(EstimateError, match="simulated is missing"):
        read_fit(path)


def test_all_that_is_wrong_is_said_at_once(tmp_path, estimate):
    def change(data):
        del data["rows"]
        data |= {"colour": "blue", "condition": "much", "robot": 3}

    path, text = spoil(tmp_path, estimate, change)
    path.write_text(text)
    with pytest.raises(EstimateError) as caught:
        read_fit(path)
    for part in ("rows ", "colour ", "got 'much'", "got 3"):
        assert part in str(caught.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"robot": "panda"}, "'two_link', not for 'panda'"),
        ({"joints": "asymmetric"}, r"coulomb-viscous-offset, .*asymmetric"),
        ({}, r"robot 'two_link' .* another, .* two_link-sig;"),
    ],
)
def test_an_estimate_of_another_model_says_what_differs(tmp_path, estimate, change, message):
    if "joints" in change:
        change = {"joints": tuple(replace(joint, friction="asymmetric") for joint in LIBRARY.card.joints)}
    card = replace(LIBRARY.card, signature="another", **change)
    path = write_fit(estimate, tmp_path / "estimate.json")
    with raises(EstimateError, "estimate.signature", match=message):
        read_rigid(path, card)


def nest(depth):
    value = []
    for _ in range(depth):
        value = [value]
    return value


def refuse(path, text, words=""):
    """Return the places that the refusal of a file names, with these words."""
    path.write_text(text)
    with pytest.raises(EstimateError, match=words or None) as caught:
        read_fit(path)
    notices = caught.value.notices
    assert {notice.code for notice in notices} == {"estimate.format"}
    return {notice.text.partition(": ")[0] for notice in notices}


@pytest.mark.parametrize(
    ("change", "place"),
    [
        (lambda data: data.update(residual=[]), "residual: *got none"),
        (lambda data: data["parameters"][0].update(value=None), "parameters[0].value: *got null"),
        (lambda data: data["residual"][0].update(norm=None), "residual[0].norm: *got null"),
        (lambda data: data.update(samples=None), "samples: *got null"),
        (lambda data: data.update(samples=-1), "samples: *got -1"),
        (lambda data: data.update(kind="stiff"), "kind: *rigid, elastic, friction"),
        (lambda data: data.update(settings=[]), "settings: *"),
        (lambda data: data.update(notices=[{"code": 3}]), r"notices[0]: *notices\[0\]\.code: .* got 3"),
        (lambda data: data.update(friction=["sticky"]), "friction: *'sticky'"),
        (lambda data: data.update(rows="columns"), "rows: *'columns'"),
        (lambda data: data.update(condition=10**400), "condition: *"),
        (lambda data: data["covariance"].pop(), "covariance: *12 rows of 12"),
        (lambda data: data["parameters"][0].pop("std"), "parameters[0]: *std is missing"),
        (lambda data: data["parameters"][0].update(value="1e400"), "parameters[0].value"),
        (lambda data: data["parameters"][0].update(std="1e400"), "parameters[0].std"),
        (lambda data: data["settings"].update(far=["-1e400"]), "settings.far[0]"),
        (lambda data: data["covariance"].__setitem__(0, []), "covariance"),
        (lambda data: data.pop("covariance"), "covariance is missing"),
        (lambda data: data["parameters"][1].pop("truth"), "parameters[1]"),
        (lambda data: data.update(robot="\ud800"), "robot"),
        (lambda data: data["settings"].update({"\udfff": 1}), "settings"),
        (lambda data: data["settings"].update(deep=nest(900)), "settings.deep[0]"),
        (lambda data: data["parameters"][0].update(std=-1.0), "parameters"),
        (lambda data: data.update(condition=-1.0), "condition"),
        (lambda data: data.update(sources=[]), "sources"),
        (lambda data: data.update(version=2.0), "version 2.0 "),
        (lambda data: data.update(version=True), "version True "),
        (lambda data: data.update(format=["symid fit"]), "this is JSON"),
    ],
)
def test_a_broken_file_is_refused_at_its_place(tmp_path, estimate, change, place):
    path, text = spoil(tmp_path, estimate, change)
    text = text.replace('"1e400"', "1e400").replace('"-1e400"', "-1e400")
    place, _, words = place.partition(": *")
    places = refuse(path, text, words)
    assert {entry[: len(place)] for entry in places} == {place}


def test_a_key_that_is_given_twice_and_parameters_that_are_no_list_are_refused(tmp_path, estimate):
    path = write_fit(estimate, tmp_path / "estimate.json")
    text = path.read_text().replace('"robot": ', '"robot": "other", "robot": ', 1)
    assert refuse(path, text) == {"not JSON"}
    data = json.loads((FITS / "elastic_1.json").read_text()) | {"parameters": 5}
    assert refuse(tmp_path / "old.json", json.dumps(data)) == {"parameters"}


@pytest.mark.parametrize(
    ("change", "place"),
    [
        (lambda spring: spring["elasticity"]["stops"][0].update(threshold=None), "stops[0].threshold"),
        (lambda spring: spring["elasticity"]["knees"][0].update(threshold=None), "knees[0].threshold"),
        (lambda spring: spring["elasticity"]["knees"][0].update(slope=None), "knees[0].slope"),
        (lambda spring: spring["elasticity"].pop("damping"), ""),
        (lambda spring: spring.update(torsion=-1.0), "springs"),
        (lambda spring: spring.update(torque=-1.0), "springs"),
    ],
)
def test_a_broken_spring_is_refused_at_its_place(tmp_path, change, place):
    path, data = build_elastic(tmp_path)
    change(data["springs"][0])
    where = place if place == "springs" else f"springs[0].elasticity.{place}".removesuffix(".")
    assert refuse(path, json.dumps(data)) == {where}


def build_elastic(folder):
    """Return the path of a new file of elastic joints, and its data, with stops and knees."""
    path = write_fit(read_fit(FITS / "elastic_1.json"), folder / "elastic.json")
    data = json.loads(path.read_text())
    spring = data["springs"][0]["elasticity"]
    spring["stops"] = [{"threshold": 0.001, "stiffness": 10.0}]
    spring["knees"] = [{"threshold": 1.0, "slope": 0.1}]
    path.write_text(json.dumps(data))
    assert read_fit(path).springs[0].elasticity.knees[0].slope == 0.1
    return path, data


@pytest.mark.parametrize("name", ["a\0b", "\ud800", "none/a.json"])
def test_names_that_no_file_can_have_are_refused(tmp_path, estimate, name):
    """Nor is a folder made that does not exist."""
    with raises(EstimateError, "estimate.format"):
        read_fit(tmp_path / name)
    for write in (lambda path: write_fit(estimate, path), lambda path: write_file(path, "text")):
        with raises(OutputError, "output.write", match="No such file" if "/" in name else None):
            write(tmp_path / name)


def test_parameters_that_are_not_the_models_are_refused(tmp_path, estimate):
    first, *rest = estimate.parameters
    renamed = (replace(first, name="colour"), *rest)
    for parameters, message in (
        (tuple(rest), f"model 'two_link': '{first.name}' "),
        (renamed, "model 'two_link': 'colour' "),
    ):
        changed = replace(estimate, parameters=parameters, covariance=())
        path = write_fit(changed, tmp_path / "estimate.json")
        with raises(EstimateError, "estimate.parameters", match=message):
            read_rigid(path, LIBRARY.card)
