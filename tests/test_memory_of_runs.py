"""What an experiment keeps in memory, and what it does where a disk has no room."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from comparisons import rollout

from adaptctl.dynamics import load
from adaptctl.errors import FileError
from adaptctl.recording import stream
from adaptctl.simulation.shared_columns import with_shared_columns

resource = pytest.importorskip("resource")


def test_columns_that_are_the_same_are_in_memory_once() -> None:
    rows = np.random.default_rng(0).normal(size=(50, 3))
    first = rollout(load("two_link"), 50, 1.0, rows)
    same = with_shared_columns(replace(first, estimate=rows[:1].repeat(50, axis=0), applied=first.torque.copy()), first)
    assert same.reference_p is first.reference_p
    assert same.applied is same.torque
    assert not np.shares_memory(same.p, first.p)
    assert same.estimate.strides[0] == 0
    np.testing.assert_array_equal(same.estimate, rows[:1].repeat(50, axis=0))
    other = with_shared_columns(replace(first, applied=0.5 * first.torque, reference_p=first.p + 1.0), first)
    assert not np.shares_memory(other.estimate, first.estimate)  # else all that was recorded stays in memory
    np.testing.assert_array_equal(other.estimate, first.estimate)
    np.testing.assert_array_equal(other.applied, 0.5 * first.torque)
    np.testing.assert_array_equal(other.reference_p, first.p + 1.0)


def test_a_recording_that_a_full_disk_stops_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (picture := tmp_path / "picture.png").write_bytes(os.urandom(2**21))
    monkeypatch.setattr(stream, "MAX_WRITING_TIME", 0.5)
    shown: stream.Recorded = SimpleNamespace(experiment="one", title="One", seed=0, complete=True)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2**20, before[1]))
    try:
        with pytest.raises(FileError, match="the disk may be full"):
            stream.write_illustrated(tmp_path / "recording.rrd", shown, "text", {"picture": picture})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert list(tmp_path.iterdir()) == [picture]
