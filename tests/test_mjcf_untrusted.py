"""MJCF of strangers: MuJoCo neither hangs, nor reads elsewhere, nor writes; meshes where an inertia needs them.

``python tests/test_mjcf_untrusted.py 5000`` loads as many mutants as one likes, and prints what became of them.
"""

from __future__ import annotations

import os
import random
import sys
import tempfile
import time
import warnings
from collections import Counter
from pathlib import Path

import mujoco
import numpy as np
import pytest
from fuzzing import mutant
from mjcf_files import BODY, CLOSED, chain, linkage, mjcf, reading, same_motion

from adaptctl.description import read_mjcf
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.description.readers.registry import read_model
from adaptctl.errors import FileError, MissingExtraError, SimplificationWarning

LONGEST = 2.0
"""s of processor time for a file"""
RICH = """<mujoco model="rich">
  <compiler angle="radian" autolimits="true" eulerseq="xyz"/>
  <option gravity="0 0 -9.81" timestep="0.002"><flag energy="enable"/></option>
  <size nkey="3" njmax="100"/>
  <default><joint armature="0.1" damping="0.2"/><geom density="500"/><motor gear="2"/>
    <default class="arm"><joint axis="0 1 0" range="-2 2"/><geom type="capsule" size="0.05 0.3"/></default></default>
  <asset><mesh name="m" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/><hfield name="h" nrow="20" ncol="20" size="1 1 1 1"/>
    <texture name="t" type="2d" builtin="flat" width="8" height="8"/><material name="s" texture="t"/></asset>
  <worldbody>
    <light pos="0 0 3"/><geom type="plane" size="1 1 0.1"/><geom type="hfield" hfield="h"/>
    <body name="base" pos="0 0 1"><freejoint name="float"/><inertial pos="0 0 0" mass="3" diaginertia="0.1 0.2 0.2"/>
      <body name="upper" childclass="arm" euler="0.1 0.2 0.3"><joint name="q1"/><geom name="g1" fromto="0 0 0 0 0 1"/>
        <frame pos="0 0 1" euler="0 0.5 0"><body name="lower"><joint name="q2"/><joint name="q3" axis="1 0 0"/>
          <geom/><geom type="mesh" mesh="m" material="s" mass="0"/><site name="tip" pos="0 0 0.3"/>
          <inertial pos="0 0 0.1" quat="1 0.2 0 0" mass="1.5" fullinertia="0.1 0.1 0.03 0.001 0 0"/></body></frame>
      </body>
      <body name="other"><joint name="q4" type="slide" ref="0.2" stiffness="3"/><geom type="box" size="0.1 0.1 0.2"/>
        <replicate count="3" euler="0 0 1"><body name="leaf" pos="0.1 0 0"><geom size="0.02"/></body></replicate></body>
    </body>
  </worldbody>
  <equality><joint joint1="q4" joint2="q2" polycoef="0 0.5"/>
    <weld body1="lower" body2="other" active="false"/></equality>
  <tendon><fixed name="f"><joint joint="q1" coef="1"/></fixed></tendon>
  <actuator><motor name="u1" joint="q1" ctrlrange="-3 3"/><position joint="q2" kp="50" forcerange="-9 9"/>
    <muscle joint="q3"/><motor tendon="f"/></actuator>
  <sensor><jointpos joint="q1"/></sensor>
  <keyframe><key qpos="0"/></keyframe>
</mujoco>
"""
HOSTILE = (
    '<size nkey="2000000000"/>',
    '<size memory="1000G"/>',
    '<replicate count="20000"><body><geom size="1"/></body></replicate>',
    '<replicate count="3000"><replicate count="3000"><geom size="1"/></replicate></replicate>',
    '<flexcomp name="x" type="grid" count="10000 10000 10" spacing="1 1 1"/>',
    '<composite type="cable" count="100000 1 1"/>',
    '<asset><hfield name="x" nrow="2000000" ncol="2000000" size="1 1 1 1"/></asset>',
    '<asset><texture name="x" type="2d" builtin="checker" width="200000" height="200000"/></asset>',
    '<asset><mesh name="x" builtin="supersphere" params="20000 1 1"/></asset>',
    '<asset><mesh name="x" file="/etc/passwd"/></asset>',
    '<asset><model name="x" file="/etc/passwd"/></asset>',
    '<include file="/etc/passwd"/>',
    '<extension><plugin plugin="mujoco.elasticity.cable"/></extension>',
    '<custom><numeric name="x" size="2000000000"/></custom>',
    '<actuator><general joint="q1" actdim="2000000000" dyntype="user"/></actuator>',
    '<actuator><motor joint="q1" nsample="2000000000" delay="1"/></actuator>',
    '<sensor><user dim="2000000000"/></sensor>',
    '<joint damping="nan"/>',
    '<joint damping="-1"/>',
)
"""What takes MuJoCo's time, memory or files, in any place."""


def mutants(count: int, seed: int, folder: Path) -> tuple[Counter[str], float, list[str]]:
    """What became of so many mutants, the slowest one's processor time (s), and what failed."""
    rng, counts, slowest, failures = random.Random(seed), Counter[str](), 0.0, []
    for k in range(count):
        text = RICH
        for _ in range(rng.randint(0, 2)):
            place = rng.choice([i for i, c in enumerate(text) if c == "<" and not text.startswith("</", i)][1:])
            text = text[:place] + rng.choice(HOSTILE) + text[place:]
        data = mutant(text, rng) if rng.random() < 0.9 else text.encode()
        (folder / "mutant.xml").write_bytes(data)
        start = time.process_time()
        try:
            made = read_mjcf(folder / "mutant.xml", root=rng.choice((None, None, "base", "upper")))
            sound = all(np.isfinite(link.inertia).all() and link.inertia[0] >= 0.0 for link in made.links)
            outcome = "read" if sound else "unsound"
        except FileError as error:
            outcome = "refused" if str(folder / "mutant.xml") in str(error) else f"no file named: {error}"
        except Exception as error:
            outcome = f"{type(error).__name__}: {error}"
        spent = time.process_time() - start
        slowest = max(slowest, spent)
        if outcome not in ("read", "refused") or spent > LONGEST:
            (folder / f"failed-{seed}-{k}.xml").write_bytes(data)
            failures.append(f"failed-{seed}-{k}.xml: {outcome}, {spent:.1f} s")
        counts[outcome if outcome in ("read", "refused") else "failed"] += 1
    return counts, slowest, failures


@pytest.mark.filterwarnings(
    "ignore::adaptctl.errors.SimplificationWarning", "ignore::adaptctl.errors.PhysicalConsistencyWarning"
)
def test_mutants_are_read_or_refused_and_leave_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "here").mkdir()
    (tmp_path / "files").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    counts, _, failures = mutants(300, 0, tmp_path / "files")
    assert not failures
    assert min(counts["read"], counts["refused"]) > 20
    assert capfd.readouterr() == ("", "")
    assert not list((tmp_path / "here").iterdir())


@pytest.mark.parametrize("text", HOSTILE)
def test_a_few_digits_take_neither_time_nor_memory(tmp_path: Path, text: str) -> None:
    start = time.process_time()
    for place in ("</mujoco>", "</worldbody>", "<inertial"):
        (tmp_path / "robot.xml").write_text(mjcf(chain()).replace(place, text + place, 1))
        said = ""
        try:
            assert len(read_mjcf(tmp_path / "robot.xml").links) == 2
        except FileError as error:
            said = str(error)
        assert "root:" not in said  # nothing of a password file is quoted
    assert time.process_time() - start < LONGEST


@pytest.mark.parametrize(
    ("joint", "message"),
    [
        ('damping="nan"', "joint 'j1': damping of <joint>: expected .* finite numbers, got 'nan'"),
        ('damping="-1"', "joint 'j1': viscous: expected a finite number of at least 0"),
        ('frictionloss="-1"', "joint 'j1': coulomb: expected a finite number of at least 0"),
        ('ref="inf"', "joint 'j1': ref of <joint>: expected a finite number, got 'inf'"),
    ],
)
def test_numbers_that_mujoco_lets_pass(tmp_path: Path, joint: str, message: str) -> None:
    with pytest.raises(FileError, match=rf"robot\.xml: {message}.*\(line 1\)"):
        reading(tmp_path, mjcf(chain(joint)))


def test_links_do_not_lead_includes_out_of_the_folder(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "secret.xml").write_text("<mujoco/>")
    (tmp_path / "in" / "part.xml").symlink_to(tmp_path / "secret.xml")
    with pytest.raises(FileError, match=r"'part\.xml' is outside the file's folder"):
        reading(tmp_path / "in", mjcf(chain(), before='<include file="part.xml"/>'))


def test_inertias_are_the_files(tmp_path: Path) -> None:
    """MuJoCo keeps principal axes; the tensor that they make is the file's."""
    rng = np.random.default_rng(0)
    for scale in (1e-6, 1e-3, 1.0, 1e3):
        points = rng.normal(size=(5, 3)) * np.sqrt(scale)
        J = sum(p @ p * np.eye(3) - np.outer(p, p) for p in points)
        words = " ".join(repr(float(J[i])) for i in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
        inertia = f'<inertial pos=".1 .2 .3" mass="2.5" fullinertia="{words}"/>'
        robot = reading(tmp_path, mjcf(f'<body name="a"><joint name="j"/>{inertia}</body>'))
        expected = from_center_of_mass(2.5, [0.1, 0.2, 0.3], J)
        np.testing.assert_allclose(robot.links[0].inertia, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def tetrahedron(folder: Path) -> None:
    corners = ((0, 0, 0), (0.3, 0, 0), (0, 0.2, 0), (0, 0, 0.4))
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + ["f 1 3 2", "f 1 2 4", "f 2 3 4", "f 1 4 3"]
    (folder / "meshes").mkdir()
    (folder / "meshes" / "wedge.obj").write_text("\n".join(lines))


WEDGE = '<compiler meshdir="meshes"/><asset><mesh file="wedge.obj"/></asset>'
SHAPES = '<geom type="mesh" mesh="wedge" pos=".1 0 0" euler="10 20 0"/><geom size=".1"/>'


def test_meshes_that_an_inertia_needs_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    tetrahedron(tmp_path)
    monkeypatch.chdir(tmp_path)
    text = mjcf(chain(inertia1=SHAPES), before=WEDGE)
    robot = reading(tmp_path, text)
    same_motion(robot, text.replace('file="wedge', f'file="{tmp_path}/meshes/wedge'))
    assert capfd.readouterr() == ("", "")
    assert {path.name for path in tmp_path.iterdir()} == {"meshes", "robot.xml"}


@pytest.mark.parametrize("geom", ['mass="0"', 'density="0"', 'group="7"'])
def test_meshes_that_no_inertia_needs_need_not_be_there(tmp_path: Path, geom: str) -> None:
    before = '<compiler inertiagrouprange="0 5"/><asset><mesh name="m" file="none.stl"/></asset>'
    shape = f'<geom type="mesh" mesh="m" {geom}/>'
    assert len(reading(tmp_path, mjcf(chain(inertia1=f'<geom size=".1"/>{shape}'), before=before)).links) == 2
    assert len(reading(tmp_path, mjcf(chain(inertia1=BODY + '<geom type="mesh" mesh="m"/>'), before=before)).links) == 2


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        ('name="m" file="none.stl"', "mesh 'm': no such file: '.*none.stl'"),
        ('name="m" file="../wedge.obj"', "mesh 'm': .* is outside the file's folder"),
        ('name="m" file="/etc/passwd"', "mesh 'm': .* is outside the file's folder"),
        ('name="m" file="robot.xml"', "mesh 'm': MuJoCo: "),
        ('name="m" file="pipe.stl"', "mesh 'm': no such file: '.*pipe.stl'"),
        ('name="m" file="bad.stl"', "mesh 'm': MuJoCo: |cannot compute the inertia"),
        ('name="other" file="none.stl"', "<geom>: unknown mesh 'm'"),
    ],
)
def test_meshes_that_cannot_be_read(tmp_path: Path, mesh: str, message: str) -> None:
    os.mkfifo(tmp_path / "pipe.stl")
    (tmp_path / "bad.stl").write_bytes(b"\0" * 80 + b"\xff\xff\xff\x7f" + b"\0" * 100)
    with pytest.raises(FileError, match=rf"robot\.xml: {message}"):
        reading(tmp_path, mjcf(chain(inertia1='<geom type="mesh" mesh="m"/>'), before=f"<asset><mesh {mesh}/></asset>"))


def test_without_mujoco_one_line_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingExtraError, match=r"^MJCF needs mujoco: pip install 'adaptctl\[mujoco\]'$"):
        reading(tmp_path, mjcf(chain()))


def test_loops_of_a_compiled_model_are_those_of_its_file(tmp_path: Path) -> None:
    text = linkage(CLOSED["connect"])
    one, other = reading(tmp_path, text), read_model(mujoco.MjModel.from_xml_string(text))
    assert one.loops is not None
    assert other.loops is not None
    assert one.loops.plain(12) == other.loops.plain(12)
    with pytest.warns(SimplificationWarning, match="no actuator drives these joints, which are taken as driven: crank"):
        read_model(mujoco.MjModel.from_xml_string(linkage(CLOSED["connect"], actuator="")))


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    made = Path(tempfile.mkdtemp(prefix="mutants-"))
    started = time.process_time()
    found, longest, wrong = mutants(int(sys.argv[1]), int((*sys.argv, "1")[2]), made)
    print(dict(found), f"slowest {longest:.2f} s, in all {time.process_time() - started:.0f} s", *wrong[:40], sep="\n")
