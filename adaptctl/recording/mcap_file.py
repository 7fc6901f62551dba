"""Finished runs as MCAP files, and a layout of Foxglove that shows them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from adaptctl.files import replacing, write_json
from adaptctl.optional_packages import needed
from adaptctl.recording.finished_trace import FinishedTrace
from adaptctl.version import __version__

MCAP, LAYOUT = "recording.mcap", "foxglove.json"
STATES, DESIRED, ESTIMATE, VALUES = "/joint_states", "/desired_joint_states", "/estimate", "/values"
JOINT_STATES = "foxglove.JointStates"
POSITIONS = ((STATES, ""), (DESIRED, ", desired"))
SINGLE = ("energy", "reward", "lyapunov", "clipped")
"""columns of the channel of single values"""
NUMBER = {"type": "number"}
JOINT = {"name": {"type": "string"}, "position": NUMBER, "velocity": NUMBER, "acceleration": NUMBER, "effort": NUMBER}
STAMP = {"type": "object", "title": "time", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}}
SCHEMA = {
    "title": JOINT_STATES,
    "type": "object",
    "properties": {
        "timestamp": STAMP,
        "joints": {"type": "array", "items": {"title": "foxglove.JointState", "type": "object", "properties": JOINT}},
    },
}
"""of Foxglove, https://docs.foxglove.dev/docs/sdk/schemas/joint-states"""


def write_mcap(path: str | Path, trace: FinishedTrace) -> None:
    """
    Write a finished run as MCAP, whole or not at all: joint states by Foxglove's schema, in JSON.

    Parameters
    ----------
    path : str or Path
        Path of the file, which is replaced if it exists.
    trace : FinishedTrace
        Samples of the run.

    Raises
    ------
    FileError
        If the file cannot be written.
    MissingExtraError
        If mcap is not installed.
    """
    with needed("MCAP"):
        from mcap.writer import Writer
    channels = dict(_channels(trace))
    with replacing(path) as beside, beside.open("wb") as file:
        writer: Any = Writer(file)
        writer.start(profile="", library=f"adaptctl {__version__}")
        writer.add_metadata("adaptctl", {name: trace.entry(name) for name in ("robot", "experiment", "run", "seed")})
        topics = {topic: _registered(writer, topic, schema) for topic, (schema, _) in channels.items()}
        for i, stamp in enumerate(np.rint(1e9 * trace.time).astype(np.int64).tolist()):
            seconds, rest = divmod(stamp, 1_000_000_000)
            for topic, (_, messages) in channels.items():
                content = {"timestamp": {"sec": seconds, "nsec": rest}} | next(messages)
                writer.add_message(topics[topic], stamp, msgspec.json.encode(content), stamp, i)
        writer.finish()


def _registered(writer: Any, topic: str, schema: Mapping[str, Any]) -> int:
    """Number of a new channel."""
    data = msgspec.json.encode(schema)
    return int(writer.register_channel(topic, "json", writer.register_schema(schema["title"], "jsonschema", data)))


def _channels(trace: FinishedTrace) -> Iterator[tuple[str, tuple[Mapping[str, Any], Iterator[dict[str, Any]]]]]:
    """Schema and messages of each topic."""
    measured = {"position": "p", "velocity": "v", "effort": "applied"}
    desired = {"position": "reference_p", "velocity": "reference_v", "acceleration": "reference_a"}
    yield STATES, (SCHEMA, _states(trace, measured))
    yield DESIRED, (SCHEMA, _states(trace, desired))
    single = [name for name in SINGLE if name in trace.table.column_names]
    estimates = [f"estimate.{name}" for name in trace.names("estimate")]
    for topic, names in ((VALUES, single), (ESTIMATE, estimates)):
        if names:
            yield topic, _numbers(trace, topic, names)


def _numbers(trace: FinishedTrace, topic: str, names: list[str]) -> tuple[Mapping[str, Any], Iterator[dict[str, Any]]]:
    """Schema and messages of a topic of columns."""
    keys = [_key(name.removeprefix("estimate.")) for name in names]
    properties = {"timestamp": STAMP} | dict.fromkeys(keys, NUMBER)
    rows = np.column_stack([trace.column(name) for name in names]).tolist()
    schema = {"title": f"adaptctl{topic.replace('/', '.')}", "type": "object", "properties": properties}
    return schema, (dict(zip(keys, row, strict=True)) for row in rows)


def _key(name: str) -> str:
    """Name without points, which part the paths of Foxglove."""
    return name.replace(".", "_")


def _states(trace: FinishedTrace, kinds: Mapping[str, str]) -> Iterator[dict[str, Any]]:
    """Messages of joint states with fields from kinds of columns."""
    names, arrays = trace.names("p"), {field: trace.columns(kind) for field, kind in kinds.items()}
    for i in range(len(trace.table)):
        rows = {field: values[i].tolist() for field, values in arrays.items()}
        yield {"joints": [{"name": n} | {field: row[j] for field, row in rows.items()} for j, n in enumerate(names)]}


def write_layout(path: str | Path, trace: FinishedTrace) -> None:
    """Write a layout for Foxglove: positions over desired ones, torques, estimates and the Lyapunov function."""
    joints, keys = trace.names("p"), [*map(_key, trace.names("estimate"))]
    both = ((topic, j, name + more) for j, name in enumerate(joints) for topic, more in POSITIONS)
    plots = {
        "Position": [(f"{topic}.joints[{j}].position", name) for topic, j, name in both],
        "Torque": [(f"{STATES}.joints[{j}].effort", name) for j, name in enumerate(joints)],
        "Estimates": [(f"{ESTIMATE}.{key}", key) for key in keys],
        "Lyapunov function": [(f"{VALUES}.lyapunov", "V")] if "lyapunov" in trace.table.column_names else [],
    }
    shown = {f"Plot!{title.split()[0].lower()}": _plot(title, paths) for title, paths in plots.items() if paths}
    write_json(path, {"configById": shown, "globalVariables": {}, "userNodes": {}, "layout": _side_by_side([*shown])})


def _plot(title: str, paths: list[tuple[str, str]]) -> dict[str, Any]:
    series = [{"value": path, "label": name, "enabled": True, "timestampMethod": "receiveTime"} for path, name in paths]
    return {"foxglovePanelTitle": title, "paths": series, "xAxisVal": "timestamp", "isSynced": True, "showLegend": True}


def _side_by_side(panels: list[str], direction: str = "row") -> Any:
    """Tree of panels, each split at its middle."""
    if len(panels) == 1:
        return panels[0]
    middle, other = -(-len(panels) // 2), "column" if direction == "row" else "row"
    parts = {"first": _side_by_side(panels[:middle], other), "second": _side_by_side(panels[middle:], other)}
    return {"direction": direction, **parts}
