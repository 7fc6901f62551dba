"""A custom loop around MuJoCo: three lines a period, and the run kept."""

from __future__ import annotations

import sys

import mujoco
import numpy as np

import adaptctl

PERIOD = 1e-3


def track(scene: str, body: str | None, duration: float, path: str | None = None) -> adaptctl.Rollout:
    """An arm of a scene that learns to follow its reference."""
    model = mujoco.MjModel.from_xml_path(scene)
    model.opt.timestep = PERIOD
    data = mujoco.MjData(model)
    arm = adaptctl.Mechanism.from_mujoco(model, body)
    joints = [joint.name for joint in arm.primary_joints]
    places = [int(model.joint(name).qposadr[0]) for name in joints]
    speeds = [int(model.joint(name).dofadr[0]) for name in joints]
    tuning = adaptctl.tune(arm, control_period=PERIOD)
    reduced = adaptctl.ReducedModel(arm, adaptctl.fundamental_basis(adaptctl.essential_space(arm)))
    controller, reference = tuning.controller(reduced).compile(), tuning.reference
    data.qpos[places] = reference.at(0.0).p + tuning.initial_error
    state = controller.init(data.qpos[places], data.qvel[speeds])
    with adaptctl.RunLogger(arm.dof, PERIOD, path, estimates=len(reduced.names)) as log:
        while data.time < duration:
            time, p, v, point = data.time, data.qpos[places], data.qvel[speeds], reference.at(data.time)
            torque, state = controller.step(state, p, v, point)
            data.qfrc_applied[speeds] = np.clip(torque, -arm.effort_limits, arm.effort_limits)
            mujoco.mj_step(model, data)
            log.append(time, p, v, point, torque, data.qfrc_applied[speeds], state.estimate)
        return log.rollout()


if __name__ == "__main__":
    run = track(sys.argv[1], sys.argv[2] if len(sys.argv) > 2 else None, 10.0, "run.parquet")
    print(f"{1e3 * float(np.sqrt(np.mean(run.error[-2000:] ** 2))):.2f} mrad in the last two seconds")
