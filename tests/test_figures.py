"""Figures beside their bounds: the worst is kept, what is beyond a bound fails, and all are gathered."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from figures import FOLDER, SCHEMA, gathered, require


def test_the_worst_of_a_name_is_kept_and_all_are_gathered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(FOLDER, str(tmp_path))
    for figure in (1.0, 3.0, 2.0):
        require("b", figure, 4.0, "at most", unit="MB")
        require("a", figure, 0.5, "at least", at_least=True)
    with pytest.raises(AssertionError, match="at most: 5 MB, promised 4"):
        require("b", 5.0, 4.0, "at most", unit="MB")
    told = json.loads(gathered(tmp_path))
    assert told == {
        "schema": SCHEMA,
        "figures": [
            {"name": "a", "meaning": "at least", "unit": "1", "at_least": 0.5, "figure": 1.0},
            {"name": "b", "meaning": "at most", "unit": "MB", "at_most": 4.0, "figure": 5.0},
        ],
    }


def test_nothing_is_written_unless_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(FOLDER, raising=False)
    monkeypatch.chdir(tmp_path)
    require("a", 1.0, 2.0, "a figure")
    with pytest.raises(AssertionError):
        require("a", float("nan"), 2.0, "a figure")
    assert list(tmp_path.iterdir()) == []
