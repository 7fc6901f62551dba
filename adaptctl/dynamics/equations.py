"""The interface of a mechanism's equations over scalars: what `mechanism.equations` may be asked."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

from adaptctl.dynamics.recursion.mass_matrix import factorised
from adaptctl.dynamics.recursion.segment import Segment
from adaptctl.scalars import Column, Scalar


class Motion(ABC):
    """The motion of a mechanism of r primary (independent) joints at one instant, from which torques, regressors and
    powers follow: at a configuration q (n,) of the tree's n joints, rad (m if prismatic), under velocities v and
    Slotine and Li's reference velocities v_r (r,), rad/s (m/s), and reference accelerations a_r (r,), rad/s^2 (m/s^2).
    Abstract, made by `Equations.motion`; calling the class raises `TypeError`.

    A subclass gives `torque`, `regressor`, `powers` and `numbers`. Its links are placed and moved once; what is asked
    of them afterwards shares that work. Nothing is checked.
    """

    __slots__ = ()

    @abstractmethod
    def torque(self, parameters: Column) -> Column:
        """The torque M a_r + C v_r + g + friction at v_r (r,), in N m (N if prismatic), of the r primary (independent)
        joints under the motion's reference velocities v_r and accelerations a_r, M the mass matrix, C the Christoffel
        (Coriolis) matrix, g gravity's torque, for values D (P,) of the P inertial and friction parameters in SI units;
        with the torque of parameters that linear constraints fix. D is not checked: too short a one raises `IndexError`
        or `ValueError`."""

    @abstractmethod
    def regressor(self, columns: Sequence[int]) -> list[Column]:
        """The r rows of the Slotine-Li regressor Y (r, k) of r primary (independent) joints, one `Column` (k,) each,
        for the k of the P inertial and friction parameters whose indices `columns` are, in their order: N m (N if
        prismatic) per unit of each parameter. Over all P columns Y D is the `torque` of parameters D (P,); under linear
        constraints D are the free ones, and Y D lacks the torque of those that are fixed. Raises `IndexError` for an
        index of P or more, `TypeError` for one not whole; negative ones are not refused, and may mean any parameter."""

    @abstractmethod
    def powers(self, s: Column, columns: Sequence[int]) -> Column:
        """The powers Y' s (k,), W per unit of each parameter, with the transpose Y' of the Slotine-Li `regressor` Y (r,
        k), which is not formed, for the k of the P inertial and friction parameters whose indices `columns` are, at
        rates s (r,) of the r primary (independent) joints, rad/s (m/s if prismatic). Raises `IndexError` for an index
        of P or more, `TypeError` for one not whole, `IndexError` or `ValueError` for s too short; negative indices are
        not refused, and may mean any parameter."""

    @property
    @abstractmethod
    def numbers(self) -> Column:
        """The column (`Equations.motion_size`,) of scalars in SI units that hold this motion: with loops first the
        derivatives of the dependent joints by each primary one in turn; then of every link in turn the cosine and sine
        of its joint's angle (or its displacement); then of every link its twelve `LinkMotion.numbers`, in the link's
        axes: six products of angular velocities (xx, xy, yy, xz, yz, zz), then x, y, z of the angular acceleration and
        of its origin's acceleration less gravity's; then of every rotor or friction term of a drive its torque per unit
        of the parameter. From them `Equations.remembered` makes the same motion again."""


class Equations(ABC):
    """The equations of motion of one mechanism, on Columns of scalars of any kind: floats, arrays of samples, dual
    numbers, symbolic ones. Abstract: `Mechanism.equations` has them, calling the class raises `TypeError`.

    Sizes: r primary (independent) joints, whose positions are p and velocities v; n joints of the tree, whose
    configuration is q; P inertial and friction parameters D, in the order of `Mechanism.parameter_names`. All are in SI
    units: rad, N m, or m, N for prismatic joints. For a tree n = r and q = p; with loops q must be closed, which the
    caller sees to by `closed` or `projected`. No code branches on a scalar's value, and nothing is checked here:
    `Mechanism`, which asks the same on arrays, does. Vectors too short raise `IndexError` or `ValueError`, those too
    long may pass, NaN goes through, an infinite angle raises `ValueError` in floats. A system that is exactly singular,
    as of locked loops or no inertia, raises `ZeroDivisionError` in floats and gives infinity or NaN in arrays.

    Subclasses: `TreeEquations`, of a tree; `LoopEquations`, of a tree with closures; `ConstrainedEquations`, of either
    under linear constraints, by which all parameters are D0 + N z. There the free parameters z take the place of D, P
    is their number, and D0 is the known share. A subclass defines `dof`, `links`, `parameters`, `motion_size`,
    `closed`, `projected`, `rates`, `energy_regressor`, `potential_regressor`, `motion`, `remembered`, `mass_matrix`,
    `damping` and `weightless`; torque regressors, torques and accelerations follow from these.
    """

    @property
    @abstractmethod
    def dof(self) -> int:
        """Number r of primary joints, the degrees of freedom: all joints of a tree, the independent ones of loops."""

    @property
    @abstractmethod
    def links(self) -> tuple[Segment, ...]:
        """Geometry of the tree's n links, a `Segment` each, lengths in m, in depth-first order: parents come before
        their children."""

    @property
    def joints(self) -> int:
        """Number n of joints of the tree, one a link: the primary (independent) joints and, with loops, those that
        follow them."""
        return len(self.links)

    @property
    @abstractmethod
    def parameters(self) -> int:
        """Number P of inertial and friction parameters: ten for each link that is not massless and one for each rotor
        or friction term of a drive or, under linear constraints, the free ones."""

    @property
    def has_known_share(self) -> bool:
        """True where linear constraints fix parameters at values other than zero: torques and energies then have a part
        due to these known parameters, for which regressors have no columns. False otherwise."""
        return False

    @property
    def closing_numbers(self) -> object:
        """The numbers, texts and kinds that closing the loops depends on, nested tuples to be compared: equations with
        equal ones close their loops alike. None for a tree."""
        return None

    @abstractmethod
    def closed(self, p: Column, guess: Column) -> Column:
        """The closed configuration q (n,) of the tree's n joints, rad (m if prismatic), at positions p (r,) of the r
        primary (independent) joints, on the assembly branch of `guess` (n,), a closed configuration; p itself for a
        tree. It is found in closed form where the loops allow, else by three Newton steps, which is exact to round-off
        from within 0.05 rad. Not checked: where the loops stay open, nothing is raised; too short a p or guess raises
        `ValueError` or `IndexError` with loops, exactly locked loops `ZeroDivisionError` in floats."""

    @abstractmethod
    def projected(self, q: Column) -> Column:
        """A configuration (n,) of the tree's n joints, rad (m if prismatic), with the primary (independent) joints'
        positions of q (n,) and the loops closed: exactly where a closed form exists, else more closely than in q, by
        one Newton step, q being near a closed one. q itself for a tree. Not checked: with loops, too short a q raises
        `IndexError`, loops exactly locked `ZeroDivisionError` in floats."""

    @abstractmethod
    def rates(self, q: Column, v: Column) -> Column:
        """Velocities J v (n,) of the tree's n joints, rad/s (m/s if prismatic), at their configuration q (n,), rad (m),
        and velocities v (r,) of the r primary (independent) joints, rad/s (m/s); J (n, r) is the derivative of q by the
        primary positions. For a tree v itself. Not checked: with loops, vectors too short raise `IndexError` or
        `ValueError`, loops exactly locked `ZeroDivisionError` in floats."""

    @abstractmethod
    def energy_regressor(self, q: Column, v: Column) -> Column:
        """Energy regressor E (P,), J per unit of each of the P inertial and friction parameters D (P,), at a
        configuration q (n,) of the tree's n joints, rad (m if prismatic), and velocities v (r,) of the r primary
        (independent) joints, rad/s (m/s). The inner product of E and D is kinetic plus potential energy in J, the
        latter 0 at the ground frame's origin. E is 0 for friction. Under linear constraints D are the free parameters,
        and the energy lacks the share of those that are fixed. Not checked: vectors too short raise `IndexError` or
        `ValueError`, exactly locked loops `ZeroDivisionError` in floats."""

    @abstractmethod
    def potential_regressor(self, q: Column) -> Column:
        """The potential part (P,) of the energy regressor, J per unit of each of the P inertial and friction parameters
        D (P,), at a configuration q (n,) of the tree's n joints, rad (m if prismatic): the inner product with D is the
        potential energy in J, 0 at the ground frame's origin. Under linear constraints D are the free parameters, and
        the energy lacks the share of those that are fixed. Not checked: too short a q raises `IndexError`."""

    @abstractmethod
    def motion(self, q: Column, v: Column, v_r: Column, a_r: Column) -> Motion:
        """The state of motion, a `Motion`, at a configuration q (n,) of the tree's n joints, rad (m if prismatic),
        under velocities v and Slotine and Li's reference velocities v_r (r,) of the r primary (independent) joints,
        rad/s (m/s), and reference accelerations a_r (r,), rad/s^2 (m/s^2): torques, regressors and powers follow from
        it. Not checked: vectors too short raise `IndexError` or `ValueError`, exactly locked loops `ZeroDivisionError`
        in floats."""

    @abstractmethod
    def remembered(self, numbers: Column) -> Motion:
        """The state of motion, a `Motion`, made again from its `Motion.numbers` (`motion_size`,), scalars in SI units,
        without the sines, the recursion over the links and the loops' Jacobian that it took to make it. Not checked:
        too few numbers raise `TypeError` or `IndexError` or, where only a few lack, pass until the motion is asked for
        torques; too many may pass."""

    @property
    @abstractmethod
    def motion_size(self) -> int:
        """Number of scalars that store one state of motion, `Motion.numbers`: 14 a link (13 if prismatic), one for each
        rotor or friction term of a drive and, with loops, the derivative of each dependent joint by each primary
        one."""

    @abstractmethod
    def mass_matrix(self, q: Column, parameters: Column) -> list[list[Scalar]]:
        """The r rows of the mass matrix (r, r) of the r primary (independent) joints, symmetric, rotors included, in kg
        m^2 (kg between prismatic joints, kg m mixed), at a configuration q (n,) of the tree's n joints, rad (m), for
        values D (P,) of the P inertial and friction `parameters` in SI units, with the share of those that linear
        constraints fix. Not checked: vectors too short raise `IndexError` or `ValueError`, exactly locked loops
        `ZeroDivisionError` in floats."""

    @abstractmethod
    def damping(self, q: Column, v: Column, parameters: Column) -> list[list[Scalar]]:
        """The r rows of the damping matrix B (r, r) of the r primary (independent) joints, symmetric, in N m s/rad (N
        s/m between prismatic joints, N s mixed): B v is the drives' friction at v, but for its constant offsets, the
        entries being secants of the friction curves. At a configuration q (n,) of the tree's n joints, rad (m), and
        primary velocities v (r,), rad/s (m/s), for values D (P,) of the P inertial and friction `parameters` in SI
        units. B is positive semidefinite where no friction parameter but offsets is negative. Not checked: vectors too
        short raise `IndexError` or `ValueError` where they are read, exactly locked loops `ZeroDivisionError` in
        floats."""

    @abstractmethod
    def weightless(self) -> Equations:
        """New equations of the same mechanism and sizes without gravity: there is no gravity torque and no potential
        energy."""

    def torque_regressor(self, q: Column, v: Column, v_r: Column, a_r: Column, columns: Sequence[int]) -> list[Column]:
        """The r rows of the torque regressor Y (r, k) of r primary (independent) joints, one `Column` (k,) each, for
        the k of the P inertial and friction parameters whose indices `columns` are: N m (N if prismatic) per unit of
        each. Over all P columns Y D = M a_r + C v_r + g + friction at v_r for parameters D (P,), M the mass matrix, C
        the Christoffel (Coriolis) matrix, g gravity's torque; under linear constraints D are the free parameters, and
        the torque lacks the share of those that are fixed.

        At a configuration q (n,) of the tree's n joints, rad (m), velocities v and Slotine and Li's reference
        velocities v_r (r,), rad/s (m/s), and reference accelerations a_r (r,), rad/s^2 (m/s^2). Raises `IndexError` for
        an index of P or more, `TypeError` for one not whole, `IndexError` or `ValueError` for vectors too short;
        negative indices are not refused, and may mean any parameter.
        """
        return self.motion(q, v, v_r, a_r).regressor(columns)

    def inverse_dynamics(self, q: Column, v: Column, v_r: Column, a_r: Column, parameters: Column) -> Column:
        """Torque M a_r + C v_r + g + friction at v_r (r,), in N m (N if prismatic), of the r primary (independent)
        joints, M the mass matrix, C the Christoffel (Coriolis) matrix, g gravity's torque, for values D (P,) of the P
        inertial and friction `parameters` in SI units.

        At a configuration q (n,) of the tree's n joints, rad (m), velocities v and Slotine and Li's reference
        velocities v_r (r,), rad/s (m/s), and reference accelerations a_r (r,), rad/s^2 (m/s^2). Not checked: vectors
        too short raise `IndexError` or `ValueError`, exactly locked loops `ZeroDivisionError` in floats.
        """
        return self.motion(q, v, v_r, a_r).torque(parameters)

    def forward_dynamics(self, q: Column, v: Column, torque: Column, parameters: Column) -> Column:
        """Accelerations a (r,), rad/s^2 (m/s^2 if prismatic), of the r primary (independent) joints under a torque
        (r,), N m (N): M a = torque - C v - g - friction, M the mass matrix, C the Christoffel (Coriolis) matrix, g
        gravity's torque.

        At a configuration q (n,) of the tree's n joints, rad (m), and velocities v (r,), rad/s (m/s), for values D (P,)
        of the P inertial and friction `parameters` in SI units. Not checked: vectors too short raise `IndexError` or
        `ValueError`; an exactly singular mass matrix, as of a joint without inertia, or locked loops raise
        `ZeroDivisionError` in floats, give infinity or NaN in arrays.
        """
        inertia = factorised(self.mass_matrix(q, parameters))  # first: its divisions wait for each other
        bias = self.inverse_dynamics(q, v, v, Column.zeros(self.dof), parameters)
        return inertia.solved(torque - bias)

    def damped_dynamics(
        self, q: Column, v: Column, torque: Column, parameters: Column, dt: float, more: Sequence[Scalar]
    ) -> Column:
        """Accelerations a (r,), rad/s^2 (m/s^2 if prismatic), of the r primary (independent) joints over a time step dt
        (s), friction being taken at its end, at the velocities v + dt a: (M + dt B) a = torque - C v - g - friction at
        v, under a torque (r,), N m (N), M the mass matrix, C the Christoffel (Coriolis) matrix, g gravity's torque.

        At a configuration q (n,) of the tree's n joints, rad (m), and velocities v (r,), rad/s (m/s), for values D (P,)
        of the P inertial and friction `parameters` in SI units. B is the `damping` matrix at v, to whose diagonal
        `more` (r,), N m s/rad (N s/m), is added: secants of other friction of the primary joints that is in the torque
        already; empty for none, a shorter one for the first joints only. Not checked: vectors too short, or `more` too
        long, raise `IndexError` or `ValueError`; an exactly singular M + dt B or locked loops raise `ZeroDivisionError`
        in floats, give infinity or NaN in arrays.
        """
        rows, damping = self.mass_matrix(q, parameters), self.damping(q, v, parameters)
        for i, secant in enumerate(more):
            damping[i][i] = damping[i][i] + secant
        pairs = (zip(row, damped, strict=True) for row, damped in zip(rows, damping, strict=True))
        inertia = factorised([[_damped(m, b, dt) for m, b in pair] for pair in pairs])
        bias = self.inverse_dynamics(q, v, v, Column.zeros(self.dof), parameters)
        return inertia.solved(torque - bias)


def _damped(inertia: Scalar, damping: Scalar, dt: float) -> Scalar:
    """m + dt b, where there is a b: zeros of a tree's matrices stay zeros."""
    return inertia if isinstance(damping, float) and damping == 0.0 else inertia + dt * damping
