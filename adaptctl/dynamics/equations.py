"""The interface of a mechanism's equations over scalars: what `mechanism.equations` may be asked."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

from adaptctl.dynamics.recursion.mass_matrix import solve_symmetric
from adaptctl.dynamics.recursion.segment import Segment
from adaptctl.scalars import Column, Scalar


class Motion(ABC):
    """The motion of a mechanism at one instant, at a configuration q (n,), rad (m if prismatic), under velocities v and
    v_r (r,), rad/s (m/s), and accelerations a_r (r,), rad/s^2 (m/s^2), of r primary joints: torques, regressors and
    powers follow from it. Abstract, made by `Equations.motion`; calling the class raises `TypeError`.

    Its links are placed and moved once; what is asked of them afterwards shares that work. Nothing is checked.
    """

    __slots__ = ()

    @abstractmethod
    def torque(self, parameters: Column) -> Column:
        """The torque M(p) a_r + C(p, v) v_r + g(p) + friction at v_r (r,), in N m (N if prismatic), of parameters D
        (P,) in SI units, M the mass matrix, C the Christoffel one, g gravity; with what known parameters add. D is
        not checked: too short a one raises `IndexError` or `ValueError`."""

    @abstractmethod
    def regressor(self, columns: Sequence[int]) -> list[Column]:
        """The r rows of the Slotine-Li regressor Y (r, k), one `Column` (k,) each, of the k parameters of indices
        `columns` only, in their order, N m (N if prismatic) per unit of each parameter: over all P columns Y D is the
        `torque` of D (P,), but for what known parameters add. Raises `IndexError` for an index of P or more,
        `TypeError` for one not whole; negative ones are not refused, and may mean any parameter."""

    @abstractmethod
    def powers(self, s: Column, columns: Sequence[int]) -> Column:
        """The powers Y' s (k,), W per unit of each parameter, of the `regressor` Y (r, k) of indices `columns` at rates
        s (r,) of the primary joints, rad/s (m/s if prismatic), without forming Y. Raises `IndexError` for an index of P
        or more, `TypeError` for one not whole, `IndexError` or `ValueError` for s too short; negative indices are not
        refused, and may mean any parameter."""

    @property
    @abstractmethod
    def numbers(self) -> Column:
        """The column (motion_size,) of scalars in SI units that hold this motion, such as the sines and cosines of the
        joints and the links' accelerations, from which `Equations.remembered` makes the same motion again."""


class Equations(ABC):
    """The equations of motion of one mechanism, on `Column`s of scalars of any kind: floats, arrays of samples, dual
    numbers, traced ones. Abstract: `Mechanism.equations` has them, calling the class raises `TypeError`.

    Sizes: r primary joints, whose positions are p and velocities v; n joints of the tree, whose configuration is q; P
    parameters D. All are in SI units: rad, N m, or m, N for prismatic joints. For a tree n = r and q = p; with loops q
    is closed, which callers see to (`closed`, `projected`). Nothing branches on a value and nothing is checked, but by
    `Mechanism`, which asks the same on arrays: columns too short raise `IndexError` or `ValueError`, those too long may
    pass, NaN goes through, an infinite angle raises `ValueError` in floats. A system that is exactly singular, as of
    locked loops or no inertia, raises `ZeroDivisionError` in floats and gives infinity or NaN in arrays.

    Families: `TreeEquations`, `LoopEquations` of a tree with closures, `ConstrainedEquations` of either on fewer
    parameters: with linear constraints D = D0 + N z, P and D here are those of z, and D0 is the known share. A family
    says how its links move and what they weigh; torque regressors and torques follow here.
    """

    @property
    @abstractmethod
    def dof(self) -> int:
        """Number of primary joints r, the degrees of freedom: all joints of a tree, the independent ones of loops."""

    @property
    @abstractmethod
    def links(self) -> tuple[Segment, ...]:
        """Geometry of the tree's n links, a `Segment` each, lengths in m, in depth-first order: parents come before
        their children."""

    @property
    def joints(self) -> int:
        """Number of joints n of the tree, one a link: the primary joints and, with loops, those that follow them."""
        return len(self.links)

    @property
    @abstractmethod
    def parameters(self) -> int:
        """Number of parameters P: ten for each body and one for each term of a drive or, under linear constraints, the
        free ones."""

    @property
    def has_known_share(self) -> bool:
        """True where linear constraints fix values other than zero: torques and energies then have a part due to these
        known parameters, for which regressors have no columns. Else False."""
        return False

    @abstractmethod
    def closed(self, p: Column, guess: Column) -> Column:
        """The closed configuration q = U(p) (n,), rad (m if prismatic), of primary positions p (r,), on the branch of
        the closed `guess` (n,); p itself for a tree. In closed form where the loops allow, else by three Newton steps,
        which is exact to round-off from within 0.05 rad. Not checked: where the loops stay open, nothing is raised; too
        short a p or guess raises `ValueError` or `IndexError` with loops, locked loops `ZeroDivisionError`."""

    @abstractmethod
    def projected(self, q: Column) -> Column:
        """A configuration (n,), rad (m if prismatic), with the primary positions of q (n,) and all loops closed, in
        closed form, or closed better, by one Newton step from near a closed one; q itself for a tree. Not checked:
        with loops, too short a q raises `IndexError`, loops exactly locked `ZeroDivisionError` in floats."""

    @abstractmethod
    def rates(self, q: Column, v: Column) -> Column:
        """Velocities J v (n,) of the tree's joints, rad/s (m/s if prismatic), at configuration q (n,), rad (m), and
        primary velocities v (r,), rad/s (m/s), J = dU/dp (n, r); v itself for a tree. Not checked: with loops, columns
        too short raise `IndexError` or `ValueError`, loops exactly locked `ZeroDivisionError` in floats."""

    @abstractmethod
    def energy_regressor(self, q: Column, v: Column) -> Column:
        """Energy regressor E (P,), J per unit of each parameter, at q (n,), rad (m if prismatic), and v (r,), rad/s
        (m/s): kinetic plus potential energy, the latter 0 at the ground frame's origin, is E' D, in J, but for what
        known parameters add; 0 for friction. Not checked: columns too short raise `IndexError` or `ValueError`, exactly
        locked loops `ZeroDivisionError` in floats."""

    @abstractmethod
    def potential_regressor(self, q: Column) -> Column:
        """The potential part (P,) of the energy regressor at q (n,), rad (m if prismatic), J per unit of each
        parameter: the inner product with D is the potential energy in J, 0 at the ground frame's origin, but for what
        known parameters add. Not checked: too short a q raises `IndexError`."""

    @abstractmethod
    def motion(self, q: Column, v: Column, v_r: Column, a_r: Column) -> Motion:
        """The `Motion` at configuration q (n,), rad (m if prismatic), under velocities v and reference ones v_r (r,),
        rad/s (m/s), and reference accelerations a_r (r,), rad/s^2 (m/s^2), from which torques, regressors and powers
        follow. Not checked: columns too short raise `IndexError` or `ValueError`, exactly locked loops
        `ZeroDivisionError` in floats."""

    @abstractmethod
    def remembered(self, numbers: Column) -> Motion:
        """The `Motion` made again from its `numbers` (motion_size,), without the sines, the recursion over the links
        and the loops' Jacobian that it took to make it. Not checked: too few numbers raise `TypeError` or `IndexError`
        or, where only a few lack, pass until the motion is asked for torques; too many may pass."""

    @property
    @abstractmethod
    def motion_size(self) -> int:
        """Number of scalars in `Motion.numbers`: 14 a link (13 if prismatic), one for each term of a drive and, with
        loops, the slope of each dependent joint by each primary one."""

    @abstractmethod
    def mass_matrix(self, q: Column, parameters: Column) -> list[list[Scalar]]:
        """The r rows of the mass matrix M(p) (r, r), symmetric, rotors included, in kg m^2 (kg between prismatic
        joints, kg m mixed), at q (n,), rad (m), of parameters D (P,) in SI units, with what known ones add. Not
        checked: columns too short raise `IndexError` or `ValueError`, exactly locked loops `ZeroDivisionError` in
        floats."""

    @abstractmethod
    def damping(self, q: Column, v: Column, parameters: Column) -> list[list[Scalar]]:
        """The r rows of the damping matrix B (r, r), symmetric, in N m s/rad (N s/m between prismatic joints, N s
        mixed), at q (n,), rad (m), and v (r,), rad/s (m/s), of parameters D (P,) in SI units: the drives' friction at v
        is B v, B being secants of its curves, but for their offsets. B is positive semidefinite where no friction
        parameter but offsets is negative. Not checked: columns too short raise `IndexError` or `ValueError` where they
        are read, exactly locked loops `ZeroDivisionError` in floats."""

    @abstractmethod
    def weightless(self) -> Equations:
        """The same equations without gravity, of the same sizes, as new ones: g = 0 and no potential energy."""

    def torque_regressor(self, q: Column, v: Column, v_r: Column, a_r: Column, columns: Sequence[int]) -> list[Column]:
        """The r rows of the torque regressor Y (r, k), one `Column` (k,) each, of the k parameters of indices `columns`
        only, N m (N if prismatic) per unit of each: over all P columns Y D = M(p) a_r + C(p, v) v_r + g(p) + friction
        at v_r, but for what known parameters add, at q (n,), rad (m), v and v_r (r,), rad/s (m/s), a_r (r,), rad/s^2
        (m/s^2). Raises `IndexError` for an index of P or more, `TypeError` for one not whole, `IndexError` or
        `ValueError` for columns too short; negative indices are not refused, and may mean any."""
        return self.motion(q, v, v_r, a_r).regressor(columns)

    def inverse_dynamics(self, q: Column, v: Column, v_r: Column, a_r: Column, parameters: Column) -> Column:
        """Torque M(p) a_r + C(p, v) v_r + g(p) + friction at v_r (r,), in N m (N if prismatic), at q (n,), rad (m), v
        and v_r (r,), rad/s (m/s), a_r (r,), rad/s^2 (m/s^2), of parameters D (P,) in SI units, M the mass matrix, C the
        Christoffel one, g gravity. Not checked: columns too short raise `IndexError` or `ValueError`, exactly locked
        loops `ZeroDivisionError` in floats."""
        return self.motion(q, v, v_r, a_r).torque(parameters)

    def forward_dynamics(self, q: Column, v: Column, torque: Column, parameters: Column) -> Column:
        """Accelerations a (r,), rad/s^2 (m/s^2 if prismatic), under a torque (r,), N m (N): M(p) a = torque - C(p, v) v
        - g(p) - friction, at q (n,), rad (m), and v (r,), rad/s (m/s), of parameters D (P,) in SI units. Not checked:
        columns too short raise `IndexError` or `ValueError`; an exactly singular mass matrix, as of a joint without
        inertia, or locked loops raise `ZeroDivisionError` in floats, give infinity or NaN in arrays."""
        bias = self.inverse_dynamics(q, v, v, Column.zeros(self.dof), parameters)
        return solve_symmetric(self.mass_matrix(q, parameters), torque - bias)

    def damped_dynamics(
        self, q: Column, v: Column, torque: Column, parameters: Column, dt: float, more: Sequence[Scalar]
    ) -> Column:
        """Accelerations a (r,), rad/s^2 (m/s^2 if prismatic), over a step of dt (s) whose friction is taken at its end:
        (M + dt B) a = torque - C(p, v) v - g(p) - friction at v, at q (n,), rad (m), v (r,), rad/s (m/s), and torque
        (r,), N m (N), of parameters D (P,) in SI units.

        Linearised by the secants B at v (see `damping`), to whose diagonal `more` (r,), N m s/rad (N s/m), is added:
        secants of other friction of the primary joints that is in the torque already; empty for none, a shorter one for
        the first joints only. Not checked: columns too short, or `more` too long, raise `IndexError` or `ValueError`;
        an exactly singular M + dt B or locked loops raise `ZeroDivisionError` in floats, give inf or NaN in arrays.
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
