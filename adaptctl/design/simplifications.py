"""Design changes that remove parameters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from adaptctl.arrays import Array, positive_number
from adaptctl.caching import cached_property
from adaptctl.design.bodies import STEEL_DENSITY, ball_tens
from adaptctl.design.mounting_bounds import MountingBounds
from adaptctl.design.task import DesignTask
from adaptctl.dynamics.equation_costs import equation_costs
from adaptctl.errors import InputError
from adaptctl.identifiability import FundamentalBasis
from adaptctl.identifiability.regrouping import TOLERANCE, regrouping_equations

Way = Literal["symmetry", "balance", "relocation"]
# Parameters that vanish where a link is its own mirror image along an axis of its frame.
MIRRORED = {
    "x": ("mc_x", "I_xy", "I_xz"),
    "y": ("mc_y", "I_xy", "I_yz"),
    "z": ("mc_z", "I_xz", "I_yz"),
}
# Size of coefficients that are zero.
ZERO_COEFFICIENT = 1e-11
# Positions along each edge of a link's box that are tried, ends included.
GRID_POINTS = 13


@dataclass(frozen=True, eq=False)
class Simplification:
    """
    Change of a design that reduces the number of inertial parameters on which the torques depend.

    Made by `simplifications`.

    Parameters
    ----------
    basis : FundamentalBasis
        Fundamental basis of the k base parameters before the change.
    kind : {"symmetry", "balance", "relocation"}
        A link is made symmetric to a plane, a ball is added, or a part of a link's mass is moved.
    link : str
        Name of the link; empty for the use of all symmetries that links already have.
    known : tuple of str
        Names of the inertial parameters that are zero by symmetry.
    columns : tuple of int
        Indices of the j parameters that remain after the change.
    regrouping : numpy.ndarray
        Matrix (j, P) in SI units that gives the remaining parameters from all P.
    zero : tuple of str
        Names of the base parameters that become zero.
    mass : float, default 0.0
        Mass in kg that is added or moved; 0 for a symmetry.
    place : numpy.ndarray, optional
        Position (3,) of that mass in the link's frame in m; None for a symmetry.
    already_symmetric : bool, default False
        True if the mechanism already has the symmetry, so that nothing need be changed.

    Examples
    --------
    >>> from adaptctl.design import DesignTask, MountingBounds, simplifications
    >>> found = simplifications(DesignTask.within_limits(arm, samples=20), [MountingBounds.for_link(arm, "lower")])
    >>> found[0].description
    'lower is symmetric along y already'
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
    already_symmetric: bool = False

    def __repr__(self) -> str:
        return f"<Simplification: {self.description}>"

    @property
    def rank(self) -> int:
        """Number of base parameters after the change."""
        return len(self.columns)

    @property
    def eliminated(self) -> tuple[str, ...]:
        """Names of the base parameters that the change removes."""
        left = {self.basis.parameter_names[j] for j in self.columns}
        return tuple(name for name in self.basis.names if name not in left)

    @property
    def description(self) -> str:
        """Description of the change, such as "add 1.2 kg to link2 at (0.100, 0.000, 0.000) m"."""
        if not self.link:
            return "use all existing symmetries"
        if self.place is None:
            axes = [axis for axis, names in MIRRORED.items() if f"{self.link}.{names[0]}" in self.known]
            mirror = f"symmetric along {' and '.join(axes)}"
            return f"{self.link} is {mirror} already" if self.already_symmetric else f"make {self.link} {mirror}"
        x = ", ".join(f"{value:.3f}" for value in self.place + 0.0)
        if self.kind == "balance":
            return f"add {self.mass:.3g} kg to {self.link} at ({x}) m"
        return f"move {self.mass:.3g} kg of {self.link} from its centre of mass to ({x}) m"

    @cached_property
    def equations_before(self) -> tuple[str, ...]:
        """Regrouping equations before the change, in SI units."""
        return tuple(equation for equation in self.basis.equations() if equation not in self._left)

    @cached_property
    def equations_after(self) -> tuple[str, ...]:
        """Regrouping equations after the change, in SI units."""
        own = set(self.basis.equations())
        return (*(f"{name}* = 0" for name in self.zero), *(equation for equation in self._left if equation not in own))

    @cached_property
    def _left(self) -> tuple[str, ...]:
        return regrouping_equations(self.regrouping, self.columns, self.basis.parameter_names)


def operations_saved(task: DesignTask, removal: Simplification) -> int:
    """Floating-point operations that a controller saves in each control period."""
    mechanism = task.mechanism
    friction = range(mechanism.num_energy_parameters, len(mechanism.parameter_names))
    before, after = (
        equation_costs(mechanism, (*c, *friction)).control_law for c in (task.basis.columns, removal.columns)
    )
    return before - after


def simplifications(
    task: DesignTask, bounds: Sequence[MountingBounds], density: float = STEEL_DENSITY
) -> tuple[Simplification, ...]:
    """
    Find the changes of a design that remove base parameters.

    Parameters
    ----------
    task : DesignTask
        Mechanism and states.
    bounds : sequence of MountingBounds
        Bounds of mass and position for each link that may change.
    density : float, default 7850.0
        Density of added balls in kg/m^3, steel's by default.

    Returns
    -------
    tuple of Simplification
        Changes, each by itself; sorted by the number of parameters that remain, then by mass.

    Raises
    ------
    InputError
        If a link is unknown or given twice, the density is not positive and finite, or the task's energy is constant.
    RankError
        If the number of identifiable parameters cannot be certified.

    Notes
    -----
    Balls are tried at 13 positions along each edge of the bounds, for parameters that make up more than 1e-6 of the
    energy. One more change uses all existing symmetries at once.

    Examples
    --------
    >>> from adaptctl.design import DesignTask, MountingBounds, simplifications
    >>> found = simplifications(DesignTask.within_limits(arm, samples=20), [MountingBounds.for_link(arm, "lower")])
    >>> found[0].eliminated
    ('lower.mc_y',)
    """
    positive_number(density, "density: expected a positive number of kg/m^3")
    bounds = tuple(bounds)
    links = [places.link for places in bounds]
    if len({task.link_index(link) for link in links}) < len(links):
        raise InputError(f"simplifications: expected bounds for different links, got {', '.join(links)}")
    found = [removal for places in bounds for removal in _of_link(task, places, density)]
    so_already = dict.fromkeys(name for removal in found if removal.already_symmetric for name in removal.known)
    together = by_symmetry(task, tuple(so_already)) if so_already else None
    if together is not None:
        found.append(together)
    return tuple(sorted(found, key=lambda removal: (removal.rank, removal.mass)))


def by_symmetry(task: DesignTask, known: Sequence[str], link: str = "") -> Simplification | None:
    """Simplification with `known` parameters zero."""
    basis = task.basis
    wrong = [name for name in known if name not in basis.parameter_names]
    if wrong:
        raise InputError(f"{task.mechanism.name}: unknown inertial parameter {wrong[0]!r}")
    K = np.array(basis.regrouping)
    places = [basis.parameter_names.index(name) for name in known]
    K[:, places] = 0.0
    columns = _independent_columns(K, basis)
    if len(columns) == basis.rank:
        return None
    zero = tuple(name for name, row in zip(basis.names, K, strict=True) if not np.any(row))
    solved = np.linalg.lstsq(K[:, columns], K, rcond=None)[0]
    regrouping: Array = np.where(np.abs(solved) < ZERO_COEFFICIENT, 0.0, solved)
    holds = not np.any(task.parameters[places])
    return Simplification(basis, "symmetry", link, tuple(known), columns, regrouping, zero, already_symmetric=holds)


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
    """Balance and relocation that make a parameter zero."""
    first = 10 * task.link_index(places.link)
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
    """Least mass that changes a parameter as wanted."""
    from scipy.optimize import brentq

    grid = places.grid(GRID_POINTS)
    most = ball_tens(np.full(len(grid), places.mass), grid, density) @ share
    x = grid[int(np.argmax(most * np.sign(wanted)))]

    def short(mass: float) -> float:
        return float(share @ ball_tens(mass, x, density)) - mass * taken - wanted

    if abs(short(places.mass)) <= ZERO_COEFFICIENT * abs(wanted):  # all that is allowed is just enough
        return places.mass, x
    if short(0.0) * short(places.mass) >= 0.0:
        return None
    return float(brentq(short, 0.0, places.mass, xtol=1e-12)), x


def _without(basis: FundamentalBasis, way: Way, link: str, row: int, mass: float, place: Array) -> Simplification:
    left = [i for i in range(basis.rank) if i != row]
    columns, zero = tuple(basis.columns[i] for i in left), (basis.names[row],)
    return Simplification(basis, way, link, (), columns, basis.regrouping[left], zero, mass, place)


def _independent_columns(K: Array, basis: FundamentalBasis) -> tuple[int, ...]:
    """Independent columns of K (k, P), those of the basis first."""
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
