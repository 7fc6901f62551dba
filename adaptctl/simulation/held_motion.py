"""The motion of a mechanism over one control period, its torques held."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

from adaptctl.compilation import outlined
from adaptctl.dynamics import Mechanism
from adaptctl.scalars import Column
from adaptctl.simulation.effects import JointEffect
from adaptctl.simulation.integrator import Integrator

HeldMotion: TypeAlias = Callable[[Column, Column, Column, Column], tuple[Column, Column]]
"""From q (n,), v (r,), torque (r,) and parameters (P,) to the q and v a control period later."""


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

    def motion(q: Column, v: Column, torque: Column, parameters: Column) -> tuple[Column, Column]:
        """Rates of the configuration and of the velocities: together, for loops need their Jacobian for both."""
        return equations.rates(q, v), equations.forward_dynamics(q, v, torque, parameters)

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
