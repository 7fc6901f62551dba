"""Fixtures of more than one file."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """MuJoCo writes its warnings into a file where it runs."""
    here = Path.cwd()
    os.chdir(tmp_path_factory.mktemp("mujoco"))
    yield
    os.chdir(here)
