"""Base parameters of an arm in a MuJoCo specification, and consistent bodies that have them."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked, positive_number
from adaptctl.caching import cached_property
from adaptctl.description import Description
from adaptctl.description.drive import Drive
from adaptctl.description.inertia import transformed
from adaptctl.description.link import GROUND
from adaptctl.description.pose import Pose
from adaptctl.description.readers.mujoco_arm import MujocoArm
from adaptctl.description.writers.mujoco_model import principal_axes
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, MissingExtraError
from adaptctl.identifiability import FundamentalBasis, essential_space, fundamental_basis
from adaptctl.identification.consistent_estimate import consistent_estimate
from adaptctl.identification.entropic import EntropicPrior, prior_links

if TYPE_CHECKING:
    import mujoco

# Weight of the base parameters' squares beside the divergence from the start, which only chooses among the bodies.
WEIGHT = 1e8
# Units by which a parameter may leave the start unless told; a unit is a change of the links by about all of them.
REACH = 10.0


@dataclass(frozen=True, eq=False)
class MujocoBaseParameters:
    """
    Base parameters of an arm in a MuJoCo specification, each in a unit of its own.

    Made by `of`. A unit is what a parameter changes by when the links change by about as much as they are, so that all
    have one size. Motion depends on the base parameters alone. Which bodies have them is chosen by the entropic
    divergence from those of the specification (Lee, Wensing and Park 2020); where none has, the nearest are taken.
    Rotor inertia (armature) and friction stay as they are.

    Parameters
    ----------
    basis : FundamentalBasis
        Basis of the N links' inertial parameters, k in number.
    start : numpy.ndarray
        Inertial parameters (10 N,) of the specification in SI units.
    prior : EntropicPrior
        Consistent bodies near the start.
    places : tuple
        Names of the N bodies in the specification, with their poses in the links' frames.
    fixed : tuple of str
        Names of the bodies that are fixed to one of them.

    Examples
    --------
    >>> import mujoco
    >>> from adaptctl.description import builtin_file
    >>> from adaptctl.identification import MujocoBaseParameters
    >>> spec = mujoco.MjSpec.from_file(str(builtin_file("scene")))
    >>> base = MujocoBaseParameters.of(spec)
    >>> base.write(spec, base.values + 0.1)
    >>> len(base.names), spec.compile().nbody
    (15, 6)
    """

    basis: FundamentalBasis
    start: Array
    prior: EntropicPrior
    places: tuple[tuple[str, Pose], ...]
    fixed: tuple[str, ...]

    @classmethod
    def of(cls, spec: mujoco.MjSpec, body: str | None = None) -> MujocoBaseParameters:
        """
        Return the base parameters of a specification.

        Parameters
        ----------
        spec : mujoco.MjSpec
            Specification of an arm of which all bodies have names. It is compiled.
        body : str, optional
            Name of the body at which the arm begins. Default: the only root body with hinge or slide joints.

        Returns
        -------
        MujocoBaseParameters
            Parameters of that body with all its descendants.

        Raises
        ------
        InputError
            If the motion depends on more than base parameters (a floating base, gravity compensation, drag), a body has
            no name or a link no mass, or the compiler changes masses.
        NotFoundError
            If `body` is unknown.
        RankError
            If the number of base parameters cannot be certified.
        """
        arm = MujocoArm.of(spec.compile(), body)
        links = tuple(arm.links())
        _validate(arm, spec)
        bare = Mechanism(Description(arm.body_name(arm.root), links, arm.gravity, "MuJoCo model")).with_drives(Drive())
        carrying = [int(arm.model.jnt_bodyid[arm.joints[i]]) for i in bare.description.bodies]
        tens, _ = prior_links(bare)
        return cls(
            fundamental_basis(essential_space(bare, prove=False)),
            bare.inertial_parameters,
            EntropicPrior(tens, np.zeros(0, dtype=np.int64), np.zeros(0)),
            tuple((arm.body_name(b), arm.places[b]) for b in carrying),
            tuple(arm.body_name(b) for b in arm.bodies if b not in carrying and arm.carriers[b] != GROUND),
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the k base parameters, such as `lower.I_zz`."""
        return self.basis.names

    @cached_property
    def units(self) -> Array:
        """Units (k,) of the parameters in SI units."""
        K = self.basis.regrouping
        return np.asarray(np.sqrt(np.einsum("ka,ab,kb->k", K, self._spread, K)))

    @property
    def values(self) -> Array:
        """Base parameters (k,) of the specification, in their units."""
        return self._map @ self.start

    def bodies(self, values: ArrayLike) -> Array:
        """
        Return consistent bodies with base parameters, or with the nearest that a body has.

        Parameters
        ----------
        values : array_like
            Base parameters (k,), in their units.

        Returns
        -------
        numpy.ndarray
            Ten inertial parameters (N, 10) of each link in SI units.

        Raises
        ------
        InputError
            If the values are not k finite numbers.
        """
        wanted, K = checked(values, len(self.names), "values"), self._map
        near = consistent_estimate(WEIGHT * K.T @ K, WEIGHT * K.T @ wanted, self.prior, 1.0)
        exact = near + self._spread @ K.T @ np.linalg.solve(K @ self._spread @ K.T, wanted - K @ near)
        consistent = np.linalg.eigvalsh(self.prior.matrices(exact))[:, 0].min() > 0.0
        return (exact if consistent else near).reshape(-1, 10)

    def write(self, spec: mujoco.MjSpec, values: ArrayLike) -> None:
        """
        Write the consistent bodies with given base parameters into a specification.

        Parameters
        ----------
        spec : mujoco.MjSpec
            Specification with bodies of the same names. What is fixed to a link's body becomes massless.
        values : array_like
            Base parameters (k,), in their units.

        Raises
        ------
        InputError
            If the values are not k finite numbers.
        """
        # The compiler's own axes of a full inertia ignore what is below 1e-12 kg m^2, which finite differences are.
        for (name, place), ten in zip(self.places, self.bodies(values), strict=True):
            _write_body(spec.body(name), transformed(ten, place.inverse))
        for name in self.fixed:
            _write_body(spec.body(name), np.zeros(10))

    def to_sysid(self, name: str = "base_parameters", reach: float = REACH) -> Any:
        """
        Return the parameter of MuJoCo's own toolbox `mujoco.sysid` (extra `mujoco[sysid]`).

        Parameters
        ----------
        name : str
            Name of the parameter.
        reach : float
            Units by which each base parameter may leave its start.

        Returns
        -------
        mujoco.sysid.Parameter
            Parameter of size k that writes consistent bodies.

        Raises
        ------
        InputError
            If `reach` is not a positive number.
        MissingExtraError
            If the toolbox is not installed.
        """
        reach = positive_number(reach, "reach: expected a positive number")
        try:
            parameter = import_module("mujoco.sysid").Parameter
        except (ImportError, AttributeError) as error:  # which that package raises where one of its own is missing
            raise MissingExtraError("mujoco.sysid is not installed: pip install 'mujoco[sysid]'") from error
        values = self.values
        return parameter(
            name, values, values - reach, values + reach, modifier=lambda spec, found: self.write(spec, found.value)
        )

    @cached_property
    def _map(self) -> Array:
        """Matrix (k, 10 N) from inertial to base parameters in their units."""
        return self.basis.regrouping / self.units[:, None]

    @cached_property
    def _spread(self) -> Array:
        """Covariance (10 N, 10 N) of a change of the links by about all of them: the metric's inverse."""
        return np.asarray(np.linalg.inv(self.prior.curvature(self.prior.tens.ravel(), 1.0)))


def _validate(arm: MujocoArm, spec: mujoco.MjSpec) -> None:
    """Refuse what makes motion depend on more than base parameters."""
    model = arm.model
    for found, text in (
        (arm.held, "a floating base: base parameters are those of an arm that stands"),
        (
            [arm.body_name(b) for b in arm.bodies if model.body_gravcomp[b]],
            "gravity compensation; remove gravcomp",
        ),
        ([arm.body_name(b) for b in arm.bodies if not model.body(b).name], "no name; name it"),
    ):
        if found:
            raise InputError(f"body {found[0]!r} has {text}")
    if model.opt.density or model.opt.viscosity:
        raise InputError("option: drag depends on each body's inertia; set density and viscosity to 0")
    if spec.compiler.inertiafromgeom == 1:
        raise InputError("compiler: inertiafromgeom replaces what is written; set it to auto")
    if spec.compiler.settotalmass > 0.0:
        raise InputError("compiler: settotalmass scales what is written; remove it")


def _write_body(body: mujoco.MjsBody, ten: Array) -> None:
    body.mass, body.ipos, body.iquat, body.inertia = principal_axes(ten, body.name)
    body.fullinertia[:], body.explicitinertial = np.nan, True
