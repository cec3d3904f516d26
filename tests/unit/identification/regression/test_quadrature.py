import numpy as np
import pytest

from symid.errors import UsageError
from symid.identification.regression.equations import choose_windows, integrate_windows
from tests.refusals import raises


def test_simpson_is_exact_for_cubics():
    time = np.linspace(0.0, 2.0, 41)
    windows = choose_windows(41, 0.05, 0.5)
    assert (windows.count, windows.intervals) == (4, 10)
    found = integrate_windows(np.column_stack([time**3, np.ones(41)]), windows)
    ends = time[windows.ends]
    np.testing.assert_allclose(found[:, 0], np.diff(ends**4) / 4, rtol=1e-13)
    np.testing.assert_allclose(found[:, 1], np.diff(ends), rtol=1e-13)
    # Samples that fill no window are left over.
    windows = choose_windows(100, 0.01, 0.1)
    assert windows.count == 9
    assert integrate_windows(np.ones((100, 2)), windows).shape == (9, 2)


def test_error_falls_with_the_fourth_power_of_the_period():
    errors = []
    for samples in (201, 401):
        time = np.linspace(0.0, 1.0, samples)
        total = integrate_windows(np.exp(3 * time), choose_windows(samples, time[1], 0.1)).sum()
        errors.append(abs(total - (np.exp(3) - 1) / 3))
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.05)


@pytest.mark.parametrize(
    ("length", "pieces", "words"),
    [
        *((length, 1, r"0\.02 s.*1 s") for length in (0.0, -1.0, 0.005, 100.0)),
        # Windows that overlap too much are told as they were asked for.
        (0.1, 10, r"0\.1 s.*0\.01 s.*overlap"),
    ],
)
def test_windows_that_do_not_fit_are_refused(length, pieces, words):
    with raises(UsageError, "usage.window", match=words):
        choose_windows(101, 0.01, length, pieces=pieces)
    assert choose_windows(101, 0.01, 0.4, pieces=10) == choose_windows(101, 0.01, 0.04)
