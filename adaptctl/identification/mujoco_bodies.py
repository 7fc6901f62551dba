"""Consistent bodies of an arm in a MuJoCo specification, by coordinates of its base parameters."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, positive_number
from adaptctl.description import Description
from adaptctl.description.drive import Drive
from adaptctl.description.inertia import transformed
from adaptctl.description.link import GROUND
from adaptctl.description.pose import Pose, quaternion_rotation, rotation_quaternions
from adaptctl.description.readers.mujoco_arm import MujocoArm, mujoco_package
from adaptctl.description.writers.mujoco_model import principal_axes
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, MissingExtraError, NotFoundError, validate_kind
from adaptctl.identifiability import ConsistentBodies, essential_space, fundamental_basis
from adaptctl.identification.entropic import prior_links

if TYPE_CHECKING:
    import mujoco

# Coordinates by which an optimiser may leave the start unless told; 1 changes bodies by about all of them.
REACH = 3.0
# Coordinates in one of the toolbox's parameter: its optimiser damps steps by at least 1e-6, whatever their unit.
UNIT = 10.0
CYCLE = [1, 2, 0]


@dataclass(frozen=True, eq=False)
class MujocoBodies:
    """
    Consistent bodies of an arm in a MuJoCo specification, by as many coordinates as there are base parameters.

    Made by `of`. Motion depends on the base parameters alone, so that no coordinate is left open, as the ten numbers
    of each body are. Rotor inertia (armature) and friction stay as they are.

    Parameters
    ----------
    bodies : ConsistentBodies
        Bodies of the arm's N links, by k coordinates.
    places : tuple
        Names of the N bodies in the specification, with their poses in the links' frames.
    fixed : tuple of str
        Names of the bodies that are fixed to one of them.

    Examples
    --------
    >>> import mujoco
    >>> from adaptctl.description import builtin_file
    >>> from adaptctl.identification import MujocoBodies
    >>> spec = mujoco.MjSpec.from_file(str(builtin_file("scene")))
    >>> arm = MujocoBodies.of(spec)
    >>> arm.bodies.size
    15
    >>> arm.write(spec, [0.1] * 15)
    >>> model = spec.compile()
    """

    bodies: ConsistentBodies
    places: tuple[tuple[str, Pose], ...]
    fixed: tuple[str, ...]

    @classmethod
    def of(cls, spec: mujoco.MjSpec, body: str | None = None) -> MujocoBodies:
        """
        Return the bodies of a specification.

        Parameters
        ----------
        spec : mujoco.MjSpec
            Specification of an arm of which all bodies have names. It is compiled.
        body : str, optional
            Name of the body at which the arm begins. Default: the only root body with hinge or slide joints.

        Returns
        -------
        MujocoBodies
            Bodies of that one with all its descendants. Links that no body can be are made consistent.

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
        validate_kind(spec, mujoco_package().MjSpec, "spec", "as mujoco.MjSpec.from_file(...) gives one")
        arm = MujocoArm.of(spec.compile(), body)
        links = tuple(arm.links())
        _validate(arm, spec)
        bare = Mechanism(Description(arm.body_name(arm.root), links, arm.gravity, "MuJoCo model")).with_drives(Drive())
        carrying = [int(arm.model.jnt_bodyid[arm.joints[i]]) for i in bare.description.bodies]
        return cls(
            ConsistentBodies.of(fundamental_basis(essential_space(bare, prove=False)), prior_links(bare)[0]),
            tuple((arm.body_name(b), arm.places[b]) for b in carrying),
            tuple(arm.body_name(b) for b in arm.bodies if b not in carrying and arm.carriers[b] != GROUND),
        )

    def write(self, spec: mujoco.MjSpec, coordinates: ArrayLike) -> None:
        """
        Write the bodies at coordinates into a specification.

        Parameters
        ----------
        spec : mujoco.MjSpec
            Specification with bodies of the same names. What is fixed to a link's body becomes massless.
        coordinates : array_like
            Coordinates (k,), 0 at the start.

        Raises
        ------
        InputError
            If the coordinates are not k finite numbers.
        NotFoundError
            If the specification has no body of one of the names.
        """
        for name in (*(name for name, _ in self.places), *self.fixed):
            if spec.body(name) is None:
                raise NotFoundError(f"spec: there is no body {name!r}; give the specification of the same arm")
        for (name, place), ten in zip(self.places, self.bodies.at(coordinates), strict=True):
            _write_body(spec.body(name), transformed(ten, place.inverse))
        for name in self.fixed:
            _write_body(spec.body(name), np.zeros(10))

    def to_sysid(self, name: str = "bodies", reach: float = REACH) -> Any:
        """
        Return the parameter of MuJoCo's own toolbox `mujoco.sysid` (extra `mujoco[sysid]`).

        Parameters
        ----------
        name : str
            Name of the parameter.
        reach : float
            How far each coordinate may leave 0.

        Returns
        -------
        mujoco.sysid.Parameter
            Parameter of size k, in tens of coordinates, that writes consistent bodies.

        Raises
        ------
        InputError
            If `reach` is not a positive number.
        MissingExtraError
            If the toolbox is not installed.
        """
        most = np.full(self.bodies.size, positive_number(reach, "reach: expected a positive number") / UNIT)
        try:
            parameter = import_module("mujoco.sysid").Parameter
        except (ImportError, AttributeError) as error:  # which that package raises where one of its own is missing
            raise MissingExtraError("mujoco.sysid is not installed: pip install 'mujoco[sysid]'") from error
        return parameter(
            name, 0.0 * most, -most, most, modifier=lambda spec, found: self.write(spec, UNIT * found.value)
        )


def _validate(arm: MujocoArm, spec: mujoco.MjSpec) -> None:
    """Refuse what makes motion depend on more than base parameters."""
    model = arm.model
    for found, text in (
        (arm.held, "a floating base: base parameters are those of an arm that stands"),
        ([arm.body_name(b) for b in arm.bodies if model.body_gravcomp[b]], "gravity compensation; remove gravcomp"),
        ([arm.body_name(b) for b in arm.bodies if not model.body(b).name], "no name; name it"),
    ):
        if found:
            raise InputError(f"body {found[0]!r} has {text}")
    if model.opt.density or model.opt.viscosity:
        raise InputError("option: drag depends on each body's inertia; set density and viscosity to 0")
    if spec.compiler.inertiafromgeom == 1:
        raise InputError("compiler: inertiafromgeom replaces what is written; set it to auto")
    for name in ("settotalmass", "boundmass", "boundinertia", "balanceinertia"):
        if getattr(spec.compiler, name) > 0.0:
            raise InputError(f"compiler: {name} changes what is written; remove it")


def _write_body(body: mujoco.MjsBody, ten: Array) -> None:
    """Write by principal axes: of a full inertia, MuJoCo's compiler ignores changes below 1e-12 kg m^2."""
    body.mass, body.ipos, turn, moments = principal_axes(ten, body.name)
    if (
        turn[0] ** 2 > 0.75
    ):  # MuJoCo takes axes within 1e-6 rad of the body's own for these; exchanged they are not near
        turn, moments = rotation_quaternions(quaternion_rotation(turn)[:, CYCLE]), moments[CYCLE]
    body.iquat, body.inertia = turn, moments
    body.fullinertia[:], body.explicitinertial = np.nan, True
