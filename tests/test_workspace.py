"""Where an arm may be: boxes about its frames, and links that do not meet."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from adaptctl.description import Joint, Limits
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import SimplificationWarning
from adaptctl.identification.workspace import ReachableSpace, _middle, workspace

BAR = '<collision><origin xyz="0.5 0 0"/><geometry><box size="1 0.1 0.1"/></geometry></collision>'
WALL = '<collision><origin xyz="0 1.2 0"/><geometry><box size="0.4 0.4 2"/></geometry></collision>'


def arm(folder: Path, bar: str = BAR, kind: str = "revolute", name: str = "arm.urdf") -> tuple[Mechanism, Path]:
    """An arm of one link of 1 m that turns about z beside a wall."""
    inertia = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
    (path := folder / name).write_text(
        f'<robot name="arm"><link name="base">{WALL if bar else ""}</link>'
        f'<link name="bar"><inertial><mass value="1"/>{inertia}</inertial>{bar}</link>'
        f'<joint name="a" type="{kind}"><parent link="base"/><child link="bar"/><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="2" velocity="1" effort="1"/></joint></robot>'
    )
    return load(path), path


def test_links_that_meet_are_not_allowed_if_the_file_has_their_shapes(tmp_path: Path) -> None:
    """In none of several positions."""
    found = workspace(*arm(tmp_path))
    assert found.allows(np.array([[0.0], [0.5]]))
    assert not found.allows(np.array([[0.0], [0.5 * np.pi]]))
    again = workspace(*arm(tmp_path, name="arm.URDF"))
    assert not again.allows(np.array([[0.5 * np.pi]]))


def test_without_shapes_nothing_collides(tmp_path: Path) -> None:
    assert workspace(*arm(tmp_path, bar="")).collides is None
    assert workspace(*arm(tmp_path, kind="continuous")).collides is None  # its position is a cosine and a sine there
    mechanism, path = arm(tmp_path)
    assert workspace(mechanism, path.with_suffix(".xml")).collides is None
    assert workspace(mechanism, tmp_path / "other.urdf").collides is None
    looped: Any = SimpleNamespace(description=SimpleNamespace(loops=()))
    assert workspace(looped, path).collides is None


def test_shapes_whose_files_are_missing_are_warned_of(tmp_path: Path) -> None:
    mesh = '<collision><geometry><mesh filename="nowhere.stl"/></geometry></collision>'
    mechanism, path = arm(tmp_path, bar=mesh)
    with pytest.warns(SimplificationWarning, match=r"arm\.urdf: self-collision is not checked \(.*nowhere"):
        assert workspace(mechanism, path).collides is None


@pytest.mark.parametrize(("lower", "upper", "allowed"), [(-0.1, 0.1, True), (0.01, 0.1, False), (-0.1, -0.01, False)])
def test_all_frames_are_within_the_box(lower: float, upper: float, allowed: bool, tmp_path: Path) -> None:
    mechanism, path = arm(tmp_path, bar="")
    assert workspace(mechanism, path, np.full(3, lower)).allows(np.zeros((1, 1))) == (lower <= 0.0)
    assert workspace(mechanism, path, None, np.full(3, upper)).allows(np.zeros((1, 1))) == (upper >= 0.0)
    found = ReachableSpace(mechanism, np.array([-9.0, -9.0, lower]), np.full(3, upper), None)
    assert found.allows(np.zeros((1, 1))) == allowed


def test_what_touches_in_the_middle_of_all_ranges_touches_always() -> None:
    joints = [Joint("a", limits=Limits(-1.0, 2.0)), Joint("b"), Joint("c", limits=Limits(-np.inf, 1.0))]
    mechanism: Any = SimpleNamespace(primary_joints=joints)
    np.testing.assert_array_equal(_middle(mechanism), [0.5, 0.0, 0.0])
