"""Systems for python-control."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from adaptctl.arrays import Array, numbers, positive_period
from adaptctl.compilation import compile_function
from adaptctl.compilation.routine import MAX_COMPILED_LINKS
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
    """
    Return the forward dynamics of a mechanism as a continuous-time python-control system.

    Parameters
    ----------
    mechanism : Mechanism
        Robot with r primary joints.
    name : str, default "mechanism"
        Name in python-control, by which interconnections tell systems apart.

    Returns
    -------
    control.NonlinearIOSystem
        System with the inputs ``torque[0]``, ... in N m (N if prismatic) and the states and outputs ``p[0]``, ... in
        rad (m) and ``v[0]``, ... in rad/s (m/s).

    Raises
    ------
    MissingExtraError
        If python-control is not installed.

    Notes
    -----
    An evaluation with loops follows p from the reference configuration: `SingularityError` where it cannot,
    `NonFiniteError` for NaN or infinity. A tree of up to 100 joints is not checked.

    Examples
    --------
    >>> from adaptctl.simulation.systems import mechanism_system
    >>> system = mechanism_system(arm)
    >>> system.nstates, system.ninputs
    (4, 2)
    """
    r, accelerations = mechanism.dof, _accelerations(mechanism)

    def update(t: float, x: Array, u: Array, params: Any) -> Array:
        return np.concatenate((x[r:], accelerations(x[:r], x[r:], u)))

    return _of_joints(update, r, name)


@needed("plant_system")
def plant_system(plant: Plant, name: str = "plant") -> control.NonlinearIOSystem:
    """
    Return a plant as a discrete-time python-control system.

    Parameters
    ----------
    plant : Plant
        Robot with r primary joints and effects in the joints alone; its torque limits hold.
    name : str, default "plant"
        Name in python-control, by which interconnections tell systems apart.

    Returns
    -------
    control.NonlinearIOSystem
        System with the inputs ``torque[0]``, ... in N m (N if prismatic) and the states and outputs ``p[0]``, ... in
        rad (m) and ``v[0]``, ... in rad/s (m/s).

    Raises
    ------
    InputError
        If the plant has effects other than in the joints, or with a state: its state is then more than p and v.
    MissingExtraError
        If python-control is not installed.

    Notes
    -----
    An evaluation raises `NonFiniteError` for non-finite numbers, `SingularityError` where loops cannot be closed.

    Examples
    --------
    >>> from adaptctl.simulation.systems import plant_system
    >>> system = plant_system(plant)
    >>> system.nstates, system.dt
    (4, 0.001)
    """
    r = plant.dof
    if any(not isinstance(effect, JointEffect) or effect.has_state for effect in plant.effects):
        raise InputError("plant_system: expected a plant with joint effects without a state only, such as Friction")

    def update(t: float, x: Array, u: Array, params: Any) -> Array:
        after = plant.step(plant.init(np.array(x[:r]), np.array(x[r:])), np.array(u))
        return np.concatenate((after.p, after.v))

    return _of_joints(update, r, name, dt=plant.control_period)


@needed("controller_system")
def controller_system(
    controller: Controller[Any], control_period: float, name: str = "controller"
) -> control.NonlinearIOSystem:
    """
    Return a controller as a discrete-time python-control system.

    Parameters
    ----------
    controller : Controller
        Controller of r joints.
    control_period : float
        Sampling time in s.
    name : str, default "controller"
        Name in python-control, by which interconnections tell systems apart.

    Returns
    -------
    control.NonlinearIOSystem
        System with the inputs ``p[0]``, ..., ``v[0]``, ..., ``reference_p[0]``, ..., ``reference_v[0]``, ...,
        ``reference_a[0]``, ..., the outputs ``torque[0]``, ... and the states ``memory[0]``, ..., the estimate first.
        `controller_start` returns the initial state.

    Raises
    ------
    InputError
        If the period is not positive and finite or not the controller's own.
    MissingExtraError
        If python-control is not installed.

    Examples
    --------
    >>> from adaptctl.simulation.systems import controller_system
    >>> system = controller_system(law, period)
    >>> system.ninputs, system.noutputs
    (10, 2)
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
    """
    Return the initial state of a controller's python-control system.

    Parameters
    ----------
    controller : Controller
        Controller of r joints.
    p, v : ndarray
        Positions in rad (m if prismatic) and velocities in rad/s (m/s), (r,).

    Returns
    -------
    ndarray
        Internal state (n,) as one array, the estimate first in SI units.

    Raises
    ------
    InputError
        If a shape is wrong.
    NonFiniteError
        If a number is NaN or infinite.
    SingularityError
        If kinematic loops cannot be closed.

    Examples
    --------
    >>> from adaptctl.simulation.systems import controller_start
    >>> controller_start(law, p, v)[:6].shape
    (6,)
    """
    for what, given in (("p", numbers(p, "p")), ("v", numbers(v, "v"))):
        if given.shape != (controller.dof,):
            raise InputError(f"{what}: expected shape ({controller.dof},), for one arm, got {given.shape}")
    return np.concatenate([*leaves(controller.init(p, v)), np.zeros(0)])


@needed("closed_loop_system")
def closed_loop_system(
    plant: Plant, controller: Controller[Any], name: str = "closed_loop"
) -> control.InterconnectedSystem:
    """
    Return plant and controller in closed loop as a discrete-time python-control system.

    Parameters
    ----------
    plant : Plant
        Robot with r joints and effects in the joints alone.
    controller : Controller
        Controller of r joints.
    name : str, default "closed_loop"
        Name in python-control, by which interconnections tell systems apart.

    Returns
    -------
    control.InterconnectedSystem
        System with the inputs ``reference_p[0]``, ..., ``reference_v[0]``, ..., ``reference_a[0]``, ... and the outputs
        ``p[0]``, ... and ``v[0]``, .... Its state is p, v (2r,), then the controller's internal state.

    Raises
    ------
    InputError
        If joints or periods differ, or the plant has effects other than in the joints.
    MissingExtraError
        If python-control is not installed.

    Examples
    --------
    >>> from adaptctl.simulation.systems import closed_loop_system
    >>> loop = closed_loop_system(plant, law)
    >>> loop.ninputs, loop.noutputs
    (6, 4)
    """
    import control

    if plant.dof != controller.dof:
        raise InputError(f"closed loop: the plant has {plant.dof} joints, but the controller has {controller.dof}")
    parts = [plant_system(plant), controller_system(controller, plant.control_period)]
    return control.interconnect(
        parts,
        inputs=_signals(REFERENCE, controller.reference_size),
        outputs=_signals(("p", "v"), plant.dof),
        name=name,
    )


def _of_joints(update: Any, r: int, name: str, **timing: float) -> control.NonlinearIOSystem:
    """System of torques with p and v as states and outputs."""
    import control

    joints = _signals(("p", "v"), r)
    return control.nlsys(
        update, None, inputs=_signals(("torque",), r), outputs=joints, states=joints, name=name, **timing
    )


def _ticked(controller: Controller[Any], control_period: float) -> float:
    control_period = positive_period(control_period, "control_period")
    own = getattr(controller, "control_period", None)
    if own is not None and not math.isclose(own, control_period):
        raise InputError(
            f"control_period: {type(controller).__name__} has the period {own:g} s, got {control_period:g} s"
        )
    return control_period


def _accelerations(mechanism: Mechanism) -> Any:
    """Forward dynamics, native for short trees."""
    equations, parameters = mechanism.equations, Column(mechanism.inertial_parameters.tolist())
    if mechanism.continuation is not None or mechanism.dof > MAX_COMPILED_LINKS:
        return mechanism.forward_dynamics

    def accelerations(p: Column, v: Column, torque: Column) -> Column:
        return equations.forward_dynamics(p, v, torque, parameters)

    r = mechanism.dof
    return compile_function(accelerations, {"p": r, "v": r, "torque": r}, name="accelerations")


def _signals(names: Sequence[str], count: int) -> list[str]:
    return [f"{name}[{i}]" for name in names for i in range(count)]
