"""The torque of a known payload is taken off, of the model that it was stated for."""

import pytest

from symid.errors import LogError
from symid.identification.regression.preparation import compute_payload_torque
from symid.logs.recording import Recording, RunSettings
from tests.recovery.closed_form import TWO_LINK_TRUTH, build_signals, build_two_link


def record(load):
    signals = build_signals(build_two_link(), TWO_LINK_TRUTH, samples=101)
    run = RunSettings(file="log.npz", payload="disc", load=load)
    return signals, Recording(
        time=signals.time, position=signals.q, torque=signals.tau, source="log.npz", run=run
    )


def test_without_one_nothing_changes_and_that_of_another_model_is_refused():
    signals, recording = record(())
    assert compute_payload_torque(build_two_link(), signals, recording) is None
    signals, recording = record((1.0, 2.0))
    with pytest.raises(LogError) as caught:
        compute_payload_torque(build_two_link(), signals, recording)
    (notice,) = caught.value.notices
    assert (notice.code, notice.file) == ("log.payload-model", "log.npz")
    assert [word for word in notice.text.replace(":", "").split() if word.isdigit()] == ["2", "6"]
