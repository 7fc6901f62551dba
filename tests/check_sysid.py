"""Coordinates of base parameters against the `Pseudo` form of `mujoco.sysid`, in that toolbox: `make check-neighbours`.

Arms under position servos follow sines for three seconds in MuJoCo; their links are others than those the fit begins
with. Both forms begin there, with one tolerance and bounds that neither reaches. Prints iterations, the condition of
the Jacobian with scaled columns, and the error of the prediction.
"""

from __future__ import annotations

import io
import sys
from typing import Any

import mujoco
import numpy as np
from mujoco import minimize, rollout, sysid
from scipy.linalg import expm

import adaptctl
from adaptctl.arrays import Array
from adaptctl.description.inertia import from_pseudo_inertia, is_physically_consistent, pseudo_inertia
from adaptctl.description.writers.mujoco_model import mjcf_text
from adaptctl.identification import MujocoBodies

STEP, STEPS, STIFFNESS = 2e-3, 1500, 30.0
"""Of the simulation (s), and how many; rad/s of the servos"""
CASES = (("puma560_measured", 0.05, 2), ("puma560_measured", 0.1, 1), ("puma560_measured", 0.2, 4))
"""Arms, how far their links are off (logarithms of their axes), seeds"""
MOST_ITERATIONS, MOST_CONDITION, MOST_ERROR = 1.0 / 3.0, 1e4, 1e-9
FEW = 5
"""Iterations that are not compared"""


def servoed(arm: adaptctl.Mechanism, inertias: Array) -> mujoco.MjSpec:
    """Specification of an arm with sensors and with position servos for given inertias (kg m^2)."""
    spec = mujoco.MjSpec.from_string(mjcf_text(arm.description))
    spec.option.timestep, spec.option.integrator = STEP, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for motor in list(spec.actuators):
        spec.delete(motor)
    for joint, inertia in zip(spec.joints, inertias, strict=True):
        joint.limited, of = 0, {"objtype": mujoco.mjtObj.mjOBJ_JOINT, "objname": joint.name}
        servo = spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.set_to_position(kp=STIFFNESS**2 * inertia, kv=1.4 * STIFFNESS * inertia)
        spec.add_sensor(name=f"{joint.name} position", type=mujoco.mjtSensor.mjSENS_JOINTPOS, **of)
        spec.add_sensor(name=f"{joint.name} velocity", type=mujoco.mjtSensor.mjSENS_JOINTVEL, **of)
    return spec


def changed(arm: adaptctl.Mechanism, size: float, random: np.random.Generator) -> adaptctl.Mechanism:
    """The arm with other consistent links."""
    tens = []
    for link in arm.links:
        root, turn = np.linalg.cholesky(pseudo_inertia(link.inertia)), size * random.normal(size=(4, 4))
        tens.append(from_pseudo_inertia(root @ expm(turn + turn.T) @ root.T))
    return arm.with_parameters(np.concatenate([*tens, arm.inertial_parameters[10 * len(tens) :]]))


def recorded(model: mujoco.MjModel, random: np.random.Generator) -> tuple[Array, Any, Any]:
    """Initial state, commands and sensors of the run."""
    times = STEP * np.arange(STEPS + 1)
    sines = np.sin(
        random.uniform(1.0, 8.0, (3, 1, model.nu)) * times[:, None] + random.uniform(0.0, 6.0, (3, 1, model.nu))
    )
    commands = np.sum(random.uniform(0.2, 0.5, (3, 1, model.nu)) * sines, axis=0)
    first = sysid.create_initial_state(model, commands[0], (commands[1] - commands[0]) / STEP, None)
    states, sensed = rollout.rollout([model], mujoco.MjData(model), first[None], commands[None, :-1])
    given = sysid.TimeSeries.from_control_names(times[:-1], commands[:-1], model)
    return first, given, sysid.TimeSeries.from_names(states[0, :, 0], sensed[0], model)


def pseudo(spec: mujoco.MjSpec) -> sysid.ParameterDict:
    """The toolbox's own form; its bodies' NaN quaternions do not compile in MuJoCo 4.0."""
    found, model = sysid.ParameterDict(), spec.compile()
    for name in [body.name for body in spec.bodies if body.name != "world"]:

        def write(spec: mujoco.MjSpec, parameter: sysid.Parameter, name: str = name) -> None:
            sysid.apply_body_inertia(spec, name, parameter)
            spec.body(name).iquat[:] = [1.0, 0.0, 0.0, 0.0]

        kind = sysid.InertiaType.Pseudo
        found.add(sysid.body_inertia_param(spec.copy(), model, name, kind, modifier=write))
    return found


def fitted(
    parameters: sysid.ParameterDict, spec: mujoco.MjSpec, run: tuple[Array, Any, Any]
) -> tuple[int, float, float, bool]:
    """Iterations, condition, error, and whether the model that is written is consistent."""
    first, given, sensed = run
    sequences = [sysid.ModelSequences("arm", spec.copy(), "sines", first, given, sensed)]
    residual = sysid.build_residual_fn(models_sequences=sequences)
    now = parameters.copy()
    x, log = minimize.least_squares(
        parameters.as_vector(),
        lambda x: np.concatenate(residual(x, now)[0]),
        bounds=parameters.get_bounds(),
        verbose=minimize.Verbosity.FULLITER,
        output=io.StringIO(),
    )
    now.update_from_vector(x.ravel())
    arm = adaptctl.Mechanism.from_mujoco(sysid.apply_param_modifiers(now, spec.copy()))
    scaled = log[-1].jacobian / np.linalg.norm(log[-1].jacobian, axis=0)
    error = float(np.sqrt(np.mean(log[-1].residual ** 2)))
    consistent = all(is_physically_consistent(link.inertia) for link in arm.links)
    return len(log) - 1, float(np.linalg.cond(scaled)), error, consistent


def main() -> int:
    if not hasattr(sysid, "ParameterDict"):
        print("mujoco.sysid is missing: .venv-neighbours/bin/pip install 'mujoco[sysid]'")
        return 1
    failed = 0
    for name, size, seed in CASES:
        random, arm = np.random.default_rng(seed), adaptctl.load(name)
        inertias = np.diag(arm.mass_matrix(np.zeros(arm.dof)))
        spec = servoed(arm, inertias)
        run = recorded(servoed(changed(arm, size, random), inertias).compile(), random)
        ours = sysid.ParameterDict()
        ours.add(MujocoBodies.of(spec.copy()).to_sysid())
        found = {}
        for form, one in (("coordinates", ours), ("Pseudo", pseudo(spec))):
            found[form] = iterations, condition, error, _ = fitted(one, spec, run)
            told = f"{iterations} iterations, condition {condition:.0e}, error {error:.0e}"
            print(f"{name} off by {size:g}, {form}: {told}", flush=True)
        (iterations, condition, error, consistent), (theirs, *_) = found.values()
        good = error < MOST_ERROR and condition < MOST_CONDITION and consistent
        failed |= int(not good or iterations > max(FEW, MOST_ITERATIONS * theirs))
    return failed


if __name__ == "__main__":
    sys.exit(main())
