"""Our TOML of any mechanism: everything a file can say, and every wrong one."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from adaptctl.description import ClosureKind, Description, JointKind, Limits, Pose, read, read_mechanism_file
from adaptctl.description.pose import FrameKind, NamedFrame, roll_pitch_yaw
from adaptctl.description.writers.mechanism_file import _rpy, mechanism_toml
from adaptctl.dynamics import load
from adaptctl.errors import FileError, InputError, LoopError, NotFoundError, SimplificationWarning

HEAD = 'schema = "adaptctl/mechanism/1"\n'
TREE = HEAD + 'links = [{ name = "a", joint = "one" }, { name = "b", parent = "a", joint = "two" }]\n'
GEARED = TREE + 'couplings = [{ follower = "two", leader = "one", ratio = -2 }]\n'
CLOSED = (
    TREE
    + 'primary = ["one"]\n'
    + 'closures = [{ name = "c", first = { link = "b", position = [1, 0, 0] }, second = { position = [1, 0, 0] } }]\n'
)

EVERYTHING = """
schema = "adaptctl/mechanism/1"
name = "crank"
source = " by hand "
gravity = [0, -9.81, 0]
primary = ["crank", "spare"]
reference = { crank = 0.5, slide = 0.1 }

# Out of order on purpose: a link's parent may come after it.
[[links]]
name = "rod"
joint = "pin"
parent = "wheel"
position = [0.2, 0, 0]
mass = 2
first_moment = [0.3, 0, 0]
inertia = { xx = 0.1, yy = 0.2, zz = 0.2, xy = 0.01 }

[[links]]
name = "wheel"
joint = "crank"
range_deg = [-90, 180]
velocity = 3
effort = 4
rpy_deg = [0, 0, 90]
far = { position = [0, 0, 0.1], rpy = [0.1, 0.2, 0.3] }

[[links]]
name = "piston"
joint = "slide"
type = "prismatic"
axis = [2, 0, 0]
range = [-1, 1]

[[links]]
name = "extra"
joint = "spare"
type = "continuous"
parent = "piston"
rpy = [0.4, 0.5, 0.6]

[[closures]]
name = "wrist"
kind = "axis"
first = { link = "rod", position = [0.5, 0, 0], rpy_deg = [90, 0, 0] }
second = { link = "piston" }

[[closures]]
name = "stop"
first = { position = [0, 0, 1] }
second = { link = "extra" }

[[couplings]]
follower = "slide"
leader = "spare"
ratio = 0.5
offset = 0.25

[[conditions]]
name = "ahead"
weights = { crank = 1, spare = -2 }
lower = -1

[[frames]]
name = "tool"
link = "piston"
position = [0, 0, 0.1]
rpy_deg = [0, 0, 90]

[[frames]]
name = "camera"
kind = "sensor"
"""


def reading(folder: Path, text: str) -> Description:
    (folder / "m.toml").write_text(text)
    return read_mechanism_file(folder / "m.toml")


def test_links_joints_and_frames(tmp_path: Path) -> None:
    crank = reading(tmp_path, EVERYTHING)
    assert (crank.name, crank.source, crank.gravity.tolist()) == ("crank", "by hand", [0, -9.81, 0])
    assert [link.name for link in crank.links] == ["wheel", "rod", "piston", "extra"]
    assert crank.parents == (-1, 0, -1, 2)
    wheel, rod, piston, extra = crank.links
    assert wheel.joint.kind is JointKind.REVOLUTE
    assert piston.joint.kind is JointKind.PRISMATIC
    assert extra.joint.kind is JointKind.CONTINUOUS
    limits = wheel.joint.limits
    assert (limits.lower, limits.upper, limits.velocity, limits.effort) == (-math.pi / 2, math.pi, 3, 4)
    np.testing.assert_array_equal(wheel.parent_to_joint.rotation, [[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    assert wheel.joint_to_link == Pose(roll_pitch_yaw([0.1, 0.2, 0.3]), np.array([0, 0, 0.1]))
    assert extra.parent_to_joint == Pose(roll_pitch_yaw([0.4, 0.5, 0.6]), np.zeros(3))
    np.testing.assert_array_equal(rod.parent_to_joint.translation, [0.2, 0, 0])
    np.testing.assert_array_equal(piston.joint.axis, [1, 0, 0])
    np.testing.assert_array_equal(rod.inertia, [2, 0.3, 0, 0, 0.1, 0.01, 0.2, 0, 0, 0.2])
    np.testing.assert_array_equal(wheel.inertia, np.zeros(10))


def test_closures_couplings_and_conditions(tmp_path: Path) -> None:
    loops = reading(tmp_path, EVERYTHING).loops
    assert loops is not None
    assert loops.primary == ("crank", "spare")
    assert dict(loops.reference) == {"crank": 0.5, "slide": 0.1}
    wrist, stop = loops.closures
    assert (wrist.name, wrist.first, wrist.second, wrist.kind) == ("wrist", "rod", "piston", ClosureKind.AXIS)
    assert wrist.first_frame == Pose(roll_pitch_yaw([math.pi / 2, 0, 0]), np.array([0.5, 0, 0]))
    assert wrist.second_frame == Pose.identity()
    assert (stop.first, stop.second, stop.kind) == (None, "extra", ClosureKind.POINT)
    (coupling,) = loops.couplings
    assert (coupling.name, coupling.ratio, coupling.offset) == ("slide follows spare", 0.5, 0.25)
    (condition,) = loops.conditions
    assert (condition.name, dict(condition.weights)) == ("ahead", {"crank": 1.0, "spare": -2.0})
    assert (condition.lower, condition.upper) == (-1.0, math.inf)


def test_named_frames(tmp_path: Path) -> None:
    tool, camera = reading(tmp_path, EVERYTHING).frames
    assert tool == NamedFrame("tool", 2, Pose(roll_pitch_yaw([0, 0, math.pi / 2]), (0, 0, 0.1)))
    assert camera == NamedFrame("camera", -1, Pose.identity(), FrameKind.SENSOR)


def test_limits_of_one_side(tmp_path: Path) -> None:
    limits = reading(tmp_path, TREE.replace('joint = "two"', "lower = -0.5, effort = 3")).links[1].joint.limits
    assert limits == Limits(lower=-0.5, effort=3.0)
    assert reading(tmp_path, TREE.replace('joint = "two"', "upper = 0")).links[1].joint.limits == Limits(upper=0.0)
    both = reading(tmp_path, TREE.replace('joint = "two"', "lower = 1, upper = 2")).links[1].joint.limits
    assert both == Limits(1.0, 2.0)


def with_limits(description: Description, kind: JointKind, limits: Limits) -> Description:
    first, *others = description.links
    moved = replace(first, joint=replace(first.joint, kind=kind, limits=limits))
    return replace(description, links=(moved, *others))


def test_everything_is_written_and_read_back(tmp_path: Path) -> None:
    crank = reading(tmp_path, EVERYTHING)
    again = reading(tmp_path, mechanism_toml(crank))
    assert again.geometry_sha256 == crank.geometry_sha256
    assert [link.joint.limits for link in again.links] == [link.joint.limits for link in crank.links]
    assert again.frames == crank.frames


@pytest.mark.parametrize("limits", [Limits(lower=0.0), Limits(upper=-1.0, velocity=2.0), Limits(-1.0, 1.0), Limits()])
def test_limits_are_written_and_read_back(tmp_path: Path, limits: Limits) -> None:
    tree = with_limits(reading(tmp_path, TREE), JointKind.PRISMATIC, limits)
    assert reading(tmp_path, mechanism_toml(tree)).links[0].joint.limits == limits


def test_what_a_file_cannot_say_is_not_written(tmp_path: Path) -> None:
    tree = reading(tmp_path, TREE)
    for limits in (Limits(-1.0, 1.0), Limits(upper=1.0)):
        with pytest.raises(InputError, match=r"m: joint 'one' is continuous, but has position limits from .* to 1\.0"):
            mechanism_toml(with_limits(tree, JointKind.CONTINUOUS, limits))


POINT = "mass = 1, center_of_mass = [0, 0, 0], inertia_at_center = {}"


def test_a_massless_link_owns_no_parameters(tmp_path: Path) -> None:
    tree = reading(tmp_path, TREE.replace('name = "a"', 'name = "a", massless = true', 1))
    assert [link.massless for link in tree.links] == [True, False]
    assert len(tree.parameter_names) == 10
    with pytest.raises(FileError, match=r"\$\.links\[0\]: link 'a': inertia: expected zero for a massless link"):
        reading(tmp_path, TREE.replace('name = "a"', f'name = "a", massless = true, {POINT}', 1))


def test_names_default_to_the_place_in_the_file(tmp_path: Path) -> None:
    tree = reading(tmp_path, HEAD + 'links = [{}, { parent = "link1" }, { name = "end", parent = "link2" }]\n')
    assert [link.name for link in tree.links] == ["link1", "link2", "end"]
    assert tree.joint_names == ("joint1", "joint2", "joint3")
    assert (tree.name, tree.loops) == ("m", None)


def test_what_follows_no_other_joint_is_primary_unless_said(tmp_path: Path) -> None:
    loops = reading(tmp_path, GEARED).loops
    assert loops is not None
    assert loops.primary == ("one",)


def test_a_file_is_read_by_the_schema_it_names(tmp_path: Path) -> None:
    (tmp_path / "tree.toml").write_text(TREE)
    (tmp_path / "chain.toml").write_text(
        'schema = "adaptctl/denavit-hartenberg/1"\nconvention = "standard"\nlinks = [{ alpha = 0, a = 1 }]\n'
    )
    assert read(tmp_path / "tree.toml").links[1].parent == 0
    np.testing.assert_array_equal(read(tmp_path / "chain.toml").links[0].joint_to_link.translation, [1, 0, 0])
    (tmp_path / "wrong.toml").write_text(TREE.replace("mechanism/1", "mechanism/9"))
    wanted = r"wrong\.toml: Invalid .* at `\$.schema`; expected one of 'adaptctl/denavit-h.*', 'adaptctl/mechanism/1'"
    with pytest.raises(FileError, match=wanted):
        read(tmp_path / "wrong.toml")


def test_the_same_tree_from_both_formats(tmp_path: Path) -> None:
    """A frame at the far end is a `far` pose here and a step of Denavit and Hartenberg there."""
    body = "mass = 1, center_of_mass = [0.1, 0.2, 0.3], inertia_at_center = { xx = 1, yy = 1.5, zz = 2, xz = 0.1 }"
    (tmp_path / "same.toml").write_text(
        f"{HEAD}links = [{{ far = {{ position = [0.4, 0, 0.2], rpy_deg = [90, 0, 0] }}, {body} }}]\n"
    )
    (tmp_path / "chain").mkdir()
    (tmp_path / "chain" / "same.toml").write_text(
        'schema = "adaptctl/denavit-hartenberg/1"\nconvention = "standard"\n'
        f"links = [{{ a = 0.4, d = 0.2, alpha_deg = 90, {body} }}]\n"
    )
    assert read(tmp_path / "same.toml") == read(tmp_path / "chain" / "same.toml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"`schema` is missing"),
        (HEAD, r"`links` is missing"),
        (HEAD + "links = []", r"length >= 1 - at `\$.links`"),
        (HEAD + "[[links]]\n" * 257, r"length <= 256 - at `\$.links`"),
        (TREE + "grvity = [0, 0, 1]", "unknown field `grvity`; expected one of schema, links, name, source, gravity"),
        (TREE.replace("parent", "parnt"), r"unknown field `parnt` - at `\$.links\[1\]`; expected one of name, joint"),
        (TREE.replace('parent = "a"', 'parent = "c"'), r"\$.links\[1\] \(b\): parent: unknown link 'c'; links: a, b;"),
        (TREE.replace('parent = "a"', 'parent = "b"'), "link 'b' is not connected to the ground"),
        (TREE.replace('name = "b"', 'name = "a"'), r"\$.links\[0\]: the name 'a' is given more than once"),
        (TREE.replace('joint = "two"', 'joint = "one"'), "joint names must be unique, got 'one'"),
        (TREE.replace('name = "b"', 'name = ""'), r"length >= 1 - at `\$.links\[1\].name`"),
        (
            TREE.replace('joint = "two"', "axis = [0, 0, 0]"),
            r"\$.links\[1\]: joint 'joint2': axis: expected a vector other than zero",
        ),
        (TREE.replace('joint = "two"', "rpy = [0, 0, 0], rpy_deg = [0, 0, 0]"), r"\$.links\[1\]: rpy is given twice"),
        (TREE.replace('joint = "two"', "position = [0, 0, inf]"), r"finite number, got inf - at `\$.links\[1\].pos"),
        (TREE.replace('joint = "two"', "mass = 1"), r"\$.links\[1\]: the inertia is incomplete"),
        (TREE.replace('joint = "two"', 'type = "ball"'), r"'ball' - at `\$.links\[1\].type`; expected one of 'cont"),
        (
            TREE.replace('joint = "two"', "lower = 1, upper = 0"),
            r"\$.links\[1\]: position limits: expected lower < upper",
        ),
        (TREE.replace('joint = "two"', "lower = 1, range_deg = [0, 1]"), r"\$.links\[1\]: the range is given twice"),
        (TREE.replace('joint = "two"', 'upper = 1, type = "continuous"'), "a continuous joint has no range"),
        (TREE + 'frames = [{ name = "f", link = "z" }]', r"\$.frames\[0\]: unknown link 'z'; links: a, b"),
        (
            TREE + 'frames = [{ name = "f", kind = "x" }]',
            r"`\$.frames\[0\].kind`; expected one of 'body', 'fixed joint'",
        ),
        (TREE + 'primary = ["one"]', r"\$.primary: used only with closures or couplings"),
        (TREE + "reference = { one = 1 }", r"\$.reference: used only with closures"),
        (GEARED.replace('leader = "one"', 'leader = "on"'), "unknown joint 'on'; joints: one, two"),
        (
            GEARED.replace("ratio = -2", "ratio = 0"),
            r"\$.couplings\[0\]: coupling 'two follows one': expected a finite",
        ),
        (GEARED.replace('leader = "one"', 'leader = "two"'), r"\$.couplings\[0\]: .* joint 'two' cannot follow itself"),
        (GEARED + 'primary = ["two"]', "joint 'two' is a follower and cannot be primary"),
        (GEARED + 'primary = ["three"]', "primary: unknown joint 'three'; joints: one, two"),
        (GEARED + "reference = { three = 1 }", "reference: unknown joint 'three'; joints: one, two"),
        (
            GEARED.replace("ratio = -2 }", 'ratio = -2 }, { follower = "one", leader = "two" }'),
            "joint 'two' follows 'one', but its leaders follow in a ring",
        ),
        (CLOSED.replace('primary = ["one"]', ""), r"\$.primary is missing; name the driven joints among one, two"),
        (CLOSED.replace('link = "b"', 'link = "z"'), "c: unknown link 'z'; links: a, b"),
        (
            CLOSED.replace("second = {", 'second = { link = "b",'),
            r"\$.closures\[0\]: .* expected two different links, got b twice",
        ),
        (CLOSED.replace("first = {", 'kind = "ball", first = {'), r"at `\$.closures\[0\].kind`; expected one of"),
        (
            CLOSED.replace("second = {", "second = { rpy = [0, 0, 0], rpy_deg = [0, 0, 0],"),
            r"\$.closures\[0\]: second: rpy is given twice",
        ),
        (
            CLOSED + 'conditions = [{ name = "x", weights = { two = 1 }, lower = 0 }]',
            "condition 'x': joint 'two' is not primary",
        ),
        (
            CLOSED + 'conditions = [{ name = "x", weights = { one = 1 }, lower = 1, upper = 1 }]',
            r"\$.conditions\[0\]: condition 'x': expected lower < upper",
        ),
        (
            CLOSED + 'conditions = [{ name = "x", weights = {}, lower = 1 }]',
            r"\$.conditions\[0\]: condition 'x': expected finite weights of at least one joint",
        ),
        (
            CLOSED.replace("]\n", "]\n", 1) + 'couplings = [{ name = "c", follower = "two", leader = "one" }]',
            "closure or coupling 'c' is given more than once",
        ),
    ],
)
def test_wrong_files(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(FileError, match=r"m\.toml: (?s:.*)" + message):
        reading(tmp_path, text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            CLOSED.replace("second = { position = [1,", "second = { position = [3,"),
            "m: closure 'c' cannot close at the",
        ),
        (
            CLOSED.replace('parent = "a"', 'parent = "a", position = [1, 0, 0]')
            .replace('link = "b", position = [1, 0, 0]', 'link = "b"')
            .replace('name = "c"', 'name = "c", kind = "weld"'),
            "m: the mechanism is locked: 2 constraints fix all 2 joints",
        ),
    ],
)
def test_loops_that_cannot_be_are_refused_when_loaded(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "m.toml").write_text(text)
    with pytest.raises(LoopError, match=r"m\.toml: " + message):
        load(tmp_path / "m.toml")


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"none\.toml: cannot be read \(no such file or directory\)"):
        read(tmp_path / "none.toml")
    with pytest.raises(NotFoundError, match="semi_direct_drive"):
        read("semi_direct_driv")


@pytest.mark.parametrize("pitch", [0.3, -1.2, 0.5 * np.pi, -0.5 * np.pi])
@pytest.mark.parametrize(("roll", "yaw"), [(0.0, 0.0), (0.4, -2.5), (-3.0, 1.0)])
def test_written_angles_turn_as_the_matrix_does(roll: float, pitch: float, yaw: float) -> None:
    """By SciPy's rotations; where the pitch is a right angle, the yaw is zero."""
    R = Rotation.from_euler("xyz", (roll, pitch, yaw)).as_matrix()
    found = _rpy(R)
    np.testing.assert_allclose(Rotation.from_euler("xyz", found).as_matrix(), R, rtol=0, atol=1e-12)
    assert abs(pitch) < 1.5 or found[2] == 0.0


@pytest.mark.parametrize("angles", ["rpy = [0, 90, 0]", "far = { rpy = [0, 0, -90] }"])
def test_angles_of_more_than_a_turn_are_named_by_their_link(angles: str, tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(TREE.replace('joint = "two"', f'joint = "two", {angles}'))
    with pytest.warns(SimplificationWarning, match=r"rpy of \$.links\[1\]"):
        read_mechanism_file(tmp_path / "a.toml")
