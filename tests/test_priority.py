"""Priority tables: the three ways to write one, and what is wrong with the rest."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_trees import random_tree

from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import FileError, InputError, NotFoundError
from adaptctl.identifiability import Priority, essential_space, fundamental_basis
from adaptctl.identifiability.priority import KINDS, suggestion

HEAD = 'schema = "adaptctl/priority/1"\n'


@pytest.fixture(scope="module")
def puma() -> Mechanism:
    return load("puma560_measured")


def reading(folder: Path, text: str, mechanism: Mechanism) -> Priority:
    (folder / "priority.toml").write_text(HEAD + text)
    return Priority.read(folder / "priority.toml", mechanism)


def ordered(priority: Priority, mechanism: Mechanism) -> list[str]:
    names = mechanism.parameter_names
    return [names[i] for i in priority.indices(names)]


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 9))
def test_the_default_goes_kind_by_kind_and_link_by_link(seed: int, links: int) -> None:
    mechanism = random_tree(seed, links)
    names = ordered(Priority.default(mechanism), mechanism)
    assert names == [f"{link.name}.{kind}" for kind in KINDS for link in mechanism.links]
    assert names == ordered(Priority(), mechanism)


@settings(max_examples=25, deadline=None)
@given(st.permutations(range(60)), st.integers(0, 60), st.integers(0, 60))
def test_what_is_not_named_follows_in_the_default_order(permutation: list[int], a: int, b: int) -> None:
    mechanism = load("puma560_measured")
    names = [mechanism.parameter_names[i] for i in permutation]
    first, last = sorted((a, b))
    order, keep, rest = names[:first], names[last:], set(names[first:last])
    default = ordered(Priority(), mechanism)
    result = ordered(Priority(tuple(order), tuple(keep)), mechanism)
    assert result == [*order, *(name for name in default if name in rest), *reversed(keep)]


def test_friction_has_no_priority(puma: Mechanism, tmp_path: Path) -> None:
    """Rotors come last by default; friction, which energies never find, is not in the order at all."""
    links = [replace(link, joint=replace(link.joint, drive=Drive(0.2, 1.0, 0.5))) for link in puma.links]
    geared = Mechanism(replace(puma.description, links=tuple(links)))
    order = Priority.default(geared).order
    assert order[:60] == Priority.default(puma).order
    assert order[60:] == tuple(f"joint{i}.rotor_inertia" for i in range(1, 7))
    space = essential_space(geared)
    assert "link1.I_yy" not in fundamental_basis(space).names
    # The first rotor turns with the first link: either will do. The third one nothing can stand for.
    rotors = reading(tmp_path, 'order = ["joint1.rotor_inertia", "joint3.rotor_inertia"]', geared)
    kept = set(fundamental_basis(space, rotors).names)
    assert {"link1.I_yy", "joint3.rotor_inertia"} <= kept
    assert "joint1.rotor_inertia" not in kept
    with pytest.raises(FileError, match=r"unknown parameter 'joint1\.viscous'"):
        reading(tmp_path, 'order = ["joint1.viscous"]', geared)


def test_by_parameter(puma: Mechanism, tmp_path: Path) -> None:
    names = ordered(reading(tmp_path, 'order = ["link3.I_z", "link1.m"]\nkeep = ["link6.m", "link5.m"]', puma), puma)
    assert names[:3] == ["link3.I_zz", "link1.m", "link2.m"]
    assert names[-2:] == ["link5.m", "link6.m"]
    assert sorted(names) == sorted(puma.parameter_names)
    assert ordered(reading(tmp_path, 'keep = ["link4.m"]', puma), puma)[-1] == "link4.m"


def test_by_kinds_and_links(puma: Mechanism, tmp_path: Path) -> None:
    names = ordered(reading(tmp_path, 'kinds = ["I_x", "m"]\nlinks = ["link6", "link2"]', puma), puma)
    assert names[:5] == ["link6.I_xx", "link2.I_xx", "link6.m", "link2.m", "link1.m"]
    text = 'kinds = ["I_xx", "m"]\nlinks = ["link6", "link2"]\nfirst = "links"\nkeep = ["link6.m"]'
    names = ordered(reading(tmp_path, text, puma), puma)
    assert names[:4] == ["link6.I_xx", "link2.I_xx", "link2.m", "link1.m"]
    assert names[-1] == "link6.m"
    last_first = ordered(reading(tmp_path, f"links = {[f'link{i}' for i in range(6, 0, -1)]}", puma), puma)
    assert last_first[:7] == [*(f"link{i}.m" for i in range(6, 0, -1)), "link6.mc_x"]


def test_by_a_grid_as_the_paper_prints_it(puma: Mechanism, tmp_path: Path) -> None:
    text = "[grid]\nm = [6, 5, 4, 3, 2, 1]\nI_z = [0.5, 10, 11, 12, 13, 14]\n"
    names = ordered(reading(tmp_path, text, puma), puma)
    assert names[:4] == ["link1.I_zz", "link6.m", "link5.m", "link4.m"]
    assert names[12:14] == ["link1.mc_x", "link2.mc_x"]
    some = 'links = ["link3", "link1"]\nkeep = ["link1.m"]\n[grid]\nm = [1, 2]\nmc_x = [3, 4]\n'
    names = ordered(reading(tmp_path, some, puma), puma)
    assert names[:4] == ["link3.m", "link3.mc_x", "link1.mc_x", "link2.m"]
    assert names[-1] == "link1.m"


def test_a_priority_decides_what_is_kept(puma: Mechanism) -> None:
    """Of two parameters that only their difference matters, the one asked for stays."""
    space = essential_space(puma)
    assert "link6.I_xx" not in fundamental_basis(space).names
    kept = fundamental_basis(space, Priority(keep=("link6.I_xx",)))
    assert "link6.I_xx" in kept.names
    assert "link6.I_yy" not in fundamental_basis(space, Priority(("link6.I_yy",))).names
    # What has no effect goes, and what is irreplaceable stays, whatever is asked for.
    stubborn = fundamental_basis(space, Priority(("link6.mc_x",), keep=("link1.m",)))
    assert "link6.mc_x" in stubborn.names
    assert "link1.m" not in stubborn.names


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('order = ["link1.Ixx"]', "unknown parameter 'link1.Ixx'; did you mean 'link1.I_xx'?"),
        ('order = ["elbow"]', "unknown parameter 'elbow'; known names: link1.m, link1.mc_x, .* (60 in all)"),
        ('keep = ["link7.m"]', "unknown parameter 'link7.m'; did you mean 'link"),
        ('order = ["link1.m", "link1.m"]', "parameter 'link1.m' is given more than once"),
        ('order = ["link1.m"]\nkeep = ["link1.m"]', "parameter 'link1.m' is given more than once"),
        ('kinds = ["mass"]', "unknown kind of parameter 'mass'; known names: m, mc_x"),
        ('kinds = ["I_x", "I_xx"]', "kind of parameter 'I_xx' is given more than once"),
        ('links = ["link9"]', "unknown link 'link9'; did you mean 'link"),
        ('links = ["link1", "link1"]', "link 'link1' is given more than once"),
        ("[grid]\nm = [1, 2]", "grid: row m has 2 numbers, expected 6: one for each link"),
        ("[grid]\nm = [1, 2, 3, 4, 5, 5]", "grid: the number 5 is given at link5.m and at link6.m"),
        ("[grid]\nmass = [1, 2, 3, 4, 5, 6]", "unknown kind of parameter 'mass'"),
        ("[grid]\nI_x = [1, 2, 3, 4, 5, 6]\nI_xx = [7, 8, 9, 10, 11, 12]", "'I_xx' is given more than once"),
        ("[grid]\nm = [1, 2, 3, 4, 5, nan]", "expected a finite number, got nan - at `$.grid.m[5]`"),
        ("[grid]\nm = [1, 2, 3, 4, 5, 'x']", "expected a number, got text - at `$.grid[...][5]`"),
        ('order = ["link1.m"]\nkinds = ["m"]', "give one of: order; kinds and links; grid"),
        ('order = ["link1.m"]\n[grid]\nm = [1, 2, 3, 4, 5, 6]', "give one of: order; kinds and links; grid"),
        ('kinds = ["m"]\n[grid]\nm = [1, 2, 3, 4, 5, 6]', "give one of: order; kinds and links; grid"),
        ("", "empty priority; give order, keep, kinds, links or grid"),
        ("order = 3", "expected a list, got a whole number - at `$.order`"),
        ('oder = ["link1.m"]', "unknown field `oder`; expected one of schema, order, keep, kinds, links, first, grid"),
        ('first = "mass"\nkinds = ["m"]', "at `$.first`; expected one of 'kinds', 'links'"),
        ("order = [", "not valid TOML"),
    ],
)
def test_wrong_files(puma: Mechanism, tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(FileError) as refusal:
        reading(tmp_path, text, puma)
    said = str(refusal.value)
    assert said.startswith(str(tmp_path / "priority.toml"))
    for part in message.split(".*"):
        assert part in said


def test_another_schema_and_a_missing_file(puma: Mechanism, tmp_path: Path) -> None:
    (tmp_path / "old.toml").write_text('schema = "adaptctl/priority/9"\norder = []')
    with pytest.raises(FileError, match=r"at `\$.schema`; expected one of 'adaptctl/priority/1'"):
        Priority.read(tmp_path / "old.toml", puma)
    with pytest.raises(FileError, match="cannot be read"):
        Priority.read(tmp_path / "none.toml", puma)


@pytest.mark.parametrize("known", [20, 21])
def test_an_unknown_name_like_none_is_told_what_there_is(known: int) -> None:
    names = [f"x{k}" for k in range(known)]
    more = ", ... (21 in all)" if known > 20 else ""
    assert suggestion("elbow", names) == f"known names: {', '.join(names[:20])}{more}"


def test_wrong_names_in_python(puma: Mechanism) -> None:
    space = essential_space(puma)
    with pytest.raises(NotFoundError, match=r"unknown parameter 'link1\.mass'"):
        fundamental_basis(space, Priority(("link1.mass",)))
    with pytest.raises(InputError, match=r"'link1.m' is given more than once"):
        Priority(("link1.m",), ("link1.m",)).indices(puma.parameter_names)
    np.testing.assert_array_equal(np.sort(Priority().indices(puma.parameter_names)), np.arange(60))
