"""Derivations step by step."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.lessons.chapters import load_words as load_words
    from symid.lessons.derivation import Step as Step, derive_lesson as derive_lesson
    from symid.lessons.exercises import (
        AnswerSheet as AnswerSheet,
        MarkedAnswer as MarkedAnswer,
        mark_sheet as mark_sheet,
        read_sheet as read_sheet,
    )
    from symid.lessons.page import (
        MOTION_RATE as MOTION_RATE,
        LoggedMotion as LoggedMotion,
        write_lesson as write_lesson,
        write_lesson_notebook as write_lesson_notebook,
    )
    from symid.lessons.textbook import get_book as get_book
else:
    from symid.lazy import load_names

    __getattr__, __dir__, __all__ = load_names(__name__, __file__)
