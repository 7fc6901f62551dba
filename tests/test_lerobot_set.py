"""Data sets of LeRobot from traces that are written by hand."""

from __future__ import annotations

import json
from pathlib import Path
from statistics import quantiles
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from adaptctl.errors import InputError
from adaptctl.recording import lerobot_set

UNITS = {"p": "rad", "v": "rad/s", "reference_p": "rad", "reference_v": "rad/s", "applied": "N m", "torque": "N m"}


def trace(run: str, rows: int, joints: int = 1, sample_time: float = 0.01, robot: str = "arm") -> Any:
    """Row k of kind i and joint j is 100 i + 10 j + k."""
    told = {"robot": robot, "geometry_sha256": "a", "experiment": "adaptive", "run": run}
    numbers = {
        kind: 100.0 * i + 10.0 * np.arange(joints) + np.arange(float(rows))[:, None] for i, kind in enumerate(UNITS)
    }
    return SimpleNamespace(
        table=range(rows),
        time=5.0 + sample_time * np.arange(rows),
        sample_time=sample_time,
        folder=Path(run),
        entry=told.__getitem__,
        columns=numbers.__getitem__,
        names=lambda kind: [f"j{j}" for j in range(joints)],
        unit=lambda name: UNITS[name.partition(".")[0]],
    )


def test_episodes_and_tasks_are_numbered_and_samples_go_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lerobot_set, "CHUNK", 2)
    lerobot_set.write_lerobot(tmp_path, [trace("off", 3), trace("on", 4), trace("off", 2)])
    places = ["data/chunk-000/file-000", "data/chunk-000/file-001", "data/chunk-001/file-000"]
    found = [pq.read_table(tmp_path / f"{place}.parquet").to_pydict() for place in places]
    for name, wanted in (
        ("index", [[0, 1, 2], [3, 4, 5, 6], [7, 8]]),
        ("frame_index", [[0, 1, 2], [0, 1, 2, 3], [0, 1]]),
        ("episode_index", [[0] * 3, [1] * 4, [2] * 2]),
        ("task_index", [[0] * 3, [1] * 4, [0] * 2]),
        ("action", [[500.0, 501.0, 502.0], [500.0, 501.0, 502.0, 503.0], [500.0, 501.0]]),
    ):
        assert [own[name] for own in found] == wanted, name
    assert found[2]["timestamp"] == pytest.approx([0.0, 0.01])
    assert found[2]["observation.state"] == [[0.0, 100.0], [1.0, 101.0]]
    episodes = pq.read_table(tmp_path / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    spans = [(one["dataset_from_index"], one["dataset_to_index"], one["length"]) for one in episodes]
    assert spans == [(0, 3, 3), (3, 7, 4), (7, 9, 2)]
    assert [(one["data/chunk_index"], one["data/file_index"]) for one in episodes] == [(0, 0), (0, 1), (1, 0)]
    assert (episodes[1]["stats/action/mean"], episodes[1]["stats/action/std"]) == ([501.5], [np.sqrt(1.25)])
    whole = json.loads((tmp_path / "meta/stats.json").read_text())["index"]
    cuts = quantiles(range(9), n=100, method="inclusive")
    for share in (1, 10, 50, 90, 99):
        assert whole[f"q{share:02d}"] == pytest.approx([cuts[share - 1]])
    assert (whole["count"], whole["min"], whole["max"]) == ([9], [0.0], [8.0])


def test_a_data_set_says_what_its_numbers_are(tmp_path: Path) -> None:
    lerobot_set.write_lerobot(tmp_path, [trace("off", 3, joints=2), trace("on", 2, joints=2)])
    info = json.loads((tmp_path / "meta/info.json").read_text())
    totals = {"total_episodes": 2, "total_frames": 5, "total_tasks": 2, "fps": 100, "chunks_size": 1000}
    assert info.items() >= (totals | {"splits": {"train": "0:2"}, "robot_type": "arm"}).items()
    state = {"names": ["j0.pos", "j1.pos", "j0.vel", "j1.vel"], "units": ["rad", "rad", "rad/s", "rad/s"]}
    assert info["features"]["observation.state"] == {"dtype": "float64", "shape": [4], **state}
    assert {tuple(info["features"][name]["shape"]) for name in ("timestamp", "index", "task_index")} == {(1,)}
    actions = pq.read_table(tmp_path / "data/chunk-000/file-001.parquet").column("action").to_pylist()
    assert actions == [[500.0, 510.0], [501.0, 511.0]]


@pytest.mark.parametrize(
    ("other", "told"),
    [
        (trace("on", 2, sample_time=0.01 * (1.0 + 5e-7)), ""),
        (trace("on", 2, sample_time=0.01 * (1.0 + 1.5e-6)), "on: 99.9999 samples in a second"),
        (trace("on", 2, robot="hand"), "off is of arm, and on of hand"),
    ],
)
def test_runs_of_a_data_set_have_one_robot_and_one_rate(other: Any, told: str) -> None:
    if told:
        with pytest.raises(InputError, match=told):
            lerobot_set._common([trace("off", 2), other])
    else:
        assert lerobot_set._common([trace("off", 2), other]) == 100
