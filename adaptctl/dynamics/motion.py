"""A motion of a mechanism, whose equations share subexpressions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

from adaptctl.compilation import trace
from adaptctl.scalars import Column


class MotionMemory(NamedTuple):
    """Choice of the numbers that a controller stores of a motion, without constants and repetitions."""

    kept: tuple[int, ...]
    sources: tuple[float | int, ...]

    @classmethod
    def of(cls, numbers: Callable[..., Column], sizes: Mapping[str, int]) -> MotionMemory:
        """Choice for a mechanism, by tracing `numbers`."""
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
        """The numbers to store, among all (m,)."""
        return Column(numbers[i] for i in self.kept)

    def numbers(self, remembered: Column) -> Column:
        """All numbers (m,) from the stored ones."""
        return Column(x if isinstance(x, float) else remembered[x] for x in self.sources)


class Torques(Protocol):
    """Torques that are linear in the parameters; their methods are as those of `Motion`."""

    def torque(self, parameters: Column) -> Column:
        """Torque (r,) of parameters (P,)."""

    def regressor(self, columns: Sequence[int]) -> list[Column]:
        """Regressor (r, k), as r rows."""


class Motion(ABC):
    """
    Kinematics of a mechanism at one instant, from which torques and regressors are computed.

    Abstract; `Equations.motion` makes it for a configuration q, velocities v and Slotine and Li's reference velocities
    v_r and accelerations a_r. Arguments are not checked.

    Examples
    --------
    >>> from adaptctl.scalars import column
    >>> q, still = column(p), column(np.zeros(2))
    >>> motion = arm.equations.motion(q, still, still, still)
    >>> torque = motion.torque(column(arm.inertial_parameters))
    >>> bool(np.allclose(list(torque), arm.inverse_dynamics(p, 0.0 * p, 0.0 * p)))
    True
    """

    __slots__ = ()

    @abstractmethod
    def torque(self, parameters: Column) -> Column:
        """
        Compute the torque under the reference velocities and accelerations.

        Parameters
        ----------
        parameters : Column
            Inertial and friction parameters (P,) in SI units.

        Returns
        -------
        Column
            Torque M a_r + C v_r + g + friction at v_r (r,) in N m (N if prismatic).
        """

    @abstractmethod
    def regressor(self, columns: Sequence[int]) -> list[Column]:
        """
        Compute the Slotine-Li regressor.

        Parameters
        ----------
        columns : sequence of int
            Indices of the k parameters, from 0 to P - 1; negative ones are not refused.

        Returns
        -------
        list of Column
            Rows (k,) of the regressor (r, k) in N m (N if prismatic) per unit of each parameter.

        Raises
        ------
        IndexError
            If an index is P or more.

        Examples
        --------
        >>> from adaptctl.scalars import column
        >>> still = column([0.0, 0.0])
        >>> motion = arm.equations.motion(column(p), column(v), column(v), still)
        >>> [len(row) for row in motion.regressor([0, 1, 9])]
        [3, 3]
        """

    @abstractmethod
    def regressor_transpose_product(self, s: Column, columns: Sequence[int]) -> Column:
        """
        Compute the transpose of the Slotine-Li regressor Y times a vector s of joint rates.

        Parameters
        ----------
        s : Column
            Rates (r,) of the primary joints in rad/s (m/s if prismatic), such as the composite tracking error s = v -
            v_r.
        columns : sequence of int
            Indices of the k parameters, from 0 to P - 1; negative ones are not refused.

        Returns
        -------
        Column
            Product Y' s (k,) in W per unit of each parameter.

        Raises
        ------
        IndexError
            If an index is P or more.

        Examples
        --------
        >>> from adaptctl.scalars import column
        >>> still = column([0.0, 0.0])
        >>> motion = arm.equations.motion(column(p), column(v), column(v), still)
        >>> rows = motion.regressor([0, 1, 9])
        >>> product = motion.regressor_transpose_product(column([1.0, 2.0]), [0, 1, 9])
        >>> bool(np.allclose(list(product), list(1.0 * rows[0] + 2.0 * rows[1])))
        True
        """

    @property
    @abstractmethod
    def numbers(self) -> Column:
        """Column of scalars from which `Equations.restored_motion` rebuilds this motion."""
