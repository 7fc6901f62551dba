"""Finished runs for other tools: read back, each form has the run's numbers, and gives the same estimate."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
import rerun as rr
from comparisons import comparison
from mcap.reader import make_reader
from nightly import nightly

from adaptctl.cli.main import main
from adaptctl.dynamics import load
from adaptctl.identification import identify
from adaptctl.logs.foxglove import read_mcap
from adaptctl.logs.lerobot import read_lerobot
from adaptctl.logs.parquet import read_parquet
from adaptctl.logs.rerun_recording import read_rrd
from adaptctl.recording.mcap_file import _side_by_side
from adaptctl.recording.trace import write_trace

ARM = load("two_link")
JOINTS = [joint.name for joint in ARM.primary_joints]
RUN = comparison(ARM)
ROLLOUT = RUN.subject.rollout


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run in all forms: trace.parquet, recording.mcap, set and log.rrd, and another robot's."""
    place = tmp_path_factory.mktemp("run")
    write_trace(place / "trace.parquet", RUN)
    assert main(["experiment", "convert", str(place), "--to", "mcap"]) == 0
    assert main(["experiment", "convert", str(place), str(place), "--to", "lerobot", "--out", str(place / "two")]) == 0
    assert main(["experiment", "convert", str(place), "--to", "lerobot", "--out", str(place / "set")]) == 0
    stream = rr.RecordingStream("log")
    stream.save(place / "log.rrd")
    time = rr.TimeColumn("time", duration=np.rint(1e9 * ROLLOUT.time).astype("timedelta64[ns]"))
    for kind, values in (("position", ROLLOUT.p), ("effort", ROLLOUT.applied)):
        for name, column in zip(JOINTS, values.T, strict=True):
            stream.send_columns(f"{kind}/{name}", [time], rr.Scalars.columns(scalars=column))
    stream.disconnect()
    return place


def test_each_form_has_the_run_s_numbers(written: Path) -> None:
    logs = [
        (read_parquet(written / "trace.parquet"), "p", "applied"),
        (read_mcap(written / "recording.mcap"), "position", "effort"),
        (read_lerobot(written / "set"), "position", "effort"),
        (read_rrd(written / "log.rrd"), "position", "effort"),
    ]
    for log, position, effort in logs:
        np.testing.assert_allclose(log.columns["time"], ROLLOUT.time, rtol=0.0, atol=1e-15)
        for name, p, torque in zip(JOINTS, ROLLOUT.p.T, ROLLOUT.applied.T, strict=True):
            np.testing.assert_array_equal(log.columns[f"{position}.{name}"], p)
            np.testing.assert_array_equal(log.columns[f"{effort}.{name}"], torque)
    for log, position, effort in logs[:3]:
        assert (log.units[f"{position}.{JOINTS[0]}"], log.units[f"{effort}.{JOINTS[0]}"]) == ("rad", "N m")


@nightly
def test_one_log_gives_one_estimate_in_each_form(written: Path) -> None:
    units = {"position": "rad", "torque": "N m"}
    known = {"friction": "viscous,coulomb", "cutoff": 20.0, "prior_weight": 1e-3, "trust_log": True}
    found = [
        identify(written / name, ARM, units=units if name == "log.rrd" else None, **known).mechanism  # type: ignore[arg-type]
        for name in ("trace.parquet", "recording.mcap", "set", "log.rrd")
    ]
    for one in found[1:]:
        scale = np.abs(found[0].inertial_parameters).max()
        np.testing.assert_allclose(one.inertial_parameters, found[0].inertial_parameters, rtol=0.0, atol=1e-12 * scale)


def test_mcap_has_foxglove_s_schema_and_a_layout_of_its_paths(written: Path) -> None:
    with (written / "recording.mcap").open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        assert summary is not None
        topics = {one.topic: summary.schemas[one.schema_id] for one in summary.channels.values()}
        values = {topic: json.loads(next(reader.iter_messages(topic))[2].data) for topic in topics}
        latest = {topic: next(reader.iter_messages(topic, reverse=True))[2] for topic in topics}
    assert {topics[name].name for name in ("/joint_states", "/desired_joint_states")} == {"foxglove.JointStates"}
    assert topics["/joint_states"].encoding == "jsonschema"
    assert values["/joint_states"]["joints"][0] == {
        "name": JOINTS[0],
        "position": ROLLOUT.p[0, 0],
        "velocity": ROLLOUT.v[0, 0],
        "effort": ROLLOUT.applied[0, 0],
    }
    last = {topic: json.loads(message.data) | {"log_time": message.log_time} for topic, message in latest.items()}
    kinds = {
        "/joint_states": {"position": ROLLOUT.p, "velocity": ROLLOUT.v, "effort": ROLLOUT.applied},
        "/desired_joint_states": {
            "position": ROLLOUT.reference_p,
            "velocity": ROLLOUT.reference_v,
            "acceleration": ROLLOUT.reference_a,
        },
    }
    for topic, of in kinds.items():
        for j, name in enumerate(JOINTS):
            told = {"name": name} | {field: values[-1, j] for field, values in of.items()}
            assert last[topic]["joints"][j] == told
        stamp = last[topic]["timestamp"]
        assert stamp["sec"] + 1e-9 * stamp["nsec"] == pytest.approx(ROLLOUT.time[-1], abs=1e-9)
        assert last[topic]["log_time"] == round(1e9 * ROLLOUT.time[-1])
    layout = json.loads((written / "foxglove.json").read_text())
    for panel in layout["configById"].values():
        for series in panel["paths"]:
            topic, _, rest = series["value"].partition(".")
            field = rest.rpartition(".")[2]
            found = values[topic]["joints"][int(rest[7:-1].partition("]")[0])] if "[" in rest else values[topic]
            assert isinstance(found[field], float)


@pytest.mark.parametrize("count", range(1, 8))
def test_panels_are_split_at_their_middle_by_turns_beside_and_below_each_other(count: int) -> None:
    names = [f"panel {k}" for k in range(count)]

    def leaves(tree: Any, direction: str) -> list[str]:
        if isinstance(tree, str):
            return [tree]
        assert tree["direction"] == direction
        first, second = (leaves(tree[part], "column" if direction == "row" else "row") for part in ("first", "second"))
        assert len(first) - len(second) in (0, 1)
        return first + second

    assert leaves(_side_by_side(names), "row") == names


def test_a_data_set_has_an_episode_for_each_run(written: Path) -> None:
    info = json.loads((written / "two" / "meta" / "info.json").read_text())
    count = len(ROLLOUT.time)
    assert (info["codebase_version"], info["fps"], info["total_episodes"], info["total_frames"]) == (
        "v3.0",
        500,
        2,
        2 * count,
    )
    episodes = pq.read_table(written / "two" / "meta" / "episodes" / "chunk-000" / "file-000.parquet").to_pylist()
    assert [(one["dataset_from_index"], one["dataset_to_index"]) for one in episodes] == [
        (0, count),
        (count, 2 * count),
    ]
    stats = json.loads((written / "two" / "meta" / "stats.json").read_text())
    expected = {"mean": np.mean, "std": np.std, "min": np.min, "max": np.max}
    expected |= {f"q{q:02d}": partial(np.percentile, q=q) for q in (1, 10, 50, 90, 99)}
    for name, of in expected.items():
        np.testing.assert_allclose(stats["action"][name], of(ROLLOUT.torque, axis=0), atol=1e-12)
    for i in range(2):
        table = pq.read_table(written / "two" / "data" / "chunk-000" / f"file-00{i}.parquet")
        assert set(table.column_names) == set(info["features"])
        assert table["episode_index"].unique().to_pylist() == [i]
        np.testing.assert_allclose(table["timestamp"].to_numpy(), ROLLOUT.time - ROLLOUT.time[0], atol=1e-12)
        np.testing.assert_array_equal(table["frame_index"].to_numpy(), np.arange(count))
        np.testing.assert_array_equal(table["index"].to_numpy(), np.arange(count) + i * count)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (["--to", "mcap"], "expected at least one results folder"),
        (["{0}", "--to", "mcap", "--out", "x"], "--out: MCAP is written beside each recording"),
        (["{0}", "--to", "lerobot"], "--out: expected the folder of the data set"),
        (["{0}", "--to", "lerobot", "--out", "{0}/set"], "--out: {0}/set is not empty; choose another folder"),
        (["{0}/none", "--to", "mcap"], "none/trace.parquet: does not exist"),
        (
            ["{0}", "{0}/other", "--to", "lerobot", "--out", "{0}/new"],
            "has one robot, but {0} is of two_link, and {0}/other of puma",
        ),
        (["{0}", "{0}/slow", "--to", "lerobot", "--out", "{0}/new"], "{0}/slow: 3.3 samples in a second"),
        (["{0}/empty", "--to", "mcap"], "has no samples of a run"),
        (["{0}/lacking", "--to", "mcap"], "has no samples of a run"),
        (["{0}/edited", "--to", "mcap"], "the numbers are not those that were written"),
    ],
)
def test_runs_that_cannot_be_written_are_named(
    written: Path, given: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    table = pq.read_table(written / "trace.parquet")
    unsealed = {key: value for key, value in table.schema.metadata.items() if key != b"sha256"}
    time = table.column_names.index("time")
    others = {
        "edited": table.set_column(time, table.schema.field(time), [np.arange(table.num_rows) / 2.0]),
        "lacking": table.drop_columns([f"reference_v.{JOINTS[0]}"]),
        "other": table.replace_schema_metadata(unsealed | {b"robot": b"puma"}),
        "slow": table.replace_schema_metadata(unsealed).set_column(
            time, table.schema.field(time), [np.arange(table.num_rows) / 3.3]
        ),
        "empty": table.slice(0, 0),
    }
    for name, one in others.items():
        (written / name).mkdir(exist_ok=True)
        pq.write_table(one, written / name / "trace.parquet")
    assert main(["experiment", "convert", *(word.format(written) for word in given)]) == 2
    assert says.format(written) in capsys.readouterr().err
    assert not (written / "new").exists()
