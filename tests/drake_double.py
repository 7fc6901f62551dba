"""The names of Drake that its plant of a contest uses, on the dynamics of Pinocchio; Drake itself is too large here."""

from __future__ import annotations

from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pinocchio

MOST_STEP = 2.5e-4
"""s of a step of the classical Runge-Kutta method"""


def rigid(rotation: Any, translation: Any) -> pinocchio.SE3:
    return pinocchio.SE3(np.asarray(rotation), np.asarray(translation))


class Spatial:
    """Inertia of a body by its mass, center and inertia per mass about the body's origin."""

    def __init__(self, mass: float, center: Any, about: Any, skip_validity_check: bool = False) -> None:
        tensor = mass * about + mass * pinocchio.skew(np.asarray(center)) @ pinocchio.skew(np.asarray(center))
        self.inertia = pinocchio.Inertia(mass, np.asarray(center), tensor)

    @classmethod
    def Zero(cls) -> Spatial:
        return cls(0.0, np.zeros(3), np.zeros((3, 3)))


def unit(xx: float, yy: float, zz: float, xy: float, xz: float, yz: float) -> Any:
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


class Body:
    def __init__(self, number: int, spatial: Spatial) -> None:
        self.number, self.spatial = number, spatial

    def body_frame(self) -> Any:
        return self, pinocchio.SE3.Identity()

    def SetSpatialInertiaInBodyFrame(self, context: Any, spatial: Spatial) -> None:
        context.inertias[self.number] = spatial.inertia


class Joint:
    def __init__(self, name: str, before: Any, after: Any, axis: Any) -> None:
        self.name, self.frame, self.child, self.axis = name, before, after[0], np.asarray(axis, dtype=float)

    def position_start(self) -> int:
        return int(self.place)

    def SetDamping(self, context: Any, damping: float) -> None:
        context.damping[self.place] = damping


class Revolute(Joint):
    model = staticmethod(pinocchio.JointModelRevoluteUnaligned)


class Prismatic(Joint):
    model = staticmethod(pinocchio.JointModelPrismaticUnaligned)


class System:
    """Tree of bodies; its context keeps what changes."""

    def __init__(self, time_step: float) -> None:
        assert time_step == 0.0  # continuous
        self.world, self.bodies, self.joints, self.frames = (
            Body(0, Spatial.Zero()),
            list[Body](),
            dict[str, Joint](),
            [],
        )
        self.actuators = set[str]()
        self.context: Any = SimpleNamespace(time=0.0)

    def mutable_gravity_field(self) -> Any:
        return SimpleNamespace(set_gravity_vector=lambda gravity: setattr(self, "gravity", np.asarray(gravity)))

    def world_body(self) -> Body:
        return self.world

    def AddFrame(self, frame: Any) -> Any:
        return frame

    def AddRigidBody(self, name: str, spatial: Spatial) -> Body:
        self.bodies.append(Body(len(self.bodies) + 1, spatial))
        return self.bodies[-1]

    def AddJoint(self, joint: Joint) -> Joint:
        self.joints[joint.name] = joint
        return joint

    def AddJointActuator(self, name: str, joint: Joint) -> None:
        assert self.joints[name] is joint
        self.actuators.add(name)

    def Finalize(self) -> None:
        self.model = pinocchio.Model()
        self.model.gravity.linear = self.gravity
        for joint in self.joints.values():
            (parent, inner), own = joint.frame, joint.model(joint.axis)
            joint.place = self.model.addJoint(parent.number, own, inner, joint.name) - 1
        count = len(self.joints)
        self.context.damping, self.context.rotors, self.context.gears = np.zeros(count), np.zeros(count), np.ones(count)
        self.context.inertias = {body.number: body.spatial.inertia for body in self.bodies}

    def GetJointByName(self, name: str) -> Joint:
        return self.joints[name]

    def GetJointActuatorByName(self, name: str) -> Any:
        assert name in self.actuators
        place = self.joints[name].place
        return SimpleNamespace(
            SetGearRatio=lambda context, ratio: context.gears.__setitem__(place, ratio),
            SetRotorInertia=lambda context, inertia: context.rotors.__setitem__(place, inertia),
        )

    def SetPositions(self, context: Any, q: Any) -> None:
        context.q = np.array(q)

    def SetVelocities(self, context: Any, v: Any) -> None:
        context.v = np.array(v)

    def get_actuation_input_port(self) -> Any:
        return SimpleNamespace(FixValue=lambda context, torque: setattr(context, "torque", np.array(torque)))

    def GetPositions(self, context: Any) -> Any:
        return context.q

    def GetVelocities(self, context: Any) -> Any:
        return context.v


class Simulator:
    def __init__(self, system: System) -> None:
        self.system, self.data, self.ready = system, None, False
        self.integrator: dict[str, float] = {}

    def get_mutable_integrator(self) -> Any:
        return SimpleNamespace(
            set_target_accuracy=lambda x: self.integrator.__setitem__("accuracy", x),
            set_maximum_step_size=lambda x: self.integrator.__setitem__("step", x),
        )

    def get_mutable_context(self) -> Any:
        context = self.system.context
        context.SetTime = lambda time: setattr(context, "time", time)
        return context

    def Initialize(self) -> None:
        assert set(self.integrator) == {"accuracy", "step"}
        model, context = self.system.model, self.system.context
        for body in self.system.bodies:
            model.inertias[body.number] = context.inertias[body.number]
        model.armature = context.rotors * context.gears**2
        self.data, self.ready = model.createData(), True

    def AdvanceTo(self, time: float) -> None:
        assert self.ready
        context, self.ready = self.system.context, False
        count = max(1, int(np.ceil((time - context.time) / min(MOST_STEP, self.integrator["step"]))))
        state, step = np.concatenate((context.q, context.v)), (time - context.time) / count
        for _ in range(count):
            a = self._rate(state)
            b = self._rate(state + 0.5 * step * a)
            c = self._rate(state + 0.5 * step * b)
            state = state + step / 6.0 * (a + 2.0 * b + 2.0 * c + self._rate(state + step * c))
        context.q, context.v = np.split(state, 2)
        context.time = time

    def _rate(self, state: Any) -> Any:
        q, v = np.split(state, 2)
        context = self.system.context
        acceleration = pinocchio.aba(self.system.model, self.data, q, v, context.torque - context.damping * v)
        return np.concatenate((v, acceleration))


def modules() -> dict[str, ModuleType]:
    """Modules by their names in Drake."""
    found = {
        "pydrake": {},
        "pydrake.multibody": {},
        "pydrake.multibody.plant": {"MultibodyPlant": System},
        "pydrake.systems": {},
        "pydrake.systems.analysis": {"Simulator": Simulator},
        "pydrake.math": {
            "RigidTransform": rigid,
            "RotationMatrix": SimpleNamespace(ProjectToRotationMatrix=lambda rotation: rotation),
        },
        "pydrake.multibody.tree": {
            "FixedOffsetFrame": lambda name, above, pose: (above[0], above[1] * pose),
            "PrismaticJoint": Prismatic,
            "RevoluteJoint": Revolute,
            "SpatialInertia": Spatial,
            "UnitInertia": unit,
        },
    }
    made = {}
    for name, content in found.items():
        made[name] = ModuleType(name)
        vars(made[name]).update(content)
    return made
