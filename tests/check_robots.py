"""The Franka example, through Franka's own client, against arms that nobody here wrote: `make check-robots`.

franky-sim moves MuJoCo's FR3 behind libfranka's network protocol, franka-sim enforces the limits of Franka's interface
as well, and pylibfranka is the vendor's client. The example runs as it is, from postures about the robot's own: it must
start where the arm stands, without a jump of torque, stay below the joints' speed limits and follow its reference. With
a mass in the hand that nobody told the robot of, it is learned and named. Names each package that is missing, with the
command that brings it.

    python tests/check_robots.py [postures] [masses] [limits] [widowx]

`postures`, `limits`, `widowx` are numbers of runs, `masses` those of 0 to 3 kg; 1 each unless given, and 0 for none.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import vendor_servers

import adaptctl

ROOT = Path(__file__).resolve().parent.parent
HOME = ROOT / ".venv-vendors"
LIMITS = ROOT / ".venv-vendors-limits"
"""franka-sim asks for an old MuJoCo"""
CLIENT = HOME / "client"
FILE = CLIENT / "franka_sim" / "models" / "fr3.urdf"
"""Of the bare arm; franky-sim's own has a hand"""
CARRY = """
import adaptctl
from adaptctl.hardware import FrankaRobot, motion_about, ready_controller, with_rotors
robot, arm = FrankaRobot("127.0.0.1", real_time=False), with_rotors(adaptctl.load("fr3.urdf"))
reference = motion_about(robot.read().p, robot.limits)
controller = ready_controller(arm, robot.period, reference, robot.tool, delay=1)
run = adaptctl.drive(robot, controller, reference, 8.0, "run.parquet", lead_in=1.0)
print(run.stopped or run.payload.words)
"""
REACH = """
import adaptctl
from adaptctl.hardware import HardwareLimits, TrossenRobot, motion_about, ready_controller
robot, fingers = TrossenRobot("127.0.0.1"), ("left_carriage_joint", "right_carriage_joint")
arm = adaptctl.load("arm.xml", lock=fingers)
reference = motion_about(robot.read().p, robot.limits.within(HardwareLimits.of(arm)))
run = adaptctl.drive(robot, ready_controller(arm, robot.period, reference, delay=1), reference, 12.0, "run.parquet")
print(run.stopped or f"{1e3 * run.final_rms_error.max():.2f} mrad at the worst joint in the last two seconds")
"""
HOME_POSTURE, AWAY = (0.0, -0.3, 0.0, -1.9, 0.0, 1.7, 0.785), 0.4
"""rad about which, and by how much, postures are drawn"""
WIDOWX_POSTURE, WIDOWX_ERROR = (0.0, 1.2, 1.2, 0.3, 0.0, 0.0), 2e-3
"""rad"""
MAX_FIRST_ERROR = 1e-4
"""rad"""
MAX_RATE = 1000.0
"""N m/s at which the robot stops"""
MAX_SPEED = 2.62
"""rad/s: the FR3's limit of joints 1 to 4"""
MAX_ERROR = 2e-4
"""rad RMS of the worst joint in the last two seconds, from a file without rotor inertias"""
MASS_SHARE, MASS_ROOM = 0.03, 0.03
"""share and kg by which a mass may be off"""
FINGERS = 0.03
"""kg in the simulator's hand that the robot does not count to it"""


def missing(limits: bool) -> list[str]:
    """What is not here, and how it comes."""
    wanted = {"franky-sim": HOME / "bin" / "python", "pylibfranka": CLIENT / "pylibfranka", "franka-sim": FILE}
    wanted["trossen-arm"] = CLIENT / "trossen_arm"
    if limits:
        wanted["franka-sim with its own MuJoCo"] = LIMITS / "bin" / "run-franka-sim-server"
    return [f"{name} is missing: run make check-robots" for name, place in wanted.items() if not place.exists()]


@contextmanager
def served(python: Path, program: str, argument: object, **more: str) -> Iterator[None]:
    """A simulator that answers."""
    command = [str(python), "-c", program, json.dumps(argument)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env={**os.environ, **more}) as server:
        try:
            assert server.stdout is not None
            assert (said := server.stdout.readline()) == "ready\n", f"the simulator did not start: {said}"
            yield
        finally:
            server.kill()


def driven(folder: Path, *program: str) -> adaptctl.Rollout:
    """What a program recorded, which runs in a folder with the arm's file."""
    (folder / "fr3.urdf").symlink_to(FILE)
    paths = os.pathsep.join([str(ROOT), str(CLIENT)])
    called = [sys.executable, "-W", "ignore", *program]
    subprocess.run(called, cwd=folder, env={**os.environ, "PYTHONPATH": paths}, check=True, timeout=300.0)
    return adaptctl.Rollout.load(folder / "run.parquet")


EXAMPLE = (str(ROOT / "docs" / "examples" / "franka_loop.py"), "127.0.0.1", "--any-kernel")


def started(run: adaptctl.Rollout) -> dict[str, tuple[float, float]]:
    """What must be small in every run, and how small, by name."""
    added = np.stack([run.flags[name] for name in sorted(run.flags) if name.startswith("compensation.")], axis=1)
    told = np.stack([run.flags[name] for name in sorted(run.flags) if name.startswith("reported_torque.")], axis=1)
    sent = np.diff(run.applied - added, axis=0, prepend=told[:1])
    passed = np.diff(run.time, prepend=run.time[0] - run.control_period)
    periods = np.maximum(passed, run.control_period)[:, None]
    return {
        "first error, rad": (float(np.abs(run.error[0]).max()), MAX_FIRST_ERROR),
        "greatest rate of torque, N m/s": (float(np.abs(sent / periods).max()), MAX_RATE),
        "greatest speed, rad/s": (float(np.abs(run.v).max()), MAX_SPEED),
    }


def from_a_posture(folder: Path, posture: list[float]) -> dict[str, tuple[float, float]]:
    """Figures of the example from a posture."""
    with served(HOME / "bin" / "python", vendor_servers.FRANKY, (posture, 0.0)):
        run = driven(folder, *EXAMPLE)
    last = run.error[-round(2.0 / run.control_period) :]
    worst = float(np.sqrt(np.mean(last**2, axis=0)).max())
    return started(run) | {"RMS error of the worst joint, rad": (worst, MAX_ERROR)}


def with_a_mass(folder: Path, posture: list[float], mass: float) -> dict[str, tuple[float, float]]:
    """Figures of a run with a mass in the hand from its start on."""
    with served(HOME / "bin" / "python", vendor_servers.FRANKY, (posture, mass)):
        run = driven(folder, "-c", CARRY)
    later = run.error[run.time > 3.0]
    return started(run) | {
        f"error of {mass:g} kg, kg": (
            abs(float(run.flags["payload_mass"][-1]) - mass - FINGERS), MASS_SHARE * mass + MASS_ROOM,
        ),
        "RMS error from 3 s on, rad": (float(np.sqrt(np.mean(later**2))), MAX_ERROR),
    }  # fmt: skip


def within_limits(folder: Path, posture: list[float]) -> dict[str, tuple[float, float]]:
    """Figures of the example where limits are enforced: a run that was aborted is shorter."""
    scene = folder / "scene"
    scene.mkdir()
    assets = next((HOME / "lib").glob("*/site-packages/franky_sim/assets"))
    (scene / "fr3.xml").symlink_to(assets / "fr3.xml")
    (scene / "assets").symlink_to(assets / "meshes")
    with served(
        LIMITS / "bin" / "python",
        vendor_servers.FRANKA_LIMITS,
        posture,
        FR3_MJCF=str(scene / "fr3.xml"),
        MUJOCO_GL="disable",
    ):
        run = driven(folder, *EXAMPLE)
    return started(run) | {"s that are missing of 10": (10.0 - float(run.time[-1]), 0.01)}


def through_trossens_client(folder: Path) -> dict[str, tuple[float, float]]:
    """Figures of a WidowX, from its simulator's own file."""
    with served(HOME / "bin" / "python", vendor_servers.WIDOWX, (WIDOWX_POSTURE, str(folder / "arm.xml"))):
        run = driven(folder, "-c", REACH)
    last = run.error[run.time > 10.0]
    worst = float(np.sqrt(np.mean(last**2, axis=0)).max())
    return started(run) | {"RMS error of the worst joint after 10 s, rad": (worst, WIDOWX_ERROR)}


def main(postures: int = 1, masses: int = 1, limits: int = 1, widowx: int = 1) -> int:
    """Exit code: 1 where something is missing or too large."""
    absent, random, bad = missing(limits > 0), np.random.default_rng(0), False
    print("\n".join(absent))
    around = (HOME_POSTURE + random.uniform(-AWAY, AWAY, (max(postures, limits), 7))).tolist()
    carried = np.linspace(0.0, 3.0, masses) if masses > 1 else np.full(masses, 2.0)
    cases = [lambda folder, p=p: from_a_posture(folder, p) for p in around[:postures]]
    cases += [lambda folder, m=m: with_a_mass(folder, list(HOME_POSTURE), m) for m in carried.tolist()]
    cases += [lambda folder, p=p: within_limits(folder, p) for p in around[:limits]]
    cases += [through_trossens_client] * widowx
    for case in [] if absent else cases:
        with tempfile.TemporaryDirectory() as folder:
            found = case(Path(folder))
        print(
            "; ".join(f"{name}: {value:.3g} (at most {limit:g})" for name, (value, limit) in found.items()), flush=True
        )
        bad = bad or any(not value <= limit for value, limit in found.values())
    return int(bad or bool(absent))


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:5])))
