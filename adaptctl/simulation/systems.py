"""Plants and controllers as systems of python-control, to be interconnected, linearised and simulated there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from adaptctl.arrays import Array, numbers, positive_number
from adaptctl.compilation import compile_function
from adaptctl.compilation.kernel import MAX_COMPILED_LINKS
from adaptctl.control.controller import Controller, ReferencePoint
from adaptctl.control.pytree import leaves, like
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.optional_packages import needed
from adaptctl.scalars import Column
from adaptctl.simulation.effects import JointEffect
from adaptctl.simulation.plant import Plant
from adaptctl.simulation.references import REFERENCE

if TYPE_CHECKING:
    import control


@needed("mechanism_system")
def mechanism_system(mechanism: Mechanism, name: str = "mechanism") -> control.NonlinearIOSystem:
    """A continuous-time python-control system of the forward dynamics of a mechanism, called `name`. It has 2r states,
    which are the outputs, positions p, rad (m if prismatic), and velocities v, rad/s (m/s), of the r primary
    (independent) joints, and r inputs, the torques, N m (N).

    Signals are ``torque[0]``, ..., ``p[0]``, ..., ``v[0]``, ..., in the order of the primary joints. With loops, p is
    followed from the reference configuration at every evaluation, which raises `SingularityError` where it cannot be,
    and `NonFiniteError` for NaN or infinity; of a tree of up to 100 joints an evaluation is not checked, NaN goes
    through. Raises `MissingExtraError` without python-control.
    """
    r, accelerations = mechanism.dof, _accelerations(mechanism)

    def update(t: float, x: Array, u: Array, params: Any) -> Array:
        return np.concatenate((x[r:], accelerations(x[:r], x[r:], u)))

    return _of_joints(update, r, name)


@needed("plant_system")
def plant_system(plant: Plant, name: str = "plant") -> control.NonlinearIOSystem:
    """A discrete-time python-control system of a plant, called `name`, that takes one step in each control period. For
    r primary (independent) joints it has 2r states, which are the outputs: positions ``p[0]``, ..., rad (m if
    prismatic), then velocities ``v[0]``, ..., rad/s (m/s). Its r inputs are the torques ``torque[0]``, ..., N m (N),
    held over the period. The plant's torque limits and friction are included.

    Raises `InputError` for a plant with effects other than in the joints, which friction is, as its state is more than
    p and v, and `MissingExtraError` without python-control. An evaluation raises `NonFiniteError` for NaN or infinity
    and where the motion becomes non-finite, and `SingularityError` where loops cannot be closed or are near a
    singularity.
    """
    r = plant.dof
    if any(not isinstance(effect, JointEffect) for effect in plant.effects):
        raise InputError("plant_system: expected a plant whose effects are in the joints, such as Friction, alone")

    def update(t: float, x: Array, u: Array, params: Any) -> Array:
        after = plant.step(plant.init(np.array(x[:r]), np.array(x[r:])), np.array(u))
        return np.concatenate((after.p, after.v))

    return _of_joints(update, r, name, dt=plant.control_period)


@needed("controller_system")
def controller_system(
    controller: Controller[Any], control_period: float, name: str = "controller"
) -> control.NonlinearIOSystem:
    """A discrete-time python-control system of a controller, called `name`, whose control law is evaluated every
    `period` (s).

    Its inputs are positions p, rad (m if prismatic), velocities v, rad/s (m/s), r each for r joints, and the
    reference's positions, velocities and accelerations, in rad, rad/s and rad/s^2 (m, m/s and m/s^2 if prismatic), r
    each (or as many as a task space has coordinates, in m, m/s, m/s^2): ``p[0]``, ..., ``v[0]``, ...,
    ``reference_p[0]``, ..., ``reference_v[0]``, ..., ``reference_a[0]``, ... Its outputs are r torques, ``torque[0]``,
    ..., N m (N). Its state, ``memory[0]``, ..., is the law's internal state, the estimate first where there is one;
    `controller_start` returns the initial one. Raises `InputError` for a period that is not positive and finite, or is
    not the controller's own where it has one, and `MissingExtraError` without python-control; an evaluation raises what
    `controller.step` raises.
    """
    import control

    control_period = _ticked(controller, control_period)
    r, m = controller.dof, controller.reference_size
    blank = controller.initial_state(controller.neutral_configuration, np.zeros(r))
    sizes = [len(part) for part in leaves(blank)]

    def tick(x: Array, u: Array) -> tuple[Array, Array]:
        reference = ReferencePoint(*np.split(np.array(u[2 * r :]), 3))
        memory = like(blank, np.split(np.array(x), np.cumsum(sizes)[:-1]))
        torque, after = controller.step(memory, np.array(u[:r]), np.array(u[r : 2 * r]), reference)
        return torque, np.concatenate([*leaves(after), np.zeros(0)])

    return control.nlsys(
        lambda t, x, u, params: tick(x, u)[1],
        lambda t, x, u, params: tick(x, u)[0],
        inputs=[*_signals(("p", "v"), r), *_signals(REFERENCE, m)],
        outputs=_signals(("torque",), r),
        states=_signals(("memory",), sum(sizes)),
        dt=control_period,
        name=name,
    )


def controller_start(controller: Controller[Any], p: Array, v: Array) -> Array:
    """The initial state (n,) of a controller's python-control system, as `controller_system` makes it: the n numbers of
    the controller's initial internal state in one array. The arm is at positions p, rad (m if prismatic), and
    velocities v, rad/s (m/s), (r,) each. Raises `InputError` on a wrong shape, `NonFiniteError` on NaN or infinity, and
    `SingularityError` where loops cannot be closed or are near a singularity."""
    for what, given in (("p", numbers(p, "p")), ("v", numbers(v, "v"))):
        if given.shape != (controller.dof,):
            raise InputError(f"{what}: expected shape ({controller.dof},), of one arm, got {given.shape}")
    return np.concatenate([*leaves(controller.init(p, v)), np.zeros(0)])


@needed("closed_loop_system")
def closed_loop_system(
    plant: Plant, controller: Controller[Any], name: str = "closed_loop"
) -> control.InterconnectedSystem:
    """A discrete-time python-control system of a plant and a controller in closed loop, called `name`, sampled every
    control period of the plant.

    Inputs are the reference's positions, velocities and accelerations, in rad, rad/s and rad/s^2 (m, m/s and m/s^2 if
    prismatic), ``reference_p[0]``, ..., ``reference_v[0]``, ..., ``reference_a[0]``, ..., r each for r joints (or as
    many as a task space has, in m); outputs are positions ``p[0]``, ..., rad (m), and velocities ``v[0]``, ..., rad/s
    (m/s), r each. The state is the plant's, p and v (2r,), then the controller's internal state, such as its estimate.

    Raises `InputError` where plant and controller differ in their number of joints or, if the controller has a period
    of its own, in their period, and for a plant with effects other than those in the joints, such as friction;
    `MissingExtraError` without python-control. An evaluation raises `NonFiniteError` for NaN or infinity and where the
    motion becomes non-finite, `SingularityError` where loops cannot be closed or are near a singularity.
    """
    import control

    if plant.dof != controller.dof:
        raise InputError(f"closed loop: the plant has {plant.dof} joints, the controller is for {controller.dof}")
    parts = [plant_system(plant), controller_system(controller, plant.control_period)]
    return control.interconnect(
        parts,
        inputs=_signals(REFERENCE, controller.reference_size),
        outputs=_signals(("p", "v"), plant.dof),
        name=name,
    )


def _of_joints(update: Any, r: int, name: str, **timing: float) -> control.NonlinearIOSystem:
    """A system of torques whose outputs are its states, p and v of r joints."""
    import control

    joints = _signals(("p", "v"), r)
    return control.nlsys(
        update, None, inputs=_signals(("torque",), r), outputs=joints, states=joints, name=name, **timing
    )


def _ticked(controller: Controller[Any], control_period: float) -> float:
    """The period, s. Raises `InputError` unless it is positive and the controller's own, where that has one."""
    control_period = positive_number(control_period, "control_period: expected a positive time in s")
    own = getattr(controller, "control_period", None)
    if own is not None and not math.isclose(own, control_period):
        raise InputError(
            f"control_period: {type(controller).__name__} is for {own:g} s, its own period, got {control_period:g} s"
        )
    return control_period


def _accelerations(mechanism: Mechanism) -> Any:
    """Forward dynamics of p, v, torque (r,), in native code for a tree that is short enough."""
    equations, parameters = mechanism.equations, Column(mechanism.inertial_parameters.tolist())
    if mechanism.continuation is not None or mechanism.dof > MAX_COMPILED_LINKS:
        return mechanism.forward_dynamics

    def accelerations(p: Column, v: Column, torque: Column) -> Column:
        return equations.forward_dynamics(p, v, torque, parameters)

    r = mechanism.dof
    return compile_function(accelerations, {"p": r, "v": r, "torque": r}, name="accelerations")


def _signals(names: Sequence[str], count: int) -> list[str]:
    return [f"{name}[{i}]" for name in names for i in range(count)]
