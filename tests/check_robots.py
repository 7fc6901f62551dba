"""The Franka example, through Franka's own client, against an arm that nobody here wrote: `make check-robots`.

franky-sim moves MuJoCo's FR3 behind libfranka's network protocol, and pylibfranka is the vendor's client. The example
runs as it is, from postures about the robot's own: it must start where the arm stands, without a jump of torque, stay
below the joints' speed limits and follow its reference. Names each package that is missing, with the command that
brings it. `python tests/check_robots.py 20` takes 20 postures.
"""

from __future__ import annotations

import json
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
import json, sys, time
from franky_sim import SimulationServer
from franky_sim.mujoco_simulator import MujocoSimulator
with MujocoSimulator() as simulator:
    simulator.add_robot(initial_q=json.loads(sys.argv[1]))
    with SimulationServer(simulator, hostname_candidates=["127.0.0.1"]) as server:
        server.run_async()
        print("ready", flush=True)
        time.sleep(600.0)
"""
HOME_POSTURE, AWAY = (0.0, -0.3, 0.0, -1.9, 0.0, 1.7, 0.785), 0.4
"""rad about which, and by how much, postures are drawn"""
MAX_FIRST_ERROR = 1e-4
"""rad"""
MAX_RATE = 1000.0
"""N m/s at which the robot stops"""
MAX_SPEED = 2.62
"""rad/s: the FR3's limit of joints 1 to 4"""
MAX_ERROR = 2e-4
"""rad RMS of the worst joint in the last two seconds, from a file without rotor inertias"""


def missing() -> list[str]:
    """What is not here, and how it comes."""
    wanted = {"franky-sim": HOME / "bin" / "python", "pylibfranka": CLIENT / "pylibfranka", "franka-sim": FILE}
    return [f"{name} is missing: run make check-vendors" for name, place in wanted.items() if not place.exists()]


def drive(folder: Path, posture: list[float]) -> adaptctl.Rollout:
    """What the example recorded, which runs in a folder with the arm's file."""
    (folder / "fr3.urdf").symlink_to(FILE)
    paths = os.pathsep.join([str(ROOT), str(CLIENT)])
    example = [sys.executable, str(ROOT / "docs" / "examples" / "franka_loop.py"), "127.0.0.1", "--any-kernel"]
    with subprocess.Popen(
        [str(HOME / "bin" / "python"), "-c", SERVER, json.dumps(posture)], stdout=subprocess.PIPE, text=True
    ) as server:
        try:
            assert server.stdout is not None
            assert server.stdout.readline() == "ready\n", "franky-sim did not start"
            subprocess.run(example, cwd=folder, env={**os.environ, "PYTHONPATH": paths}, check=True, timeout=300.0)
        finally:
            server.kill()
    return adaptctl.Rollout.load(folder / "run.parquet")


def figures(run: adaptctl.Rollout) -> dict[str, tuple[float, float]]:
    """What must be small, and how small, by name."""
    last = run.error[-round(2.0 / run.control_period) :]
    added = np.stack([run.flags[name] for name in sorted(run.flags) if name.startswith("compensation.")], axis=1)
    sent = np.diff(run.applied - added, axis=0, prepend=0.0)
    periods = np.diff(run.time, prepend=run.time[0] - run.control_period)[:, None]
    return {
        "first error, rad": (float(np.abs(run.error[0]).max()), MAX_FIRST_ERROR),
        "greatest rate of torque, N m/s": (float(np.abs(sent / periods).max()), MAX_RATE),
        "greatest speed, rad/s": (float(np.abs(run.v).max()), MAX_SPEED),
        "RMS error of the worst joint, rad": (float(np.sqrt(np.mean(last**2, axis=0)).max()), MAX_ERROR),
    }


def main(count: int = 1) -> int:
    """Exit code: 1 where something is missing or too large."""
    absent, random, bad = missing(), np.random.default_rng(0), False
    print("\n".join(absent))
    for _ in range(0 if absent else count):
        posture = (np.array(HOME_POSTURE) + random.uniform(-AWAY, AWAY, 7)).tolist()
        with tempfile.TemporaryDirectory() as folder:
            found = figures(drive(Path(folder), posture))
        print(
            "; ".join(f"{name}: {value:.3g} (at most {limit:g})" for name, (value, limit) in found.items()), flush=True
        )
        bad = bad or any(not value <= limit for value, limit in found.values())
    return int(bad or bool(absent))


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:2])))
