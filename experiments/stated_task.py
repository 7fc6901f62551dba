"""Common part of experiments on a stated task: one arm, its own gains, sinusoids written down."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypeAlias

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import Gains, Sinusoids
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.experiments.experiment import require_count, setting
from adaptctl.experiments.learning import Learning
from adaptctl.experiments.ranged_gain import RangedGain
from adaptctl.recording import Setting

if TYPE_CHECKING:
    import gymnasium


REFERENCE = ("center", "amplitude", "frequency", "start_time")
"""Settings that are those of `Sinusoids`."""
ENVIRONMENT = ("duration", "control_period", "initial_error")
"""Settings that are those of a tracking environment."""
Named: TypeAlias = tuple[tuple[str, Any], ...]
"""Settings as pairs of a name and a value, which compare."""


class SinusoidTask(NamedTuple):
    """Named tuple of what defines a tracking environment on sinusoids, as plain data, so that equal tasks compare
    equal: `environment_id`, the Gymnasium environment's; `reference`, the arguments of `Sinusoids` as pairs of name and
    value, SI units (Hz for frequencies); and `settings`, other arguments of the environment as such pairs, SI units.
    Nothing is checked at construction."""

    environment_id: str
    reference: Named
    settings: Named

    def environment(self, mechanism: Mechanism) -> gymnasium.Env[Any, Any]:
        """Gymnasium tracking environment of a `mechanism` on this task's sinusoids. Raises `InputError` for arguments
        that do not suit the mechanism, such as another number of joints."""
        import gymnasium

        reference = Sinusoids(**dict(self.reference))
        return gymnasium.make(
            f"adaptctl.envs:{self.environment_id}", robot=mechanism, reference=reference, **dict(self.settings)
        )


@dataclass(frozen=True)
class StatedTask(RangedGain, Learning):
    """Base class of experiments of learning to track sinusoids in an arm's own environment, in which every number of
    the task is a setting. A subclass gives `name`, `title` and the property `purpose`; `joints`, the number of the
    arm's primary (independently moving) joints; `environment_id`, the Gymnasium environment's; and defaults of
    `damping`, `center`, `amplitude` and `frequency`, which have one number a joint. Raises `InputError` at construction
    for another number of these, and for settings of the wrong type or out of their bounds, `NonFiniteError` for NaN or
    infinity."""

    joints: ClassVar[int]
    environment_id: ClassVar[str]

    damping: tuple[float, ...] = setting((), "damping of each joint, N m s", symbol="K", low=1e-3, high=1e4)
    mass_range: float = setting(5.0, "prior range of masses, kg", low=1e-3, high=1e3)
    first_moment_range: float = setting(2.0, "prior range of first moments, kg m", low=1e-3, high=1e3)
    inertia_range: float = setting(0.6, "prior range of inertias, kg m^2", low=1e-3, high=1e3)
    center: tuple[float, ...] = setting((), "centre of the reference, rad", low=-10.0, high=10.0)
    amplitude: tuple[float, ...] = setting((), "amplitude of the reference, rad", low=0.0, high=3.2)
    frequency: tuple[float, ...] = setting((), "frequency of the reference, Hz", low=0.0, high=5.0)
    start_time: float = setting(2.0, "length of the smooth (quintic) start, s", low=0.0, high=60.0)

    payload: float = setting(0.0, "mass that the last link holds and no controller knows of, kg", low=0.0, high=1e3)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_count(self, ("damping", "center", "amplitude", "frequency"), self.joints, "one a joint")

    def environment(self, mechanism: Mechanism) -> gymnasium.Env[Any, Any]:
        """Gymnasium tracking environment of a `mechanism`, on the sinusoids that the settings state. Raises
        `InputError` for a mechanism whose number of primary (independently moving) joints is not this experiment's
        `joints`."""
        if mechanism.dof != self.joints:
            raise InputError(
                f"robot: {mechanism.name} has {mechanism.dof} joints, this experiment is for {self.joints}; "
                "use the experiment 'adaptive'"
            )
        return self.task(mechanism).environment(mechanism)

    def task(self, mechanism: Mechanism) -> SinusoidTask:
        """Data that define the experiment's tracking environment, a `SinusoidTask` in SI units: the reference's
        sinusoids, the run's duration, the control period, the joints' initial error, and the torque limits that the
        method `torque_limits` returns for the `mechanism`, which is not used otherwise. Raises what a subclass's
        `torque_limits` raises; else nothing is checked."""
        limits = self.torque_limits(mechanism)
        limited = ("torque_limits", None if limits is None else tuple(limits.tolist()))
        return SinusoidTask(self.environment_id, self._named(REFERENCE), (*self._named(ENVIRONMENT), limited))

    def _named(self, names: tuple[str, ...]) -> Named:
        return tuple((name, getattr(self, name)) for name in names)

    @property
    def options(self) -> dict[str, Any]:
        """Options of the reset of the experiment's environment, by name: `payload`, the mass, kg, of a point at the
        origin of the frame of the last link that has mass, where it is above 0, else none."""
        return {"payload": self.payload} if self.payload > 0.0 else {}

    def torque_limits(self, mechanism: Mechanism) -> Array | None:
        """Torque limits (r,) of the r primary (independently moving) joints of a `mechanism`, N m (N if prismatic), for
        the environment; None, as here, for the environment's own."""
        return None

    def gains(self, mechanism: Mechanism) -> Gains:
        """Gains of the tracking loop, a `Gains`, from the settings: the bandwidth Lambda (r,), 1/s, the same for all of
        the r joints, and the damping K (r,), N m s/rad. `mechanism` is not used. Nothing is checked."""
        return Gains(np.full(self.joints, self.bandwidth), np.array(self.damping))

    def reference_settings(self, env: gymnasium.Env[Any, Any]) -> Iterator[Setting]:
        """Iterator over one `Setting` (name, value and meaning) for the report, which states the reference's formula,
        sinusoids faded in from rest over `start_time` (s). `env`, the tracking environment, is not used. Nothing is
        checked."""
        yield Setting(
            "reference",
            "p(t) = centre + fade(t) · amplitude · sin(2π · frequency · t)",
            f"fade is a quintic from rest over {self.start_time:g} s",
        )
