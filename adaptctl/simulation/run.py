"""A closed-loop run of an arm, simulated or real: what happened in it, kept as arrays."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked, frozen, numbers, positive_number
from adaptctl.caching import sent_as_made
from adaptctl.errors import FileError, InputError
from adaptctl.optional_packages import needed
from adaptctl.simulation.rollout_file import (
    KEPT,
    OF_JOINTS,
    OF_LAWS,
    OF_TIME,
    WHOLE,
    RolloutFile,
    joint_names,
    read_rollout,
    rollout_table,
    stated_units,
)

if TYPE_CHECKING:
    import pandas
    import pyarrow
    from matplotlib.figure import Figure


MOST_SAMPLES = 4000
"""as many a curve are drawn at most"""
LAST = 2.0
"""s at the end over which an error is averaged"""


@sent_as_made
@dataclass(frozen=True, eq=False)
class Rollout:
    """Closed-loop run of an arm of r joints, simulated or real, as T samples; every array is read-only. Nothing is
    checked at construction.

    Sample k is the state at `time[k]`, the beginning of a control period, and the torque commanded on it; there is one
    sample in `every` control periods. Positions are in rad (m if prismatic), velocities in rad/s (m/s), accelerations
    in rad/s^2 (m/s^2), torques in N m (N).

    (T,): `time`, s; `clipped`, 1 where a torque was clipped, else 0; `energy`, J, NaN where not known; `reward` of the
    control period that begins, no unit. `flags` maps names of events to arrays (T,): 1 where there was one, such as
    "torque_limited", else 0; "payload" is the mass held, kg. (T, r): positions `p` and velocities `v`, the true ones
    where the environment gives them; `reference_p`, `reference_v`, `reference_a`; `torque`, the one commanded, and
    `applied`, the one after the limits; `measured_p` and `measured_v`, None where these are p and v. `estimate` (T, k)
    is the controller's k parameter estimates in SI units, k = 0 where it has none; `learning` (T, l) the l numbers that
    the adaptation law records of its internal state, l = 0 where it records none.

    `control_period`, s; `wall_time`, s, that the run took; `complete`, False if it was interrupted; `terminated`, True
    if the environment ended it early; `info`, the last dict of that name that it gave, empty by default;
    `position_units` (r,), "rad" for revolute joints and "m" for prismatic ones, empty, the default, where that is not
    known.
    """

    time: Array
    p: Array
    v: Array
    reference_p: Array
    reference_v: Array
    reference_a: Array
    torque: Array
    applied: Array
    clipped: Array
    energy: Array
    reward: Array
    estimate: Array
    control_period: float
    wall_time: float
    complete: bool = True
    terminated: bool = False
    info: dict[str, object] = field(default_factory=dict)
    measured_p: Array | None = None
    measured_v: Array | None = None
    flags: Mapping[str, Array] = field(default_factory=dict)
    every: int = 1
    logged_state: Array = field(default_factory=partial(np.empty, (0, 0)))
    position_units: tuple[str, ...] = ()

    @property
    def sample_time(self) -> float:
        """Time between successive samples of the run, s: its `every` times its `control_period`."""
        return self.every * self.control_period

    @property
    def duration(self) -> float:
        """Duration of the run in closed loop, s, from time zero to its end, rounded up to a whole sample."""
        first = round(float(self.time[0]) / self.control_period) if len(self.time) else 0
        return (first + len(self.time) * self.every) * self.control_period

    @property
    def error(self) -> Array:
        """Tracking errors p - p_d (T, r), rad or m: the positions of T samples of r joints minus the reference's."""
        return self.p - self.reference_p

    @property
    def velocity_error(self) -> Array:
        """Velocity errors v - v_d (T, r), rad/s or m/s: the velocities of T samples of r joints minus the
        reference's."""
        return self.v - self.reference_v

    @needed("Rollout.save")
    def save(self, path: str | Path, joints: Sequence[str] | None = None) -> None:
        """Write the run to a Parquet file at `path`, whole or not at all, which `adaptctl identify` reads too. There is
        a row for each sample, and columns of float64: one for `time`, `clipped`, `energy` and `reward`, one a joint for
        arrays (T, r), such as `p.joint1`, one a number for `estimate` and `learning`, such as `estimate.0`, and one an
        event, such as `flag.payload`, with their units as metadata, as if all joints were revolute where
        `position_units` is empty. `joints` (r,) names the r joints, None for joint1, joint2, ...

        The environment's last `info` is left out. Raises `InputError` for other than r different names, `FileError`
        where the file cannot be written, and `MissingExtraError` without pyarrow.
        """
        with RolloutFile(path, self.p.shape[1], joints, self.position_units) as file:
            file.append(self._columns, self.flags)
            file.about = self._about

    @needed("Rollout.to_arrow")
    def to_arrow(self, joints: Sequence[str] | None = None) -> pyarrow.Table:
        """The run as an Arrow table: a row for each sample, and columns of float64. There is one for `time`, `clipped`,
        `energy` and `reward`, one a joint for arrays (T, r), such as `p.joint1`, one a number for `estimate` and
        `learning`, such as `estimate.0`, and one an event, such as `flag.payload`, with their units as metadata, as if
        all joints were revolute where `position_units` is empty. `joints` (r,) names the r joints, None for joint1,
        joint2, ... Raises `InputError` for other than r different names, `MissingExtraError` without pyarrow."""
        names = joint_names(self.p.shape[1], joints)
        return rollout_table(self._columns, self.flags, names, self._about, self.position_units)

    @property
    def _columns(self) -> dict[str, Array | None]:
        return {name: getattr(self, name) for name in (*OF_TIME, *OF_JOINTS, *OF_LAWS)}

    @property
    def _about(self) -> dict[str, object]:
        return {name: getattr(self, name) for name in KEPT}

    def to_pandas(self, joints: Sequence[str] | None = None) -> pandas.DataFrame:
        """The run as a pandas data frame: a row for each sample, and columns of float64 in SI units: rad (m if
        prismatic), s, N m (N), J. There is one for `time`, `clipped`, `energy` and `reward`, one a joint for arrays (T,
        r), such as `p.joint1`, one a number for `estimate` and `learning`, such as `estimate.0`, and one an event, such
        as `flag.payload`. `joints` (r,) names the r joints, None for joint1, joint2, ... Raises `InputError` for other
        than r different names, `MissingExtraError` without pandas or pyarrow."""
        with needed("Rollout.to_pandas"):
            return self.to_arrow(joints).to_pandas()

    @needed("Rollout.plot")
    def plot(self, joints: Sequence[str] | None = None) -> Figure:
        """A Matplotlib figure of the run over time (s): positions (rad or m) on the reference, tracking errors (mrad or
        mm), applied torques (N m or N), and parameter estimates (SI units) if there are any. `joints` (r,) names the
        curves of the r joints, None for joint1, joint2, ... Raises `InputError` for other than r different names,
        `MissingExtraError` without matplotlib."""
        return self._figure(joints)

    @needed("the figure of a Rollout")
    def _repr_html_(self) -> str:
        """Notebook's view of the run: its figure, with the numbers that matter."""
        last = self.error[self.time >= self.time[-1] - LAST] if len(self.time) else self.error
        rms = 1e3 * float(np.sqrt(np.mean(last**2))) if last.size else float("nan")
        end = "stopped by an error" if self.terminated else "to the end" if self.complete else "cut off"
        text = f"{len(self.time):,} control periods of {self.control_period:g} s, {self.p.shape[1]} joints; {end}; "
        head = f"<p><b>Rollout</b> {text}RMS error over the last {LAST:g} s: {rms:.3g} mrad (mm)</p>"
        if not len(self.time):
            return head
        buffer, about = io.BytesIO(), "positions, errors, torques and estimates over time"
        self._figure().savefig(buffer, format="png", dpi=80)
        return f'{head}<img alt="{about}" src="data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode()}"/>'

    def _figure(self, joints: Sequence[str] | None = None) -> Figure:
        from matplotlib.figure import Figure

        names = joint_names(self.p.shape[1], joints)
        panels = [(self.p, "position [rad or m]"), (1e3 * self.error, "error [mrad or mm]")]
        panels += [(self.applied, "torque [N m or N]")]
        panels += [(self.estimate, "estimates")] if self.estimate.shape[1] else []
        figure = Figure(figsize=(8.0, 1.9 * len(panels)), layout="constrained")
        every = slice(None, None, max(1, -(-len(self.time) // MOST_SAMPLES)))
        for axes, (values, label) in zip(figure.subplots(len(panels), 1, sharex=True), panels, strict=True):
            axes.plot(self.time[every], values[every], linewidth=1.2)
            axes.set_ylabel(label, size=8)
            axes.grid(alpha=0.3)
            axes.tick_params(labelsize=8)
        figure.axes[0].set_prop_cycle(None)
        figure.axes[0].plot(self.time[every], self.reference_p[every], linestyle=":", linewidth=1.0)
        figure.axes[0].set_title("positions, and dotted the reference", size=9)
        figure.axes[-1].set_xlabel("time [s]")
        figure.legend(figure.axes[1].lines, names, loc="outside right upper", fontsize=8)
        return figure

    @classmethod
    def from_arrays(
        cls,
        p: ArrayLike,
        torque: ArrayLike,
        reference_p: ArrayLike,
        control_period: float,
        *,
        v: ArrayLike | None = None,
        reference_v: ArrayLike | None = None,
        reference_a: ArrayLike | None = None,
        applied: ArrayLike | None = None,
        estimate: ArrayLike | None = None,
        time: ArrayLike | None = None,
        complete: bool = True,
        position_units: Sequence[str] = (),
    ) -> Rollout:
        """A `Rollout` of a run that was logged elsewhere, from positions `p`, rad (m if prismatic), `torque`, the one
        commanded, N m (N), and the reference's positions `reference_p`, rad (m): arrays (T, r) of T samples, at least
        2, of r joints, one a `control_period` (s).

        Velocities `v` and the reference's velocities and accelerations `reference_v` and `reference_a`, (T, r) each, in
        rad/s and rad/s^2 (m/s, m/s^2), are differences of the positions unless given, central, one-sided at both ends;
        `applied` (T, r), N m (N), the torque at the joints, is the one commanded unless given; `time` (T,), s, counts
        control periods from zero unless given. `estimate` (T, k) is the controller's k parameter estimates, SI units,
        None where it has none; `complete` is False for a run that was cut off; `position_units` (r,) has "rad" for
        revolute joints and "m" for prismatic ones, empty, the default, where that is not to be kept. Energy and reward
        are not known: NaN, and zero; `clipped` is 1 where `applied` is not `torque`. Raises `InputError` on shapes that
        do not fit, a period that is not positive, times that do not increase or other than r of these units,
        `NonFiniteError` on NaN and infinity.
        """
        period = positive_number(control_period, "control_period: expected a positive time in s")
        p = numbers(p, "p")
        shape = p.shape
        if len(shape) != 2 or shape[0] < 2 or shape[1] < 1:
            raise InputError(f"p: expected shape (T, r) with T of at least 2, got {shape}")
        given: dict[str, Any] = {"p": p, "torque": torque, "reference_p": reference_p, "v": v}
        given |= {"reference_v": reference_v, "reference_a": reference_a, "applied": applied}
        known: dict[str, Any] = {
            name: _table(values, name, shape) for name, values in given.items() if values is not None
        }
        for name, integral in (("v", "p"), ("reference_v", "reference_p"), ("reference_a", "reference_v")):
            if name not in known:
                known[name] = np.asarray(np.gradient(known[integral], period, axis=0), dtype=np.float64)
        known.setdefault("applied", known["torque"])
        count = shape[0]
        estimates = np.empty((count, 0)) if estimate is None else numbers(estimate, "estimate")
        if estimates.ndim != 2:
            raise InputError(f"estimate: expected shape ({count}, k), got {estimates.shape}")
        known["estimate"] = _table(estimates, "estimate", (count, estimates.shape[1]))
        known["clipped"] = (known["applied"] != known["torque"]).any(axis=1).astype(np.float64)
        known |= {"time": _times(time, count, period), "energy": np.full(count, np.nan), "reward": np.zeros(count)}
        kept: dict[str, Any] = {name: frozen(values.copy()) for name, values in known.items()}
        return cls(
            **kept,
            control_period=period,
            wall_time=0.0,
            complete=complete,
            position_units=stated_units(shape[1], position_units),
        )

    @classmethod
    @needed("Rollout.load")
    def load(cls, path: str | Path) -> Rollout:
        """The run that `Rollout.save` wrote to the Parquet file `path`. Raises `FileError` for a file that cannot be
        read, was not written so or is damaged, and `MissingExtraError` without pyarrow."""
        columns, flags, about = read_rollout(path)
        try:
            whole = {name: about[name] for name in KEPT if name in about or name in WHOLE}
            units = stated_units(columns["p"].shape[1], whole.pop("position_units", ()))
            return cls(**columns, flags=flags, **whole, position_units=units)
        except (KeyError, TypeError, ValueError) as error:
            raise FileError(f"{path}: {type(error).__name__}: {error}; it is not whole") from error


def _table(values: ArrayLike, name: str, shape: tuple[int, ...]) -> Array:
    array = checked(np.atleast_2d(numbers(values, name)), shape[-1], name)
    if array.shape != shape:
        raise InputError(f"{name}: expected shape {shape}, got {array.shape}")
    return np.asarray(array, dtype=np.float64)


def _times(time: ArrayLike | None, count: int, control_period: float) -> Array:
    if time is None:
        return np.asarray(control_period * np.arange(count), dtype=np.float64)
    times = np.asarray(checked(time, count, "time"), dtype=np.float64)
    if times.shape != (count,) or np.any(np.diff(times) <= 0.0):
        raise InputError(f"time: expected {count} increasing numbers, s")
    return times
