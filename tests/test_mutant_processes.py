"""Tests on changed code run apart from what is its user's."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest
from mutant_processes import forked, run

AT_HOME = """
import os
from pathlib import Path

def test_home():
    Path("~/.profile").expanduser().touch()
    assert "XDG_CONFIG_HOME" not in os.environ
"""


def test_changed_code_writes_into_a_home_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    users, own, file = tmp_path / "users", tmp_path / "own", tmp_path / "test_home.py"
    users.mkdir()
    own.mkdir()
    monkeypatch.setenv("HOME", str(users))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(users))
    file.write_text(AT_HOME)
    assert forked(partial(run, [str(file)], [], str(own)), 20) == 0
    assert (own / ".profile").exists()
    assert not list(users.iterdir())
