"""Layout of a tree's parameters: the columns of each body and of each drive."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from adaptctl.dynamics.recursion.drive import DriveTerm
from adaptctl.errors import InputError
from adaptctl.scalars import Column, Scalar


class ParameterLayout(NamedTuple):
    """The order of P parameters: ten for each body, in the order of the links, then one for each drive's term.

    `bodies` are those of the tree's `links` that have mass; the others only join two joints.
    """

    links: int
    bodies: tuple[int, ...]
    drives: tuple[DriveTerm, ...] = ()

    @property
    def driven(self) -> int:
        """Index of the first parameter of the drives."""
        return 10 * len(self.bodies)

    @property
    def size(self) -> int:
        """Number of parameters P."""
        return self.driven + len(self.drives)

    def sorted_out(self, columns: Sequence[int]) -> tuple[dict[int, int], dict[int, int]]:
        """The asked columns of bodies, each with its column of ten a link, and those of drives, with their numbers."""
        of_bodies = {c: 10 * self.bodies[c // 10] + c % 10 for c in columns if c < self.driven}
        return of_bodies, {c: c - self.driven for c in columns if c >= self.driven}

    def tens(self, parameters: Column) -> Column:
        """Ten entries a link (10N,); exact zeros for massless ones, so that they cost nothing once traced."""
        if len(self.bodies) == self.links:
            return Column(parameters.of[: self.driven]) if self.drives else parameters
        tens: list[Scalar] = [0.0] * (10 * self.links)
        for place, i in enumerate(self.bodies):
            tens[10 * i : 10 * i + 10] = parameters.of[10 * place : 10 * place + 10]
        return Column(tens)

    def owned(self, tens: Column) -> Sequence[Scalar]:
        """The entries that are parameters, from ten a link (10N,)."""
        return [x for i in self.bodies for x in tens.of[10 * i : 10 * i + 10]]

    def of_drives(self, parameters: Column) -> Sequence[Scalar]:
        """The drives' values, one for each of `drives`."""
        return parameters.of[self.driven :]


def required_columns(columns: Sequence[int], known: int, name: str) -> Sequence[int]:
    """The columns. Raises `InputError`, which begins with the mechanism's `name`, for what is no index among the
    `known` parameters."""
    for c in columns:
        if not ((type(c) is int or isinstance(c, np.integer)) and 0 <= c < known):
            raise InputError(f"{name}: columns: expected whole numbers from 0 to {known - 1}, got {c!r}")
    return columns
