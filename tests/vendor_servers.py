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
served = threading.Thread(target=server.start, daemon=True)
served.start()
while served.is_alive() and (server.physics_sim.data is None or server.physics_sim.data.time < 1.0):
    time.sleep(0.1)
print("ready" if served.is_alive() else "the port is taken", flush=True)
time.sleep(600.0)
"""
"""FR3 whose server aborts motions beyond the limits of Franka's interface; the argument is its posture"""

WIDOWX = """
import json, sys, time
import mujoco
from trossen_arm_sim import server as trossen
from trossen_arm_sim.sim import WidowXSim


class WithEfforts(WidowXSim):
    efforts, servos = (), None

    def apply_joint_commands(self, modes, positions):
        super().apply_joint_commands(modes, positions)
        with self._lock:
            model, arm = self.model, self._actuator_ids[:-1]
            self.servos = self.servos or (model.actuator_gainprm.copy(), model.actuator_biasprm.copy())
            for i, place in enumerate(arm):
                free = modes[i].name == "EXTERNAL_EFFORT"
                model.actuator_gainprm[place] = 0.0 if free else self.servos[0][place]
                model.actuator_biasprm[place] = 0.0 if free else self.servos[1][place]
                self.data.qfrc_applied[self._qvel_addr[i]] = self.efforts[i] if free else 0.0


def with_efforts(data, count, parse=trossen.parse_robot_input):
    found = parse(data, count)
    sim.efforts = [joint.effort for joint in found]
    return found


def with_its_own_time(self):
    self._output_id += 1
    with sim._lock:
        time_us = int(1e6 * sim.data.time)
    return trossen.pack_robot_output(self.error_state, self._output_id, time_us, sim.read_joint_outputs())


posture, scene = json.loads(sys.argv[1])
sim = WithEfforts()
mujoco.mj_saveLastXML(scene, sim.model)
sim.data.qpos[sim._qpos_addr[:-1]] = sim.data.ctrl[sim._actuator_ids[:-1]] = posture
mujoco.mj_forward(sim.model, sim.data)
trossen.parse_robot_input = with_efforts
trossen.TrossenArmSimServer._pack_output = with_its_own_time
sim.start()
trossen.TrossenArmSimServer(sim, host="127.0.0.1").start()
print("ready", flush=True)
time.sleep(600.0)
"""
"""WidowX AI to which efforts are added, which its simulator ignores; the arguments are a posture and a file to write"""
