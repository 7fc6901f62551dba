"""Limits within which files and frames of robots are taken, on both sides of each."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from adaptctl.description import Closure, Condition, Description, Joint, Link, Loops, Pose, snapped
from adaptctl.description.link import rounded
from adaptctl.description.pose import rotation_about
from adaptctl.description.reach import attachments, link_end
from adaptctl.description.readers import mjcf_scan, urdf, xml_elements
from adaptctl.description.readers.mjcf_scan import ScannedFile, _validate_few
from adaptctl.description.readers.xml_elements import number, numbers, parsed
from adaptctl.description.right_angles import near_right_angles
from adaptctl.description.writers.robot_file import _edited, _Finder, _mjcf_edit
from adaptctl.errors import InputError


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("<r><a/><a/><a/></r>", ""),
        ("<r><a/><a/><a/><a/></r>", "more than 4 elements"),
        ("<r><a/><a/><a><b/></a></r>", "<b>: more than 4 elements"),
        ("<r><a><a/></a></r>", ""),
        ("<r><a><a><a/></a></a></r>", "more than 3 nested"),
        ('<r name="12345"/>', ""),
        ('<r model="123456"/>', "at most 5 printable"),
    ],
)
def test_xml_has_so_many_elements_levels_and_letters_of_a_name(
    text: str, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, most in (("MAX_ELEMENTS", 4), ("MAX_DEPTH", 3), ("MAX_NAME_CHARACTERS", 5)):
        monkeypatch.setattr(xml_elements, name, most)
    if not told:
        assert parsed(text, "r").tag == "r"
    else:
        with pytest.raises(InputError, match=told):
            parsed(text, "r")


def test_numbers_are_so_many_so_large_and_of_so_many_letters() -> None:
    element = parsed(f'<r one="1e30" more="1.1e30" two="1 -2" long="{1.0:.4094f}" longer="{1.0:.4095f}"/>', "r")
    assert [number(element, name, "") for name in ("one", "long")] == [1e30, 1.0]
    assert numbers(element, "two", range(1, 3), "") == [1.0, -2.0]
    for name, told in (("more", "at most 1e"), ("longer", "a finite number"), ("two", "a finite number")):
        with pytest.raises(InputError, match=told):
            number(element, name, "")
    for counts, told in ((range(3, 5), "3 to 4 finite"), (3, "3 finite"), (range(1, 2), "a finite number")):
        with pytest.raises(InputError, match=f"expected {told}"):
            numbers(element, "two", counts, "")


LEAVES = '<replicate count="{}"><body/><frame><body/></frame></replicate>'


@pytest.mark.parametrize(
    ("inside", "fits"),
    [
        ("<body><freejoint/><body><frame><joint/></frame><joint/></body></body>", True),  # six and two
        ("<body><freejoint/><body><frame><joint/></frame><joint/><joint/></body></body>", False),
        ("<body><freejoint/><body><joint/></body><body><joint/><joint/></body></body>", True),  # on two branches
        (LEAVES.format("2.5"), True),  # three times two
        (LEAVES.format("3.5"), False),
        (f'<replicate count="3">{LEAVES.format("1")}</replicate>', True),
        (f'<replicate count="2">{LEAVES.format("2")}</replicate>', False),
        (f"{LEAVES.format('-1')}{LEAVES.format('2')}", True),  # a count below one is one
        ("<geom/><site/>" * 5, True),
        ("<geom/>" * 6, False),
        ("<site/>" * 6, False),
    ],
)
def test_a_scene_has_so_many_bodies_shapes_and_moving_links(
    inside: str, fits: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, most in (("MAX_LINKS", 8), ("MAX_BODIES", 6), ("MAX_GEOMS", 5)):
        monkeypatch.setattr(mjcf_scan, name, most)
    root = parsed(f"<mujoco><worldbody>{inside}</worldbody></mujoco>", "mujoco")
    if fits:
        _validate_few(root)
    else:
        with pytest.raises(InputError, match=r"9 moving links|more than [56] <(body|geom|site)> elements"):
            _validate_few(root)


def scanned(path: Path, element: str, why: str | None) -> None:
    """An element of a body is read, or refused for a reason."""
    path.write_text(f"<mujoco><worldbody><body>{element}</body></worldbody></mujoco>")
    if why is None:
        assert ScannedFile.of(path).root.tag == "mujoco"
    else:
        with pytest.raises(InputError, match=why):
            ScannedFile.of(path)


@pytest.mark.parametrize(
    ("attribute", "fits"),
    [
        ('mass="0"', True), ('mass="-1e-9"', False), ('mass="1 2"', False), ('pos="1 2"', False), ('user="nan"', True),
        ('quat="1 0 0"', False), ('fromto="0 0 0 0 0"', False), ('size="1e31"', False), ('name="-1"', True),
    ],
)  # fmt: skip
def test_attributes_of_mjcf_have_numbers_of_their_own_count(attribute: str, fits: bool, tmp_path: Path) -> None:
    scanned(tmp_path / "a.xml", f"<geom {attribute}/>", None if fits else r"expected|must not be negative")


@pytest.mark.parametrize(
    ("limits", "fits"),
    [
        ('range="1 1"', False), ('range="2 1" limited="false"', True), ('range="1 1e31"', True),
        ('actuatorfrcrange="1 1"', True), ('actuatorfrcrange="2 1"', False),
    ],
)  # fmt: skip
def test_ranges_of_mjcf_rise(limits: str, fits: bool, tmp_path: Path) -> None:
    scanned(tmp_path / "a.xml", f"<joint {limits}/>", None if fits else "expected lower < upper")


def test_a_scene_is_of_a_hundred_files(tmp_path: Path) -> None:
    """Which are included from each other, and have their elements in place of those that include them."""

    def write(name: object, *included: object) -> None:
        before = "".join(f'<include file="{one}.xml"/>' for one in included)
        body = f'<worldbody><body name="{name}"/></worldbody>'
        (tmp_path / f"{name}.xml").write_text(f"<mujoco>{before}{body}</mujoco>")

    write("leaf")
    write(0, "leaf", 1)
    for k in range(1, 99):
        write(k, *([k + 1] if k < 98 else []))
    scene = tmp_path / "0.xml"
    names = [one.get("name") for one in ScannedFile.of(scene).root.iter("body")]
    assert names == ["leaf", *map(str, range(98, -1, -1))]
    write(98, "more")
    write("more")
    with pytest.raises(InputError, match="more than 100 files"):
        ScannedFile.of(scene)


def bar(length: float, mass: float = 2.0, start: float = 0.0, name: str = "a", parent: int = -1) -> Link:
    """A bar along x whose centre is at a length, and whose joint is behind its frame by a start."""
    ten = np.array([mass, mass * length, *np.zeros(8)])
    near, far = (Pose(np.eye(3), np.array([x, 0.0, 0.0])) for x in (0.0 if parent < 0 else 0.5, start))
    return Link(name, parent, Joint(f"{name}0"), near, far, ten)


def test_a_link_ends_at_its_centre_if_its_frame_is_at_its_joint() -> None:
    assert link_end(bar(0.3))[0] == pytest.approx(0.3)
    assert link_end(bar(0.3, start=0.9e-6))[0] == pytest.approx(0.3)
    assert link_end(bar(0.3, start=1.1e-6))[0] == 0.0  # the frame is at the end
    assert link_end(replace(bar(0.3), inertia=np.zeros(10)))[0] == 0.0


@pytest.mark.parametrize(
    ("next_at", "centre", "points"),
    [(0.5, 0.2, 1), (0.5, 0.5 + 0.9e-6, 1), (0.5, 0.5 + 1.1e-6, 2), (0.9e-6, 0.2, 1), (1.1e-6, 0.2, 2)],
)
def test_a_link_ends_beyond_its_joints_or_at_the_farthest(next_at: float, centre: float, points: int) -> None:
    """To a micrometre; one whose next joint is at its own is part of a joint of several axes."""
    second = replace(bar(0.1, name="b", parent=0), parent_to_joint=Pose(np.eye(3), np.array([next_at, 0.0, 0.0])))
    first, last = attachments(Description("two", (bar(centre), second)))
    assert (len(first), len(last)) == (points, 1)
    assert last[0][0] == pytest.approx(0.1)
    assert first[0][0] == pytest.approx(next_at)


def test_frames_of_closures_are_points_of_their_links() -> None:
    at = Pose(np.eye(3), np.array([0.0, 0.7, 0.0]))
    pin = Closure("pin", "a", None, at, Pose(np.eye(3), np.array([5.0, 0.0, 0.0])))
    two = Description("two", (bar(0.3), bar(0.3, name="b")), loops=Loops(("a0",), (pin,)))
    assert [[point.tolist() for point in own] for own in attachments(two)] == [[[0.0, 0.7, 0.0]], [[0.3, 0.0, 0.0]]]


def elbow(quarter: int, miss: float) -> Description:
    """Two joints at an angle, the first along gravity."""
    turn = Pose(rotation_about((1.0, 0.0, 0.0), quarter * math.pi / 2.0 + miss), np.zeros(3))
    links = (
        Link("a", -1, Joint("one"), Pose.identity(), Pose.identity()),
        Link("b", 0, Joint("two"), turn, Pose.identity()),
    )
    return Description("elbow", links)


@pytest.mark.parametrize("quarter", [0, 1, 2])
@pytest.mark.parametrize("miss", [0.9e-3, 1.1e-3, 2e-11, 0.5e-11])
def test_an_angle_within_a_milliradian_is_nearly_right(quarter: int, miss: float) -> None:
    found = near_right_angles(elbow(quarter, -miss))
    assert len(found) == (1e-11 < miss < 1e-3)
    for one in found:
        assert (one.parent, one.child, one.degrees) == ("one", "two", 90 * quarter)
        assert one.deviation == pytest.approx(-miss if quarter else miss, rel=1e-3)
    after = near_right_angles(snapped(elbow(quarter, -miss)), exact=1e-15)
    assert not after
    assert (snapped(elbow(quarter, -miss)) == elbow(quarter, -miss)) == (miss > 1e-3)


def test_numbers_of_a_hash_are_to_twelve_places_and_of_one_zero() -> None:
    assert repr(rounded(np.array([-0.0, -4e-13, 0.6e-12, 0.1234567890126]))) == "[0.0, 0.0, 1e-12, 0.123456789013]"


@pytest.mark.parametrize(("most", "fits"), [(2, True), (1, False)])
def test_a_urdf_has_so_many_moving_links(
    most: int, fits: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Links that are fixed to others do not move by themselves."""
    monkeypatch.setattr(urdf, "MAX_LINKS", most)
    names, kinds = "abcd", ("continuous", "fixed", "continuous")
    text = "".join(f'<link name="{name}"/>' for name in names)
    for kind, parent, child in zip(kinds, names, names[1:], strict=False):
        ends = f'<parent link="{parent}"/><child link="{child}"/>'
        text += f'<joint name="{parent}{child}" type="{kind}">{ends}<axis xyz="0 0 1"/></joint>'
    (tmp_path / "a.urdf").write_text(f'<robot name="a">{text}</robot>')
    if fits:
        assert [link.name for link in urdf.read_urdf(tmp_path / "a.urdf").links] == ["b", "d"]
    else:
        with pytest.raises(InputError, match="2 moving links, above the limit of 1"):
            urdf.read_urdf(tmp_path / "a.urdf")


def test_weights_of_a_condition_stay_as_they_were_given() -> None:
    given = {"a": 1.0}
    condition = Condition("bent", given, 0.0)
    given["a"] = 2.0
    assert dict(condition.weights) == {"a": 1.0}
    with pytest.raises(TypeError):
        condition.weights["a"] = 3.0  # type: ignore[index]


@pytest.mark.parametrize(
    "body", ['<body name="b"/>', '<body name="b"><geom/></body>', '<body name="b">x<inertial a=">"/></body>']
)
def test_an_inertia_is_written_into_any_body(body: str) -> None:
    """One without content, one without an inertia, and one in place of what it has."""
    data = f"<mujoco>{body}</mujoco>".encode()
    (span,) = _Finder.spans_of(data, "body", True).values()
    found = parsed(_edited(data, [_mjcf_edit(span, b"<inertial/>")]).decode(), "mujoco")
    (own,) = found.iter("inertial")
    assert not own.attrib
    assert [one.tag for one in found.iter()] == ["mujoco", "body", "inertial", *(["geom"] if "geom" in body else [])]
