"""Facts of a result: questions that a person asks first, with their answers."""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum
from typing import NamedTuple


class Whose(Enum):
    """The run that a fact is about, where a page marks it by colour: SUBJECT, the one a comparison is about; BASELINE,
    the same with adaptation off; NOBODY. The value is the name of the page's style."""

    SUBJECT = "subject"
    """the run that a comparison is about"""
    BASELINE = "off"
    """the same with adaptation off"""
    NOBODY = ""


class Fact(NamedTuple):
    """Fact of a result: a question that a person asks first, its answer in words, and whose it is, nobody's unless
    given."""

    question: str
    answer: str
    whose: Whose = Whose.NOBODY


def answers(facts: Iterable[Fact]) -> dict[str, str]:
    """Answers by their questions."""
    return {fact.question: fact.answer for fact in facts}
