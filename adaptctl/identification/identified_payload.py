"""Body that a robot carries, as a log tells it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.inertia import LOWER, PARAMETERS, about_center

# Order of `Tensor`'s entries among the ten parameters' last six.
ENTRIES = tuple(name.removeprefix("I_") for name in PARAMETERS[4:])
# Step of differences, relative to sizes of the ten parameters.
STEP = 1e-6


@dataclass(frozen=True, eq=False)
class IdentifiedPayload:
    """
    Body that a robot carries in a log: mass, centre and inertia in the frame of a link, with deviations.

    Parameters
    ----------
    log : str
        Log in which it is carried.
    link : str
        Link or frame that it is fixed to, in whose frame its numbers are.
    ten : numpy.ndarray
        Ten inertial parameters (10,) about the frame's origin, in SI units, of a body that there can be.
    covariance : numpy.ndarray
        Covariance (10, 10) of these, whose deviations times 1.96 make intervals of 95 %.

    Examples
    --------
    >>> from adaptctl.description.inertia import from_center_of_mass
    >>> from adaptctl.identification import IdentifiedPayload
    >>> ten = from_center_of_mass(2.0, [0.0, 0.0, 0.1], 0.01 * np.eye(3))
    >>> body = IdentifiedPayload("loaded.csv", "tool0", ten, 1e-4 * np.eye(10))
    >>> body.mass, body.center_of_mass.tolist(), round(float(body.inertia_at_center[0, 0]), 6)
    (2.0, [0.0, 0.0, 0.1], 0.01)
    """

    log: str
    link: str
    ten: Array
    covariance: Array

    @property
    def mass(self) -> float:
        """Mass in kg."""
        return float(self.ten[0])

    @property
    def center_of_mass(self) -> Array:
        """Centre of mass (3,) in m."""
        return np.asarray(self.ten[1:4] / self.ten[0])

    @property
    def inertia_at_center(self) -> Array:
        """Inertia tensor (3, 3) about the centre of mass in kg m^2, along the frame's axes."""
        return about_center(self.ten)

    @property
    def deviations(self) -> Array:
        """Deviations (10,) of mass, centre and inertia about the centre (xx, xy, yy, xz, yz, zz)."""
        sizes = self.mass * np.array([1.0, *(3 * [0.1]), *(6 * [0.01])])
        slopes = [(_numbers(self.ten + h) - _numbers(self.ten - h)) / (2.0 * STEP) for h in STEP * np.diag(sizes)]
        J = np.stack(slopes, axis=-1) / sizes
        return np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", J, self.covariance, J), 0.0))

    def set_load(self) -> dict[str, Any]:
        """
        Return the numbers that controllers of arms are told.

        Returns
        -------
        dict
            `mass` in kg, `center_of_mass` (3) in m, `inertia` (9), columns one after the other as in Franka's `setLoad`
            and rows alike, and `inertia_six` (xx, yy, zz, xy, xz, yz) as in UR's `set_target_payload`, in kg m^2.

        Examples
        --------
        >>> from adaptctl.description.inertia import from_center_of_mass
        >>> from adaptctl.identification import IdentifiedPayload
        >>> ten = from_center_of_mass(2.0, [0.0, 0.0, 0.1], 0.01 * np.eye(3))
        >>> IdentifiedPayload("loaded.csv", "tool0", ten, 1e-4 * np.eye(10)).set_load()["mass"]
        2.0
        """
        inertia = self.inertia_at_center
        order = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
        return {
            "mass": self.mass,
            "center_of_mass": self.center_of_mass.tolist(),
            "inertia": inertia.ravel().tolist(),
            "inertia_six": [float(inertia[place]) for place in order],
        }

    def urdf(self, name: str = "payload") -> str:
        """
        Return the payload as a link of a URDF file, with the fixed joint that holds it.

        Parameters
        ----------
        name : str, default "payload"
            Name of the link.

        Returns
        -------
        str
            The elements `<link>` and `<joint>`, to be pasted before `</robot>`.

        Examples
        --------
        >>> from adaptctl.description.inertia import from_center_of_mass
        >>> from adaptctl.identification import IdentifiedPayload
        >>> ten = from_center_of_mass(2.0, [0.0, 0.0, 0.1], 0.01 * np.eye(3))
        >>> print(IdentifiedPayload("loaded.csv", "tool0", ten, 1e-4 * np.eye(10)).urdf().splitlines()[2])
            <origin xyz="0.0 0.0 0.1" rpy="0 0 0"/>
        """
        from xml.sax.saxutils import quoteattr  # which brings the clients of networks with it

        inertia = self.inertia_at_center
        xyz = " ".join(repr(x) for x in self.center_of_mass.tolist())
        pairs = zip(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), inertia[np.triu_indices(3)].tolist(), strict=True)
        tensor = " ".join(f'{key}="{value!r}"' for key, value in pairs)
        return (
            f'<link name={quoteattr(name)}>\n  <inertial>\n    <origin xyz="{xyz}" rpy="0 0 0"/>\n'
            f'    <mass value="{self.mass!r}"/>\n    <inertia {tensor}/>\n  </inertial>\n</link>\n'
            f'<joint name={quoteattr(name + "_fixed")} type="fixed">\n'
            f"  <parent link={quoteattr(self.link)}/>\n  <child link={quoteattr(name)}/>\n</joint>\n"
        )

    @property
    def words(self) -> str:
        """Mass and centre, with deviations, in words."""
        off = self.deviations
        centre = ", ".join(f"{x:.3g}" for x in self.center_of_mass)
        return (
            f"payload in {self.log} at {self.link}: {self.mass:.3g} kg (deviation {off[0]:.1g}), centre ({centre}) m "
            f"(deviation {off[1:4].max():.1g})"
        )

    def as_builtins(self) -> dict[str, Any]:
        """
        Return the numbers of `set_load`, with their deviations.

        Returns
        -------
        dict
            Numbers in JSON's types, with the log and the link.

        Examples
        --------
        >>> from adaptctl.description.inertia import from_center_of_mass
        >>> from adaptctl.identification import IdentifiedPayload
        >>> ten = from_center_of_mass(2.0, [0.0, 0.0, 0.1], 0.01 * np.eye(3))
        >>> IdentifiedPayload("loaded.csv", "tool0", ten, 1e-4 * np.eye(10)).as_builtins()["link"]
        'tool0'
        """
        off = self.deviations.tolist()
        return {
            "log": self.log,
            "link": self.link,
            **self.set_load(),
            "deviations": {
                "mass": off[0],
                "center_of_mass": off[1:4],
                "inertia_at_center": dict(zip(ENTRIES, off[4:], strict=True)),
            },
        }


def _numbers(ten: Array) -> Array:
    inertia = about_center(ten)
    return np.array([ten[0], *(ten[1:4] / ten[0]), *(inertia[place] for place in LOWER)])
