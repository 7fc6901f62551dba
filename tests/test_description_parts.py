"""Locked joints' words and loops, texts of files that are edited, and couplings of models, by hand."""

from __future__ import annotations

import io
import json
import math
import resource
from types import SimpleNamespace
from typing import Any
from xml.etree.ElementTree import fromstring

import numpy as np
import pytest

from adaptctl.description.inertia import from_center_of_mass
from adaptctl.description.locking import _ancestors, _groups, _inside, locked_words
from adaptctl.description.reach import depths
from adaptctl.description.readers import mjcf
from adaptctl.description.readers.mujoco_model import _Equalities, _rank
from adaptctl.description.readers.urdf_visuals import materials
from adaptctl.description.writers.robot_file import _about_center, _all_below, _Finder, _still_below, with_comment
from adaptctl.errors import InputError, NotFoundError


@pytest.mark.parametrize(
    ("words", "found"),
    [
        (["elbow"], {"elbow": None}),
        (["elbow=0.5", "wrist=-1"], {"elbow": 0.5, "wrist": -1.0}),
        (["elbow=0.5,wrist,j2=1e-3"], {"elbow": 0.5, "wrist": None, "j2": 1e-3}),
        ([], {}),
    ],
)
def test_words_lock_joints_at_positions_or_where_none_is_given(words: list[str], found: dict[str, Any]) -> None:
    assert locked_words(words) == found


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["elbow", "0.5"], "write elbow=0.5"),
        (["elbow=0,5"], "write elbow=0.5, with a point"),
        (["elbow=1,0,5"], "got '1,0,5'$"),
        (["elbow=up"], "got 'up'$"),
        (["elbow=1", "elbow=2"], "given twice"),
    ],
)
def test_words_that_lock_no_joint_are_told_with_what_to_write(words: list[str], told: str) -> None:
    with pytest.raises(InputError, match=told):
        locked_words(words)


@pytest.mark.parametrize(
    ("ends", "middle"),
    [((-1.0, 2.0), 0.5), ((-math.inf, 2.0), 2.0), ((1.0, math.inf), 1.0), ((-math.inf, math.inf), 0.0)],
)
def test_a_position_within_limits_is_their_middle_or_the_one_there_is(ends: tuple[float, float], middle: float) -> None:
    assert _inside(*ends) == middle


def test_loops_that_share_a_joint_or_its_leader_are_one_group() -> None:
    groups = _groups([{"a", "b"}, {"c", "d"}, {"b", "e"}, {"f"}], {"f": "c", "g": "a"})
    assert sorted(map(sorted, groups)) == [["a", "b", "e", "g"], ["c", "d", "f"]]


def test_ancestors_are_the_links_up_to_the_ground() -> None:
    links = [SimpleNamespace(name=name, parent=parent) for name, parent in (("a", -1), ("b", 0), ("c", 0), ("d", 2))]
    about: Any = SimpleNamespace(links=links)
    assert [_ancestors(about, name) for name in (None, "a", "b", "d")] == [set(), {0}, {0, 1}, {0, 2, 3}]


def test_links_held_by_joints_that_do_not_move_are_below() -> None:
    joint = '<joint name="{0}"><parent link="{1}"/><child link="{2}"/></joint>'
    pairs = [("j1", "base", "a"), ("f1", "a", "b"), ("f2", "b", "c"), ("f3", "a", "d"), ("j2", "d", "e")]
    robot = fromstring(f"<robot>{''.join(joint.format(*own) for own in pairs)}<joint name='x'/></robot>")
    below = _still_below(robot, ["j1", "j2"])
    assert below == {"a": ["b", "d"], "b": ["c"]}
    assert (_all_below(below, "a"), _all_below(below, "d")) == (["b", "c", "d"], [])


def test_a_tag_ends_behind_its_own_bracket_not_one_within_quotes() -> None:
    data = b"<a x='>\"' y=\">'\">after>"
    finder = _Finder(data, "a", True, "b")
    assert data[finder._end_of_tag(0) :] == b"after>"
    assert finder._end_of_tag(data.index(b"after")) == len(data)
    assert _Finder(b"<a x='1'", "a", True, "b")._end_of_tag(0) == 8


def test_a_comment_is_put_at_the_start_and_has_no_end_of_its_own() -> None:
    assert (
        with_comment(b"<robot a='>'><link/></robot>", "x --> y") == b"<robot a='>'>\n  <!-- x - -> y --><link/></robot>"
    )
    assert with_comment(b"<robot/>", "x") == b"<robot/>"


def test_texts_of_inertia_are_read_back_the_same() -> None:
    inertia = np.array([[0.3, 0.01, 0.02], [0.01, 0.4, 0.03], [0.02, 0.03, 0.5]])
    mass, place, six = _about_center(from_center_of_mass(3.0, np.array([0.1, -0.2, 0.3]), inertia))
    assert float(mass) == 3.0
    np.testing.assert_allclose(list(map(float, place.split())), [0.1, -0.2, 0.3], rtol=1e-15)
    np.testing.assert_allclose(list(map(float, six)), inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]], rtol=1e-12)
    assert _about_center(np.zeros(10))[:2] == ("0.0", "0.0 0.0 0.0")


@pytest.mark.parametrize(
    ("rgba", "color"),
    [
        ("0 0.5 1 1", (0.0, 0.5, 1.0, 1.0)),
        ("0 0 0 0", (0.0,) * 4),
        ("0 0 1.1 1", None),
        ("-0.1 0 1 1", None),
        ("1 1", None),
    ],
)
def test_colours_are_of_four_shares(rgba: str, color: tuple[float, ...] | None) -> None:
    robot = fromstring(f'<robot><material name="m"><color rgba="{rgba}"/></material><material name="n"/></robot>')
    assert materials(robot) == ({} if color is None else {"m": color})


@pytest.mark.parametrize(("least", "rank"), [(1.0, 3), (1e-3, 3), (1e-14, 2), (0.0, 2)])
def test_rank_is_of_singular_values_clear_of_round_off(least: float, rank: int) -> None:
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    assert _rank(turn @ np.diag([5.0, 2.0, least]) @ turn) == rank
    assert _rank(np.zeros((2, 2))) == 0


def equalities(polynomial: list[float], second: int = 1) -> Any:
    """An equality of joints a and b of a model, whose references are 0.3 and -0.2."""
    model = SimpleNamespace(
        eq_data=np.array([polynomial]), qpos0=np.array([9.0, 0.3, -0.2]), jnt_qposadr=np.array([1, 2]),
    )  # fmt: skip
    return SimpleNamespace(
        arm=SimpleNamespace(model=model),
        _named=lambda: [(0, "a"), (1, "b")],
        _ends=lambda e: [0, second],
        joints=["a", "b"],
    )


def test_a_coupling_is_linear_about_the_references_and_turned_where_its_follower_is_driven() -> None:
    """q1 - 0.3 = 0.1 + 2 (q2 + 0.2)."""
    given = equalities([0.1, 2.0, 0.0, 0.0, 0.0])
    for driven in ([], ["b"], ["a", "b"]):
        found = _Equalities._coupling(given, 0, "e", driven)
        assert (found.follower, found.leader) == ("a", "b")
        assert (found.ratio, found.offset) == pytest.approx((2.0, 0.8))
    turned = _Equalities._coupling(given, 0, "e", ["a"])
    assert (turned.follower, turned.leader) == ("b", "a")
    assert (turned.ratio, turned.offset) == pytest.approx((0.5, -0.4))


@pytest.mark.parametrize(
    ("given", "error", "told"),
    [
        (equalities([0.0, 0.0, 0.0, 0.0, 0.0]), InputError, "linear"),
        (equalities([0.0, 1.0, 0.0, 0.0, 0.1]), InputError, "linear"),
        (equalities([0.0, 1.0, 0.0, 0.0, 0.0], second=-1), InputError, "fixes joint 'a'"),
        (equalities([0.0, 1.0, 0.0, 0.0, 0.0], second=2), NotFoundError, "not part of the mechanism"),
    ],
)
def test_couplings_that_are_none_of_two_joints_are_refused(given: Any, error: type[Exception], told: str) -> None:
    with pytest.raises(error, match=told):
        _Equalities._coupling(given, 0, "e", [])


def test_depths_count_joints_from_the_ground() -> None:
    assert depths([-1, 0, 1, 0, -1, 4]) == [1, 2, 3, 2, 1, 2]


def test_meshes_are_read_within_limits_of_time_memory_and_files(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A cube of a metre and of a thousand kg: one sixth of its mass about each axis."""
    limits: dict[int, tuple[int, int]] = {}
    monkeypatch.setattr(resource, "setrlimit", limits.__setitem__)
    vertices = " ".join(f"{x} {y} {z}" for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5))
    text = f'<mujoco><asset><mesh name="m" vertex="{vertices}"/></asset><worldbody><body name="b"><joint/>'
    text += '<geom type="mesh" mesh="m"/></body></worldbody></mujoco>'
    monkeypatch.setattr("sys.stdin", io.StringIO(text))
    mjcf._serve()
    assert limits == {
        resource.RLIMIT_CPU: (mjcf.MAX_MESH_SECONDS,) * 2,
        resource.RLIMIT_AS: (mjcf.MAX_MESH_MEMORY,) * 2,
        resource.RLIMIT_FSIZE: (2**20, 2**20),
    }
    found = json.loads(capsys.readouterr().out)
    assert found["body_mass"] == pytest.approx([0.0, 1000.0])
    assert found["body_inertia"] == pytest.approx([0.0] * 3 + [1000.0 / 6.0] * 3)
