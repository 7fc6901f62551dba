"""Drake as the plant of a contest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked
from adaptctl.caching import cached_property
from adaptctl.description.drive import MAY_BE_NEGATIVE
from adaptctl.description.inertia import inertia_tensor
from adaptctl.description.link import GROUND, Link
from adaptctl.description.transforms import with_joint_frames
from adaptctl.errors import InputError, NonFiniteError
from adaptctl.optional_packages import needed
from adaptctl.simulation.period import PlantState
from adaptctl.simulation.plant import Plant

ACCURACY = 1e-9
"""relative, of a control period's integration"""


@dataclass(frozen=True, eq=False)
class DrakePlant(Plant):
    """Plant that Drake's multibody dynamics move, with torques held over each control period."""

    def init(
        self, p: ArrayLike, v: ArrayLike, parameters: ArrayLike | None = None, noise: ArrayLike | None = None
    ) -> PlantState:
        """Initial state of one arm."""
        p, v = (self._vector(x, what).astype(np.float64) for x, what in ((p, "p"), (v, "v")))
        return self._state(0.0, p, v, np.zeros(self.dof), False)

    def step(
        self,
        state: PlantState,
        torque: ArrayLike,
        parameters: ArrayLike | None = None,
        noise: ArrayLike | None = None,
    ) -> PlantState:
        """State of one arm a control period later."""
        given = self._finite(torque)
        applied, time = self.clip_torque(given), state.time + self.control_period
        p, v = self._model.moved(self._values(parameters), state, applied, time)
        if not np.isfinite([p, v]).all():
            raise NonFiniteError(f"{self.mechanism.name}: Drake's simulation diverged after {state.time:g} s")
        return self._state(time, p, v, applied, bool((applied != given).any()))

    def _values(self, parameters: ArrayLike | None) -> Array:
        own = self.mechanism.inertial_parameters
        return own if parameters is None else checked(parameters, own.size, f"{self.mechanism.name}: parameters")

    def _state(self, time: float, p: Array, v: Array, applied: Array, clipped: bool) -> PlantState:
        return PlantState(time, p, v, p, p, v, applied, clipped, np.empty(0), np.empty(0), np.empty(0))

    @cached_property
    def _model(self) -> _DrakeModel:
        return _DrakeModel(self)


class _DrakeModel:
    """MultibodyPlant of an arm, whose bodies' frames are those of its joints."""

    def __init__(self, plant: DrakePlant) -> None:
        with needed("the plant drake"):
            from pydrake.multibody.plant import MultibodyPlant
            from pydrake.systems.analysis import Simulator

        self._mechanism, self._parameters = plant.mechanism, np.empty(0)
        description = plant.mechanism.description
        if description.loops is not None or description.drive_couplings:
            raise InputError(f"{description.name}: the plant drake has no closed loops and coupled drives")
        self._system, self._bodies = MultibodyPlant(0.0), list[Any]()
        self._system.mutable_gravity_field().set_gravity_vector(description.gravity)
        for link in with_joint_frames(description).links:
            self._add(link)
        self._system.Finalize()
        self._simulator = Simulator(self._system)
        self._simulator.get_mutable_integrator().set_target_accuracy(ACCURACY)
        self._simulator.get_mutable_integrator().set_maximum_step_size(plant.control_period)
        self._context = self._simulator.get_mutable_context()
        self._places = [self._system.GetJointByName(name).position_start() for name in description.joint_names]

    def _add(self, link: Link) -> None:
        from pydrake.math import RigidTransform, RotationMatrix
        from pydrake.multibody.tree import FixedOffsetFrame, PrismaticJoint, RevoluteJoint

        at = link.parent_to_joint
        above = self._system.world_body() if link.parent == GROUND else self._bodies[link.parent]
        pose = RigidTransform(RotationMatrix.ProjectToRotationMatrix(at.rotation), at.translation)
        frame = self._system.AddFrame(FixedOffsetFrame(f"{link.name} before", above.body_frame(), pose))
        self._bodies.append(self._system.AddRigidBody(link.name, _spatial(link)))
        kind = RevoluteJoint if link.joint.kind.is_revolute else PrismaticJoint
        joint = self._system.AddJoint(kind(link.joint.name, frame, self._bodies[-1].body_frame(), link.joint.axis))
        self._system.AddJointActuator(link.joint.name, joint)

    def _set(self, parameters: Array) -> None:
        """Set inertial parameters (P,), rotors and viscous friction."""
        self._parameters = parameters.copy()
        description = with_joint_frames(self._mechanism.description.with_parameters(parameters))
        for body, link in zip(self._bodies, description.links, strict=True):
            drive = link.joint.drive
            if (drive.coulomb or 0.0) != 0.0 or any(drive.value(kind) for kind in MAY_BE_NEGATIVE):
                raise InputError(
                    f"{description.name}: joint {link.joint.name!r}: Drake has only viscous friction and rotors"
                )
            body.SetSpatialInertiaInBodyFrame(self._context, _spatial(link))
            self._system.GetJointByName(link.joint.name).SetDamping(self._context, drive.viscous or 0.0)
            actuator = self._system.GetJointActuatorByName(link.joint.name)
            actuator.SetGearRatio(self._context, 1.0)
            actuator.SetRotorInertia(self._context, drive.rotor_inertia or 0.0)

    def moved(self, parameters: Array, state: PlantState, torque: Array, time: float) -> tuple[Array, Array]:
        """p and v at a time, from a state with a held torque."""
        if not np.array_equal(parameters, self._parameters):
            self._set(parameters)
        self._context.SetTime(state.time)
        q, v = np.empty_like(state.p), np.empty_like(state.v)
        q[self._places], v[self._places] = state.p, state.v
        self._system.SetPositions(self._context, q)
        self._system.SetVelocities(self._context, v)
        self._system.get_actuation_input_port().FixValue(self._context, torque)
        self._simulator.Initialize()
        self._simulator.AdvanceTo(time)
        found = self._system.GetPositions(self._context), self._system.GetVelocities(self._context)
        return found[0][self._places], found[1][self._places]


def _spatial(link: Link) -> Any:
    """SpatialInertia of a link whose frame is at its joint."""
    from pydrake.multibody.tree import SpatialInertia, UnitInertia

    mass, tensor = float(link.inertia[0]), inertia_tensor(link.inertia)
    if not mass > 0.0:
        return SpatialInertia.Zero()
    about = UnitInertia(*(tensor[at] / mass for at in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))))
    return SpatialInertia(mass, link.inertia[1:4] / mass, about, skip_validity_check=True)
