"""Mechanisms by name, from files and from models of other packages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from adaptctl.arrays import frozen_array
from adaptctl.dynamics.mechanism import Mechanism
from adaptctl.errors import LoopError

if TYPE_CHECKING:
    import mujoco
    import pinocchio


def load(
    source: str | Path | pinocchio.Model | mujoco.MjModel,
    *,
    floating_base: bool = False,
    as_written: bool = False,
    mesh_folders: Sequence[str | Path] = (),
    root: str | None = None,
    gravity: ArrayLike | None = None,
    lock: Mapping[str, float | None] | Sequence[str] = (),
) -> Mechanism:
    """
    Load a robot by name, from a file, or from a Pinocchio or MuJoCo model.

    Parameters
    ----------
    source : str, Path, pinocchio.Model or mujoco.MjModel
        Name of a built-in robot (``"puma560"``, see `builtin_names`), a file (.toml, .urdf, .xml, .mjcf), or a model.
    floating_base : bool, default False
        If true, the base floats on six joints: the root link of a URDF file, the root body of an MJCF file. By default
        it is held still, whatever the file says.
    as_written : bool, default False
        If true, all angles are meant as they stand. By default those between successive joint axes that are within
        1e-4 rad of a multiple of 90 degrees are taken as rounded and made exact, if torques change by less than 1e-4.
    mesh_folders : sequence of str or Path, optional
        Folders with meshes of a URDF file. Default: none besides its own package.
    root : str, optional
        Name of the body of an MJCF scene or MuJoCo model at which the mechanism begins. Default: the only root body
        that moves.
    gravity : array_like, optional
        Gravity (3,) in the frame of the robot's base in m/s^2, for a tilted mount. Default: the source's, which is
        (0, 0, -9.81) in URDF.
    lock : mapping of str to float or None, or sequence of str, optional
        Joints to hold fast, as `Mechanism.locked` takes them. Default: none.

    Returns
    -------
    Mechanism
        The mechanism, its loops closed at the reference configuration.

    Raises
    ------
    NotFoundError
        If the name, or the root of a model, is unknown.
    FileError
        If a file cannot be read or its contents are wrong.
    InputError
        If a model cannot be used, or an option does not go with the source.
    LoopError
        If the loops of a file cannot be closed.

    Warns
    -----
    PhysicalConsistencyWarning
        If a link has an inertia that no rigid body can have.
    RoundedAnglesWarning
        If rounded angles are taken as right angles.
    SimplificationWarning
        If a part of the source, such as springs, is left out.
    PlausibilityWarning
        If a link is denser than any material or beyond the robot's reach, or gravity exceeds a torque limit by 10 %
        at a posture within position limits.

    Examples
    --------
    >>> adaptctl.load("puma560_measured")
    <Mechanism 'puma560_measured': 6 links, 6 degrees of freedom>
    """
    from adaptctl.description.readers.registry import read, read_model
    from adaptctl.dynamics.plausibility import warn_of_implausible
    from adaptctl.dynamics.rounded_angles import as_meant

    options: dict[str, Any] = {"floating_base": floating_base, "mesh_folders": mesh_folders, "root": root}
    is_file = isinstance(source, str | Path)
    read_in = read(source, **options) if isinstance(source, str | Path) else read_model(source, **options)
    where = str(source) if is_file else read_in.name
    if gravity is not None:
        read_in = replace(read_in, gravity=frozen_array(gravity, (3,), "gravity: x, y, z in m/s^2"))
    mechanism = Mechanism(replace(read_in, as_written=True) if as_written else as_meant(read_in, where))
    if not is_file:
        return mechanism.locked(lock) if lock else mechanism
    try:
        mechanism = mechanism.locked(lock) if lock else mechanism
        _ = mechanism.continuation  # Closes the loops, so that a wrong file is named here and not later.
    except LoopError as error:
        raise LoopError(f"{source}: {error}") from error
    warn_of_implausible(mechanism, source)
    return mechanism
