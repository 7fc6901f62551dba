"""Motions as files that robots run: CSV, and the JointTrajectory of ROS 2 as YAML and JSON."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from adaptctl.files import write_text
from adaptctl.identification.robot_motion import RobotMotion


def write_csv(path: str | Path, motion: RobotMotion, joints: Sequence[str], rate: float) -> None:
    """Write a robot's `motion` to the file `path` as CSV, sampled evenly from its start to its end at about a `rate`
    (Hz), numbers to nine digits. The columns are `time` (s), then `position.J` (rad, or m for a prismatic joint),
    `velocity.J` (rad/s, m/s) and `acceleration.J` (rad/s^2, m/s^2) of each joint J in `joints`, the names in the
    motion's order. Raises `FileError` where the file cannot be written; names and rate are not checked."""
    time, p, v, a, _ = motion.sampled(rate)
    names = [f"{what}.{joint}" for what in ("position", "velocity", "acceleration") for joint in joints]
    rows = np.column_stack([time, p, v, a])
    lines = [",".join(["time", *names]), *(",".join(f"{x:.9g}" for x in row) for row in rows.tolist())]
    write_text(path, "\n".join(lines) + "\n")


def joint_trajectory(motion: RobotMotion, joints: Sequence[str], rate: float) -> dict[str, Any]:
    """The fields of a ROS 2 trajectory_msgs/JointTrajectory message, a dict of JSON's types, of a robot's `motion`,
    sampled evenly from its start to its end at about a `rate` (Hz), numbers to nine digits. They are `header`, with a
    stamp of 0 and no frame, `joint_names`, which are `joints`, and `points`, each with `time_from_start`, 0 for the
    first (sec and nanosec), and the joints' `positions` (rad, or m for a prismatic joint), `velocities` (rad/s, m/s)
    and `accelerations` (rad/s^2, m/s^2). Names and rate are not checked."""
    time, p, v, a, _ = motion.sampled(rate)
    points = [
        {
            "positions": _rounded(p[i]),
            "velocities": _rounded(v[i]),
            "accelerations": _rounded(a[i]),
            "time_from_start": {"sec": int(t), "nanosec": min(round((t % 1.0) * 1e9), 999_999_999)},
        }
        for i, t in enumerate(time.tolist())
    ]
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    return {"header": header, "joint_names": list(joints), "points": points}


def write_trajectory(path: str | Path, motion: RobotMotion, joints: Sequence[str], rate: float) -> None:
    """Write a robot's motion, sampled evenly from its start to its end at about a `rate` (Hz), as the fields of a ROS 2
    trajectory_msgs/JointTrajectory message: as JSON to a path with the suffix .json, else as YAML, which `ros2 topic
    pub` takes. `joints` are the joints' names in the motion's order. Raises `FileError` where the file cannot be
    written; names and rate are not checked."""
    content = joint_trajectory(motion, joints, rate)
    as_json = Path(path).suffix == ".json"
    write_text(path, json.dumps(content, indent=1) + "\n" if as_json else _yaml(content))


def _yaml(content: dict[str, Any]) -> str:
    """YAML of a message's fields, with its points in the flow style, which is JSON."""
    head = {name: content[name] for name in ("header", "joint_names")}
    lines = [f"{name}: {json.dumps(value)}" for name, value in head.items()]
    return "\n".join([*lines, "points:", *(f"- {json.dumps(point)}" for point in content["points"])]) + "\n"


def _rounded(values: np.ndarray) -> list[float]:
    return [float(f"{x:.9g}") for x in values.tolist()]
