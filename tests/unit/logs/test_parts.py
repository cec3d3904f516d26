"""Parts of logs in time: how they are written, which samples they hold, which of them a fit has used."""

import math
from dataclasses import replace

import numpy as np
import pytest

from symid.errors import LogError, UsageError
from symid.logs.recording import (
    LogPart,
    Recording,
    cut_ends,
    join_units,
    read_part,
    read_parts,
    refuse_shared,
    take_part,
    take_parts,
)
from symid.logs.runs import compute_log_digests, describe_runs, get_train_unit, measure_overlap
from tests.refusals import raises

FIRST = 1700000000.0
"""Time stamps of robots often count from 1970."""


def make_recording(samples=1000, period=0.01, **more):
    values = np.random.default_rng(1).normal(size=(samples, 2))
    time = FIRST + period * np.arange(samples)
    return Recording(time=time, position=values, torque=values + 1.0, source="memory", **more)


def list_samples(recording, text):
    """Return the numbers of the first sample of a part, and of the one behind its last."""
    taken = take_part(recording, read_part(text, "--train"), "--train")
    period = (recording.time[-1] - recording.time[0]) / (len(recording.time) - 1)
    first = round((taken.time[0] - recording.time[0]) / period)
    return first, first + len(taken.time)


def test_ends_of_every_channel_are_cut_and_it_is_said_but_not_all():
    names = ("velocity", "motor_position", "reference", "feedforward")
    channels = {name: np.arange(40.0).reshape(20, 2) + k for k, name in enumerate(names)}
    extras = {"sample": np.arange(20.0), "constant": np.array([7.0])}
    whole = make_recording(20, **channels, extras=extras)
    assert cut_ends(whole, 0, 0) is whole
    cut = cut_ends(whole, 4, 1)
    for name in ("time", "position", "torque", *names):
        np.testing.assert_array_equal(getattr(cut, name), getattr(whole, name)[4:19])
    np.testing.assert_array_equal(cut.extras["sample"], np.arange(4.0, 19.0))
    np.testing.assert_array_equal(cut.extras["constant"], [7.0])
    (notice,) = cut.notices
    assert (notice.code, notice.file) == ("log.cut", "memory")
    assert "first 4 and the last 1 of 20 samples" in notice.text
    assert len(cut_ends(whole, 10, 7).time) == 3
    with raises(LogError, "log.too-short", match=r"of 20 samples leaves 2, .* 3 "):
        cut_ends(whole, 10, 8)


@pytest.mark.parametrize(
    ("text", "start", "end", "units"),
    [
        ("0:60%", 0.0, 60.0, "%%"),
        (":60%", 0.0, 60.0, "%%"),
        ("60%:", 60.0, math.inf, "%%"),
        ("20:60%", 20.0, 60.0, "%%"),
        ("20%:60", 20.0, 60.0, "%%"),
        ("2.5:30", 2.5, 30.0, "ss"),
        (" 2.5s : 3e1 s ", 2.5, 30.0, "ss"),
        ("60:", 60.0, math.inf, "ss"),
        ("5s:60%", 5.0, 60.0, "s%"),
        ((2.5, None), 2.5, math.inf, "ss"),
        ([np.float64(0.5), 4], 0.5, 4.0, "ss"),
        ((None, 4.0), 0.0, 4.0, "ss"),
    ],
)
def test_parts_are_read_and_written_again(text, start, end, units):
    part = read_part(text, "--train")
    assert (part.start, part.end, "".join(part.units)) == (start, end, units)
    again = read_part(part.text, "--train")
    assert (again.start, again.end) == (start, end)
    assert [
        mark for value, mark in zip((start, end), again.units, strict=True) if 0.0 < value < math.inf
    ] == [mark for value, mark in zip((start, end), units, strict=True) if 0.0 < value < math.inf]


@pytest.mark.parametrize(
    "given",
    [
        *("60%", "", "a:b", "-1:3", "5%:s", "0:60%:1", "60%:50%", "3:3", "0:101%", "1e400:", 60),
        *((1.0,), (1.0, 2.0, 3.0), (True, 2.0), (-1.0, 2.0), (0.0, math.inf), (math.nan, None), (3.0, 2.0)),
    ],
)
def test_what_is_no_part_is_refused(given):
    with raises(UsageError, "usage.log-part") as caught:
        read_part(given, "--train")
    assert caught.value.notices[0].text.startswith("--train")


def test_a_unit_of_one_option_is_that_of_the_other():
    train = read_parts("0:60%", "--train")
    assert join_units(train) == "%"
    assert read_part("60:", "--test", join_units(train)).text == "60%:"
    assert read_part("60s:", "--test", "%").units[0] == "s"
    assert read_part((6.0, None), "--test", "%").units[0] == "s"
    mixed = join_units(read_parts(["0:60%", "0:5s"], "--train"))
    with pytest.raises(UsageError, match="state its unit"):
        read_part("60:", "--test", mixed)
    assert isinstance(read_part("0:", "--test", mixed), LogPart)


def test_parts_of_a_log_share_no_sample_and_leave_out_none():
    """A sample at a bound is of the part behind it, whatever rounding does to time stamps."""
    for samples in (1000, 1001, 997):
        whole = make_recording(samples)
        bound = math.ceil(0.6 * samples - 1e-9)
        assert list_samples(whole, "0:60%") == (0, bound)
        assert list_samples(whole, "60%:") == (bound, samples)
    whole = make_recording()
    assert list_samples(whole, "2.5:5") == (250, 500)
    assert list_samples(whole, "5:10") == (500, 1000)
    assert list_samples(whole, "2.5s:60%") == (250, 600)
    assert list_samples(whole, ":") == (0, 1000)
    taken = take_part(whole, read_part("20:60%", "--test"), "--test")
    np.testing.assert_array_equal(taken.time, whole.time[200:600])
    np.testing.assert_array_equal(taken.torque, whole.torque[200:600])
    (notice,) = taken.notices
    assert (notice.code, notice.is_note) == ("log.cut", True)
    assert "400 of 1000 samples are used, 2 to 5.99 s" in notice.text
    cut = cut_ends(make_recording(), 100, 300)
    assert len(take_part(cut, read_part("0:60%", "--train"), "--train").time) == 500
    assert len(take_part(cut, read_part("60%:", "--train"), "--train").time) == 100


@pytest.mark.parametrize(
    ("text", "code"),
    [("20:", "log.part"), ("2:30", "log.part"), ("9.985:", "log.too-short"), ("0:0.01%", "log.too-short")],
)
def test_parts_that_the_log_lacks_are_refused(text, code):
    for option in ("--train", "--test"):
        with pytest.raises(LogError) as caught:
            take_part(make_recording(), read_part(text, option), option)
        (notice,) = caught.value.notices
        assert (notice.code, notice.file) == (code, "memory")
        assert notice.text.startswith(option)


def test_one_part_is_that_of_all_logs_or_each_has_its_own():
    logs = (make_recording(1000), make_recording(500))
    assert [len(entry.time) for entry in take_parts(logs, read_parts("0:60%", "-"), "-")] == [600, 300]
    each = read_parts(["0:2", "60%:"], "-")
    assert [len(entry.time) for entry in take_parts(logs, each, "-")] == [200, 200]
    assert take_parts(logs, (), "-") == logs
    with pytest.raises(UsageError, match="3 times"):
        take_parts(logs, read_parts(["0:2", "60%:", "0:1"], "-"), "-")
    with pytest.raises(LogError) as caught:
        take_parts(logs, read_parts("20:", "-"), "-")
    assert len(caught.value.notices) == 2
    (kept,) = take_parts([make_recording()], read_parts("0:60%", "-"), "-", keep=True)
    assert kept.run.train == "0:60%"
    with pytest.raises(UsageError, match="0:60%"):
        take_part(kept, read_part("60%:", "-"), "-")


@pytest.mark.parametrize(
    ("train", "test", "overlap"),
    [
        ("0:60%", "60%:", False),
        ("60%:", "0:60%", False),
        ("0:60%", "59%:", True),
        ("20:50%", "30:40%", True),
        ("2s:60%", "60%:", False),
        ("0:60%", "5s:", True),
        (["0:5", "5:"], ["5:", "0:5"], False),
        (["0:5", "5:"], "5:", True),
    ],
)
def test_overlaps_are_found_without_the_logs(train, test, overlap):
    parts = read_parts(train, "--train"), read_parts(test, "--test")
    if not overlap:
        refuse_shared(*parts)
        return
    with raises(UsageError, "usage.log-part"):
        refuse_shared(*parts)


def take(recording, text, **options):
    return take_parts([recording], read_parts(text, "-"), "-", **options)[0]


def test_the_seconds_that_a_fit_has_used_are_counted():
    whole = make_recording()
    digests = {
        compute_log_digests([entry])[0] for entry in (whole, take(whole, "0:60%"), take(whole, "60%:"))
    }
    assert len(digests) == 1
    assert compute_log_digests([replace(whole, torque=whole.torque + 1.0)])[0] not in digests
    settings = describe_runs([take(whole, "0:60%", keep=True)])
    assert settings["parts"] == [{"start": FIRST, "end": whole.time[599]}]
    assert get_train_unit(settings) == "%"
    for text, seconds in ((":", 6.0), ("60%:", 0.0), ("50%:", 1.0), ("10:20%", 1.0)):
        found = measure_overlap(take(whole, text), ["memory"], settings)
        assert found == pytest.approx(seconds, abs=1e-6)
    other = replace(whole, torque=whole.torque + 1.0)
    assert measure_overlap(other, ["memory"], settings) == 0.0
    settings = describe_runs([whole])
    assert "parts" not in settings
    cases = (
        ((0, 0), (0, 0), 10.0),
        ((600, 0), (0, 400), 0.0),
        ((599, 0), (0, 400), 0.01),
        ((0, 300), (50, 100), 6.5),
    )
    for cut, fitted_cut, seconds in cases:
        found = measure_overlap(whole, ["memory"], settings, cut=cut, fitted_cut=fitted_cut)
        assert found == pytest.approx(seconds, abs=1e-6)
    settings = describe_runs([take(whole, text, keep=True) for text in ("0:30%", "20:50%", "80%:")])
    assert measure_overlap(whole, [], settings) == pytest.approx(7.0, abs=1e-6)
    assert measure_overlap(take(whole, "50:80%"), [], settings) == 0.0
    digests = {"log_digests": compute_log_digests([whole])}
    for more in ({}, {"parts": None}, {"parts": [3]}, {"parts": [{"start": "x"}]}, {"parts": []}):
        assert measure_overlap(take(whole, "60%:"), [], {**digests, **more}) == pytest.approx(4.0, abs=1e-6)
