"""Sentences on what logs cannot tell."""

from symid.identification.diagnostics.log_check import LogExcitation, ParameterVerdict, describe_excitation


def make(*verdicts, condition=10.0):
    parameters = tuple(
        ParameterVerdict(
            name=f"P{index}",
            verdict=verdict,
            relative_std_percent=5.0,
            reason="it acts on no torque of this log" if verdict == "refused" else "",
        )
        for index, verdict in enumerate(verdicts)
    )
    return LogExcitation(parameters=parameters, singular=(1.0, 0.1), rank=2, condition=condition)


def said(found):
    return {notice.code: notice.text for notice in describe_excitation(found)}


def test_what_a_log_does_not_tell_is_said_and_nothing_else():
    assert said(make("identifiable", "poorly identifiable")) == {}
    assert not make("identifiable", "refused").empty
    assert make("not identifiable", "refused").empty
    assert " 5e+03" in said(make("identifiable", condition=5e3))["log.condition"]
    # Refused parameters come with their reasons, faint ones are listed.
    text = said(make("identifiable", *["refused"] * 10))["log.not-excited"]
    assert text.startswith("10 of 11 ")
    assert "P1: it acts on no torque of this log" in text
    assert "; and 2 more" in text
    assert "P9" not in text
    text = said(make("identifiable", *["not identifiable"] * 9))["log.faint-parameters"]
    assert text.startswith("9 ")
    assert "P1, P2" in text
    assert ", ...)" in text
    assert "P9" not in text
