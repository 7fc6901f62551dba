"""MuJoCo as the plant."""

from __future__ import annotations

import copy
import math
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked
from adaptctl.caching import cached_property
from adaptctl.control.controller import Reference
from adaptctl.control.references import Sinusoids
from adaptctl.description import builtin_file, builtin_names
from adaptctl.dynamics import Mechanism
from adaptctl.errors import (
    FileError,
    InputError,
    MissingExtraError,
    NonFiniteError,
    ReferenceWarning,
    SimplificationWarning,
    suggested_name,
    warn,
)
from adaptctl.files import similar, validate_readable
from adaptctl.simulation.period import PlantState
from adaptctl.simulation.plant import Plant
from adaptctl.simulation.push import HandPush, validate_pushes

if TYPE_CHECKING:
    import mujoco

    from adaptctl.description.readers.mujoco_arm import MujocoArm


_OFF = ("actuator_dyntype", "actuator_gaintype", "actuator_biastype")
_SILENT = ("actuator_gainprm", "actuator_biasprm")
TOUCH_FLAGS = tuple(f"{what}_{axis}" for what in ("contact_force", "contact_point") for axis in "xyz")
"""Force in N on the arm by all that touches it, and its point in m, in the world's frame; 0 without contact."""


@dataclass(frozen=True, eq=False)
class MuJoCoPlant(Plant):
    """Plant that MuJoCo simulates, with torques held over each control period."""

    model: mujoco.MjModel | None = None
    body: str | None = None
    servos_off: bool = False
    pushes: tuple[HandPush, ...] = ()

    def __post_init__(self) -> None:
        if self.model is None:
            raise InputError("MuJoCoPlant: expected a MuJoCo model; MuJoCoPlant.of also creates the mechanism")
        if tuple(self.effects):
            raise InputError("MuJoCoPlant: effects are not supported: model them in MuJoCo")
        super().__post_init__()
        if self.arm.held:
            raise InputError(
                f"{self.mechanism.name}: the base {self.arm.held[0]!r} floats in this MuJoCo model, where nothing "
                "drives it: weld it to the world, or give the file, whose base is held"
            )
        if self.arm.servos and not self.servos_off:
            raise InputError(
                f"{self.mechanism.name}: these actuators are not torques and would work against the controller: "
                f"{', '.join(self.arm.servos)}; replace them by motors, or switch them off with servos_off=True"
            )
        if len(self.arm.joints) != self.dof:
            raise InputError(f"{self.mechanism.name}: expected {self.dof} joints in the MuJoCo model")
        validate_pushes(self.pushes)
        for push in self.pushes:
            self._pushed(push)

    @classmethod
    def of(
        cls, robot: str | Path | Mechanism | mujoco.MjModel, control_period: float, body: str | None = None, **more: Any
    ) -> MuJoCoPlant:
        """Plant of an MJCF scene, an `MjModel` or another robot."""
        model = as_mujoco(robot)
        own = robot if isinstance(robot, Mechanism) else None
        return cls(own or Mechanism.from_mujoco(model, body), control_period, model=model, body=body, **more)

    def init(
        self, p: ArrayLike, v: ArrayLike, parameters: ArrayLike | None = None, noise: ArrayLike | None = None
    ) -> PlantState:
        """Initial state of one arm, the scene in its initial state."""
        p, v = (self._vector(x, what).astype(np.float64) for x, what in ((p, "p"), (v, "v")))
        scene = self._scene.having(parameters)
        return self._state(0.0, *scene.started(p, v), np.zeros(self.dof), False, scene.touch())

    def step(
        self,
        state: PlantState,
        torque: ArrayLike,
        parameters: ArrayLike | None = None,
        noise: ArrayLike | None = None,
    ) -> PlantState:
        """State of one arm a control period later."""
        given = self._finite(torque)
        applied, scene = self.clip_torque(given), self._scene.having(parameters)
        p, v, drives = scene.moved(state.drives, applied)
        if not math.isfinite(p.dot(p) + v.dot(v)):
            raise NonFiniteError(
                f"{self.mechanism.name}: the MuJoCo simulation diverged after {state.time:g} s: use a shorter control "
                "period, a shorter timestep in the model, or smaller gains"
            )
        clipped = bool((applied != given).any())
        return self._state(state.time + self.control_period, p, v, drives, applied, clipped, scene.touch())

    @property
    def flags(self) -> tuple[str, ...]:
        """Names of the numbers that tell of contacts."""
        return TOUCH_FLAGS

    def compile(self) -> None:
        """Compile the energy to native code."""
        _ = self._energy

    def _state(
        self, time: float, p: Array, v: Array, drives: Array, applied: Array, clipped: bool, touch: Array
    ) -> PlantState:
        return PlantState(time, p, v, p, p, v, applied, clipped, touch, drives, np.empty(0))

    @cached_property
    def arm(self) -> MujocoArm:
        """Arm's part of the MuJoCo model."""
        from adaptctl.description.readers.mujoco_arm import MujocoArm

        return MujocoArm.of(self.model, self.body)

    def _pushed(self, push: HandPush) -> int:
        """Body that a push acts on."""
        names = [self.arm.model.body(i).name for i in self.arm.bodies]
        if push.body is not None and push.body not in names:
            raise InputError(
                f"{self.mechanism.name}: push: there is no link {push.body!r}"
                f"{suggested_name(str(push.body).lower(), names)}; expected one of {', '.join(names)}"
            )
        return self.arm.bodies[-1 if push.body is None else names.index(push.body)]

    @cached_property
    def _scene(self) -> _Scene:
        return _Scene(self)


class _Scene:
    """MuJoCo's model and data for one set of true parameters."""

    def __init__(self, plant: MuJoCoPlant, parameters: Array | None = None) -> None:
        import mujoco

        from adaptctl.description.readers.mujoco_arm import MujocoArm
        from adaptctl.description.writers.mujoco_model import set_parameters

        self._plant = plant
        model: Any = copy.copy(plant.model)
        arm = MujocoArm.of(model, plant.body)
        description = plant.mechanism.description
        own = plant.mechanism.inertial_parameters if parameters is None else parameters
        self.parameters = np.array(own)
        if parameters is not None:
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
        self._bodies, self._wrench = frozenset(arm.bodies), np.zeros(6)
        self._pushes = [(plant._pushed(push), push) for push in plant.pushes]
        self._kind = int(mujoco.mjtState.mjSTATE_INTEGRATION)
        self._size = mujoco.mj_stateSize(model, self._kind)
        self._latest: Array | None = None
        self._pushing: list[tuple[Array, Array]] = []

    def having(self, parameters: ArrayLike | None) -> _Scene:
        """Scene with true parameters (P,), the latest being kept."""
        own = self._plant.mechanism.inertial_parameters
        given = own if parameters is None else parameters
        if np.array_equal(given, self.parameters):
            return self
        values = checked(given, own.size, f"{self._plant.mechanism.name}: parameters")
        new = _Scene(self._plant, None if np.array_equal(values, own) else values)
        vars(self._plant)["_scene"] = new
        return new

    def started(self, p: Array, v: Array) -> tuple[Array, Array, Array]:
        """p, v and whole state with the arm at p, v (r,)."""
        import mujoco

        mujoco.mj_resetData(self._model, self._data)
        self._pushing = []
        self._data.qpos[self._q], self._data.qvel[self._v] = p, v
        mujoco.mj_forward(self._model, self._data)
        return p, v, self._kept()

    def moved(self, whole: Array, torque: Array) -> tuple[Array, Array, Array]:
        """p, v and whole state after a control period."""
        import mujoco

        if whole is not self._latest:
            mujoco.mj_setState(self._model, self._data, whole, self._kind)
        self._data.qfrc_applied[self._v] = torque
        self._push()
        mujoco.mj_step(self._model, self._data, self._substeps)
        return self._data.qpos[self._q], self._data.qvel[self._v], self._kept()

    def _push(self) -> None:
        """Apply the pushes of a control period, and keep their forces and points."""
        import mujoco

        if not self._pushes:
            return
        mujoco.mj_kinematics(self._model, self._data)
        data, self._pushing = self._data, []
        data.xfrc_applied[[body for body, _ in self._pushes]] = 0.0
        for body, push in self._pushes:
            at = self._model.body_ipos[body] if push.point is None else push.point
            force, point = push.at(data.time), data.xpos[body] + data.xmat[body].reshape(3, 3) @ at
            data.xfrc_applied[body] += [*force, *np.cross(point - data.xipos[body], force)]
            self._pushing.append((force, point))

    def touch(self) -> Array:
        """Force (3,) on the arm by what it touches and its point (3,), in the world's frame; zeros without contact."""
        found, total = np.zeros(6), 0.0
        for force, point in (*map(self._contact, range(self._data.ncon)), *self._pushing):
            size = math.sqrt(force @ force)
            found += np.concatenate((force, size * point))
            total += size
        found[3:] /= total or 1.0
        return found

    def _contact(self, k: int) -> tuple[Array, Array]:
        """Force on the arm by a contact, and its point; none by a contact within the arm, or outside of it."""
        import mujoco

        contact = self._data.contact[k]
        ours = [geom >= 0 and int(self._model.geom_bodyid[geom]) in self._bodies for geom in contact.geom]
        if ours[0] == ours[1]:
            return np.zeros(3), np.zeros(3)
        mujoco.mj_contactForce(self._model, self._data, k, self._wrench)  # on the second of the two
        return (1.0 if ours[1] else -1.0) * (self._wrench[:3] @ contact.frame.reshape(3, 3)), contact.pos

    def _kept(self) -> Array:
        import mujoco

        whole = np.empty(self._size)
        mujoco.mj_getState(self._model, self._data, whole, self._kind)
        self._latest = whole
        return whole


def as_mujoco(robot: str | Path | Mechanism | mujoco.MjModel) -> mujoco.MjModel:
    """MuJoCo model of a scene, a model or a mechanism."""
    try:
        import mujoco
    except ImportError as error:
        raise MissingExtraError("MuJoCo is not installed: pip install 'adaptctl[mujoco]'") from error
    if isinstance(robot, mujoco.MjModel):
        return robot
    if isinstance(robot, str) and robot in builtin_names():
        robot = builtin_file(robot)
    if isinstance(robot, str | Path) and Path(robot).suffix.lower() in (".xml", ".mjcf"):
        if not Path(robot).exists():
            raise FileError(f"{robot}: cannot be read (no such file or directory){similar(robot)}")
        validate_readable(robot)
        try:
            return _held(robot, mujoco.MjModel.from_xml_path(str(robot)))
        except ValueError as error:
            raise FileError(f"{robot}: MuJoCo: {' '.join(str(error).split())}") from error
    from adaptctl.dynamics import load

    return (robot if isinstance(robot, Mechanism) else load(robot)).to_mujoco()


def _held(path: str | Path, model: mujoco.MjModel) -> mujoco.MjModel:
    """Model of a file, with the bases of its mechanisms held still."""
    import mujoco

    if not np.any(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE):
        return model
    from adaptctl.description.readers.mjcf_joints import held_scene

    spec = mujoco.MjSpec.from_file(str(path))
    if not (names := held_scene(spec)):
        return model
    warn(f"{path}: the base is held still: {', '.join(names)}", SimplificationWarning)
    return spec.compile()


CONTACT_SAMPLES, CONTACT_HORIZON = 201, 20.0
"""number of times, and s"""
SHRINKING_FACTOR, MAX_SHRINKINGS = 0.8, 20
"""shrinking of a reference towards the scene's posture, and how often at most"""

Pair = tuple[str, str]
"""names of two bodies"""


def contacts_at(plant: MuJoCoPlant, positions: Array) -> Counter[Pair]:
    """Number of positions (n, r) with contact, by pair."""
    import mujoco

    model, arm = plant.model, plant.arm
    data, places = mujoco.MjData(model), [int(model.jnt_qposadr[j]) for j in arm.joints]  # type: ignore[union-attr]
    found: Counter[Pair] = Counter()
    for p in positions:
        data.qpos[places] = p
        mujoco.mj_forward(model, data)
        deep = [contact.geom for contact in data.contact if contact.dist < 0.0]
        pairs = {tuple(int(model.geom_bodyid[geom]) for geom in geoms) for geoms in deep}  # type: ignore[union-attr]
        found.update({_named(model, *sorted(pair)) for pair in pairs if set(pair) & set(arm.bodies)})
    return found


def contacts_along(plant: MuJoCoPlant, reference: Reference) -> Counter[Pair]:
    """Number of times of a reference with contact, by pair."""
    return contacts_at(plant, reference(np.linspace(0.0, CONTACT_HORIZON, CONTACT_SAMPLES)).p)


def warn_of_contacts(plant: MuJoCoPlant, reference: Reference) -> None:
    """Warn (`ReferenceWarning`) of contacts along a reference."""
    if not (found := contacts_along(plant, reference)):
        return
    (one, other), count = found.most_common(1)[0]
    more = f", and {len(found) - 1} more pairs of bodies" if len(found) > 1 else ""
    warn(
        f"{plant.mechanism.name}: along the reference, {one!r} and {other!r} are in contact at {count} of "
        f"{CONTACT_SAMPLES} times{more}, but the model of the controller has no contacts: give another reference, or "
        "exclude the pair in the scene",
        ReferenceWarning,
    )


def clear_of_contacts(plant: MuJoCoPlant, drawn: Sinusoids) -> Sinusoids:
    """Sinusoids without contacts."""
    if not contacts_along(plant, drawn):
        return drawn
    model, arm = plant.model, plant.arm
    home = np.array([model.qpos0[model.jnt_qposadr[j]] for j in arm.joints])  # type: ignore[union-attr]
    for share in (SHRINKING_FACTOR**k for k in range(1, MAX_SHRINKINGS)):
        center = home + share * (drawn.center - home)
        nearer = Sinusoids(center, share * drawn.amplitude, drawn.frequency, drawn.phase, start_time=drawn.start_time)
        if not contacts_along(plant, nearer):
            return nearer
    found = contacts_at(plant, home[None])
    names = " and ".join(repr(name) for name in next(iter(found), ("it", "the scene")))
    raise InputError(
        f"{plant.mechanism.name}: no contact-free motion about the posture of the scene: {names} are in contact"
    )


def _named(model: object, one: int, other: int) -> Pair:
    names = [model.body(i).name or f"body {i}" for i in (one, other)]  # type: ignore[attr-defined]
    return names[0], names[1]
