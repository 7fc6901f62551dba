"""Programs that serve vendors' simulators to `check_robots.py`, each in the environment that its packages ask for.

Simulators whose physics is a thread of its own tell a busy machine of times that the arm has not lived: one lost 9 % of
them here, which no controller can follow. Where that is so, physics goes with what is told.
"""

FRANKY = """
import json, sys, time
import xml.etree.ElementTree as ET
from franky_sim import SimulationServer
from franky_sim.mujoco_simulator import MujocoSimulator

posture, mass = json.loads(sys.argv[1])
with MujocoSimulator() as simulator:
    simulator.add_robot(initial_q=posture)
    hand = next(body for body in simulator.worldbody.iter("body") if body.get("name") == "robot0_hand")
    box = {"type": "box", "size": "0.04 0.04 0.04", "mass": str(mass), "contype": "0", "conaffinity": "0"}
    mass and ET.SubElement(ET.SubElement(hand, "body", name="payload", pos="0 0 0.14"), "geom", **box)
    with SimulationServer(simulator, hostname_candidates=["127.0.0.1"]) as server:
        server.run_async()
        time.sleep(2.0)
        print("ready", flush=True)
        time.sleep(600.0)
"""
"""FR3 with a mass in kg in its hand; the argument is its posture and the mass"""

FRANKA_LIMITS = """
import json, sys, threading, time
import mujoco
from franka_sim import mujoco_franka_sim
from franka_sim.franka_sim_server import FrankaSimServer
from franka_sim.mujoco_franka_sim import MujocoFrankaSim


def go_with_the_states(self):
    told, patience = None, 1e-3
    while self.running:
        self._read_and_publish_state()
        since = time.perf_counter()
        while server._last_published_message_id == told and time.perf_counter() < since + patience:
            time.sleep(5e-5)
        now = server._last_published_message_id
        told, patience = now, 1e-3 if now == told else 0.02
        self._apply_control()
        mujoco.mj_step(self.model, self.data)


mujoco_franka_sim.ARM_INITIAL_Q[:] = json.loads(sys.argv[1])
MujocoFrankaSim.run_simulation = go_with_the_states
server = FrankaSimServer(
    host="127.0.0.1", enable_gripper=False, enforce_motion_limits=True, enforce_comm_constraints=False
)
threading.Thread(target=server.start, daemon=True).start()
while getattr(server.physics_sim, "data", None) is None or server.physics_sim.data.time < 1.0:
    time.sleep(0.1)
print("ready", flush=True)
time.sleep(600.0)
"""
"""FR3 whose server aborts motions beyond the limits of Franka's interface; the argument is its posture"""
