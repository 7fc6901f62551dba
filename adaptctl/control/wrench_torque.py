"""Torques of a wrench at the last link, compiled for a loop."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.compilation import compile_function
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.recursion.kinematics import frames, point_at
from adaptctl.scalars import Column, Vec


class WrenchTorque:
    """Torques (r,) in N m (N) of a wrench (6,) in N and N m at a point (3,) of the last link of a tree."""

    def __init__(self, mechanism: Mechanism) -> None:
        links = mechanism.equations.links

        def torque(p: Column, wrench: Column, point: Column) -> Column:
            touched = point_at(links, frames(links, p), len(links) - 1, Vec(*point))
            return touched.torque(Vec(*list(wrench)[:3]), Vec(*list(wrench)[3:]))

        sizes = {"p": mechanism.dof, "wrench": 6, "point": 3}
        self._kernel = compile_function(torque, sizes, name="wrench torque")

    def __call__(self, p: Array, wrench: Array, point: Array) -> Array:
        """Torques (r,) at positions (r,) in rad (m)."""
        return np.asarray(self._kernel.call(p, wrench, point))
