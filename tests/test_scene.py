"""What is drawn of forces and of what an arm stands on, read back from the recording."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader

from adaptctl.description import Pose
from adaptctl.dynamics import Mechanism, load
from adaptctl.recording.scene import _may_have_pedestal, log_arrows, log_base
from adaptctl.recording.skeleton import skeleton

FLOOR, REACH = -0.5, 1.2


def drawn(folder: Path, path: str, draw: Callable[[rr.RecordingStream], None]) -> dict[str, list[Any]]:
    """Columns of what is drawn at a path, by their names."""
    recording = rr.RecordingStream("test", make_default=False)
    recording.save(folder / "drawn.rrd")
    draw(recording)
    recording.flush()
    recording.disconnect()
    chunks = RrdReader(folder / "drawn.rrd").store().stream().filter(content=path)
    return {name: rows for chunk in chunks for name, rows in chunk.to_record_batch().to_pydict().items()}


def test_an_arrow_pushes_at_its_point_in_the_force_s_direction_and_share(tmp_path: Path) -> None:
    forces = np.array([[0.0, 0.0, 2.0], [0.6, 0.8, 0.0], [-4.0, 0.0, 0.0]])
    points, time = np.arange(9.0).reshape(3, 3), np.array([0.0, 0.1, 0.2])
    found = drawn(tmp_path, "/world/push", lambda rec: log_arrows(rec, "push", time, points, forces, REACH, (1, 2, 3)))
    origin, arrow = (np.array(found[f"Arrows3D:{name}"][0][0]) for name in ("origins", "vectors"))
    np.testing.assert_allclose([arrow, -origin], [[0.0, 0.0, REACH / 3.0]] * 2, rtol=1e-6)
    turns, scales = (np.array(found[f"Transform3D:{name}"])[:, 0] for name in ("quaternion", "scale"))
    x, y, z, w = turns.T
    upward = np.stack([2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)], axis=-1)
    np.testing.assert_allclose(upward * scales * arrow[2], forces * arrow[2] / 4.0, atol=1e-6)
    np.testing.assert_allclose(np.array(found["Transform3D:translation"])[:, 0], points)
    assert [at.total_seconds() for at in found["sim_time"]] == time.tolist()


def test_a_pedestal_is_between_the_floor_and_the_arm_and_has_a_wider_plate(tmp_path: Path) -> None:
    arm = load("two_link")
    found = drawn(tmp_path, "/world/base", lambda rec: log_base(rec, arm, skeleton(arm), FLOOR))
    centers, lengths, radii = (np.array(found[f"Cylinders3D:{name}"][0]) for name in ("centers", "lengths", "radii"))
    ends = centers[:, 2] + np.array([[-0.5], [0.5]]) * lengths
    np.testing.assert_allclose(ends[:, 0], [FLOOR, 0.0], atol=1e-6)
    assert ends[0, 1] == pytest.approx(FLOOR)
    assert lengths[1] < radii[0] < radii[1]


@pytest.mark.parametrize("x", [0.0, 3.0])
@pytest.mark.parametrize(("aside", "below", "hangs"), [(0.1, 0.5, True), (0.3, 0.5, False), (0.1, 0.1, False)])
def test_only_what_has_nothing_below_its_foot_stands_on_a_pedestal(
    x: float, aside: float, below: float, hangs: bool
) -> None:
    arm, foot = load("two_link").description, [x, x, 1.0]
    places = (Pose(np.eye(3), foot), Pose(np.eye(3), [aside - 0.7, 0.0, -below]))  # after 0.4 and 0.3 m
    links = (replace(link, parent_to_joint=at) for link, at in zip(arm.links, places, strict=True))
    made = Mechanism(replace(arm, links=tuple(links)))
    assert _may_have_pedestal(made, np.array([foot]), 0.2).tolist() == [not hangs]
