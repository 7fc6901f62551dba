"""The motion of a mechanism over one control period, its torques held."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np

from adaptctl.compilation import outlined
from adaptctl.dynamics import Mechanism
from adaptctl.scalars import Column, absolute, where
from adaptctl.simulation.effects import JointEffect
from adaptctl.simulation.integrator import Integrator

HeldMotion: TypeAlias = Callable[[Column, Column, Column, Column], tuple[Column, Column]]
"""From q (n,), v (r,), torque (r,) and parameters (P,) to the q and v a control period later."""

STILL = 1e-9
"""rad/s (m/s): at smaller speeds the secant of friction is its slope at rest"""


def held_motion(
    mechanism: Mechanism,
    control_period: float,
    substeps: int,
    integrator: Integrator,
    friction: Sequence[JointEffect] = (),
) -> HeldMotion:
    """The motion over a control period (s), integrated in equal steps; over scalars of any kind.

    Where an integrator has several stages, they share one body of the forward dynamics. With loops the dependent
    joints are integrated too, and one Newton step a substep projects them back.
    """
    dt, equations, several = control_period / substeps, mechanism.equations, integrator.stages > 1

    def accelerated(q: Column, v: Column, torque: Column, parameters: Column) -> Column:
        if not integrator.implicit:
            return equations.forward_dynamics(q, v, torque, parameters)
        secants = _secants(friction, v) if friction else Column(())
        return equations.damped_dynamics(q, v, torque, parameters, dt, tuple(secants))

    def motion(q: Column, v: Column, torque: Column, parameters: Column) -> tuple[Column, Column]:
        """Rates of the configuration and of the velocities: together, for loops need their Jacobian for both."""
        return equations.rates(q, v), accelerated(q, v, torque, parameters)

    shared = outlined(motion) if several else motion

    def substep(q: Column, v: Column, torque: Column, parameters: Column) -> tuple[Column, Column]:
        def at(q: Column, v: Column) -> tuple[Column, Column]:
            braked = torque
            for effect in friction:
                braked = braked - effect.torque(v)
            return shared(q, v, braked, parameters)

        rates = (lambda q, v: at(q, v)[0]) if several else equations.rates
        q, v = integrator.step(lambda q, v: at(q, v)[1], q, v, dt, rates)
        return equations.projected(q), v

    repeated = outlined(substep) if substeps > 1 else substep

    def advanced(q: Column, v: Column, torque: Column, parameters: Column) -> tuple[Column, Column]:
        for _ in range(substeps):
            q, v = repeated(q, v, torque, parameters)
        return q, v

    return advanced


def _secants(friction: Sequence[JointEffect], v: Column) -> Column:
    """Friction of the effects over velocity (r,), N m s/rad."""
    total = sum((effect.torque(v) for effect in friction), Column.zeros(len(v)))
    steepest = np.sum([effect.steepest(len(v)) for effect in friction], axis=0)
    moving = [absolute(x) > STILL for x in v]
    speeds = (where(moves, x, 1.0) for moves, x in zip(moving, v, strict=True))
    pairs = zip(moving, total, speeds, steepest.tolist(), strict=True)
    return Column(where(moves, torque / speed, slope) for moves, torque, speed, slope in pairs)
