"""Runs of a sweep that fail before they begin: each by itself, and no other with it."""

from __future__ import annotations

import numpy as np
import pytest

from adaptctl.dynamics import Mechanism
from adaptctl.experiments.contest import Contender
from adaptctl.experiments.puma560_adaptive import Puma560Adaptive
from adaptctl.identifiability import FundamentalBasis
from adaptctl.sweeps.batch import batched
from adaptctl.sweeps.outcome import RunOutcome
from adaptctl.sweeps.rows import alone


class Singular(Puma560Adaptive):
    """Of whose runs some meet a singular matrix, and some numbers that are too large."""

    def contenders(self, mechanism: Mechanism, basis: FundamentalBasis) -> list[Contender]:
        if self.payload == 1.0:
            np.linalg.inv(np.zeros((2, 2)))
        if self.payload == 2.0:
            raise OverflowError("too large\nby far")
        return super().contenders(mechanism, basis)


@pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning")
@pytest.mark.parametrize(("payload", "says"), [(1.0, "Singular matrix"), (2.0, "too large by far")])
def test_what_fails_before_it_begins_fails_for_itself(payload: float, says: str) -> None:
    runs = [Singular(duration=0.05, payload=kg) for kg in (0.0, payload)]
    together = batched(runs, ("adaptive",))
    assert [(name, outcome.status) for name, outcome in together[0]] == [("adaptive", "done")]
    assert together[1] == alone(runs[1], ("adaptive",)) == [("", RunOutcome.failed(says))]
