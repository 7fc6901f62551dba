"""Base parameters, the regrouping of the others, and its file."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked, frozen_array, positive_number
from adaptctl.caching import cached_property
from adaptctl.compilation import object_cache
from adaptctl.errors import FileError, InputError, printable, validate_kind
from adaptctl.identifiability.basis_file import BasisFile, Robot
from adaptctl.identifiability.chosen_columns import ChosenColumns, chosen_columns
from adaptctl.identifiability.column_orders import column_order
from adaptctl.identifiability.essential_space import EssentialSpace
from adaptctl.identifiability.priority import Priority, or_default
from adaptctl.identifiability.regrouping import TOLERANCE, condition, regrouping_equations
from adaptctl.markup import table, titled

# Tolerance of the default priority where that of the others leaves nearly dependent parameters.
WIDER_TOLERANCE = 0.03


@dataclass(frozen=True, eq=False)
class FundamentalBasis:
    r"""
    Base parameters of a mechanism: the inertial parameters that are kept, and the regrouping of the others onto them.

    `fundamental_basis` makes it. It depends on geometry and gravity, not on the values of inertial parameters. Sheu and
    Walker call the base parameters fundamental parameters.

    Parameters
    ----------
    mechanism_name : str
        Mechanism that the basis was made for, by name.
    geometry_sha256 : str
        SHA-256 hash of its geometry and gravity.
    parameter_names : tuple of str
        Names of all P inertial parameters, without friction.
    columns : tuple of int
        Indices (k,) of the kept parameters, ascending.
    regrouping : numpy.ndarray
        Matrix K (k, P) in SI units; K times all P parameters gives the base parameters.
    scales : numpy.ndarray
        Scales (P,) of the parameters in SI units per J; divided by them, parameters are comparable.
    gap : float
        Ratio, without unit, of singular values number k and k + 1, from the rank's certificate.
    kept_despite_priority : tuple of str, optional
        Kept parameters that the priority would remove, but that removed ones already determine within the tolerance.

    Raises
    ------
    InputError
        If shapes contradict each other, columns are no ascending indices, or scales or gap are not positive and finite.

    Notes
    -----
    For all motions the torques are :math:`Y D = Y_c \beta` with :math:`\beta = K D`, where :math:`Y_c` are the kept
    columns of the torque regressor.

    Examples
    --------
    >>> basis.names
    ('upper.mc_x', 'upper.mc_y', 'upper.I_zz', 'lower.mc_x', 'lower.mc_y', 'lower.I_zz')
    >>> basis.equations()[0]
    'upper.mc_x* = upper.mc_x + 0.4 (upper.m + lower.m)'
    """

    mechanism_name: str
    geometry_sha256: str
    parameter_names: tuple[str, ...]
    columns: tuple[int, ...]
    regrouping: Array
    scales: Array
    # The gap sigma_k/sigma_k+1 of the rank's certificate.
    gap: float
    kept_despite_priority: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        P, columns = len(self.parameter_names), self.columns
        whole = isinstance(columns, Iterable) and all(isinstance(j, int | np.integer) for j in columns)
        if not whole or list(columns) != sorted(set(columns)) or not all(0 <= j < P for j in columns):
            raise InputError(f"columns: expected ascending indices in 0..{P - 1}, got {printable(repr(columns))}")
        K = frozen_array(self.regrouping, (len(columns), P), "regrouping")
        if not np.array_equal(K[:, columns], np.eye(len(columns))):
            raise InputError(
                "regrouping: every kept parameter must have the coefficient 1 in its own row and 0 in the others"
            )
        scales = frozen_array(self.scales, (P,), "scales")
        if not (scales > 0.0).all():
            raise InputError(f"scales: expected positive numbers, got {scales.min()}")
        positive_number(self.gap, "gap: expected a positive finite number")
        object.__setattr__(self, "regrouping", K)
        object.__setattr__(self, "scales", scales)

    def __repr__(self) -> str:
        return f"<FundamentalBasis of {self.mechanism_name!r}: {self.rank} of {len(self.parameter_names)} parameters>"

    @property
    def rank(self) -> int:
        """Number k of kept parameters, without friction."""
        return len(self.columns)

    @cached_property
    def condition(self) -> float:
        """Condition number, in SI units, of the matrix that is inverted for the regrouping."""
        return condition(np.delete(self.regrouping, self.columns, axis=1))

    @cached_property
    def scaled_condition(self) -> float:
        """Condition number, without unit, of the same matrix for parameters divided by `scales`."""
        scaled = self.regrouping * self.scales / self.scales[list(self.columns), None]
        return condition(np.delete(scaled, self.columns, axis=1))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the k kept parameters, such as ``link2.mc_x``."""
        return tuple(self.parameter_names[j] for j in self.columns)

    def fundamental_parameters(self, parameters: ArrayLike) -> Array:
        """
        Compute the base parameters of inertial parameters.

        Parameters
        ----------
        parameters : array_like
            Inertial parameters (..., P) in SI units, in the order of `parameter_names`.

        Returns
        -------
        numpy.ndarray
            Base parameters (..., k) in SI units, in the order of `names`.

        Raises
        ------
        InputError
            If the shape is wrong (`NonFiniteError` for NaN and infinity).

        Examples
        --------
        >>> basis.fundamental_parameters(arm.inertial_parameters).shape
        (6,)
        """
        return checked(parameters, len(self.parameter_names), "parameters") @ self.regrouping.T

    def equations(self) -> tuple[str, ...]:
        """
        Return the regrouping equations as texts.

        Returns
        -------
        tuple of str
            An equation in SI units for each kept parameter; a star marks the base parameter.

        Examples
        --------
        >>> basis.equations()[3:5]
        ('lower.mc_x* = lower.mc_x + 0.3 lower.m', 'lower.mc_y* = lower.mc_y')
        """
        return regrouping_equations(self.regrouping, self.columns, self.parameter_names)

    def in_order(self, tool: str, links: Sequence[str] = ()) -> FundamentalBasis:
        """
        Return the same basis with parameters in the order of another tool.

        Parameters
        ----------
        tool : str
            "pinocchio", "figaroh", "mujoco" (that of `mujoco.sysid`) or "drake".
        links : sequence of str, optional
            Names of all links in the tool's order. Default: as they are.

        Returns
        -------
        FundamentalBasis
            Basis of which `columns` and `regrouping` are for the tool's regressor, or vector of parameters. Link frames
            must be the tool's: at the joints, as URDF has them, or at the bodies, as MJCF has them.

        Raises
        ------
        InputError
            If `links` are not each link once (`NotFoundError` for a link or a tool that is unknown).

        Examples
        --------
        >>> [name for name in basis.in_order("mujoco").parameter_names[:7]]
        ['upper.m', 'upper.mc_x', 'upper.mc_y', 'upper.mc_z', 'upper.I_xx', 'upper.I_yy', 'upper.I_zz']
        """
        order = column_order(self.parameter_names, tool, links)
        kept = [order.index(column) for column in self.columns]
        rows = np.argsort(kept)
        return replace(
            self,
            parameter_names=tuple(self.parameter_names[j] for j in order),
            columns=tuple(sorted(kept)),
            regrouping=self.regrouping[rows][:, order],
            scales=self.scales[order],
        )

    def _repr_html_(self) -> str:
        text = f"{len(self.names)} base parameters; a star marks those into which others are regrouped"
        rows = [equation.partition(" = ")[::2] for equation in map(str, self.equations())]
        return titled("FundamentalBasis", text) + table(("kept", "is"), rows)

    def save(self, path: str | Path) -> None:
        """
        Write the basis to a JSON file, atomically.

        Parameters
        ----------
        path : str or pathlib.Path
            File that `load` reads; `kept_despite_priority` is left out.

        Raises
        ------
        FileError
            If the file cannot be written.
        """
        BasisFile(
            schema="adaptctl/fundamental-basis/2",
            robot=Robot(self.mechanism_name, self.geometry_sha256),
            rank=self.rank,
            gap=self.gap,
            parameters=list(self.parameter_names),
            scales=self.scales.tolist(),
            regrouping=BasisFile.rows(self.regrouping, self.columns, self.parameter_names),
            kept_despite_priority=list(self.kept_despite_priority),
        ).write(path)

    @classmethod
    def load(cls, path: str | Path) -> FundamentalBasis:
        """
        Read a basis from a file that `save` wrote.

        Parameters
        ----------
        path : str or pathlib.Path
            JSON file.

        Returns
        -------
        FundamentalBasis
            The saved basis.

        Raises
        ------
        FileError
            If the file cannot be read, holds no basis, or has been damaged.

        Examples
        --------
        >>> basis.save(tmp / "basis.json")
        >>> adaptctl.FundamentalBasis.load(tmp / "basis.json").names == basis.names
        True
        """
        content = BasisFile.read(path)
        try:
            return cls(
                mechanism_name=content.robot.name,
                geometry_sha256=content.robot.geometry_sha256,
                parameter_names=tuple(content.parameters),
                columns=content.columns,
                regrouping=content.matrix,
                scales=np.array(content.scales),
                gap=content.gap,
                kept_despite_priority=tuple(content.kept_despite_priority),
            )
        except InputError as error:
            raise FileError(f"{path}: {error}") from error


def fundamental_basis(
    space: EssentialSpace, priority: Priority | None = None, *, tolerance: float = TOLERANCE, prove: bool = False
) -> FundamentalBasis:
    """
    Choose the base parameters, and regroup the others onto them.

    Parameters
    ----------
    space : EssentialSpace
        Essential space of rank k of P inertial parameters.
    priority : Priority, optional
        Order in which parameters are removed. Default: Table 4 of Sheu and Walker (1991), masses first.
    tolerance : float, default 1e-3
        Threshold, without unit, for the independence of a parameter's row of `EssentialSpace.scaled_null_basis` from
        the rows of parameters removed before; above 0 and below 1/sqrt(P). Robots have values above 0.1 or below 1e-4.
        A proof replaces it up to 1e-3: the order is then followed exactly. Where parameters that are removed by default
        are nearly dependent (a condition number above 100), as of axes that are nearly parallel, it is 0.03.
    prove : bool, default False
        If true, the choice must also be made in exact arithmetic. By default this is done where the space has a proof.

    Returns
    -------
    FundamentalBasis
        The k kept parameters with the regrouping matrix (k, P).

    Raises
    ------
    RankError
        If exact arithmetic keeps other parameters, the rank differs from the space's, or the priority removes
        parameters that are nearly dependent (a condition number above 1e4, or 1e8 if exact arithmetic makes the same
        choice).
    InputError
        If the tolerance is out of range, names are given twice or unknown (`NotFoundError`), or `prove` is true and the
        space has no proof.

    Examples
    --------
    >>> kept = adaptctl.fundamental_basis(space, adaptctl.Priority(keep=("lower.m",)))
    >>> "lower.m" in kept.names, kept.rank
    (True, 6)
    """
    validate_kind(space, EssentialSpace, "fundamental_basis", "as essential_space(mechanism) gives one")
    order, usual = (or_default(given).indices(space.parameter_names) for given in (priority, None))
    inputs = [space.search.inputs, [int(j) for j in order], repr(tolerance), bool(prove)]
    most = 0.5 / np.sqrt(len(order))  # with half of the largest rows that may be left, a choice always ends
    wider = min(WIDER_TOLERANCE, most) if tolerance == TOLERANCE and list(order) == list(usual) else None
    chosen = object_cache.kept(
        "fundamental basis", inputs, ChosenColumns, lambda: chosen_columns(space, order, tolerance, prove, wider)
    )
    return FundamentalBasis(
        mechanism_name=space.mechanism.name,
        geometry_sha256=space.mechanism.geometry_sha256,
        parameter_names=space.parameter_names,
        columns=chosen.columns,
        regrouping=np.reshape(chosen.regrouping, (len(chosen.columns), len(space.parameter_names))),
        scales=np.array(chosen.scales),
        gap=space.certificate.gap,
        kept_despite_priority=chosen.kept_despite_priority,
    )
