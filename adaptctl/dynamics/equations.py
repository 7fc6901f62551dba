"""The interface of a mechanism's equations over scalars: what `mechanism.equations` may be asked."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from adaptctl.caching import cached_property
from adaptctl.compilation import trace
from adaptctl.dynamics.recursion.mass_matrix import factorised
from adaptctl.dynamics.recursion.segment import Segment
from adaptctl.scalars import Column, Scalar


class MotionMemory(NamedTuple):
    """The choice of numbers to be remembered among the m from which a mechanism's motion can be rebuilt
    (`Motion.numbers`). Those left out are constants of the mechanism, such as zeros of links that move in a plane, or
    equal to one that is kept.

    `kept` has the zero-based indices of the numbers to be remembered; `sources` (m,) has for every number its constant,
    a float, or the index, an integer, of its equal among those kept. Made by `MotionMemory.of`; nothing is checked.
    """

    kept: tuple[int, ...]
    sources: tuple[float | int, ...]

    @classmethod
    def of(cls, numbers: Callable[..., Column], sizes: Mapping[str, int]) -> MotionMemory:
        """The `MotionMemory` of a mechanism, found by tracing `numbers` once."""
        kept: list[int] = []
        places: dict[Any, int] = {}
        sources: list[float | int] = []
        for i, x in enumerate(trace(numbers, sizes, name="motion").outputs):
            if not isinstance(x, float) and x not in places:
                places[x] = len(kept)
                kept.append(i)
            sources.append(x if isinstance(x, float) else places[x])
        return cls(tuple(kept), tuple(sources))

    def chosen(self, numbers: Column) -> Column:
        """The numbers to be remembered, a `Column`, of all m `numbers` (m,) of a motion."""
        return Column(numbers[i] for i in self.kept)

    def numbers(self, remembered: Column) -> Column:
        """All m numbers of a motion, a `Column` (m,), from those `remembered`."""
        return Column(x if isinstance(x, float) else remembered[x] for x in self.sources)


class Motion(ABC):
    """The motion of a mechanism at one instant, from which torques, regressors and powers of its r primary
    (independent) joints follow. It is at a configuration q (n,) of the spanning tree's n joints, rad (m if prismatic),
    under velocities v and Slotine and Li's reference velocities v_r (r,), rad/s (m/s), and reference accelerations a_r
    (r,), rad/s^2 (m/s^2).

    Abstract, made by `Equations.motion`; calling the class raises `TypeError`. A subclass gives `torque`, `regressor`,
    `powers` and `numbers`. The links' poses and motions are computed once, for all of these. Nothing is checked.
    """

    __slots__ = ()

    @abstractmethod
    def torque(self, parameters: Column) -> Column:
        """The torque M a_r + C v_r + g + friction at v_r (r,), in N m (N if prismatic), of the r primary (independent)
        joints under the motion's reference velocities v_r and accelerations a_r. It is for values D (P,) of the P
        inertial and friction `parameters` in SI units, in the order of `Mechanism.parameter_names`. M is the mass
        matrix, C the Christoffel (Coriolis) matrix, g gravity's torque. The torque of parameters that linear
        constraints fix is included. Parameters are not checked: too few raise `IndexError` or `ValueError`."""

    @abstractmethod
    def regressor(self, columns: Sequence[int]) -> list[Column]:
        """The Slotine-Li regressor Y (r, k) of r primary (independent) joints, as r rows, one `Column` (k,) each, for
        the k of the P inertial and friction parameters whose indices `columns` are, in their order: N m (N if
        prismatic) per unit of each parameter. Over all P columns Y D is the torque of parameters D (P,); under linear
        constraints D are the free ones, and Y D lacks the torque of those that are fixed. Raises `IndexError` for an
        index of P or more, `TypeError` for one not whole; negative ones are not refused, and may mean any parameter."""

    @abstractmethod
    def regressor_transpose_product(self, s: Column, columns: Sequence[int]) -> Column:
        """The powers Y' s (k,), W per unit of each parameter, for the k of the P inertial and friction parameters whose
        indices `columns` are, at rates `s` (r,) of the r primary (independent) joints, rad/s (m/s if prismatic). Y' is
        the transpose of the Slotine-Li regressor Y (r, k), which is not formed. Raises `IndexError` for an index of P
        or more, `TypeError` for one not whole, `IndexError` or `ValueError` for s too short; negative indices are not
        refused, and may mean any parameter."""

    @property
    @abstractmethod
    def numbers(self) -> Column:
        """The scalars in SI units from which `Equations.remembered` rebuilds this motion, a `Column`."""


class Equations(ABC):
    """The equations of motion of one mechanism, on `Column` objects, vectors of scalars of any kind: floats, arrays of
    samples, dual numbers, symbolic ones. Abstract: `Mechanism.equations` has them, calling the class raises
    `TypeError`.

    Sizes: r primary (independent) joints, whose positions are p and velocities v; n joints of the spanning tree, whose
    configuration is q; P inertial and friction parameters D, in the order of `Mechanism.parameter_names`. All are in SI
    units: rad, N m, or m, N for prismatic joints. For a tree n = r and q = p; with loops q must be closed, which the
    caller ensures by `closed` or `projected`. No code branches on a scalar's value, and nothing is checked here:
    `Mechanism`, which has the same methods on arrays, does. Vectors too short raise `IndexError` or `ValueError`, those
    too long may pass, NaN goes through, an infinite angle raises `ValueError` in floats. A system that is exactly
    singular, such as the closure Jacobian at a singularity of the loops or the mass matrix of a joint without inertia,
    raises `ZeroDivisionError` in floats and gives infinity or NaN in arrays.

    Subclasses: `TreeEquations`, of a tree; `LoopEquations`, of a tree with closures; `ConstrainedEquations`, of either
    under linear constraints, by which all parameters are D0 + N z: in these, D and P stand for the free parameters z
    and their number. A subclass defines `dof`, `links`, `parameters`, `closed`, `projected`, `rates`,
    `energy_regressor`, `potential_regressor`, `motion`, `remembered`, `mass_matrix`, `damping` and `weightless`; torque
    regressors, torques and accelerations follow from these.
    """

    @property
    @abstractmethod
    def dof(self) -> int:
        """Number r of primary joints, the degrees of freedom: all joints of a tree, the independent ones of loops."""

    @property
    @abstractmethod
    def links(self) -> tuple[Segment, ...]:
        """Geometry of the spanning tree's n links, a `Segment` each, lengths in m, in depth-first order."""

    @property
    def joints(self) -> int:
        """Number n of joints of the tree, one for each link: the primary joints and, with loops, the dependent ones."""
        return len(self.links)

    @property
    @abstractmethod
    def parameters(self) -> int:
        """Number P of inertial and friction parameters."""

    @property
    def has_known_share(self) -> bool:
        """True where linear constraints fix parameters at values other than zero, False otherwise."""
        return False

    @property
    def closing_numbers(self) -> object:
        """The numbers, texts and kinds that closing the loops depends on, nested tuples to be compared."""
        return None

    @abstractmethod
    def closed(self, p: Column, guess: Column) -> Column:
        """The closed configuration q (n,) of the spanning tree's n joints, rad (m if prismatic), at positions p (r,) of
        the r primary (independent) joints, on the assembly branch of `guess` (n,), a closed configuration; p itself for
        a tree. It is found in closed form where the loops allow, else by three Newton steps, which is exact to
        round-off from within 0.05 rad. Arguments are not checked: where the loops stay open, nothing is raised; too
        short a p or guess raises `ValueError` or `IndexError` with loops, an exactly singular closure Jacobian
        `ZeroDivisionError` in floats."""

    @abstractmethod
    def projected(self, q: Column) -> Column:
        """A configuration (n,) of the spanning tree's n joints, rad (m if prismatic), near `q` (n,), with q's positions
        of the primary (independent) joints and the loops closed; q itself for a tree. It is exact where a closed form
        exists, else one Newton step from q, which must be near a closed configuration (from 0.05 rad away, 1e-3 rad
        remain). Arguments are not checked: with loops, too short a q raises `IndexError`, an exactly singular closure
        Jacobian `ZeroDivisionError` in floats."""

    @abstractmethod
    def rates(self, q: Column, v: Column) -> Column:
        """Velocities J v (n,) of the spanning tree's n joints, rad/s (m/s if prismatic), from velocities `v` (r,) of
        the r primary (independent) joints, at a configuration `q` (n,) of the tree, rad (m). J (n, r) is the derivative
        of q with respect to the primary positions. For a tree they are v itself. Arguments are not checked: with loops,
        vectors too short raise `IndexError` or `ValueError`, an exactly singular closure Jacobian `ZeroDivisionError`
        in floats."""

    @abstractmethod
    def energy_regressor(self, q: Column, v: Column) -> Column:
        """Energy regressor E (P,), J per unit of each of the P inertial and friction parameters D (P,), at a
        configuration q (n,) of the spanning tree's n joints, rad (m if prismatic), and velocities v (r,) of the r
        primary (independent) joints, rad/s (m/s). The inner product of E and D is kinetic plus potential energy in J,
        the latter 0 at the ground frame's origin. E is 0 for friction. Under linear constraints D are the free
        parameters, and the energy lacks the contribution of those that are fixed. Arguments are not checked: vectors
        too short raise `IndexError` or `ValueError`, an exactly singular closure Jacobian `ZeroDivisionError` in
        floats."""

    @abstractmethod
    def potential_regressor(self, q: Column) -> Column:
        """The potential part (P,) of the energy regressor, J per unit of each of the P inertial and friction parameters
        D (P,), at a configuration q (n,) of the spanning tree's n joints, rad (m if prismatic). Its inner product with
        D is the potential energy in J, 0 at the ground frame's origin. Under linear constraints D are the free
        parameters, and the energy lacks the contribution of those that are fixed. Arguments are not checked: too short
        a q raises `IndexError`."""

    @abstractmethod
    def motion(self, q: Column, v: Column, v_r: Column, a_r: Column) -> Motion:
        """The motion at one instant, from which torques, regressors and powers follow, a `Motion`. It is at a
        configuration q (n,) of the spanning tree's n joints, rad (m if prismatic), under velocities v and Slotine and
        Li's reference velocities v_r (r,) of the r primary (independent) joints, rad/s (m/s), and reference
        accelerations a_r (r,), rad/s^2 (m/s^2). Arguments are not checked: vectors too short raise `IndexError` or
        `ValueError`, an exactly singular closure Jacobian `ZeroDivisionError` in floats."""

    @abstractmethod
    def remembered(self, numbers: Column) -> Motion:
        """The motion at one instant, a `Motion`, rebuilt from its property `numbers`, scalars in SI units. The sines,
        the recursion over the links and the loops' Jacobian are not computed again. Arguments are not checked: too few
        numbers raise `TypeError` or `IndexError` or, where only a few lack, pass until the motion is asked for torques;
        too many may pass."""

    @cached_property
    def motion_memory(self) -> MotionMemory:
        """The choice of numbers that a controller remembers of a motion that it will need again, a `MotionMemory`."""
        sizes = {"q": self.joints, "v": self.dof, "v_r": self.dof, "a_r": self.dof}
        return MotionMemory.of(lambda q, v, v_r, a_r: self.motion(q, v, v_r, a_r).numbers, sizes)

    @abstractmethod
    def mass_matrix(self, q: Column, parameters: Column) -> list[list[Scalar]]:
        """Mass matrix (r, r) of the r primary (independent) joints, as r rows of r scalars: symmetric, rotor inertias
        included, in kg m^2 (kg between prismatic joints, kg m between one of each).

        It is at a configuration q (n,) of the spanning tree's n joints, rad (m if prismatic), for values D (P,) of the
        P inertial and friction `parameters` in SI units, in the order of `Mechanism.parameter_names`; under linear
        constraints D are the free ones, and the contribution of those that are fixed is included. Arguments are not
        checked: vectors too short raise `IndexError` or `ValueError`, an exactly singular closure Jacobian
        `ZeroDivisionError` in floats.
        """

    @abstractmethod
    def damping(self, q: Column, v: Column, parameters: Column) -> list[list[Scalar]]:
        """Damping matrix B (r, r) of the r primary (independent) joints, as r rows of r scalars: symmetric, in N m
        s/rad (N s/m between prismatic joints, N s between one of each). B v is the friction torque that the drives must
        overcome at velocities v, less its constant offsets; the entries are secants of the friction curves.

        It is at a configuration q (n,) of the spanning tree's n joints, rad (m), and primary velocities v (r,), rad/s
        (m/s), for values D (P,) of the P inertial and friction `parameters` in SI units, in the order of
        `Mechanism.parameter_names`. B is positive semidefinite where no friction parameter but offsets is negative.
        Arguments are not checked: vectors too short raise `IndexError` or `ValueError` where they are read, an exactly
        singular closure Jacobian `ZeroDivisionError` in floats.
        """

    @abstractmethod
    def massless_joints(self) -> Equations:
        """A copy of these equations without gravity: same mechanism and sizes, but no gravity torque and no potential
        energy."""

    def torque_regressor(self, q: Column, v: Column, v_r: Column, a_r: Column, columns: Sequence[int]) -> list[Column]:
        """Torque regressor Y (r, k) of r primary (independent) joints, as r rows, one `Column` (k,) each, for the k of
        the P inertial and friction parameters whose indices `columns` are: N m (N if prismatic) per unit of each.

        Over all P columns Y D = M a_r + C v_r + g + friction at v_r for parameters D (P,), M the mass matrix, C the
        Christoffel (Coriolis) matrix, g gravity's torque; under linear constraints D are the free parameters, and the
        torque lacks the contribution of those that are fixed. It is at a configuration q (n,) of the spanning tree's n
        joints, rad (m), velocities v and Slotine and Li's reference velocities v_r (r,), rad/s (m/s), and reference
        accelerations a_r (r,), rad/s^2 (m/s^2). Raises `IndexError` for an index of P or more, `TypeError` for one not
        whole, `IndexError` or `ValueError` for vectors too short; negative indices are not refused, and may mean any
        parameter.
        """
        return self.motion(q, v, v_r, a_r).regressor(columns)

    def inverse_dynamics(self, q: Column, v: Column, v_r: Column, a_r: Column, parameters: Column) -> Column:
        """Torque M a_r + C v_r + g + friction at v_r (r,), in N m (N if prismatic), of the r primary (independent)
        joints. It is for values D (P,) of the P inertial and friction `parameters` in SI units, in the order of
        `Mechanism.parameter_names`. M is the mass matrix, C the Christoffel (Coriolis) matrix, g gravity's torque.

        It is at a configuration q (n,) of the spanning tree's n joints, rad (m), velocities v and Slotine and Li's
        reference velocities v_r (r,), rad/s (m/s), and reference accelerations a_r (r,), rad/s^2 (m/s^2). Arguments are
        not checked: vectors too short raise `IndexError` or `ValueError`, an exactly singular closure Jacobian
        `ZeroDivisionError` in floats.
        """
        return self.motion(q, v, v_r, a_r).torque(parameters)

    def forward_dynamics(self, q: Column, v: Column, torque: Column, parameters: Column) -> Column:
        """Accelerations a (r,), rad/s^2 (m/s^2 if prismatic), of the r primary (independent) joints under a torque
        (r,), N m (N): M a = torque - C v - g - friction, M the mass matrix, C the Christoffel (Coriolis) matrix, g
        gravity's torque.

        They are at a configuration q (n,) of the spanning tree's n joints, rad (m), and velocities v (r,), rad/s (m/s),
        for values D (P,) of the P inertial and friction `parameters` in SI units, in the order of
        `Mechanism.parameter_names`. Arguments are not checked: vectors too short raise `IndexError` or `ValueError`; an
        exactly singular mass matrix, as of a joint without inertia, or closure Jacobian raises `ZeroDivisionError` in
        floats, gives infinity or NaN in arrays.
        """
        inertia = factorised(self.mass_matrix(q, parameters))  # first: its divisions wait for each other
        bias = self.inverse_dynamics(q, v, v, Column.zeros(self.dof), parameters)
        return inertia.solved(torque - bias)

    def damped_dynamics(
        self, q: Column, v: Column, torque: Column, parameters: Column, dt: float, more: Sequence[Scalar]
    ) -> Column:
        """Accelerations a (r,), rad/s^2 (m/s^2 if prismatic), of the r primary (independent) joints over a time step
        `dt` (s) with friction linearly implicit, taken at the velocities v + dt a of its end: (M + dt B) a = torque - C
        v - g - friction at v. The torque (r,) is in N m (N); M is the mass matrix, C the Christoffel (Coriolis) matrix,
        g gravity's torque.

        They are at a configuration q (n,) of the spanning tree's n joints, rad (m), and velocities v (r,), rad/s (m/s),
        for values D (P,) of the P inertial and friction `parameters` in SI units, in the order of
        `Mechanism.parameter_names`. B is the damping matrix that the method `damping` gives at v, to whose diagonal
        `more` (r,), N m s/rad (N s/m), is added: secants of other friction of the primary joints that is in the torque
        already; empty for none, a shorter one for the first joints only. Arguments are not checked: vectors too short,
        or `more` too long, raise `IndexError` or `ValueError`; an exactly singular M + dt B or closure Jacobian raises
        `ZeroDivisionError` in floats, gives infinity or NaN in arrays.
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


class ClosedPositions(Column):
    """Positions of a mechanism's r primary joints, stored with the closed configuration that they determine."""

    __slots__ = ("configuration", "equations")

    def __init__(self, positions: Column, configuration: Column, equations: Equations) -> None:
        super().__init__(positions)
        self.configuration, self.equations = configuration, equations
