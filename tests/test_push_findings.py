"""What is found of a hand's push, from flags that are written by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from adaptctl.experiments.push_findings import _felt
from adaptctl.simulation import HandPush


@pytest.mark.parametrize(
    ("doubted", "felt"), [([0.0, 0.75], None), ([0.25], 0.0), ([0.5, 0.625], 0.25), ([0.1, 0.625], 0.375), ([], None)]
)
def test_a_push_is_felt_from_its_begin_until_before_its_end(doubted: list[float], felt: float | None) -> None:
    time = np.arange(9) / 8.0
    decision = np.isin(time, doubted).astype(float)
    run: Any = SimpleNamespace(rollout=SimpleNamespace(time=time, logged_state=decision[:, None]))
    assert _felt(HandPush([1.0, 0.0, 0.0], 0.25, 0.5), run) == felt
