"""Base class of passivity-based adaptive controllers."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, NamedTuple

from adaptctl.arrays import Array
from adaptctl.control.adaptation.law import Period
from adaptctl.control.adaptive import AdaptiveController, AdaptiveState
from adaptctl.control.controller import ReferencePoint
from adaptctl.scalars import Column, column


class ReferenceVelocity(NamedTuple):
    """Reference velocity (r,), its derivative, and further state."""

    v_r: Column
    a_r: Column
    controller_state: Any


class Instant(NamedTuple):
    """Positions (n,), (r,), velocity and sliding variable (r,), reference, reference velocity, and parameters (P,)."""

    q: Column
    p: Column
    v: Column
    s: Column
    reference: ReferencePoint
    wanted: ReferenceVelocity
    parameters: Column


class PassivityBased(AdaptiveController):
    r"""
    Base class of controllers with the model's torque at a reference velocity, less a feedback.

    Notes
    -----
    .. math::

        s=v-v_r,\quad \tau=Y(p,v,v_r,\dot v_r)\hat\beta-u,

    with a feedback u of `damping` times s unless a subclass has another.

    Examples
    --------
    >>> adaptctl.SlotineLi.__mro__[1].__name__
    'PassivityBased'
    """

    damping: Array

    def law(
        self, p: Column, v: Column, reference: ReferencePoint, memory: AdaptiveState
    ) -> tuple[Column, AdaptiveState]:
        """
        Compute the torque and the next state.

        Parameters
        ----------
        p, v : Column
            Measured positions (r,) in rad (m) and velocities (r,) in rad/s (m/s).
        reference : ReferencePoint
            Desired positions, velocities and accelerations (r,) in rad, rad/s and rad/s^2 (m, m/s, m/s^2).
        memory : AdaptiveState
            Internal state of the last control period.

        Returns
        -------
        tuple of Column and AdaptiveState
            Torque (r,) in N m (N) and internal state after the period.

        Examples
        --------
        >>> torque, state = law.step(law.init(p, v), p, v, reference(0.0))  # evaluates the compiled law
        >>> torque.shape
        (2,)
        """
        equations, damping = self.model.mechanism.equations, column(self.damping)
        q = equations.closed(p, memory.q)
        wanted = self.reference_velocity(q, p, v, reference, memory)
        v_r, a_r = wanted.v_r, wanted.a_r
        s = v - v_r

        held = memory.regressor_state  # the oldest first

        def gradient(sliding: Column) -> Column:  # Y_r's, of the regressor at the last tick, or of what then arrived
            before = equations.motion_memory.numbers(held[: self._motion_size])
            return equations.restored_motion(before).regressor_transpose_product(sliding, self.model.columns)

        passed = Period(gradient, memory.s, s, memory.torque, q, v, self.control_period, memory.dt[0], damping)
        estimate, learning = self._adapted(memory, passed)
        motion = equations.motion(q, v, v_r, a_r)
        parameters = self._parameters(estimate)
        feedback, more = self._feedback(Instant(q, p, v, s, reference, wanted, parameters), memory)
        torque = motion.torque(parameters) - feedback
        kept = equations.motion_memory.chosen(motion.numbers) if self._motion_size else Column(())
        later = Column((*held[self._motion_size :], *kept))
        return torque, AdaptiveState(estimate, q, later, s, *self._limited(torque), learning, more)

    @abstractmethod
    def reference_velocity(
        self, q: Column, p: Column, v: Column, reference: ReferencePoint, memory: AdaptiveState
    ) -> ReferenceVelocity:
        """
        Compute the velocity that the law tracks.

        Parameters
        ----------
        q : Column
            Positions (n,) in rad (m) of the n joints of the spanning tree.
        p, v : Column
            Measured positions (r,) in rad (m) and velocities (r,) in rad/s (m/s).
        reference : ReferencePoint
            Desired positions, velocities and accelerations (r,) in rad, rad/s and rad/s^2 (m, m/s, m/s^2).
        memory : AdaptiveState
            Internal state of the last control period.

        Returns
        -------
        ReferenceVelocity
            Reference velocity (r,) in rad/s (m/s), its derivative in time (r,), and the law's further internal state.
        """

    def _feedback(self, at: Instant, memory: AdaptiveState) -> tuple[Column, Any]:
        """Torque (r,) that is subtracted, and the law's further internal state."""
        return column(self.damping) * at.s, at.wanted.controller_state

    @property
    def _motion_size(self) -> int:
        return 0 if self.adaptation_law is None else len(self.model.mechanism.equations.motion_memory.kept)
