"""Arm of a contest, and what a seed draws for it."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path
from typing import NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import Sinusoids
from adaptctl.control.controller import Reference
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import MissingExtraError, NotFoundError
from adaptctl.identifiability import ReducedModel
from adaptctl.tuning import Tuning, tune, with_friction
from adaptctl.tuning.verification import base_model

PACKAGE = "example-robot-data"
MAX_SHIFT = 10.0
"""s by which a seed shifts the phases of the reference, at most"""
REFERENCE, INITIAL_ERROR = 0, 1
"""streams of a seed's random numbers"""


class Scene(NamedTuple):
    """Arm with friction parameters, its tuning, and its base parameters."""

    mechanism: Mechanism
    tuning: Tuning
    model: ReducedModel

    @property
    def friction(self) -> Array:
        """Viscous and Coulomb friction that differ by joint, at most 5 % of damping and limit, (2, r)."""
        damping = self.tuning.gains.damping
        return 0.05 * np.array([damping, np.minimum(self.tuning.torque_limits, damping)])

    @property
    def rubbing(self) -> Array:
        """Parameters (P,) with that friction."""
        found, names = self.mechanism.inertial_parameters.copy(), list(self.mechanism.parameter_names)
        for kind, values in zip(("viscous", "coulomb"), self.friction, strict=True):
            for joint, value in zip(self.mechanism.primary_joints, values, strict=True):
                found[names.index(f"{joint.name}.{kind}")] = value
        return found

    @property
    def mass(self) -> float:
        """Mass of the arm in kg."""
        named = zip(self.mechanism.parameter_names, self.mechanism.inertial_parameters, strict=True)
        return float(sum(value for name, value in named if name.endswith(".m")))

    def pushed(self, share: float, joint: int | None = None) -> tuple[float, ...]:
        """Torques (r,) that are a share of the torque limits, of one joint (0 elsewhere) or of all."""
        torques = share * self.tuning.torque_limits
        return tuple(np.where(np.arange(len(torques)) == joint, torques, 0.0) if joint is not None else torques)

    def reference(self, seed: int) -> Reference:
        """Reference of a seed: that of the tuning, its sinusoids begun up to 10 s later."""
        found = self.tuning.reference
        if not isinstance(found, Sinusoids):
            return found
        later = np.random.default_rng([seed, REFERENCE]).uniform(0.0, MAX_SHIFT)
        phase = np.asarray(found.phase) + 2.0 * np.pi * found.frequency * later
        return replace(found, phase=phase)

    def initial_error(self, seed: int) -> Array:
        """Initial error (r,) of a seed: that of the tuning, with signs drawn by joint."""
        rng = np.random.default_rng([seed, INITIAL_ERROR])
        return np.asarray(self.tuning.initial_error * rng.choice([-1.0, 1.0], self.mechanism.dof))


def robot_path(robot: str) -> str:
    """Name of a built-in robot, or path of a file, which may be of an installed package."""
    package, _, inside = robot.partition("}/")
    if not robot.startswith("{"):
        return robot
    name = package.removeprefix("{")
    try:
        found = [one for one in files(name) or () if str(one).endswith(inside)]
    except PackageNotFoundError as error:
        raise MissingExtraError(f"{robot}: the package {name} is not installed: pip install {name}") from error
    if not found:
        raise NotFoundError(f"{robot}: the package {name} has no file {inside}")
    return str(found[0].locate())


def loaded(robot: str) -> Mechanism:
    """Mechanism of a robot as its name or file has it."""
    return load(robot_path(robot))


def robot_name(robot: str) -> str:
    """Short name of a robot in tables."""
    return Path(robot).stem if "/" in robot or "." in robot else robot


@lru_cache(maxsize=4)
def scene_of(robot: str, control_period: float) -> Scene:
    """Arm with friction parameters, tuned by the one rule that all laws share."""
    mechanism = with_friction(loaded(robot))
    return Scene(mechanism, tune(mechanism, control_period=control_period, nominal_only=True), base_model(mechanism))
