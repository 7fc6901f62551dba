"""The interface of a mechanism's equations over scalars: what `mechanism.equations` may be asked."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

from adaptctl.dynamics.recursion.mass_matrix import solve_symmetric
from adaptctl.dynamics.recursion.segment import Segment
from adaptctl.scalars import Column, Scalar


class Motion(ABC):
    """The motion of a mechanism at one instant, under velocities v and v_r and accelerations a_r (r,): torques,
    regressors and powers follow from it. Made by `Equations.motion`.

    Its links are placed and moved once; what is asked of them afterwards shares that work.
    """

    __slots__ = ()

    @abstractmethod
    def torque(self, parameters: Column) -> Column:
        """The torque M a_r + C(p, v) v_r + g + friction at v_r (r,), in N m (N for a prismatic joint), of parameters D
        (P,) in SI units."""

    @abstractmethod
    def regressor(self, columns: Sequence[int]) -> list[Column]:
        """The rows of the regressor Y (r, k), of the k parameters of indices `columns` only, N m (N for a prismatic
        joint) per unit of a parameter: Y D is the torque, but for what known parameters add."""

    @abstractmethod
    def powers(self, s: Column, columns: Sequence[int]) -> Column:
        """The product Y' s (k,) of the regressor's columns of indices `columns` and joint rates s (r,), rad/s (m/s), in
        W per unit of a parameter, without forming Y."""

    @property
    @abstractmethod
    def numbers(self) -> Column:
        """The numbers (motion_size,) from which `Equations.remembered` makes the same motion again."""


class Equations(ABC):
    """The equations of motion of one mechanism, for scalars of any kind: floats, arrays, dual numbers, traced ones.

    Sizes: r primary joints, whose positions are p and velocities v; n joints of the tree, whose configuration is q; P
    parameters D. All are in SI units: rad, N m, or m, N for prismatic joints. For a tree n = r and q = p; with loops q
    is closed, which callers see to (`closed`, `projected`). Nothing is checked and nothing branches on a value:
    `Mechanism` checks, and asks the same on arrays.

    Families: `TreeEquations`, `LoopEquations` of a tree with closures, `ConstrainedEquations` of either on fewer
    parameters. A family says how its links move and what they weigh; torque regressors and torques follow here.
    """

    @property
    @abstractmethod
    def dof(self) -> int:
        """Number of primary joints r."""

    @property
    @abstractmethod
    def links(self) -> tuple[Segment, ...]:
        """Geometry of the tree's n links, lengths in m; parents come before their children."""

    @property
    def joints(self) -> int:
        """Number of tree joints n."""
        return len(self.links)

    @property
    @abstractmethod
    def parameters(self) -> int:
        """Number of parameters P."""

    @property
    def has_known_share(self) -> bool:
        """True where torques have a part due to known parameters, for which regressors have no columns."""
        return False

    @abstractmethod
    def closed(self, p: Column, guess: Column) -> Column:
        """The closed configuration q = U(p) (n,), rad (m), of primary positions p (r,), near the closed one `guess`
        (n,); p itself for a tree."""

    @abstractmethod
    def projected(self, q: Column) -> Column:
        """A configuration (n,), rad (m), that closes all loops better than q (n,), with the same primary positions: by
        one Newton step, or all the way; q itself for a tree."""

    @abstractmethod
    def rates(self, q: Column, v: Column) -> Column:
        """The tree's joint velocities J v (n,), rad/s (m/s), at configuration q (n,) and primary velocities v (r,), J =
        dU/dp."""

    @abstractmethod
    def energy_regressor(self, q: Column, v: Column) -> Column:
        """Energy regressor E (P,), J per unit of each parameter, at q (n,) and v (r,): kinetic plus potential energy is
        E' D, in J."""

    @abstractmethod
    def potential_regressor(self, q: Column) -> Column:
        """The potential part (P,) of the energy regressor at q (n,), J per unit of each parameter: potential energy is
        its product with D, in J."""

    @abstractmethod
    def motion(self, q: Column, v: Column, v_r: Column, a_r: Column) -> Motion:
        """The `Motion` at configuration q (n,), rad (m), under velocities v and v_r (r,), rad/s (m/s), and
        accelerations a_r (r,), rad/s^2 (m/s^2), from which torques follow."""

    @abstractmethod
    def remembered(self, numbers: Column) -> Motion:
        """The `Motion` made again from its `numbers` (motion_size,), without placing its links anew."""

    @property
    @abstractmethod
    def motion_size(self) -> int:
        """Length of `Motion.numbers`."""

    @abstractmethod
    def mass_matrix(self, q: Column, parameters: Column) -> list[list[Scalar]]:
        """The rows of the mass matrix M(p) (r, r), in kg m^2 (kg between prismatic joints), at q (n,) of parameters D
        (P,)."""

    @abstractmethod
    def damping(self, q: Column, v: Column, parameters: Column) -> list[list[Scalar]]:
        """The rows of the damping matrix B (r, r) in N m s/rad (N s/m for prismatic joints), symmetric, at q (n,), rad
        (m), and v (r,), rad/s (m/s), of parameters (P,): the drives' friction at v is B v, but for their offsets. B is
        at least 0 where no square-root or Stribeck term is negative."""

    @abstractmethod
    def weightless(self) -> Equations:
        """The same equations without gravity."""

    def torque_regressor(self, q: Column, v: Column, v_r: Column, a_r: Column, columns: Sequence[int]) -> list[Column]:
        """The rows of the torque regressor Y (r, k), of the k parameters of indices `columns` only, N m (N) per unit of
        a parameter: Y D = M a_r + C(p, v) v_r + g + friction at v_r, at q (n,), rad (m), v and v_r (r,), rad/s (m/s),
        a_r (r,), rad/s^2 (m/s^2)."""
        return self.motion(q, v, v_r, a_r).regressor(columns)

    def inverse_dynamics(self, q: Column, v: Column, v_r: Column, a_r: Column, parameters: Column) -> Column:
        """Torque M a_r + C(p, v) v_r + g + friction at v_r (r,), in N m (N for a prismatic joint), at q (n,), rad (m),
        v and v_r (r,), rad/s (m/s), a_r (r,), rad/s^2 (m/s^2), of parameters (P,)."""
        return self.motion(q, v, v_r, a_r).torque(parameters)

    def forward_dynamics(self, q: Column, v: Column, torque: Column, parameters: Column) -> Column:
        """Accelerations (r,), rad/s^2 (m/s^2), under a torque (r,), N m (N): M(p) a = torque - C(p, v) v - g(p) -
        friction, at q (n,), rad (m), and v (r,), rad/s (m/s), of parameters (P,)."""
        bias = self.inverse_dynamics(q, v, v, Column.zeros(self.dof), parameters)
        return solve_symmetric(self.mass_matrix(q, parameters), torque - bias)

    def damped_dynamics(
        self, q: Column, v: Column, torque: Column, parameters: Column, dt: float, more: Sequence[Scalar]
    ) -> Column:
        """Accelerations (r,), rad/s^2 (m/s^2), over a step of dt (s) whose friction is taken at its end: (M + dt B) a =
        torque - bias, at q (n,), rad (m), v (r,), rad/s (m/s), and torque (r,), N m (N), of parameters (P,).

        Linear in the velocity, by the secant B at v; `more` (r,), N m s/rad (N s/m), are the secants of what else
        brakes the primary joints and is in the torque.
        """
        rows, damping = self.mass_matrix(q, parameters), self.damping(q, v, parameters)
        for i, secant in enumerate(more):
            damping[i][i] = damping[i][i] + secant
        bias = self.inverse_dynamics(q, v, v, Column.zeros(self.dof), parameters)
        pairs = (zip(row, damped, strict=True) for row, damped in zip(rows, damping, strict=True))
        return solve_symmetric([[_damped(m, b, dt) for m, b in pair] for pair in pairs], torque - bias)


def _damped(inertia: Scalar, damping: Scalar, dt: float) -> Scalar:
    """m + dt b, where there is a b: zeros of a tree's matrices stay zeros."""
    return inertia if isinstance(damping, float) and damping == 0.0 else inertia + dt * damping
