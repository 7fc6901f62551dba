"""Parameters that a design can do without: made zero by symmetry, by balance, or by moving a part of a link."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from adaptctl.arrays import Array, positive_number
from adaptctl.caching import cached_property
from adaptctl.design.bodies import STEEL, ball_tens
from adaptctl.design.mounting_bounds import MountingBounds
from adaptctl.design.task import DesignTask
from adaptctl.dynamics.equation_costs import equation_costs
from adaptctl.errors import InputError
from adaptctl.identifiability import FundamentalBasis
from adaptctl.identifiability.regrouping import TOLERANCE, regrouping_equations

Way = Literal["symmetry", "balance", "relocation"]
MIRRORED = {
    "x": ("mc_x", "I_xy", "I_xz"),
    "y": ("mc_y", "I_xy", "I_yz"),
    "z": ("mc_z", "I_xz", "I_yz"),
}
"""Parameters that vanish where a link is its own mirror image along an axis of its frame."""
ROUND_OFF = 1e-11
"""Size of coefficients that are zero."""
EACH = 13
"""MountingBounds along each edge of a link's box that are tried; the ends are among them."""


@dataclass(frozen=True, eq=False)
class Simplification:
    """A change of a mechanism's design after which j inertial parameters are enough for its torques, fewer than the k
    fundamental (base) parameters of a `basis`, a `FundamentalBasis`, before.

    `way` is "symmetry" (a link made its own mirror image), "balance" (a ball added) or "relocation" (a part of a link's
    mass moved), and `link` the name of the link to change, empty for all symmetries that links have already. `known`
    names the inertial parameters that are zero by symmetry (none for a ball or a moved part), `zero` the fundamental
    parameters that are zero after the change. `columns` (j,) are the indices, from 0, among all P inertial parameters
    without friction, of those that are enough, and `regrouping` (j, P), in SI units, gives their values: Y D = Y[:,
    columns] regrouping D for the inertial parameters D (P,) of the changed design, with the torque regressor Y (r, P)
    of r primary (independently moving) joints. `mass` (kg) is added at the position `place` (3,), m in the link's
    frame, or moved there from the link's centre of mass; 0 and None for a symmetry. `holds` is True where the mechanism
    has the symmetry already. Made by `simplifications`; nothing is checked at construction.
    """

    basis: FundamentalBasis
    kind: Way
    link: str
    known: tuple[str, ...]
    columns: tuple[int, ...]
    regrouping: Array
    zero: tuple[str, ...]
    mass: float = 0.0
    place: Array | None = None
    condition: bool = False

    @property
    def rank(self) -> int:
        """Number of inertial parameters that are enough for the mechanism's torques after this change of its design (a
        symmetry, a ball added or mass moved): the length of the field `columns`."""
        return len(self.columns)

    @property
    def eliminated(self) -> tuple[str, ...]:
        """Names of the mechanism's fundamental (base) parameters that are not needed after this change of its design (a
        symmetry, a ball added or mass moved), in the order of the field `basis`. They may be more than the difference
        of the numbers of parameters, since another inertial parameter can replace one of them."""
        left = {self.basis.parameter_names[j] for j in self.columns}
        return tuple(name for name in self.basis.names if name not in left)

    @property
    def description(self) -> str:
        """Phrase, as text, that describes this change of a mechanism's design, such as "add 1.2 kg to link2 at (0.100,
        0.000, 0.000) m", or for a symmetry that a link has already, such as "link2 is its own mirror image along x
        already"."""
        if not self.link:
            return "rely on every symmetry that links have already"
        if self.place is None:
            axes = [axis for axis, names in MIRRORED.items() if f"{self.link}.{names[0]}" in self.known]
            mirror = f"its own mirror image along {' and '.join(axes)}"
            return f"{self.link} is {mirror} already" if self.condition else f"make {self.link} {mirror}"
        x = ", ".join(f"{value:.3f}" for value in self.place + 0.0)
        if self.kind == "balance":
            return f"add {self.mass:.3g} kg to {self.link} at ({x}) m"
        return f"move {self.mass:.3g} kg of {self.link} from its centre of mass to ({x}) m"

    @cached_property
    def before(self) -> tuple[str, ...]:
        """Regrouping equations, as text, that this change of a mechanism's design (a symmetry, a ball added or mass
        moved) alters, as they are before it. Each gives a fundamental (base) parameter, with a star after its name, as
        a sum of inertial parameters, such as "link2.mc_x* = link2.mc_x + 0.4318 (link2.m + link3.m)". Coefficients are
        in SI units."""
        return tuple(equation for equation in self.basis.equations() if equation not in self._left)

    @cached_property
    def after(self) -> tuple[str, ...]:
        """Regrouping equations, as text, that this change of a mechanism's design (a symmetry, a ball added or mass
        moved) alters, as they are after it. Each gives a fundamental (base) parameter, with a star after its name, as a
        sum of inertial parameters, coefficients in SI units. First come those that become zero, such as "link3.I_xy* =
        0"."""
        own = set(self.basis.equations())
        return (*(f"{name}* = 0" for name in self.zero), *(equation for equation in self._left if equation not in own))

    @cached_property
    def _left(self) -> tuple[str, ...]:
        return regrouping_equations(self.regrouping, self.columns, self.basis.parameter_names)


def operations_saved(task: DesignTask, removal: Simplification) -> int:
    """Number of floating-point operations that an adaptive controller of the task's mechanism saves in each control
    period after a change of its design, a `removal`, since it needs fewer parameters. Counted are the torques Y beta
    (r,) of r primary (independently moving) joints and the powers Y' s (k,), with the regressor Y (r, k), its transpose
    Y', the values beta (k,) of the k parameters and the sliding variables s (r,), the joints' velocity errors plus
    weighted position errors; sines, cosines and roots are not counted. Friction parameters are kept. Raises `RankError`
    where the number of identifiable parameters cannot be certified, `LoopError` where kinematic loops cannot be closed.
    """
    mechanism = task.mechanism
    friction = range(mechanism.num_energy_parameters, len(mechanism.parameter_names))
    before, after = (equation_costs(mechanism, (*c, *friction)).tick for c in (task.basis.columns, removal.columns))
    return before - after


def simplifications(
    task: DesignTask, within: Sequence[MountingBounds], density: float = STEEL
) -> tuple[Simplification, ...]:
    """All changes of a mechanism's design that remove fundamental (base) parameters, as a tuple of `Simplification`,
    the one that leaves the fewest first, of equal ones the one with the least mass. `within` has one `MountingBounds`
    for each link that may change: bounds of added or moved mass and of its position. Empty where there are no such
    changes.

    By symmetry: a link becomes its own mirror image along one or two axes of its frame. By balance: a ball of a density
    in kg/m^3 (steel's 7850 by default), added to a link, makes one fundamental parameter zero. By relocation: a part of
    the link's own mass, taken from its centre of mass and placed as such a ball, does so. Tried are the fundamental
    parameters that alone make more than 1e-6 of the root mean square energy. The ball's position is the one with the
    largest effect among 13 along each edge of the link's box, its mass the least that is enough there. Each is one
    change alone; where links have symmetries already, one more takes all of these at once. Raises `InputError` for an
    unknown link or one given twice, a density that is not positive and finite and a task in whose states the energy is
    constant, `RankError` where the number of identifiable parameters cannot be certified.
    """
    positive_number(density, "density: expected a positive number of kg/m^3")
    within = tuple(within)
    links = [places.link for places in within]
    if len({task.link(link) for link in links}) < len(links):
        raise InputError(f"simplifications: expected places on links, each once, got {', '.join(links)}")
    found = [removal for places in within for removal in _of_link(task, places, density)]
    so_already = dict.fromkeys(name for removal in found if removal.condition for name in removal.known)
    together = by_symmetry(task, tuple(so_already)) if so_already else None
    if together is not None:
        found.append(together)
    return tuple(sorted(found, key=lambda removal: (removal.rank, removal.mass)))


def by_symmetry(task: DesignTask, known: Sequence[str], link: str = "") -> Simplification | None:
    """The change of a mechanism's design, a `Simplification`, by which the inertial parameters named in `known`, such
    as "link3.I_xy", are zero by symmetry; None where as many parameters are needed as before. `link` is the name of the
    link to change, empty, the default, for several; it is only copied to the `Simplification`. That the `known` belong
    to a symmetry is not checked. Raises `InputError` for a name that is no inertial parameter of the task's mechanism,
    `RankError` where the number of identifiable parameters cannot be certified."""
    basis = task.basis
    wrong = [name for name in known if name not in basis.parameter_names]
    if wrong:
        raise InputError(f"{task.mechanism.name}: there is no inertial parameter {wrong[0]!r}")
    K = np.array(basis.regrouping)
    places = [basis.parameter_names.index(name) for name in known]
    K[:, places] = 0.0
    columns = _independent_columns(K, basis)
    if len(columns) == basis.rank:
        return None
    zero = tuple(name for name, row in zip(basis.names, K, strict=True) if not np.any(row))
    solved = np.linalg.lstsq(K[:, columns], K, rcond=None)[0]
    regrouping: Array = np.where(np.abs(solved) < ROUND_OFF, 0.0, solved)
    holds = not np.any(task.parameters[places])
    return Simplification(basis, "symmetry", link, tuple(known), columns, regrouping, zero, condition=holds)


def _of_link(task: DesignTask, places: MountingBounds, density: float) -> Iterator[Simplification]:
    for axes in ("x", "y", "z", "xy", "xz", "yz"):
        known = dict.fromkeys(f"{places.link}.{name}" for axis in axes for name in MIRRORED[axis])
        removal = by_symmetry(task, tuple(known), places.link)
        if removal is not None:
            yield removal
    carried = task.nonzero_parameters()
    for i, name in enumerate(task.basis.names):
        if name in carried:
            yield from _by_mass(task, places, density, i)


def _by_mass(task: DesignTask, places: MountingBounds, density: float, row: int) -> Iterator[Simplification]:
    """Balance and relocation that make the row's fundamental parameter zero, where the bounds allow it."""
    first = 10 * task.link(places.link)
    share = task.basis.regrouping[row, first : first + 10]
    if not np.any(share):
        return
    wanted = -float(task.basis.regrouping[row] @ task.parameters)
    taken = float(share @ ball_tens(1.0, task.center_of_mass(places.link)))
    ways: tuple[tuple[Way, float], ...] = (("balance", 0.0), ("relocation", taken))
    for way, per_mass in ways:
        found = _least_mass(share, wanted, per_mass, places, density)
        if found is not None:
            yield _without(task.basis, way, places.link, row, *found)


def _least_mass(
    share: Array, wanted: float, taken: float, places: MountingBounds, density: float
) -> tuple[float, Array] | None:
    """The least mass, at the best place of a grid, whose ball changes the row's parameter as wanted."""
    from scipy.optimize import brentq

    grid = places.grid(EACH)
    most = ball_tens(np.full(len(grid), places.mass), grid, density) @ share - places.mass * taken
    best = int(np.argmax(most * np.sign(wanted)))
    x = grid[best]

    def short(mass: float) -> float:
        return float(share @ ball_tens(mass, x, density)) - mass * taken - wanted

    if abs(short(places.mass)) <= ROUND_OFF * abs(wanted):  # all that is allowed is just enough
        return places.mass, x
    if short(0.0) * short(places.mass) >= 0.0:
        return None
    return float(brentq(short, 0.0, places.mass, xtol=1e-12)), x


def _without(basis: FundamentalBasis, way: Way, link: str, row: int, mass: float, place: Array) -> Simplification:
    left = [i for i in range(basis.rank) if i != row]
    columns, zero = tuple(basis.columns[i] for i in left), (basis.names[row],)
    return Simplification(basis, way, link, (), columns, basis.regrouping[left], zero, mass, place)


def _independent_columns(K: Array, basis: FundamentalBasis) -> tuple[int, ...]:
    """Columns (k',) of K (k, P) that span all of them, in ascending order: those of the basis first, as far as they are
    enough."""
    scaled = K * basis.scales / basis.scales[list(basis.columns), None]
    own = set(basis.columns)
    others = [j for j in range(K.shape[1]) if j not in own]
    directions, kept = np.zeros((0, len(K))), []
    for j in (*basis.columns, *others):
        left = scaled[:, j]
        for _ in range(2):
            left = left - directions.T @ (directions @ left)
        if (size := float(np.linalg.norm(left))) > TOLERANCE:
            directions = np.vstack([directions, left / size])
            kept.append(j)
    return tuple(sorted(kept))
