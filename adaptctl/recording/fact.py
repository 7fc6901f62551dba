"""Facts of a result: questions that a person asks first, with their answers."""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum
from typing import NamedTuple


class Whose(Enum):
    """Enumeration of what a fact in an experiment's report is about, by which the report colours it. SUBJECT is the
    simulated run that a comparison examines, BASELINE the run with adaptation off, NOBODY no single run. The value is
    the name of the report's style: "subject", "off" or, for no colour, empty."""

    SUBJECT = "subject"
    """the run that a comparison is about"""
    BASELINE = "off"
    """the same with adaptation off"""
    NOBODY = ""


class Fact(NamedTuple):
    """A fact about an experiment's result: `question`, one that a person asks first; `answer`, in words, with its unit;
    and `whose`, the run that it is about, `Whose.NOBODY` (no run by itself) unless given. Nothing is checked at
    construction."""

    question: str
    answer: str
    whose: Whose = Whose.NOBODY


def answers(facts: Iterable[Fact]) -> dict[str, str]:
    """Mapping of questions to answers, both texts, of the facts about an experiment's result, in their order; of facts
    with one question, the last counts. Nothing is raised."""
    return {fact.question: fact.answer for fact in facts}
