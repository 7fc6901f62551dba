"""Changes listed by hand, and those that mean the same, fit the code as it is."""

from __future__ import annotations

import ast
from pathlib import Path

from alike_mutants import ALIKE
from listed_mutants import LISTED
from mutant_sites import sites

ROOT = Path(__file__).parent.parent


def test_each_listed_change_has_one_place_and_tests_that_are_there() -> None:
    assert len({listed.name for listed in LISTED}) == len(LISTED)
    for listed in LISTED:
        text = (ROOT / listed.path).read_text()
        assert text.count(listed.before) == 1, listed.name
        assert listed.after != listed.before, listed.name
        ast.parse(text.replace(listed.before, listed.after))
        for test in listed.tests:
            path, _, name = test.partition("::")
            assert f"def {name}(" in (ROOT / path).read_text(), f"{listed.name}: {test}"


def test_each_change_that_means_the_same_is_one_of_the_code() -> None:
    known = {mutant.key for path in {key.partition("::")[0] for key in ALIKE} for mutant in sites(path)}
    assert set(ALIKE) <= known
