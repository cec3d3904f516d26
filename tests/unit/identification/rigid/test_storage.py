import json
from dataclasses import replace
from pathlib import Path

import pytest

from symid.environment import write_file
from symid.errors import EstimateError, OutputError
from symid.identification.rigid.fit import identify_parameters
from symid.identification.rigid.validation import validate_estimate
from symid.identification.stored import read_fit, write_fit
from symid.robot.description import Processing
from tests.recovery.closed_form import TWO_LINK_TRUTH, build_recording, build_two_link


@pytest.fixture(scope="module")
def library():
    return build_two_link()


@pytest.fixture(scope="module")
def estimate(library):
    recording = build_recording(library, TWO_LINK_TRUTH, noise=(0.1, 0.1))
    return identify_parameters(
        library, [recording], Processing(drop_first=2, drop_last=2), echo={"log": {"torque": ("tau", 1.0)}}
    )


def test_an_estimate_is_read_as_it_was_written(tmp_path, estimate, library):
    path = write_fit(estimate, tmp_path / "estimate.json")
    assert read_fit(path, library.card) == estimate
    assert [entry.name for entry in tmp_path.iterdir()] == ["estimate.json"]


def test_writing_twice_gives_the_same_bytes(tmp_path, estimate):
    first = write_fit(estimate, tmp_path / "a.json").read_bytes()
    assert write_fit(estimate, tmp_path / "b.json").read_bytes() == first


def test_infinities_survive_as_null(tmp_path, estimate):
    odd = replace(estimate, condition=float("inf"))
    path = write_fit(odd, tmp_path / "estimate.json")
    assert json.loads(path.read_text())["condition"] is None
    assert read_fit(path) == odd


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", r"estimate.json:1:2: not JSON"),
        ("[1]", "not an estimate written by symid"),
        ('{"format": "symid fit", "version": 9}', "version 9 of the format; this symid reads 2"),
        ('{"format": "symid estimate", "version": 9}', "version 9 of the format; this symid reads 1"),
    ],
)
def test_other_files_are_refused(tmp_path, text, message):
    path = tmp_path / "estimate.json"
    path.write_text(text)
    with pytest.raises(EstimateError, match=message) as caught:
        read_fit(path)
    assert caught.value.notices[0].code == "estimate.format"


@pytest.mark.parametrize("kind", ["rigid", "elastic", "friction"])
def test_files_of_version_1_are_read(tmp_path, kind):
    """The files were written by symid 0.1 (commit 1eece39), which had a format for each kind."""
    old = Path(__file__).parents[3] / "data" / "fits" / f"{kind}_1.json"
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


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(EstimateError, match=r"none\.json: cannot be read: No such file"):
        read_fit(tmp_path / "none.json")


def test_bytes_are_no_text(tmp_path):
    path = tmp_path / "estimate.json"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(EstimateError, match="not a text file"):
        read_fit(path)


def test_all_that_is_wrong_is_said_at_once(tmp_path, estimate):
    path = write_fit(estimate, tmp_path / "estimate.json")
    data = json.loads(path.read_text())
    del data["rows"]
    data["colour"] = "blue"
    data["condition"] = "much"
    data["robot"] = 3
    path.write_text(json.dumps(data))
    with pytest.raises(EstimateError) as caught:
        read_fit(path)
    text = str(caught.value)
    for part in (
        "rows is missing",
        "colour is unknown",
        "expected a number, got 'much'",
        "expected text, got 3",
    ):
        assert part in text


def test_a_folder_that_does_not_exist_is_not_made(tmp_path):
    with pytest.raises(OutputError, match="cannot be written: No such file") as caught:
        write_file(tmp_path / "none" / "a.txt", "text")
    assert caught.value.notices[0].code == "output.write"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"robot": "panda"}, "identified for robot 'two_link', the robot given is 'panda'"),
        ({"joints": "asymmetric"}, r"its friction is viscous_coulomb_offset.*asymmetric"),
        ({}, "the model of robot 'two_link' has changed since"),
    ],
)
def test_an_estimate_of_another_model_says_what_differs(tmp_path, estimate, library, change, message):
    if "joints" in change:
        change = {"joints": tuple(replace(joint, friction="asymmetric") for joint in library.card.joints)}
    card = replace(library.card, signature="another", **change)
    path = write_fit(estimate, tmp_path / "estimate.json")
    with pytest.raises(EstimateError, match=message) as caught:
        read_fit(path, card)
    assert caught.value.notices[0].code == "estimate.signature"


def test_validation_counts_what_the_true_parameters_leave(library, estimate):
    recording = build_recording(library, TWO_LINK_TRUTH, seed=9, noise=(0.1, 0.1), source="unseen")
    validation = validate_estimate(estimate, library, recording, Processing(drop_first=2, drop_last=2))
    for entry, series in zip(validation.residual, validation.series, strict=True):
        assert entry.std == pytest.approx(0.1, rel=0.05)
        error = series.measured - series.predicted
        assert entry.norm == pytest.approx((error @ error) ** 0.5)
        whole = (series.measured @ series.measured) ** 0.5
        assert entry.relative_percent == pytest.approx(100 * entry.norm / whole)
    mean = sum(entry.relative_percent for entry in validation.residual) / 2
    assert validation.mean_relative_percent == pytest.approx(mean)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda data: data.update(residual=[]), "residual: expected one entry for each joint"),
        (
            lambda data: data["parameters"][0].update(value=None),
            r"parameters\[0\]\.value: expected a number, got null",
        ),
        (
            lambda data: data["residual"][0].update(norm=None),
            r"residual\[0\]\.norm: expected a number, got null",
        ),
        (lambda data: data.update(samples=None), "samples: expected a whole number, got null"),
        (lambda data: data.update(samples=-1), "samples: expected a count, got -1"),
        (lambda data: data.update(kind="stiff"), "kind: expected one of rigid, elastic, friction"),
        (lambda data: data.update(settings=[]), "settings: expected a table"),
        (lambda data: data.update(notices=[{"code": 3}]), r"notices\[0\].code: expected text, got 3"),
        (lambda data: data.update(friction=["sticky"]), "friction: expected one of none"),
        (lambda data: data.update(rows="columns"), "rows: expected one of"),
        (lambda data: data.update(condition=10**400), "condition: "),
        (lambda data: data["covariance"].pop(), "covariance: expected 12 rows of 12"),
        (lambda data: data["parameters"][0].pop("std"), r"parameters\[0\]: std is missing"),
    ],
)
def test_values_of_a_wrong_kind_are_refused(tmp_path, estimate, change, message):
    path = write_fit(estimate, tmp_path / "estimate.json")
    data = json.loads(path.read_text())
    change(data)
    path.write_text(json.dumps(data))
    with pytest.raises(EstimateError, match=message):
        read_fit(path)


@pytest.mark.parametrize("text", ["[" * 100_000, '{"format": NaN}', "1" * 5000])
def test_json_that_no_one_writes_is_refused(tmp_path, text):
    path = tmp_path / "estimate.json"
    path.write_text(text)
    with pytest.raises(EstimateError):
        read_fit(path)


def test_parameters_that_are_not_the_models_are_refused(tmp_path, estimate, library):
    first, *rest = estimate.parameters
    renamed = (replace(first, name="colour"), *rest)
    for parameters, message in ((tuple(rest), "is missing"), (renamed, "'colour' is no parameter")):
        changed = replace(estimate, parameters=parameters, covariance=())
        path = write_fit(changed, tmp_path / "estimate.json")
        with pytest.raises(EstimateError, match=message) as caught:
            read_fit(path, library.card)
        assert caught.value.notices[0].code == "estimate.parameters"
