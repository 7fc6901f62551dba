"""What an experiment keeps in memory, and what it does where a disk has no room."""

from __future__ import annotations

import os
from pathlib import Path
from types import SimpleNamespace

import pytest

from adaptctl.errors import FileError
from adaptctl.recording import stream

resource = pytest.importorskip("resource")


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
