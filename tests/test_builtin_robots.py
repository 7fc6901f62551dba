"""The built-in robots against the papers' printed numbers, and how names and paths are resolved."""

from __future__ import annotations

import math
import warnings
from pathlib import Path

import numpy as np
import pinocchio
import pytest

from adaptctl.description import Description, builtin_file, builtin_names, read, read_denavit_hartenberg, to_pinocchio
from adaptctl.errors import FileError, NotFoundError, PhysicalConsistencyWarning

PUMAS = ("puma560", "puma560_arm3", "puma560_friction", "puma560_geared", "puma560_measured")
ASSIGNED = ("semi_direct_drive", "semi_direct_drive_parallelogram")

# Table 1 of Sheu and Walker (1991): position range (rad) and velocity (rad/s) of each joint.
TABLE_1 = [
    (-2.79, 2.79, 25.13),
    (-3.93, 0.79, 35.34),
    (-0.79, 3.93, 35.34),
    (-1.92, 2.97, 26.70),
    (-1.75, 1.75, 15.71),
    (-4.64, 4.64, 41.78),
]

# Table 6: m, mc_x, mc_y, mc_z, I_x, I_y, I_z, I_xy, I_xz, I_yz by link, products of inertia +integral.
TABLE_6 = np.array(
    [
        [4.7, 14.3, 3.3, 1.25, 0.33, 0.12],
        [0, -3.232, 0, 0, 0, 0],
        [0, 0, 0, 0, 0, 0],
        [-0.324, 0.980, 0.436, 0, 0.023, 0.012],
        [0.216, 0.175, 0.171, 0.004, 0.052, 0.157],
        [0.216, 1.859, 0.174, 0.003, 0.052, 0.157],
        [0.529, 2.032, 1.590, 0.190, 0.170, 0.178],
        [0, 0, 0, 0, 0, 0],
        [0, -0.221, 0, 0, 0, 0],
        [0, 0, 0, 0, 0, 0],
    ]
).T

# Armstrong, Khatib and Burdick (1986), in modified frames: mass, centre, principal inertias about it. Of link 1
# and of link 3's tensor the assigned values, which the source of puma560_measured explains.
ARMSTRONG = [
    (13.0, (0, 0, 0), (0.35, 0.35, 0.35)),
    (17.4, (0.068, 0.006, -0.016), (0.130, 0.524, 0.539)),
    (4.8, (0, -0.070, 0.014), (0.07075, 0.01725, 0.086)),
    (0.82, (0, 0, -0.019), (1.8e-3, 1.8e-3, 1.3e-3)),
    (0.34, (0, 0, 0), (0.3e-3, 0.3e-3, 0.4e-3)),
    (0.09, (0, 0, 0.032), (0.15e-3, 0.15e-3, 0.04e-3)),
]
MODIFIED = [(0, 0, 0), (-90, 0, 0.2435), (0, 0.4318, 0.14909 - 0.2435), (90, -0.0203, 0.4331), (-90, 0, 0), (90, 0, 0)]


def quietly(name: str) -> Description:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PhysicalConsistencyWarning)
        return read(name)


def torques(description: Description, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    model = to_pinocchio(description)
    return pinocchio.rnea(model, model.createData(), q, v, a)


def test_names() -> None:
    assert {*PUMAS, *ASSIGNED} <= set(builtin_names())
    assert list(builtin_names()) == sorted(set(builtin_names()))


@pytest.mark.parametrize("name", builtin_names())
def test_every_built_in_bears_its_name_and_says_where_it_is_from(name: str) -> None:
    robot = quietly(name)
    assert robot.name == name
    assert len(robot.source) > 20 or builtin_file(name).suffix == ".xml"  # MJCF has no place for it
    assert "1986" in robot.source or name not in PUMAS
    assert "assigned" in robot.source or name not in ASSIGNED
    np.testing.assert_array_equal(robot.gravity, [0, 0, -9.81])


@pytest.mark.parametrize("name", PUMAS)
def test_geometry_and_limits_of_the_puma_560(name: str) -> None:
    """Sheu and Walker's arm; efforts are Armstrong, Khatib and Burdick's limits."""
    a, d = (0, 0.4318, -0.0203, 0, 0, 0), (0, 0.14909, 0, 0.4331, 0, 0.05625)
    twists, efforts = (-1, 0, 1, -1, 1, 0), (97.6, 186.4, 89.4, 24.2, 20.1, 21.3)
    for i, link in enumerate(quietly(name).links):
        s = twists[i]
        np.testing.assert_array_equal(link.parent_to_joint.rotation, np.eye(3))
        np.testing.assert_array_equal(link.parent_to_joint.translation, np.zeros(3))
        np.testing.assert_array_equal(link.joint_to_link.translation, [a[i], 0, d[i]])
        np.testing.assert_array_equal(link.joint_to_link.rotation, [[1, 0, 0], [0, 1 - abs(s), -s], [0, s, 1 - abs(s)]])
        limits = link.joint.limits
        assert (limits.lower, limits.upper, limits.velocity) == TABLE_1[i]
        assert limits.effort == efforts[i]


def test_puma560_has_table_6() -> None:
    """The paper's products of inertia are +integral, ours the tensor's own entries: the sign turns."""
    columns, signs = [0, 1, 2, 3, 4, 7, 5, 8, 9, 6], [1, 1, 1, 1, 1, -1, 1, -1, -1, 1]
    np.testing.assert_array_equal(quietly("puma560").inertial_parameters.reshape(6, 10), TABLE_6[:, columns] * signs)


def test_puma560_arm3_is_the_first_three_joints() -> None:
    for ours, whole in zip(quietly("puma560_arm3").links, quietly("puma560").links[:3], strict=True):
        np.testing.assert_array_equal(ours.inertia, whole.inertia)
        assert (ours.parent_to_joint, ours.joint_to_link, ours.joint.limits) == (
            whole.parent_to_joint,
            whole.joint_to_link,
            whole.joint.limits,
        )


def measured_in_modified_frames(folder: Path) -> Description:
    head = 'schema = "adaptctl/denavit-hartenberg/1"\nconvention = "modified"\n'
    steps = "".join(
        f"[[links]]\nalpha_deg = {alpha}\na = {a}\nd = {d}\nmass = {mass}\ncenter_of_mass = {list(center)}\n"
        f"inertia_at_center = {{ xx = {tensor[0]}, yy = {tensor[1]}, zz = {tensor[2]} }}\n"
        for (alpha, a, d), (mass, center, tensor) in zip(MODIFIED, ARMSTRONG, strict=True)
    )
    (folder / "armstrong.toml").write_text(head + steps)
    return read_denavit_hartenberg(folder / "armstrong.toml")


def test_measured_values_are_the_papers_own_in_its_own_frames(tmp_path: Path) -> None:
    paper, ours = measured_in_modified_frames(tmp_path), read("puma560_measured")
    for seed in range(20):
        q, v, a = np.random.default_rng(seed).uniform(-3, 3, (3, 6))
        expected = torques(paper, q, v, a)
        assert np.abs(torques(ours, q, v, a) - expected).max() <= 1e-12 * np.abs(expected).max()


def test_measured_gravity_has_the_published_constants() -> None:
    """Armstrong, Khatib and Burdick (1986), appendix: the five constants of the gravity terms (N m)."""
    g1, g2, g3, g4, g5 = -37.2, -8.44, 1.02, 2.49e-1, -2.82e-2
    for seed in range(20):
        q = np.random.default_rng(seed).uniform(-3, 3, 6)
        torque = torques(read("puma560_measured"), q, np.zeros(6), np.zeros(6))
        (s2, c2), (s23, c23) = ((math.sin(x), math.cos(x)) for x in (q[1], q[1] + q[2]))
        (s4, c4), (s5, c5) = ((math.sin(x), math.cos(x)) for x in (q[3], q[4]))
        third = g2 * s23 + g4 * c23 + g5 * (s23 * c5 + c23 * c4 * s5)
        expected = [0, g1 * c2 + g3 * s2 + third, third, -g5 * s23 * s4 * s5, g5 * (c23 * s5 + s23 * c4 * c5), 0]
        np.testing.assert_allclose(torque, expected, atol=0.06)
        np.testing.assert_allclose(torque[3:], expected[3:], atol=1e-4)


def test_link_1_matters_by_its_0_35_about_the_joint_alone() -> None:
    robot, rng = read("puma560_measured"), np.random.default_rng(0)
    bare = robot.inertial_parameters.copy()
    bare[:10] = 0.0
    q, v, a = rng.uniform(-3, 3, (3, 6))
    difference = torques(robot, q, v, a) - torques(robot.with_parameters(bare), q, v, a)
    np.testing.assert_allclose(difference, [0.35 * a[0], 0, 0, 0, 0, 0], atol=1e-12)


def test_measured_links_can_be_rigid_bodies() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert read("puma560_measured").inconsistent_links == ()


def test_rotors_and_friction_are_added_to_the_measured_arm_and_nothing_else() -> None:
    """Rotors: Armstrong, Khatib and Burdick (1986). Friction: Corke and Armstrong-Helouvry (1994), at the motors."""
    measured, geared, rubbing = (read(f"puma560_{kind}") for kind in ("measured", "geared", "friction"))
    rotors = [1.14, 4.71, 0.83, 0.2, 0.179, 0.193]
    np.testing.assert_array_equal(geared.inertial_parameters, [*measured.inertial_parameters, *rotors])
    np.testing.assert_array_equal(rubbing.inertial_parameters[:66], geared.inertial_parameters)
    gears = np.array([62.6111, 107.815, 53.7063, 76.0364, 71.923, 76.686])
    viscous = np.array([1.48, 0.817, 1.38, 0.0712, 0.0826, 0.0367]) * 1e-3
    forward = np.array([0.395, 0.126, 0.132, 0.0112, 0.00926, 0.00396])
    backward = np.array([0.435, 0.071, 0.105, 0.0169, 0.0145, 0.0105])
    expected = [*viscous * gears**2, *0.5 * (forward + backward) * gears]
    np.testing.assert_allclose(rubbing.inertial_parameters[66:], expected, rtol=5e-4)
    assert rubbing.parameter_names[60:78:6] == ("joint1.rotor_inertia", "joint1.viscous", "joint1.coulomb")


def test_puma560_says_that_it_is_not_physical() -> None:
    names = "link1, link2, link3, link4, link5"
    wanted = (
        f"puma560: physically inconsistent inertial parameters of {names}. Table 6 of Sheu and Walker .* puma560_meas"
    )
    with pytest.warns(PhysicalConsistencyWarning, match=wanted) as caught:
        robot = read("puma560")
    assert robot.inconsistent_links == tuple(names.split(", "))
    assert caught[0].filename == __file__
    assert "puma560_measured" in robot.source


def one_body(inertia: str) -> str:
    return f'schema = "adaptctl/denavit-hartenberg/1"\nconvention = "standard"\nlinks = [{{ alpha = 0, {inertia} }}]\n'


@pytest.mark.parametrize(
    "inertia",
    [
        "d = 0",
        "mass = 1, center_of_mass = [0.3, 0.2, -0.7], inertia_at_center = {}",
        "mass = 1, center_of_mass = [0.3, 0.2, -0.7], inertia_at_center = { xx = 0.1, yy = 0.1 }",
    ],
    ids=["massless", "point", "rod"],
)
def test_bodies_shrunk_to_nothing_points_or_rods_raise_no_warning(tmp_path: Path, inertia: str) -> None:
    (tmp_path / "a.toml").write_text(one_body(inertia))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read(tmp_path / "a.toml")


@pytest.mark.parametrize(
    "inertia",
    [
        "mass = 1, center_of_mass = [0, 0, 0], inertia_at_center = { xx = 1, yy = 1, zz = 2.001 }",
        "mass = 1, first_moment = [1, 0, 0], inertia = { xx = 1, yy = 1, zz = 1 }",
    ],
)
def test_bodies_that_cannot_be_raise_a_warning(tmp_path: Path, inertia: str) -> None:
    (tmp_path / "a.toml").write_text(one_body(inertia))
    with pytest.warns(PhysicalConsistencyWarning, match="a: physically inconsistent inertial parameters of link1$"):
        read(str(tmp_path / "a.toml"))


def test_files_are_read_by_their_suffix(tmp_path: Path) -> None:
    (tmp_path / "a.TOML").write_text(one_body("d = 0"))
    (tmp_path / "b.urdf").write_text(
        '<robot name="b"><link name="l0"/><link name="l1"/><joint name="j" type="continuous">'
        '<parent link="l0"/><child link="l1"/></joint></robot>'
    )
    assert read(tmp_path / "a.TOML").name == "a"
    assert read(str(tmp_path / "b.urdf")).name == "b"


@pytest.mark.parametrize("name", ["puma56", "Puma560", "puma560measured"])
def test_a_name_nearly_right_gets_a_suggestion(name: str) -> None:
    known = ", ".join(builtin_names())
    wanted = rf"unknown robot '{name}' \(did you mean 'puma560\w*'\?\); built-in: {known}"
    with pytest.raises(NotFoundError, match=wanted + r"; or a path to a file: \.toml, \.urdf"):
        read(name)


def test_a_file_nearly_right_gets_a_suggestion(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "my_arm.urdf").write_text("<robot/>")
    monkeypatch.chdir(tmp_path)
    for name in ("My_Arm.urdf", "my-arm.urdf", str(tmp_path / "my_arms.urdf")):
        with pytest.raises(FileError, match=r"no such file or directory\) \(did you mean 'my_arm\.urdf'\?\)$"):
            read(name)
    with pytest.raises(NotFoundError, match=r"unknown robot 'my_arm' \(did you mean 'my_arm\.urdf'\?\); built-in"):
        read("my_arm")
    for name in ("other.urdf", "no/my_arm.urdf", "a\0.urdf"):
        with pytest.raises(FileError, match=r"cannot be read \([^()]*\)$"):
            read(name)


@pytest.mark.parametrize("name", ["zebra", ""])
def test_an_unknown_name_lists_those_that_exist(name: str) -> None:
    with pytest.raises(
        NotFoundError, match=rf"unknown robot '{name}'; built-in: puma560, puma560_arm3, puma560_friction"
    ):
        read(name)


def test_an_unknown_suffix_lists_those_that_are_read(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"arm\.step: unknown file type '\.step'; known: \.toml, \.urdf"):
        read(tmp_path / "arm.step")
    with pytest.raises(FileError, match=r"mjcf; expand it: xacro FILE > FILE\.urdf$"):
        read(tmp_path / "arm.xacro")


def test_a_file_or_folder_without_a_suffix(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r": is a folder; give a robot file \(\.toml, \.urdf"):
        read(tmp_path)
    for name in ("arm.urdf", "arm"):
        (tmp_path / name).write_text("")
    with pytest.raises(FileError, match=r"is a folder; give a robot file, such as .*arm\.urdf \("):
        read(tmp_path)
    with pytest.raises(FileError, match=r"the file name has no suffix; expected one of \.toml, \.urdf"):
        read(tmp_path / "arm")


@pytest.mark.parametrize("name", ["arm.toml", "arm.urdf"])
def test_a_missing_file(tmp_path: Path, name: str) -> None:
    with pytest.raises(FileError, match=rf"{name}: cannot be read \(no such file or directory\)"):
        read(tmp_path / name)
