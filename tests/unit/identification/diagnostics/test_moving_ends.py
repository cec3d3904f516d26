"""Logs that begin or end in motion are named, with the samples to cut; cut, they give the truth."""

from dataclasses import replace

import numpy as np

from symid.identification.diagnostics.fit_warnings import warn_of_moving_ends
from symid.identification.rigid.fit import identify_parameters
from symid.logs.recording import Recording
from symid.robot.description import Processing
from tests.recovery.closed_form import TWO_LINK_TRUTH, build_recording, build_two_link

PROCESSING = Processing(filter_cutoff=40.0)


def find(estimate):
    return [notice.text for notice in estimate.notices if notice.code == "identify.moving-ends"]


def test_a_log_cut_out_of_a_motion_is_named_and_the_advice_helps():
    library = build_two_link()
    recording = build_recording(library, TWO_LINK_TRUTH, samples=4001)
    names = tuple(entry.name for entry in (*library.card.beta, *library.card.friction))
    whole = identify_parameters(library, [recording], PROCESSING)
    (text,) = find(whole)
    assert " begins and ends " in text
    cut = {
        word.split("=")[0].removeprefix("processing."): int(word.split("=")[1])
        for word in text.split()
        if word.startswith("processing.")
    }
    assert cut == dict.fromkeys(("drop_first", "drop_last"), round(2.0 / 40.0 / recording.period))
    advised = identify_parameters(library, [recording], replace(PROCESSING, **cut))
    assert find(advised) == []
    errors = [np.abs(estimate.assemble(names) - TWO_LINK_TRUTH).max() for estimate in (whole, advised)]
    assert errors[1] < 0.3 * errors[0]


def test_ends_at_rest_are_not_named():
    time = 1e-3 * np.arange(5001)
    # From rest to rest, and a joint that never moves.
    position = np.column_stack([np.sin(3.0 * np.sin(np.pi * time / 5.0) ** 2), np.zeros(len(time))])
    recording = Recording(time=time, position=position, torque=np.zeros_like(position), source="log.npz")
    assert warn_of_moving_ends(PROCESSING, [recording]) == ()
    half = slice(0, 2000)
    cut = replace(recording, time=time[half], position=position[half], torque=recording.torque[half])
    (notice,) = warn_of_moving_ends(PROCESSING, [recording, cut])
    assert " ends " in notice.text
    assert " begins " not in notice.text
    assert warn_of_moving_ends(replace(PROCESSING, drop_last=50), [cut]) == ()


def test_without_a_filter_there_is_nothing_to_say():
    recording = build_recording(build_two_link(), TWO_LINK_TRUTH, samples=2001)
    assert warn_of_moving_ends(Processing(), [recording]) == ()
