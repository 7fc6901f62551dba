"""Knowledge of an arm that a law may have."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from adaptctl.arrays import Array
from adaptctl.contest.scene import Scene
from adaptctl.control import Gains
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.tuning.verification import scaled_links

WRONG_SHARE, WRONG_STREAM = 0.3, 10_000
"""error of each link in a wrong file, and what is added to a seed that draws its signs"""


class Knowledge(Enum):
    """Knowledge of a law beside its gains: limits alone, a file whose links are 30 % off, the file, or the truth."""

    LIMITS = "limits"
    WRONG_FILE = "wrong file"
    FILE = "file"
    TRUTH = "truth"


@dataclass(frozen=True, eq=False)
class Known:
    """
    Arm as a law of a contest may know it.

    Parameters
    ----------
    scene : Scene
        Arm, with the gains that one rule gives all laws.
    knows : Knowledge
        What the law is told of the r joints' links.
    told : ndarray
        Inertial and friction parameters (P,) in SI units that it is told, if any.
    """

    scene: Scene
    knows: Knowledge
    told: Array

    @classmethod
    def of(cls, scene: Scene, knows: Knowledge, seed: int, truth: Array) -> Known:
        """Knowledge of a law under a seed, of an arm whose parameters (P,) are `truth`."""
        own = scene.mechanism.inertial_parameters
        if knows is Knowledge.TRUTH:
            return cls(scene, knows, truth)
        wrong = knows is Knowledge.WRONG_FILE
        return cls(scene, knows, scaled_links(scene.mechanism, WRONG_SHARE, seed + WRONG_STREAM) if wrong else own)

    @property
    def parameters(self) -> Array:
        """All parameters (P,) in SI units, as told. Raises `InputError` for a law that knows limits alone."""
        if self.knows is Knowledge.LIMITS:
            raise InputError(
                "needs parameters, which a law that knows limits may not have: knows = 'wrong file' or 'file'"
            )
        return self.told

    @property
    def initial(self) -> Array:
        """First estimate (k,) in SI units from `parameters`."""
        return self.model.regrouping @ self.parameters

    @property
    def model(self) -> ReducedModel:
        """Model of the k base parameters."""
        return self.scene.model

    @property
    def mechanism(self) -> Mechanism:
        """Mechanism of the r joints."""
        return self.scene.mechanism

    @property
    def dof(self) -> int:
        """Number r of joints."""
        return self.mechanism.dof

    @property
    def gains(self) -> Gains:
        """Bandwidth and damping by the rule."""
        return self.scene.tuning.gains

    @property
    def bandwidth(self) -> Array:
        """Bandwidth (r,) in 1/s."""
        return self.gains.bandwidth

    @property
    def damping(self) -> Array:
        """Damping (r,) in N m s/rad (N s/m)."""
        return self.gains.damping

    @property
    def stiffness(self) -> Array:
        """Stiffness (r,) in N m/rad (N/m), bandwidth times damping."""
        return self.bandwidth * self.damping

    @property
    def gain(self) -> Array:
        """Adaptation gain (k, k) in units of the parameters squared per J."""
        return self.scene.tuning.adaptation_gain_for(self.model)

    @property
    def torque_limits(self) -> Array:
        """Torque limits (r,) in N m (N)."""
        return self.scene.tuning.torque_limits

    @property
    def control_period(self) -> float:
        """Control period in s."""
        return self.scene.tuning.control_period
