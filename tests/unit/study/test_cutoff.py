"""The table over cut-offs: too low spoils torque rows, momentum rows do not care, high ones agree."""

from symid.identification.rigid.fit import identify_parameters
from symid.robot.description import Processing
from symid.study.rigid_methods import study_cutoff
from tests.recovery.closed_form import TWO_LINK_TRUTH, build_recording, build_two_link


def test_a_clean_log_is_foretold_with_any_cutoff_that_lets_motion_pass():
    library = build_two_link()
    recording = build_recording(library, TWO_LINK_TRUTH, samples=12001, source="made", noise=(0.05, 0.02))
    told = []
    found = study_cutoff(
        library,
        recording,
        Processing(automatic=True),
        cutoffs=(20.0, 100.0, 1000.0),
        progress=lambda done, whole: told.append((done, whole)),
    )
    assert [line.cutoff for line in found.lines] == [20.0, 100.0]
    assert told == [(1, 2), (2, 2)]
    assert found.factor == 10
    for line in found.lines:
        for value in (line.decimated, line.plain, line.momentum):
            assert value < 1.0
    estimate = identify_parameters(library, [recording], Processing(automatic=True))
    assert not estimate.refused
