"""The Franka example, through Franka's own client, against an arm that nobody here wrote: `make check-vendors`.

franky-sim moves MuJoCo's FR3 behind libfranka's network protocol, and pylibfranka is the vendor's client. The example
runs as it is: it must start where the arm stands, without a jump of torque, stay below the joints' speed limits and
follow its reference. Names each package that is missing, with the command that brings it.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import adaptctl

ROOT = Path(__file__).resolve().parent.parent
HOME = ROOT / ".venv-vendors"
CLIENT = HOME / "client"
FILE = CLIENT / "franka_sim" / "models" / "fr3.urdf"
"""Of the bare arm; franky-sim's own has a hand"""
SERVER = """
import time
from franky_sim import SimulationServer
from franky_sim.mujoco_simulator import MujocoSimulator
with MujocoSimulator() as simulator:
    simulator.add_robot()
    with SimulationServer(simulator, hostname_candidates=["127.0.0.1"]) as server:
        server.run_async()
        print("ready", flush=True)
        time.sleep(600.0)
"""
MAX_JUMP = 1.0
"""N m between two commands: the robot stops at 1000 N m/s"""
MAX_SPEED = 4.18
"""rad/s: the FR3's limit of joints 1 to 4"""
MAX_ERROR = 0.05
"""rad RMS of the last second: the file has no rotor inertias, and the last joint swings for want of them"""


def missing() -> list[str]:
    """What is not here, and how it comes."""
    wanted = {"franky-sim": HOME / "bin" / "python", "pylibfranka": CLIENT / "pylibfranka", "franka-sim": FILE}
    return [f"{name} is missing: run make check-vendors" for name, place in wanted.items() if not place.exists()]


def drive(folder: Path) -> adaptctl.Rollout:
    """What the example recorded, which runs in a folder with the arm's file."""
    (folder / "fr3.urdf").symlink_to(FILE)
    paths = os.pathsep.join([str(ROOT), str(CLIENT)])
    example = [sys.executable, str(ROOT / "docs" / "examples" / "franka_loop.py"), "127.0.0.1", "--any-kernel"]
    with subprocess.Popen([str(HOME / "bin" / "python"), "-c", SERVER], stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            assert server.stdout.readline() == "ready\n", "franky-sim did not start"
            subprocess.run(example, cwd=folder, env={**os.environ, "PYTHONPATH": paths}, check=True, timeout=300.0)
        finally:
            server.kill()
    return adaptctl.Rollout.load(folder / "run.parquet")


def figures(run: adaptctl.Rollout) -> dict[str, tuple[float, float]]:
    """What must be small, and how small, by name."""
    last = run.error[-round(1.0 / run.control_period) :]
    return {
        "first error, rad": (float(np.abs(run.error[0]).max()), 1e-6),
        "largest jump of torque, N m": (float(np.abs(np.diff(run.torque, axis=0, prepend=0.0)).max()), MAX_JUMP),
        "largest speed, rad/s": (float(np.abs(run.v).max()), MAX_SPEED),
        "RMS error of the last second, rad": (float(np.sqrt(np.mean(last**2))), MAX_ERROR),
    }


def main() -> int:
    """Say what is missing or what came out; 1 where something is too large."""
    absent = missing()
    print("\n".join(absent))
    if absent:
        return 1
    with tempfile.TemporaryDirectory() as folder:
        found = figures(drive(Path(folder)))
    for name, (value, limit) in found.items():
        print(f"{name}: {value:.3g}, at most {limit:g}")
    return int(any(not value <= limit for value, limit in found.values()))


if __name__ == "__main__":
    sys.exit(main())
