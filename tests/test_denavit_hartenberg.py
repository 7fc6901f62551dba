"""Denavit-Hartenberg chains: the products of the textbooks, both conventions, and every wrong file."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adaptctl.description import Description, JointKind, Pose, read_denavit_hartenberg, to_pinocchio
from adaptctl.description.drive import Drive
from adaptctl.description.inertia import from_center_of_mass, inertia_tensor, transformed
from adaptctl.description.pose import exact_right_angles, roll_pitch_yaw, rotation_about
from adaptctl.errors import FileError

HEAD = 'schema = "adaptctl/denavit-hartenberg/1"\nconvention = "standard"\n'
PLAIN = HEAD + "links = [{ alpha = 0 }]\n"
SIX = ("xx", "xy", "yy", "xz", "yz", "zz")


def as_toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {as_toml(entry)}" for key, entry in value.items()) + " }"
    if isinstance(value, list | tuple | np.ndarray):
        return "[" + ", ".join(map(as_toml, value)) + "]"
    return f'"{value}"' if isinstance(value, str) else repr(float(value))


def reading(folder: Path, text: str) -> Description:
    (folder / "arm.toml").write_text(text)
    return read_denavit_hartenberg(folder / "arm.toml")


def chain(folder: Path, convention: str, links: list[dict[str, Any]], **more: Any) -> Description:
    top = {"schema": "adaptctl/denavit-hartenberg/1", "convention": convention, **more}
    head = "\n".join(f"{key} = {as_toml(value)}" for key, value in top.items())
    return reading(folder, f"{head}\nlinks = {as_toml(links)}\n")


def about_origin(ten: np.ndarray) -> dict[str, Any]:
    return {"mass": ten[0], "first_moment": ten[1:4], "inertia": dict(zip(SIX, ten[4:], strict=True))}


def homogeneous(pose: Pose) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = pose.rotation, pose.translation
    return matrix


def screw(axis: int, angle: float, length: float) -> np.ndarray:
    """Turn about and shift along one axis, written out."""
    c, s = math.cos(angle), math.sin(angle)
    matrix, (i, j) = np.eye(4), ((1, 2), (2, 0), (0, 1))[axis]
    matrix[i, i], matrix[i, j], matrix[j, i], matrix[j, j], matrix[axis, 3] = c, -s, s, c, length
    return matrix


def placed(description: Description, q: np.ndarray) -> list[np.ndarray]:
    """Link frames in the world, (4, 4) each, of a serial chain."""
    world, frames = np.eye(4), []
    for link, x in zip(description.links, q, strict=True):
        moved = screw(2, x, 0.0) if link.joint.kind.is_revolute else screw(2, 0.0, x)
        world = world @ homogeneous(link.parent_to_joint) @ moved @ homogeneous(link.joint_to_link)
        frames.append(world)
    return frames


angles = st.one_of(st.sampled_from([0.0, 90.0, -90.0, 180.0]), st.floats(-170.0, 170.0))
steps = st.fixed_dictionaries(
    {
        "a": st.floats(-1, 1),
        "d": st.floats(-1, 1),
        "alpha_deg": angles,
        "theta_deg": angles,
        "type": st.sampled_from(["revolute", "continuous", "prismatic"]),
    }
)
chains = st.lists(steps, min_size=1, max_size=6)


def random_inertia(rng: np.random.Generator) -> np.ndarray:
    return sum(from_center_of_mass(m, c, np.zeros((3, 3))) for m, *c in rng.uniform(0.1, 1, (5, 4)))


@settings(max_examples=20, deadline=None)
@given(steps=chains, seed=st.integers(0, 10**6), standard=st.booleans())
def test_frames_are_the_products_of_the_textbooks(
    tmp_path_factory: pytest.TempPathFactory, steps: list[dict[str, Any]], seed: int, standard: bool
) -> None:
    description = chain(tmp_path_factory.mktemp("dh"), "standard" if standard else "modified", steps)
    q = np.random.default_rng(seed).uniform(-3, 3, len(steps))
    world = np.eye(4)
    for step, x, frame in zip(steps, q, placed(description, q), strict=True):
        prismatic = step["type"] == "prismatic"
        theta = math.radians(step["theta_deg"]) + (0.0 if prismatic else x)
        along_z = screw(2, theta, step["d"] + (x if prismatic else 0.0))
        along_x = screw(0, math.radians(step["alpha_deg"]), step["a"])
        world = world @ (along_z @ along_x if standard else along_x @ along_z)
        np.testing.assert_allclose(frame, world, atol=1e-12)


@settings(max_examples=20, deadline=None)
@given(steps=chains, seed=st.integers(0, 10**6))
def test_both_conventions_give_the_same_arm(
    tmp_path_factory: pytest.TempPathFactory, steps: list[dict[str, Any]], seed: int
) -> None:
    """Frame i of the one is frame i of the other after Tx(a_i) Rx(alpha_i); a and alpha move up by a link."""
    rng, folder, n = np.random.default_rng(seed), tmp_path_factory.mktemp("dh"), len(steps)
    tens = [random_inertia(rng) for _ in steps]
    twists = [Pose(rotation_about((1, 0, 0), math.radians(s["alpha_deg"])), np.array([s["a"], 0, 0])) for s in steps]
    before = [{"a": 0.0, "alpha_deg": 0.0}, *({k: s[k] for k in ("a", "alpha_deg")} for s in steps)]
    far = [step | about_origin(ten) for step, ten in zip(steps, tens, strict=True)]
    near = [step | before[i] | about_origin(transformed(tens[i], twists[i])) for i, step in enumerate(steps)]
    standard, modified = chain(folder, "standard", far), chain(folder, "modified", near)
    q, v, a = rng.uniform(-2, 2, (3, n))
    for ours, theirs, twist in zip(placed(standard, q), placed(modified, q), twists, strict=True):
        np.testing.assert_allclose(ours, theirs @ homogeneous(twist), atol=1e-12)
    one, other = (pinocchio.rnea(m, m.createData(), q, v, a) for m in map(to_pinocchio, (standard, modified)))
    assert np.abs(one - other).max() <= 1e-12 * max(1.0, np.abs(one).max())


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10**6), turns=st.tuples(*[st.sampled_from([-180, -90, 0, 90, 180, 30])] * 3))
def test_inertia_about_the_centre_or_the_origin(
    tmp_path_factory: pytest.TempPathFactory, seed: int, turns: tuple[int, int, int]
) -> None:
    """The same body described both ways, its tensor at the centre turned by hand."""
    rng = np.random.default_rng(seed)
    mass, center, folder = rng.uniform(0.1, 5), rng.uniform(-1, 1, 3), tmp_path_factory.mktemp("dh")
    rotation = roll_pitch_yaw(np.radians(turns))
    tensor = rotation @ np.diag([0.2, 0.3, 0.4]) @ rotation.T
    entries = dict(zip(SIX, (tensor[i, j] for i, j in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))), strict=True))
    central = {"alpha": 0.0, "mass": mass, "center_of_mass": center, "inertia_at_center": entries}
    ten = chain(folder, "standard", [central]).links[0].inertia
    again = chain(folder, "standard", [{"alpha": 0.0, **about_origin(ten)}]).links[0].inertia
    np.testing.assert_allclose(again, ten, rtol=1e-15)
    x, y, z = center
    shift = mass * np.array(
        [[y * y + z * z, -x * y, -x * z], [-x * y, x * x + z * z, -y * z], [-x * z, -y * z, x * x + y * y]]
    )
    np.testing.assert_allclose(inertia_tensor(ten), tensor + shift, atol=1e-12)
    np.testing.assert_allclose(ten[:4], [mass, *(mass * center)], rtol=1e-15)


@settings(max_examples=50, deadline=None)
@given(turns=st.lists(st.integers(-8, 8), min_size=3, max_size=3))
def test_right_angles_in_degrees_are_exact(tmp_path_factory: pytest.TempPathFactory, turns: list[int]) -> None:
    steps = [{"alpha_deg": 90 * k, "theta_deg": 90 * k, "a": 0.3, "d": 0.2} for k in turns]
    for link in chain(tmp_path_factory.mktemp("dh"), "modified", steps).links:
        assert set(np.abs(link.parent_to_joint.rotation).ravel()) == {0.0, 1.0}


def test_a_twist_truly_off_is_kept() -> None:
    """The paper's tables come out of 3.1416 / 2: rounding it to a right angle would hide that."""
    off = rotation_about((1, 0, 0), 3.1416 / 2)
    assert 1e-6 < abs(off[1, 1]) < 1e-5
    np.testing.assert_array_equal(exact_right_angles(off), off)


def test_degrees_and_radians_agree(tmp_path: Path) -> None:
    degrees = chain(tmp_path, "standard", [{"alpha_deg": 30, "theta_deg": -45, "range_deg": [-90, 60]}])
    radians = {"alpha": math.radians(30), "theta": math.radians(-45), "range": [-math.pi / 2, math.radians(60)]}
    assert degrees == chain(tmp_path, "standard", [radians])


def test_names_default_to_the_place_in_the_chain(tmp_path: Path) -> None:
    named = {"alpha": 0.0, "name": "hand", "joint": "wrist"}
    description = chain(tmp_path, "standard", [{"alpha": 0.0}, named, {"alpha": 0.0}])
    assert [link.name for link in description.links] == ["link1", "hand", "link3"]
    assert [link.joint.name for link in description.links] == ["joint1", "wrist", "joint3"]
    assert description.parents == (-1, 0, 1)
    assert description.name == "arm"


def test_everything_a_file_can_say(tmp_path: Path) -> None:
    limits = {"range": [-1, 2], "velocity": 3, "effort": 4}
    drive = {"rotor_inertia": 0.5, "coulomb": 0.0}
    links = [{"alpha": 0.0, "type": "prismatic", **limits}, {"alpha": 0.0, "type": "continuous", "drive": drive}]
    base = {"xyz": [1, 2, 3], "rpy": [0, 0, math.pi / 2]}
    more = {"name": "gantry", "source": " by hand ", "gravity": [0, 9.81, 0], "base": base}
    description = chain(tmp_path, "modified", links, **more)
    slide, turn = description.links
    assert (slide.joint.kind, turn.joint.kind) == (JointKind.PRISMATIC, JointKind.CONTINUOUS)
    bounds = slide.joint.limits
    assert (bounds.lower, bounds.upper, bounds.velocity, bounds.effort) == (-1, 2, 3, 4)
    assert turn.joint.limits.upper == turn.joint.limits.velocity == turn.joint.limits.effort == math.inf
    assert (description.name, description.source) == ("gantry", "by hand")
    np.testing.assert_array_equal(description.gravity, [0, 9.81, 0])
    np.testing.assert_array_equal(slide.parent_to_joint.rotation, [[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    np.testing.assert_array_equal(slide.parent_to_joint.translation, [1, 2, 3])
    assert (slide.joint.drive, turn.joint.drive) == (Drive(), Drive(rotor_inertia=0.5, coulomb=0.0))
    np.testing.assert_array_equal(description.inertial_parameters, [*np.zeros(20), 0.5, 0.0])


INCOMPLETE = "the inertia is incomplete or given twice; give mass, first_moment and inertia"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"`schema` is missing"),
        (PLAIN.replace("/1", "/9"), r"at `\$.schema`; expected one of 'adaptctl/denavit-hartenberg/1'"),
        (
            PLAIN.replace("standard", "classic"),
            r"'classic' - at `\$.convention`; expected one of 'modified', 'standard'",
        ),
        (HEAD, r"`links` is missing"),
        (HEAD + "links = []", r"expected a list of length >= 1 - at `\$.links`"),
        (HEAD + "[[links]]\nalpha = 0\n" * 257, r"expected a list of length <= 256 - at `\$.links`"),
        (PLAIN + "grvity = [0, 0, 1]", "unknown field `grvity`; expected one of schema, convention, links, name"),
        (PLAIN.replace("alpha", "aplha"), r"unknown field `aplha` - at `\$.links\[0\]`; expected one of name, joint"),
        (HEAD + "links = [{ alpha = 0 }, {}]", r"\$.links\[1\]: alpha is missing; give alpha \(rad\) or alpha_deg"),
        (
            HEAD + "links = [{ alpha = 0, alpha_deg = 0 }]",
            r"alpha is given twice; give either alpha \(rad\) or alpha_deg",
        ),
        (HEAD + "links = [{ alpha = 0, theta = 0, theta_deg = 0 }]", "theta is given twice"),
        (HEAD + "links = [{ alpha = 'x' }]", r"expected a number, got text - at `\$.links\[0\].alpha`"),
        (HEAD + "links = [{ alpha = nan }]", r"expected a finite number, got nan - at `\$.links\[0\].alpha`"),
        (HEAD + "links = [{ alpha = 0, type = 'ball' }]", r"at `\$.links\[0\].type`; expected one of 'continuous', 'p"),
        (
            HEAD + "links = [{ alpha = 0, range = [1, 1] }]",
            r"\$.links\[0\]: position limits: expected lower < upper, got 1",
        ),
        (HEAD + "links = [{ alpha = 0, range = [1] }]", r"length 2, got 1 - at `\$.links\[0\].range`"),
        (HEAD + "links = [{ alpha = 0, range = [0, 1], range_deg = [0, 1] }]", "the range is given twice"),
        (HEAD + "links = [{ alpha = 0, range = [0, 1], type = 'continuous' }]", "a continuous joint has no range"),
        (HEAD + "links = [{ alpha = 0, range_deg = [0, 1], type = 'prismatic' }]", "write range instead of range_deg"),
        (HEAD + "links = [{ alpha = 0, velocity = 0 }]", r"expected positive velocity and effort, got 0"),
        (HEAD + "links = [{ alpha = 0, effort = -1 }]", r"expected positive velocity and effort, got inf, -1"),
        (
            HEAD + "links = [{ alpha = 0, drive = { viscous = -1 } }]",
            r"links\[0\]: viscous: expected a finite number of at least 0 .*, got -1",
        ),
        (HEAD + "links = [{ alpha = 0, drive = { damping = 1 } }]", r"unknown field `damping` - at `\$.links\[0\].dr"),
        (HEAD + "links = [{ alpha = 0, mass = 1 }]", INCOMPLETE),
        (HEAD + "links = [{ alpha = 0, inertia = {} }]", INCOMPLETE),
        (HEAD + "links = [{ alpha = 0, mass = 1, first_moment = [0, 0, 0] }]", INCOMPLETE),
        (HEAD + "links = [{ alpha = 0, mass = 1, center_of_mass = [0, 0, 0], inertia = {} }]", INCOMPLETE),
        (
            HEAD + "links = [{ alpha = 0, mass = 1, inertia = { xy = 1, yx = 1 } }]",
            r"unknown field `yx` - at `\$.links\[0\].in",
        ),
        (HEAD + "links = [{ alpha = 0, name = 'a' }, { alpha = 0, name = 'a' }]", "link names must be unique, got 'a'"),
        (
            HEAD + "links = [{ alpha = 0, joint = 'a' }, { alpha = 0, joint = 'a' }]",
            "joint names must be unique, got 'a'",
        ),
        (PLAIN + "gravity = [0, 0]", r"length 3, got 2 - at `\$.gravity`"),
        (
            PLAIN + "base = { xyz = [0, 0, 0], yaw = 1 }",
            r"unknown field `yaw` - at `\$.base`; expected one of xyz, rpy",
        ),
    ],
)
def test_wrong_files(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(FileError, match=r"arm\.toml: (?s:.*)" + message):
        reading(tmp_path, text)


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"arm\.toml: cannot be read \(no such file or directory\)"):
        read_denavit_hartenberg(tmp_path / "arm.toml")
