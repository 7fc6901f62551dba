"""`adaptctl basis`: what it prints, what it saves, and how it refuses."""

from __future__ import annotations

import io
import json
import os
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rich.console import Console
from robot_files import urdf

from adaptctl.cli.basis import _in_frames_of, report, spectrum
from adaptctl.cli.main import main
from adaptctl.cli.output import print_parts
from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism, load
from adaptctl.identifiability import FundamentalBasis, ReducedModel, essential_space, fundamental_basis

KEYS = [
    "schema",
    "robot",
    "dof",
    "links",
    "parameters",
    "rank",
    "singular_values",
    "gap",
    "names",
    "independent",
    "columns",
]
KEYS += ["regrouping", "certificate"]


def output(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main(["basis", *arguments]) == 0
    return capsys.readouterr().out


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The one line on stderr of a wrong input, besides notes."""
    assert main(["basis", *arguments]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    lines = [line for line in said.err.splitlines() if ": note: " not in line]
    assert len(lines) == 1
    return lines[0]


def test_json_has_exactly_the_agreed_keys(capsys: pytest.CaptureFixture[str]) -> None:
    content: dict[str, Any] = json.loads(output(capsys, "puma560_measured", "--json"))
    assert list(content) == KEYS
    puma = load("puma560_measured")
    basis = fundamental_basis(essential_space(puma))
    assert content["schema"] == "adaptctl/basis/1"
    assert content["robot"] == {"name": "puma560_measured", "sha256": puma.description.sha256}
    assert (content["dof"], content["links"], content["parameters"], content["rank"]) == (6, 6, 60, 36)
    assert len(content["singular_values"]) == 60
    assert content["gap"] > 1e13
    assert content["independent"] == list(basis.names)
    assert content["columns"] == list(basis.columns)
    np.testing.assert_array_equal(content["regrouping"], basis.regrouping)
    ranks = [content["certificate"][f"rank_{way}"] for way in ("energy", "torque", "doubled")]
    assert ranks == [36, 36, 36]
    assert content["certificate"]["samples"] == 121


def test_tables(capsys: pytest.CaptureFixture[str]) -> None:
    text = output(capsys, "puma560_measured")
    words = " ".join(text.split())
    assert words.startswith("puma560_measured: 6 links, 6 degrees of freedom, 60 inertial parameters, of which 36 are")
    assert "gap 7.5e+13" in words
    assert "condition 4.45" in words
    rows = {line.split()[0]: line for line in text.splitlines() if line.strip()}
    header = next(line for line in text.splitlines() if "link1" in line and "link6" in line)
    for kind, kept in {"m": (), "mc_y": (2, 6), "mc_z": (3, 4, 6), "I_xx": (), "I_yy": range(1, 7)}.items():
        flags = [i for i, c in enumerate(rows[kind]) if c == "x" and i > 8]
        links = [header.index(f"link{i}") for i in kept]
        assert [start <= mark <= start + 4 for start, mark in zip(links, flags, strict=True)] == [True] * len(links)
    assert "link6.I_yy* = link6.I_yy - link6.I_xx" in words
    assert "36 5.9e+01 ###" in words
    assert "rank 36: below is round-off 37" in words
    assert "Model reduction" not in text


def test_a_priority_file(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('schema = "adaptctl/priority/1"\nkeep = ["link6.I_xx"]\n')
    content = json.loads(output(capsys, "puma560_measured", "--priority", str(path), "--json"))
    assert "link6.I_xx" in content["independent"]
    path.write_text('schema = "adaptctl/priority/1"\norder = ["link6.Ixx"]\n')
    message = refused(capsys, "puma560_measured", "--priority", str(path))
    assert "mine.toml: unknown parameter 'link6.Ixx'; did you mean 'link6.I_xx'?" in message
    assert "cannot be read" in refused(capsys, "puma560_measured", "--priority", str(tmp_path / "none.toml"))


def test_model_reduction(capsys: pytest.CaptureFixture[str]) -> None:
    words = " ".join(output(capsys, "puma560_measured", "--energy-error", "5").split())
    assert "of 36 components keep the energy error at" in words
    assert "over 20000 other random states within the joint limits than those" in words
    content = json.loads(output(capsys, "puma560_measured", "--energy-error", "5", "--json"))
    assert list(content) == [*KEYS, "reduction"]
    reduction = content["reduction"]
    assert reduction["percent_error"] <= 5 < reduction["percent_errors"][reduction["components"] - 1]
    assert "--energy-error: expected a finite number of at least 0" in refused(
        capsys, "puma560_measured", "--energy-error", "-1"
    )


def test_saving(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    output(capsys, "puma560_measured", "--out", str(tmp_path / "basis.json"))
    puma = load("puma560_measured")
    model = ReducedModel(puma, FundamentalBasis.load(tmp_path / "basis.json"))
    assert len(model.columns) == 36
    assert "does not exist" in refused(capsys, "puma560_measured", "--out", str(tmp_path / "none" / "basis.json"))


def test_a_saved_basis_is_replaced_where_that_is_allowed(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    place = tmp_path / "notes.json"
    place.write_text("mine")
    asked = "two_link", "--out", str(place)
    assert "notes.json: exists already; choose another or allow it with --overwrite" in refused(capsys, *asked)
    assert place.read_text() == "mine"
    output(capsys, *asked, "--overwrite")
    assert FundamentalBasis.load(place).rank == 6
    os.mkfifo(tmp_path / "pipe")
    assert "is no regular file" in refused(capsys, asked[0], "--out", str(tmp_path / "pipe"), "--overwrite")


def test_many_links_with_long_names_fit_the_page(capsys: pytest.CaptureFixture[str]) -> None:
    text = output(capsys, str(urdf("talos_reduced.urdf")))
    assert max(map(len, text.splitlines())) <= 80
    grids = text[text.index("Base parameters") : text.index("Regrouping relations")]
    for link in ("leg_left_1_link", "gripper_right_motor_double_link", "head_2_link"):
        assert grids.split().count(link) == 1
    assert grids.count("mc_x") == grids.count("I_yz") > 5


def test_names_are_not_taken_for_markup(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    inertia = "mass = 1, first_moment = [0, 0, 0], inertia = { xx = 1, yy = 1, zz = 1 }"
    (tmp_path / "odd.toml").write_text(
        'schema = "adaptctl/denavit-hartenberg/1"\nconvention = "standard"\nname = "[red]arm[/red]"\n'
        f'links = [{{ name = "[bold]1", alpha_deg = 90, {inertia} }}, {{ name = "[/]", alpha_deg = 0, {inertia} }}]\n'
    )
    text = output(capsys, str(tmp_path / "odd.toml"))
    assert text.startswith("[red]arm[/red]: 2 links")
    assert "[bold]1.I_yy* =" in text


def test_rotors_are_in_the_grid_and_friction_is_noted() -> None:
    puma = load("puma560_measured")
    links = [replace(link, joint=replace(link.joint, drive=Drive(0.2, 1.0, 0.5))) for link in puma.links]
    geared = Mechanism(replace(puma.description, links=tuple(links)))
    space = essential_space(geared)
    console = Console(width=100, file=io.StringIO(), record=True)
    for part in report(geared, space, fundamental_basis(space), None):
        console.print(part)
    words = console.export_text().split()
    assert " ".join(words).startswith(
        "puma560_measured: 6 links, 6 degrees of freedom, 66 inertial parameters, of which 40"
    )
    start = words.index("rotor_inertia")
    assert words[start + 1 : start + 7] == ["x"] * 6
    assert "note: 12 friction parameters do not change the energy, so that all of them are kept" in " ".join(words)


def test_wrong_robots(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert "unknown robot 'puma56'" in refused(capsys, "puma56")
    assert "cannot be read" in refused(capsys, str(tmp_path / "none.toml"))


def test_a_rank_that_cannot_be_certified_fails(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Not the user's input: what was asked for could not be done, exit code 1."""
    flat = flat_arm(tmp_path, twist=5e-4)
    assert main(["basis", flat]) == 1
    said = capsys.readouterr()
    assert said.out == ""
    assert "flat: the rank is 17 for the geometry as given, but 9 if nearly special values are made exact" in said.err
    assert "joint1 and joint2 are 5.0e-04 rad from 0 degrees" in said.err
    assert "or use them as they stand with as_written=True (--as-written)" in said.err
    assert main(["basis", flat, "--as-written", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["certificate"]["rank_exact"] == 17


def test_rounded_angles_are_taken_as_meant_and_said(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    flat = flat_arm(tmp_path, twist=1e-6)
    assert main(["basis", flat, "--json"]) == 0
    said = capsys.readouterr()
    found = json.loads(said.out)["certificate"]
    assert (found["rank_energy"], found["rank_exact"], found["proof_method"]) == (9, 9, "a prime field")
    rounded, massless = said.err.splitlines()
    assert rounded == f"adaptctl: note: {flat}: 2 rounded angles taken as right angles: rank 9; --as-written for 17"
    assert massless.startswith(f"adaptctl: note: {flat}: no link has an inertia: base parameters follow from")
    assert main(["basis", flat, "--as-written"]) == 1
    assert "flat: the rank cannot be certified: the gap at 13 is" in capsys.readouterr().err


def flat_arm(folder: Path, twist: float) -> str:
    """File of a planar arm whose joints 2 and 3 are a little out of the plane."""
    links = "\n".join(f"[[links]]\nalpha = {each}\na = 0.3\n" for each in (twist, twist, 0.0))
    head = 'schema = "adaptctl/denavit-hartenberg/1"\nconvention = "standard"\ngravity = [0, -9.81, 0]\n'
    (folder / "flat.toml").write_text(head + links)
    return str(folder / "flat.toml")


@pytest.mark.parametrize(("count", "rank"), [(60, 36), (20, 9), (9, 9), (5, 1)])
def test_singular_values_are_listed_at_the_ends_and_about_the_rank(
    count: int, rank: int, capsys: pytest.CaptureFixture[str]
) -> None:
    """With dots for those that are left out, and a line where round-off begins."""
    values = np.concatenate([np.geomspace(50.0, 0.05, rank), np.full(count - rank, 1e-19)])
    print_parts([spectrum(SimpleNamespace(singular_values=values, rank=rank))])  # type: ignore[arg-type]
    rows = [line.split() for line in capsys.readouterr().out.splitlines() if line.strip()]
    told = [row[0] for row in rows]
    bars = {int(row[0]): len(row[2]) for row in rows if row[-1].startswith("#")}
    assert max(bars, key=lambda k: bars[k]) == 1
    for k, length in bars.items():
        assert length == pytest.approx(bars[1] * (1.0 + np.log10(values[k - 1] / 50.0) / 18.0), abs=0.51)
    near = [k for k in range(1, count + 1) if k <= min(2, rank) or k == count or rank - 6 < k <= rank + 6]
    expected = list[str]()
    for before, k in pairwise([0, *near]):
        expected += ["..."] * (k > before + 1) + ["----"] * (k == rank + 1) + [str(k)]
    assert told == expected


@pytest.mark.parametrize(("tool", "file"), [("mujoco", "a.urdf"), ("pinocchio", "a.xml"), ("mujoco", "a.xml")])
def test_only_mujoco_has_the_frames_of_its_own_files(tool: str, file: str) -> None:
    arm = load("two_link")
    assert (_in_frames_of(tool, arm, file) is arm) == (tool + file == "mujocoa.xml")
