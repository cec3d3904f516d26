"""Logs condensed within their scoring band, for diagnoses that need no choice of settings."""

from symid.codegen import Library
from symid.identification.regression import CondensedLogs, measure_scoring_band
from symid.logs.recording import Recording
from symid.robot.description import Processing


def thin(library: Library, *recordings: Recording) -> CondensedLogs:
    """Return logs at three bands up to the scoring band; positions pass ten times of it."""
    scoring, rate = measure_scoring_band(recordings), 1.0 / recordings[0].period
    bands = (0.25 * scoring, 0.5 * scoring, scoring)
    settings = Processing(automatic=True, differences="fourth-order")
    return CondensedLogs(library, recordings, settings, bands, min(10.0 * scoring, 0.4 * rate))
