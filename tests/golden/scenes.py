"""A figure and a recording by hand, of all that can be drawn."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np


def sheet() -> str:
    """Two panels over each other with all that a sheet can draw, and a legend in two columns of three curves."""
    from adaptctl.recording.vector import Sheet

    figure, x = Sheet(6.0, 4.0), np.linspace(0.0, 2.0, 9)
    above, below = figure.subplots(2, 1, sharex=True)
    for k, label in enumerate(("a", "a longer one", "third")):
        above.plot(x, np.sin((k + 1) * x), color="#123456", label=label, linestyle=(0, (3, 2 + k)), zorder=3 - k)
    above.fill_between(x, np.cos(x), color="#abcdef", alpha=0.5)
    above.axhline(0.25, color="#222222", linewidth=0.5)
    above.axhspan(0.1, 0.4, "#333333", 0.3)
    above.legend()
    for k, more in enumerate(({"ha": "right", "va": "top"}, {"weight": "bold", "transform": above.transAxes}, {})):
        above.text(0.4, 0.3 * k, f"word {k}", size=7.0 + k, **more)
    below.bar(np.array([0.5, 1.5]), np.array([2.0, -1.0]), 0.5, ["#111111", "#222222"], 0.8)
    below.semilogy(x, 10.0**x, ".", color="#654321")
    below.grid(False, "x")
    below.set_title("below", size=12.0)
    figure.legend(ncols=2)
    figure.supxlabel("x")
    return figure.svg()


def scene(path: Path) -> None:
    """Arms that stand, slide, close loops, have two feet, or hang and have looks, each twice; a force and a box."""
    import rerun as rr

    from adaptctl import load
    from adaptctl.description.pose import Pose
    from adaptctl.description.visual import Box, Visual
    from adaptctl.recording.colors import FORCE, GOAL
    from adaptctl.recording.scene import log_arm, log_arrows, log_base, log_surroundings
    from adaptctl.recording.skeleton import Viewpoint, floor_height, skeleton

    files, time = Path(__file__).parent / "files", np.arange(4) / 4.0
    arms = {name: load(files / name) for name in ("cart.toml", "mjcf_branches.xml", "mjcf_loop_connect.xml")}
    arms["hanging"] = load(hanging(path.parent))
    recording = rr.RecordingStream("scene", make_default=False)
    recording.save(path)
    for name, mechanism in arms.items():
        parts = skeleton(mechanism)
        p = 0.05 * np.outer(np.sin(3.0 * time), np.arange(1.0, mechanism.dof + 1.0))
        for ghost in (True, False):
            tip = log_arm(recording, f"{name}/{ghost}", mechanism, parts, time, p, GOAL, ghost=ghost)
        log_base(recording, mechanism, parts, floor_height(mechanism, parts, p), f"{name}/base")
        seen = Viewpoint.of(mechanism, parts, p)
        recording.log(f"{name}/seen", rr.Points3D([seen.eye, seen.target, [0.0, 0.0, seen.floor]]), static=True)
    forces = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0], [0.0, 0.0, -4.0], [0.5, 0.0, 0.0]])
    log_arrows(recording, "force", time, tip, forces, parts.reach, FORCE)
    beside = Pose(np.eye(3), np.array([0.3, 0.2, 0.1]))
    log_surroundings(recording, "beside", [Visual(-1, beside, Box((0.1, 0.2, 0.3)))])
    recording.disconnect()


def hanging(folder: Path) -> Path:
    """A file of an arm that hangs, with a shape of each kind, one of them with a color."""
    corner = struct.pack("<12fH", 0, 0, 1, 0, 0, 0, 0.3, 0, 0, 0, 0.3, 0, 0)
    (folder / "part.stl").write_bytes(bytes(80) + struct.pack("<I", 4) + 4 * corner)
    shapes = ('box size="0.1 0.2 0.3"', 'sphere radius="0.1"', 'cylinder radius="0.05" length="0.4"')
    looks = [f"<visual><geometry><{shape}/></geometry></visual>" for shape in shapes]
    red = '<material name="red"><color rgba="0.7 0.2 0 1"/></material>'
    looks.append(f'<visual><geometry><mesh filename="part.stl" scale="1 -2 1"/></geometry>{red}</visual>')
    body = '<inertial><mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    links = [f'<link name="base">{looks[0]}</link>', f'<link name="upper">{body}{looks[3]}{looks[2]}</link>']
    links.append(f'<link name="lower">{body}{looks[1]}</link>')
    hinges = [
        f'<joint name="j{k}" type="continuous"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0.1 0 {height}"/><axis xyz="0 1 0"/></joint>'
        for k, (parent, child, height) in enumerate((("base", "upper", 1.0), ("upper", "lower", -0.8)))
    ]
    (folder / "hanging.urdf").write_text(f'<robot name="hanging">{"".join([*links, *hinges])}</robot>')
    return folder / "hanging.urdf"
