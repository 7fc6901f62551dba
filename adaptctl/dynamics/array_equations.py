"""The equations of a mechanism that can be called with arrays."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol

from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.compilation.limits import LARGEST_COMPILED
from adaptctl.description import Description
from adaptctl.dynamics.array_equation import LONGEST_MATRIX, LONGEST_REGRESSOR, ArrayEquation
from adaptctl.dynamics.equations import Equations
from adaptctl.errors import InputError
from adaptctl.scalars import Column

REGRESSORS = "torque_regressor", "slotine_li_regressor"
"""Names of the regressors that are evaluated on some columns alone."""


class ArrayMechanism(Protocol):
    """Protocol of a `Mechanism` as the equations on arrays need it."""

    @property
    def description(self) -> Description:
        """The description that the mechanism is made of."""

    @property
    def equations(self) -> Equations:
        """The mechanism's equations over scalars of any kind."""

    @property
    def name(self) -> str:
        """The mechanism's name."""

    @property
    def dof(self) -> int:
        """Number of primary joints r."""

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """The P parameters' names."""

    def configuration(self, p: ArrayLike) -> Array:
        """The tree's joints (..., n) at positions (..., r)."""

    def require_mass(self) -> None:
        """Raise `InputError` where links have no mass to be accelerated."""


class ArrayEquations:
    """A mechanism's equations on arrays, as attributes, so that a call finds them at once. None is traced before it is
    called."""

    def __init__(self, mechanism: ArrayMechanism) -> None:
        self._mechanism = mechanism
        self._on_columns: dict[tuple[str, tuple[int, ...]], ArrayEquation] = {}
        self.energy_regressor = self.of(lambda q, v: mechanism.equations.energy_regressor(q, v), "v")
        self.torque_regressor = self._regressor("torque_regressor", None)
        self.slotine_li_regressor = self._regressor("slotine_li_regressor", None)

        def torque(q: Column, v: Column, a: Column, parameters: Column) -> Column:
            return mechanism.equations.inverse_dynamics(q, v, v, a, parameters)

        def accelerations(q: Column, v: Column, torque: Column, parameters: Column) -> Column:
            mechanism.require_mass()
            return mechanism.equations.forward_dynamics(q, v, torque, parameters)

        def inertia(q: Column, parameters: Column) -> list[Column]:
            return [Column(row) for row in mechanism.equations.mass_matrix(q, parameters)]

        self.inverse_dynamics = self.of(torque, "v", "a", "parameters")
        self.forward_dynamics = self.of(accelerations, "v", "torque", "parameters")
        self.mass_matrix = self.of(inertia, "parameters", longest=LONGEST_MATRIX)

    def on_columns(self, regressor: str, columns: tuple[int, ...]) -> ArrayEquation:
        """The equation on arrays of a regressor, "torque_regressor" or "slotine_li_regressor", with the asked columns
        only. Raises `InputError` for another name."""
        if regressor not in REGRESSORS:
            raise InputError(f"regressor: expected {' or '.join(REGRESSORS)}, got {regressor!r}")
        key = regressor, columns
        if key not in self._on_columns:
            self._on_columns[key] = self._regressor(*key)
        return self._on_columns[key]

    def of(
        self,
        function: Callable[..., Column | list[Column]],
        *arguments: str,
        longest: int = LARGEST_COMPILED,
        sizes: Mapping[str, int] | None = None,
    ) -> ArrayEquation:
        """An equation on arrays from a function of columns: of q, the configuration of the p that it is called with,
        and of other arguments: (r,), `parameters` (P,), or of other `sizes`."""
        mechanism = self._mechanism
        configured = None if mechanism.description.loops is None else mechanism.configuration

        def lengths() -> dict[str, int]:
            known = {"parameters": len(mechanism.parameter_names), **(sizes or {})}
            return {name: known.get(name, mechanism.dof) for name in ("p", *arguments)}

        return ArrayEquation(
            mechanism.name, function, lengths, len(mechanism.description.links), longest=longest, configured=configured
        )

    def _regressor(self, name: str, columns: tuple[int, ...] | None) -> ArrayEquation:
        def rows(q: Column, v: Column, v_r: Column, a_r: Column) -> list[Column]:
            equations = self._mechanism.equations
            return equations.torque_regressor(
                q, v, v_r, a_r, range(equations.parameters) if columns is None else columns
            )

        if name == "slotine_li_regressor":
            return self.of(rows, "v", "v_r", "a_r", longest=LONGEST_REGRESSOR)
        return self.of(lambda q, v, a: rows(q, v, v, a), "v", "a", longest=LONGEST_REGRESSOR)
