"""Samples that a log of a running loop keeps, overwrites and omits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from adaptctl.control import ReferencePoint
from adaptctl.errors import InputError, LostSamplesWarning
from adaptctl.simulation import RunLogger, run_logger


def test_a_log_has_room_for_its_capacity_and_tells_what_it_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    bytes_of: list[int] = []
    monkeypatch.setattr(run_logger, "_validate_memory", lambda size, capacity: bytes_of.append(size))
    log = RunLogger(2, 1e-3, estimates=3, capacity=2, flags=("a",))
    assert bytes_of == [log._rows.nbytes] == [8 * 2 * (1 + 7 * 2 + 3 + 1)]
    one = np.ones(2)

    def add(time: float, **more: Any) -> None:
        given = {"applied": 7.0 * one, "estimate": 8.0 * np.ones(3), "flags": [9.0], **more}
        log.append(time, one, 2.0 * one, ReferencePoint(3.0 * one, 4.0 * one, 5.0 * one), 6.0 * one, **given)

    add(0.1)
    with pytest.raises(InputError, match="at least 2 samples, got 1 "):
        log.rollout()
    add(0.2)
    add(0.3, flags=[np.inf])
    add(0.3, flags=[])
    assert (log.count, log.lost, log.faulty) == (2, 0, 2)
    assert log.rollout().time.tolist() == [0.1, 0.2]
    with pytest.warns(LostSamplesWarning, match="of 5 samples, 1 were overwritten and 2 omitted: `capacity` is 2"), log:
        add(0.4)
    run = log.rollout(interrupted=True)
    assert (run.time.tolist(), run.interrupted, run.flags["a"].tolist()) == ([0.2, 0.4], True, [9.0, 9.0])
    columns = (run.p, run.v, run.reference_p, run.reference_v, run.reference_a, run.torque, run.applied, run.estimate)
    assert [float(values[0, -1]) for values in columns] == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]


@pytest.mark.parametrize("given", [{"dof": 0}, {"estimates": -1}, {"capacity": 1}, {"dof": True}, {"capacity": 2.0}])
def test_a_log_has_whole_numbers_of_columns_and_rows(given: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="expected a whole number of at least"):
        RunLogger(**{"dof": 1, "control_period": 1e-3, **given})
