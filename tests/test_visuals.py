"""What links look like: read from URDF against Pinocchio's reader, and shown in the recording."""

from __future__ import annotations

import struct
import warnings
from pathlib import Path

import numpy as np
import pinocchio
import pytest
from comparisons import comparison
from nightly import mostly_at_night
from rerun.chunk import RrdReader
from robot_files import urdf

from adaptctl.description import GROUND, Description, Pose, read_urdf
from adaptctl.description.pose import NamedFrame
from adaptctl.description.readers import urdf_visuals as reader
from adaptctl.description.transforms import joined, with_floating_base
from adaptctl.description.visual import Box, Cylinder, Mesh, Sphere, Visual
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import InputError
from adaptctl.recording import scene as recorded
from adaptctl.recording.rerun_recording import write_recording

BODY = '<inertial><mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
HINGE = '<joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint>'
WELD = (
    '<joint name="weld" type="fixed"><parent link="arm"/><child link="tool"/>'
    '<origin xyz="0 0 1" rpy="0 0 1.5707963267948966"/></joint>'
)


def seen(geometry: str, rest: str = "") -> str:
    return f"<visual>{rest}<geometry>{geometry}</geometry></visual>"


def reading(folder: Path, base: str = "", arm: str = "", tool: str = "", rest: str = "") -> Description:
    links = f'<link name="base">{base}</link><link name="arm">{BODY}{arm}</link><link name="tool">{tool}</link>'
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "robot.urdf").write_text(f'<robot name="one">{rest}{links}{HINGE}{WELD}</robot>')
    return read_urdf(folder / "robot.urdf")


def stl(path: Path, triangles: int = 4) -> Path:
    """A file of that many triangles, 50 bytes each after 84."""
    corner = struct.pack("<12fH", 0, 0, 1, 0, 0, 0, 0.3, 0, 0, 0, 0.3, 0, 0)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(bytes(80) + struct.pack("<I", triangles) + corner * triangles)
    return path


@pytest.mark.filterwarnings("ignore::adaptctl.errors.SimplificationWarning")
@pytest.mark.parametrize(
    "name", mostly_at_night(["ur5_robot.urdf", "panda.urdf", "talos_reduced.urdf"], "ur5_robot.urdf")
)
def test_real_robots_look_as_pinocchio_reads_them(name: str) -> None:
    path, description = urdf(name), read_urdf(urdf(name))
    model = pinocchio.buildModelFromUrdf(str(path))
    folders = [str(folder) for folder in path.parents]
    geometry = pinocchio.buildGeomFromUrdf(model, str(path), pinocchio.GeometryType.VISUAL, None, folders)
    theirs = {}
    for item in geometry.geometryObjects:
        place = (model.names[item.parentJoint], Path(item.meshPath).name, *item.placement.translation.round(6) + 0.0)
        theirs[place] = (item.placement.rotation, item.meshScale)
    joints = {GROUND: "universe"} | dict(enumerate(description.joint_names))
    assert len(description.visuals) == len(geometry.geometryObjects) > 5
    for visual in description.visuals:
        mesh = visual.solid if isinstance(visual.solid, Mesh) else None
        place = (
            joints[visual.link],
            mesh.path.name if mesh else type(visual.solid).__name__.upper(),
            *visual.pose.translation.round(6) + 0.0,
        )
        rotation, scale = theirs[place]
        np.testing.assert_allclose(visual.pose.rotation, rotation, atol=1e-9)
        if mesh:
            np.testing.assert_allclose(mesh.scale, scale)


def test_plain_solids_sit_on_the_links_that_carry_them(tmp_path: Path) -> None:
    description = reading(
        tmp_path,
        base=seen('<box size="1 2 3"/>'),
        arm=seen('<cylinder radius="0.1" length="0.5"/>', '<origin xyz="0 0 0.25"/><material name="blue"/>'),
        tool=seen('<sphere radius="0.2"/>', '<origin xyz="1 0 0"/>'),
        rest='<material name="blue"><color rgba="0 0 1 0.5"/></material>',
    )
    box, cylinder, sphere = description.visuals
    assert (box.link, box.solid, box.color) == (GROUND, Box((1.0, 2.0, 3.0)), None)
    assert (cylinder.link, cylinder.solid, cylinder.color) == (0, Cylinder(0.1, 0.5), (0.0, 0.0, 1.0, 0.5))
    assert (sphere.link, sphere.solid) == (0, Sphere(0.2))
    np.testing.assert_allclose(cylinder.pose.translation, [0.0, 0.0, 0.25])
    np.testing.assert_allclose(sphere.pose.translation, [0.0, 1.0, 1.0], atol=1e-15)  # turned by the weld


def test_no_hash_counts_what_it_looks_like(tmp_path: Path) -> None:
    bare, dressed = reading(tmp_path), reading(tmp_path, arm=seen('<sphere radius="0.2"/>'))
    assert len(dressed.visuals) == 1
    assert bare == dressed
    assert (bare.sha256, bare.geometry_sha256) == (dressed.sha256, dressed.geometry_sha256)


@pytest.mark.parametrize(
    ("name", "place"),
    [
        ("meshes/part.stl", "arm/urdf/meshes/part.stl"),
        ("../meshes/part.STL", "arm/meshes/part.STL"),
        ("meshes/part.stl", "arm/meshes/part.stl"),
        ("package://arm/meshes/part.stl", "arm/meshes/part.stl"),
        ("package://arm/meshes/part.stl", "cell/arm/meshes/part.stl"),
        ("package://old_name/meshes/part.stl", "arm/meshes/part.stl"),
    ],
)
def test_meshes_are_found_from_the_file_upwards(name: str, place: str, tmp_path: Path) -> None:
    path = stl(tmp_path / place)
    (path.parents[1] / "package.xml").touch()
    folder = tmp_path / "cell" / "arm" / "urdf" if place.startswith("cell") else tmp_path / "arm" / "urdf"
    (visual,) = reading(folder, arm=seen(f'<mesh filename="{name}" scale="1 -2 0.001"/>')).visuals
    assert isinstance(visual.solid, Mesh)
    assert visual.solid.path.resolve() == path
    assert visual.solid.scale == (1.0, -2.0, 0.001)


def test_a_mesh_may_be_named_by_its_whole_path(tmp_path: Path) -> None:
    path = stl(tmp_path / "arm" / "part.stl")
    (visual,) = reading(tmp_path / "arm", arm=seen(f'<mesh filename="file://{path}"/>')).visuals
    assert visual.solid == Mesh(path)


@pytest.mark.parametrize("form", ["file://{path}", "{path}", "../elsewhere/part.stl", "inside.stl"])
def test_meshes_outside_the_package_are_not_read_unless_their_folder_is_named(form: str, tmp_path: Path) -> None:
    """A link within the package that leads out of it is no way around."""
    path = stl(tmp_path / "elsewhere" / "part.stl")
    (tmp_path / "arm").mkdir()
    (tmp_path / "arm" / "inside.stl").symlink_to(path)
    text = seen(f'<mesh filename="{form.format(path=path)}"/>')
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        assert reading(tmp_path / "arm", arm=text).visuals == ()
    assert [str(w.message).partition(": ")[2][:32] for w in said] == ["meshes outside the robot's packa"]
    (visual,) = read_urdf(tmp_path / "arm" / "robot.urdf", mesh_folders=[tmp_path / "elsewhere"]).visuals
    assert isinstance(visual.solid, Mesh)
    assert visual.solid.path.resolve() == path


@pytest.mark.parametrize("source", ["puma560_measured", "arm.toml", "arm.xml"])
def test_folders_of_meshes_are_for_urdf_files(source: str) -> None:
    with pytest.raises(InputError, match=rf"{source}: mesh_folders: only for URDF files, got \['meshes'\]"):
        load(source, mesh_folders=["meshes"])
    with pytest.raises(InputError, match="mesh_folders: expected a list of folders, got 'meshes'"):
        load("arm.urdf", mesh_folders="meshes")


@pytest.mark.parametrize(
    "geometry",
    [
        '<mesh filename="none.stl"/>',
        '<mesh filename="robot.urdf"/>',
        '<mesh filename="pointer.stl"/>',
        '<mesh filename="folder.stl"/>',
        '<mesh filename="https://example.org/part.stl"/>',
        '<mesh filename="part.stl" scale="1 0 1"/>',
        '<mesh filename="part.stl" scale="big"/>',
        "<mesh/>",
        '<box size="1 2"/>',
        '<box size="1 2 -3"/>',
        '<cylinder radius="nan" length="1"/>',
        '<sphere radius="0"/>',
        '<capsule radius="1" length="1"/>',
        "",
    ],
)
def test_what_cannot_be_shown_is_left_out(geometry: str, tmp_path: Path) -> None:
    stl(tmp_path / "part.stl")
    (tmp_path / "pointer.stl").write_text("version https://git-lfs.github.com/spec/v1\n")
    (tmp_path / "folder.stl").mkdir()
    assert reading(tmp_path, arm=seen(geometry)).visuals == ()
    assert reading(tmp_path, arm="<visual/>").visuals == ()


def test_large_meshes_are_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    size = stl(tmp_path / "part.stl").stat().st_size
    mesh = seen('<mesh filename="part.stl"/>')
    monkeypatch.setattr(reader, "MAX_MESH_BYTES", size)
    assert len(reading(tmp_path, arm=mesh).visuals) == 1
    monkeypatch.setattr(reader, "MAX_MESH_BYTES", size - 1)
    assert reading(tmp_path, arm=mesh).visuals == ()


def test_joined_and_floating_mechanisms_keep_their_looks(tmp_path: Path) -> None:
    arm = reading(tmp_path, base=seen('<box size="1 1 1"/>'), arm=seen('<sphere radius="0.2"/>'))
    stand = Pose(np.eye(3), np.array([0.0, 2.0, 0.0]))
    pair = joined("pair", {"left": (arm, Pose.identity()), "right": (arm, stand)})
    assert [visual.link for visual in pair.visuals] == [GROUND, 0, GROUND, 1]
    np.testing.assert_array_equal(pair.visuals[2].pose.translation, [0.0, 2.0, 0.0])
    np.testing.assert_array_equal(pair.visuals[3].pose.translation, np.zeros(3))
    for floating in (
        read_urdf(tmp_path / "robot.urdf", floating_base=True),
        with_floating_base(arm, "base", np.array([1.0, 0, 0, 0, 1, 0, 1, 0, 0, 1])),
    ):
        assert [floating.links[visual.link].name for visual in floating.visuals] == ["base", "arm"]


def test_a_visual_and_a_frame_belong_to_a_link(tmp_path: Path) -> None:
    arm = reading(tmp_path)
    for link in (-2, 1):
        with pytest.raises(InputError, match=f"one: a visual: link: expected an index from -1 to 0, got {link}"):
            Description("one", arm.links, visuals=(Visual(link, Pose.identity(), Sphere(1.0)),))
        with pytest.raises(InputError, match=f"one: frame 'tool': link: expected an index from -1 to 0, got {link}"):
            Description("one", arm.links, frames=(NamedFrame("tool", link, Pose.identity()),))


@pytest.fixture
def two_link(tmp_path: Path) -> Description:
    stl(tmp_path / "part.stl")
    return reading(
        tmp_path,
        base=seen('<box size="0.2 0.2 0.2"/>'),
        arm=seen('<mesh filename="part.stl" scale="2 2 2"/>') + seen('<cylinder radius="0.1" length="1"/>'),
    )


def drawn(description: Description, folder: Path) -> dict[str, set[str]]:
    """The archetypes of every entity of the arms and their base."""
    write_recording(folder / "recording.rrd", comparison(Mechanism(description), samples=20))
    found: dict[str, set[str]] = {}
    for chunk in RrdReader(folder / "recording.rrd").store().stream():
        if str(chunk.entity_path).startswith("/world/"):
            names = {name.partition(":")[0] for name in chunk.to_record_batch().schema.names if ":" in name}
            found.setdefault(str(chunk.entity_path), set()).update(names - {"rerun.controls.RowId"})
    return found


def test_the_recording_draws_what_the_file_shows(two_link: Description, tmp_path: Path) -> None:
    found = drawn(two_link, tmp_path)
    for arm in ("adaptive", "desired", "adaptation-off"):
        assert {"Asset3D", "Transform3D"} <= found[f"/world/{arm}/arm/visual/0"]
        assert "Cylinders3D" in found[f"/world/{arm}/arm/visual/1"]
        assert f"/world/{arm}/arm/link" not in found
        assert f"/world/{arm}/arm/joint" not in found
    assert "Boxes3D" in found["/world/base/visual/0"]


def test_capsules_take_over_where_meshes_are_gone(two_link: Description, tmp_path: Path) -> None:
    (tmp_path / "part.stl").unlink()
    found = drawn(two_link, tmp_path)
    assert "/world/adaptive/arm/joint" in found
    assert "/world/adaptive/arm/visual/0" not in found
    assert "/world/base/visual/0" in found


def test_capsules_take_over_where_meshes_are_too_large(
    two_link: Description, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    size = (tmp_path / "part.stl").stat().st_size
    monkeypatch.setattr(recorded, "MAX_MESH_BYTES", size)
    assert recorded.visuals(two_link)
    monkeypatch.setattr(recorded, "MAX_MESH_BYTES", size - 1)
    assert not recorded.visuals(two_link)
