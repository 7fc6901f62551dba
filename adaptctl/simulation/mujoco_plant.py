"""MuJoCo as the plant: it moves the arm, with contacts, joint stops and all else that a scene has."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked
from adaptctl.caching import cached_property
from adaptctl.dynamics import Mechanism
from adaptctl.errors import FileError, InputError, MissingExtraError, NonFiniteError
from adaptctl.simulation.plant import Plant
from adaptctl.simulation.plant_state import PlantState

if TYPE_CHECKING:
    import mujoco

    from adaptctl.description.readers.mujoco_model import MujocoArm

_OFF = ("actuator_dyntype", "actuator_gaintype", "actuator_biastype")
_SILENT = ("actuator_gainprm", "actuator_biasprm")


@dataclass(frozen=True, eq=False)
class MuJoCoPlant(Plant):
    """An arm of a MuJoCo model, moved by MuJoCo under torques in N m that are held over each control period.

    The torques act at the joints (`qfrc_applied`), clipped to the limits of the joints' motors; the motors themselves
    get no control. `body` is the arm's root, found where only one root body moves. Each control period is integrated
    by MuJoCo in equal steps that are no longer than the model's own. The model given is copied, never changed.
    `PlantState.drives` holds the whole scene, so that `step` is a function of what it is given.

    Actuators of the arm that are no torques would hold it against the law: they are refused with an
    `InputError`, or, with `servos_off`, switched off.
    """

    model: mujoco.MjModel | None = None
    body: str | None = None
    servos_off: bool = False

    def __post_init__(self) -> None:
        if self.model is None:
            raise InputError("MuJoCoPlant: expected a MuJoCo model; MuJoCoPlant.of makes the mechanism of it as well")
        if tuple(self.effects):
            raise InputError("MuJoCoPlant: effects are of our own plant: put what they do into MuJoCo's model")
        super().__post_init__()
        if self.arm.servos and not self.servos_off:
            raise InputError(
                f"{self.mechanism.name}: actuators that are no torques would hold the arm against the law: "
                f"{', '.join(self.arm.servos)}; put motors in their place, or switch them off with servos_off=True"
            )
        if len(self.arm.joints) != self.dof:
            raise InputError(f"{self.mechanism.name}: expected {self.dof} joints in MuJoCo's model")

    @classmethod
    def of(
        cls, robot: str | Path | Mechanism | mujoco.MjModel, control_period: float, body: str | None = None, **more: Any
    ) -> MuJoCoPlant:
        """The plant of a MuJoCo model, an MJCF scene's file, or a model made of another robot's links."""
        model = as_mujoco(robot)
        own = robot if isinstance(robot, Mechanism) else None
        return cls(own or Mechanism.from_mujoco(model, body), control_period, model=model, body=body, **more)

    def init(
        self, p: ArrayLike, v: ArrayLike, parameters: ArrayLike | None = None, noise: ArrayLike | None = None
    ) -> PlantState:
        """The state at time zero, from the arm's positions and velocities (r,); all else is as the scene draws it."""
        p, v = (self._vector(x, what).astype(np.float64) for x, what in ((p, "p"), (v, "v")))
        scene = self._scene.having(parameters)
        return self._state(0.0, *scene.begun(p, v), np.zeros(self.dof), False)

    def step(
        self,
        state: PlantState,
        torque: ArrayLike,
        parameters: ArrayLike | None = None,
        noise: ArrayLike | None = None,
    ) -> PlantState:
        """The state a control period later, under a torque (r,), clipped to the limits and held.

        `parameters` (P,) are the true ones, the model's own unless given. Raises as `Plant.step` does.
        """
        given = self._finite(torque)
        applied = self.limited(given)
        p, v, drives = self._scene.having(parameters).moved(state.drives, applied)
        if not math.isfinite(p.dot(p) + v.dot(v)):
            raise NonFiniteError(
                f"{self.mechanism.name}: MuJoCo's motion ran away after {state.time:g} s: use a shorter control "
                "period, a shorter timestep in the model, or weaker gains"
            )
        clipped = bool((applied != given).any())
        return self._state(state.time + self.control_period, p, v, drives, applied, clipped)

    def compile(self) -> None:
        """Compile now what would else be compiled when first used."""
        _ = self._energy

    def _state(self, time: float, p: Array, v: Array, drives: Array, applied: Array, clipped: bool) -> PlantState:
        return PlantState(time, p, v, p, p, v, applied, clipped, np.empty(0), drives, np.empty(0))

    @cached_property
    def arm(self) -> MujocoArm:
        """The part of the model that is the arm."""
        from adaptctl.description.readers.mujoco_model import MujocoArm

        return MujocoArm.of(self.model, self.body)

    @cached_property
    def _scene(self) -> _Scene:
        return _Scene(self)


class _Scene:
    """MuJoCo's model and data for one set of true parameters: memory in which a control period is computed."""

    def __init__(self, plant: MuJoCoPlant, parameters: Array | None = None) -> None:
        import mujoco

        from adaptctl.description.readers.mujoco_model import MujocoArm
        from adaptctl.description.writers.mujoco_model import set_parameters

        self._plant = plant
        model: Any = copy.copy(plant.model)
        arm = MujocoArm.of(model, plant.body)
        description = plant.mechanism.description
        own = plant.mechanism.inertial_parameters if parameters is None else parameters
        self.parameters = np.array(own)
        if parameters is not None:
            _ = tuple(arm.links())
            set_parameters(arm, description, description.with_parameters(parameters))
        for i in arm.actuators:
            for name in (*_OFF, *_SILENT):
                getattr(model, name)[i] = 0
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        self._substeps = max(1, math.ceil(plant.control_period / model.opt.timestep - 1e-9))
        model.opt.timestep = plant.control_period / self._substeps
        self._model, self._data = model, mujoco.MjData(model)
        self._q = [int(model.jnt_qposadr[j]) for j in arm.joints]
        self._v = [int(model.jnt_dofadr[j]) for j in arm.joints]
        self._kind = int(mujoco.mjtState.mjSTATE_INTEGRATION)
        self._size = mujoco.mj_stateSize(model, self._kind)
        self._latest: Array | None = None

    def having(self, parameters: ArrayLike | None) -> _Scene:
        """The scene with these true parameters (P,); the plant keeps the latest."""
        if parameters is None or np.array_equal(parameters, self.parameters):
            return self
        own = self._plant.mechanism.inertial_parameters
        values = checked(parameters, own.size, f"{self._plant.mechanism.name}: parameters")
        new = _Scene(self._plant, None if np.array_equal(values, own) else values)
        vars(self._plant)["_scene"] = new
        return new

    def begun(self, p: Array, v: Array) -> tuple[Array, Array, Array]:
        """The arm at p, v (r,), the rest as the scene draws it: p, v and the whole state."""
        import mujoco

        mujoco.mj_resetData(self._model, self._data)
        self._data.qpos[self._q], self._data.qvel[self._v] = p, v
        mujoco.mj_forward(self._model, self._data)
        return p, v, self._kept()

    def moved(self, whole: Array, torque: Array) -> tuple[Array, Array, Array]:
        """A control period under a torque (r,) from a whole state: p, v (r,) and the whole state after it."""
        import mujoco

        if whole is not self._latest:
            mujoco.mj_setState(self._model, self._data, whole, self._kind)
        self._data.qfrc_applied[self._v] = torque
        mujoco.mj_step(self._model, self._data, self._substeps)
        return self._data.qpos[self._q], self._data.qvel[self._v], self._kept()

    def _kept(self) -> Array:
        import mujoco

        whole = np.empty(self._size)
        mujoco.mj_getState(self._model, self._data, whole, self._kind)
        self._latest = whole
        return whole


def as_mujoco(robot: str | Path | Mechanism | mujoco.MjModel) -> mujoco.MjModel:
    """A MuJoCo model: the one given, an MJCF scene's, or one made of another robot's links. Raises as `load` does."""
    try:
        import mujoco
    except ImportError as error:
        raise MissingExtraError("MuJoCo is not installed: pip install 'adaptctl[mujoco]'") from error
    if isinstance(robot, mujoco.MjModel):
        return robot
    if isinstance(robot, str | Path) and Path(robot).suffix.lower() in (".xml", ".mjcf"):
        try:
            return mujoco.MjModel.from_xml_path(str(robot))
        except ValueError as error:
            raise FileError(f"{robot}: MuJoCo: {' '.join(str(error).split())}") from error
    from adaptctl.dynamics import load

    return (robot if isinstance(robot, Mechanism) else load(robot)).to_mujoco()
