"""Lists in messages end where they get long, and say that there is more."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest

from adaptctl.cli.refusals import _some
from adaptctl.content_words import told_all
from adaptctl.control.reference_file import _place
from adaptctl.description.readers.entries import unknown_body
from adaptctl.description.readers.urdf import _listed as listed_links
from adaptctl.dynamics.plausibility import _listed as listed_faults
from adaptctl.errors import FileError
from adaptctl.markup import table


def columns(names: list[str]) -> str:
    with pytest.raises(FileError) as refused:
        _place("a.csv", names, "position", ("pos",))
    return str(refused.value)


@pytest.mark.parametrize(
    ("told", "most", "more"),
    [
        (lambda names: _some([f"--{name}" for name in names]), 12, "..."),
        (told_all, 12, "..."),
        (lambda names: unknown_body("hand", names), 20, "..."),
        (listed_links, 5, "..."),
        (lambda names: "; ".join(listed_faults(names)), 3, "and 1 more"),
        (lambda names: table(["name"], [[name] for name in names]), 60, "and 1 more"),
        (columns, 20, ""),
    ],
)
def test_a_long_list_is_cut_and_says_so(told: Callable[[list[str]], str], most: int, more: str) -> None:
    names = [f"n{k:02d}" for k in range(most + 1)]
    whole, cut = told(names[:most]), told(names)
    assert re.findall(r"\bn\d\d\b", whole) == re.findall(r"\bn\d\d\b", cut) == names[:most]
    if more:
        assert more not in whole
        assert more in cut


def test_a_message_is_two_thousand_characters_of_text_at_most() -> None:
    assert str(FileError("a\x07b\nc")) == "a\\x07b\nc"
    told = str(FileError("a" + 5000 * "x" + "z"))
    assert (len(told), told[0], told[-1], "x...x" in told) == (2000, "a", "z", True)
    assert str(FileError(2000 * "x")) == 2000 * "x"
