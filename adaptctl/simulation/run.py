"""Record of a closed-loop run."""

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

from adaptctl.arrays import Array, checked, frozen, numbers, positive_period
from adaptctl.caching import sent_as_made
from adaptctl.dynamics.joint_units import either
from adaptctl.errors import FileError, InputError
from adaptctl.optional_packages import needed
from adaptctl.simulation.rollout_file import (
    CONTROLLER_ARRAYS,
    JOINT_UNITS,
    RUN_ENTRIES,
    SAMPLE_UNITS,
    STORED_ENTRIES,
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


MAX_PLOTTED_SAMPLES = 4000
"""per curve"""
FINAL_WINDOW = 2.0
"""s at the end for the final error"""


@sent_as_made
@dataclass(frozen=True, eq=False)
class Rollout:
    """
    Record of a closed-loop run of r joints, simulated or real, as T samples.

    Parameters
    ----------
    time : ndarray
        Times (T,) in s at which the control periods of the samples begin.
    p, v : ndarray
        Positions in rad (m if prismatic) and velocities in rad/s (m/s), (T, r); the true ones where known.
    reference_p, reference_v, reference_a : ndarray
        The reference's positions, velocities and accelerations (T, r) in rad, rad/s and rad/s^2 (m, m/s, m/s^2).
    torque : ndarray
        Commanded torques (T, r) in N m (N).
    applied : ndarray
        Torques after the limits (T, r) in N m (N).
    clipped : ndarray
        1 without a unit where a torque was clipped, else 0, (T,).
    energy : ndarray
        Energy (T,) in J, NaN where not known.
    reward : ndarray
        Rewards (T,) of the control periods that begin, without a unit.
    estimate : ndarray
        Parameter estimates (T, k) in SI units; k = 0 for a controller without.
    control_period : float
        Control period in s.
    wall_time : float
        Time in s that the run took.
    interrupted : bool, default False
        True for a run that its user cut off, as by Ctrl-C.
    terminated : bool, default False
        True if the environment ended the run early, as where an error exceeds its limit. False where there is no
        environment.
    info : dict, optional
        Last `info` of the environment. Default: empty.
    measured_p, measured_v : ndarray, optional
        Measured positions in rad (m) and velocities in rad/s (m/s), (T, r). Default: p and v.
    flags : mapping, optional
        Arrays (T,) by the names of events, such as "torque_limited", 1 or 0; "payload" is the mass held in kg.
    every : int, default 1
        Control periods from one sample to the next. By default every period is a sample.
    logged_state : ndarray, optional
        Numbers (T, l) that the adaptation law records of its internal state, in its units. Default: none.
    position_units : tuple of str, default ()
        Joint units (r,), "rad" or "m"; empty where not known.
    joints : tuple of str, default ()
        Joint names (r,), for figures; empty where not known.

    Notes
    -----
    Sample k has the state at ``time[k]`` and the torque commanded there. Arrays are read-only and unchecked.

    Examples
    --------
    >>> run
    <Rollout of 2 joints: 200 samples in 0.2 s, to the end>
    >>> run.error.shape
    (200, 2)
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
    interrupted: bool = False
    terminated: bool = False
    info: dict[str, object] = field(default_factory=dict)
    measured_p: Array | None = None
    measured_v: Array | None = None
    flags: Mapping[str, Array] = field(default_factory=dict)
    every: int = 1
    logged_state: Array = field(default_factory=partial(np.empty, (0, 0)))
    position_units: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()

    def __repr__(self) -> str:
        end = "to the end" if self.reached_end else "interrupted" if self.interrupted else "terminated"
        return f"<Rollout of {self.p.shape[-1]} joints: {len(self.time)} samples in {self.duration:.6g} s, {end}>"

    @property
    def reached_end(self) -> bool:
        """True if the run was neither interrupted by its user nor terminated by its environment."""
        return not (self.interrupted or self.terminated)

    @property
    def sample_time(self) -> float:
        """Time between successive samples in s."""
        return self.every * self.control_period

    @property
    def duration(self) -> float:
        """Duration in s, rounded up to a whole sample."""
        first = round(float(self.time[0]) / self.control_period) if len(self.time) else 0
        return (first + len(self.time) * self.every) * self.control_period

    @property
    def error(self) -> Array:
        """Tracking errors p - p_d (T, r) in rad (m if prismatic)."""
        return self.p - self.reference_p

    @property
    def velocity_error(self) -> Array:
        """Velocity errors v - v_d (T, r) in rad/s (m/s if prismatic)."""
        return self.v - self.reference_v

    @needed("Rollout.save")
    def save(self, path: str | Path, joints: Sequence[str] | None = None) -> None:
        """
        Write the run to a Parquet file, whole or not at all.

        Parameters
        ----------
        path : str or Path
            File to write; `Rollout.load` and ``adaptctl identify`` read it.
        joints : sequence of str, optional
            Joint names (r,). Default: joint1, joint2, ...

        Raises
        ------
        InputError
            If the names are not r different ones, or the file's name ends as another format's.
        FileError
            If the file cannot be written.
        MissingExtraError
            If pyarrow is not installed.

        Notes
        -----
        Columns are as in `to_arrow`, without `info`.

        Examples
        --------
        >>> run.save(tmp / "run.parquet")
        >>> adaptctl.Rollout.load(tmp / "run.parquet").p.shape
        (200, 2)
        """
        if Path(path).suffix not in ("", ".parquet"):
            table = f"pyarrow.csv.write_csv(run.to_arrow(), {str(path)!r})"
            raise InputError(f"save: expected a file name that ends in .parquet, got {str(path)!r}; as text: {table}")
        with RolloutFile(path, self.p.shape[1], joints, self.position_units) as file:
            file.append(self._columns, self.flags)
            file.about = self._about

    @needed("Rollout.to_arrow")
    def to_arrow(self, joints: Sequence[str] | None = None) -> pyarrow.Table:
        """
        Return the run as an Arrow table, one row per sample.

        Parameters
        ----------
        joints : sequence of str, optional
            Joint names (r,). Default: joint1, joint2, ...

        Returns
        -------
        pyarrow.Table
            Columns of float64 such as ``time``, ``p.joint1``, ``estimate.0`` and ``flag.payload``; their units are
            metadata, those of revolute joints where `position_units` is empty.

        Raises
        ------
        InputError
            If the names are not r different ones.
        MissingExtraError
            If pyarrow is not installed.

        Examples
        --------
        >>> run.to_arrow().column_names[:2]
        ['time', 'clipped']
        """
        names = joint_names(self.p.shape[1], joints)
        return rollout_table(self._columns, self.flags, names, self._about, self.position_units)

    @property
    def _columns(self) -> dict[str, Array | None]:
        return {name: getattr(self, name) for name in (*SAMPLE_UNITS, *JOINT_UNITS, *CONTROLLER_ARRAYS)}

    @property
    def _about(self) -> dict[str, object]:
        return {name: getattr(self, name) for name in STORED_ENTRIES}

    def to_pandas(self, joints: Sequence[str] | None = None) -> pandas.DataFrame:
        """
        Return the run as a pandas data frame, one row per sample.

        Parameters
        ----------
        joints : sequence of str, optional
            Joint names (r,). Default: joint1, joint2, ...

        Returns
        -------
        pandas.DataFrame
            Columns as in `to_arrow`, SI units.

        Raises
        ------
        InputError
            If the names are not r different ones.
        MissingExtraError
            If pandas or pyarrow is not installed.
        """
        with needed("Rollout.to_pandas"):
            return self.to_arrow(joints).to_pandas()

    @needed("Rollout.plot")
    def plot(self, joints: Sequence[str] | None = None) -> Figure:
        """
        Plot positions, tracking errors, applied torques and parameter estimates.

        Parameters
        ----------
        joints : sequence of str, optional
            Names (r,) of the curves. Default: those of the run's robot where known, else joint1, joint2, ...

        Returns
        -------
        matplotlib.figure.Figure
            Figure with errors in mrad (mm if prismatic) and the rest in SI units.

        Raises
        ------
        InputError
            If the names are not r different ones.
        MissingExtraError
            If matplotlib is not installed.
        """
        return self._figure(joints)

    @needed("the figure of a Rollout")
    def _repr_html_(self) -> str:
        last = self.error[self.time >= self.time[-1] - FINAL_WINDOW] if len(self.time) else self.error
        rms = 1e3 * float(np.sqrt(np.mean(last**2))) if last.size else float("nan")
        length = min(FINAL_WINDOW, np.ptp(self.time)) if len(self.time) else 0.0
        end = "stopped at the error limit" if self.terminated else "completed" if self.reached_end else "interrupted"
        text = f"{len(self.time):,} control periods of {self.control_period:g} s, {self.p.shape[1]} joints; {end}; "
        head = f"<p><b>Rollout</b> {text}RMS error over the last {length:.2g} s: {rms:.3g} mrad (mm)</p>"
        if not len(self.time):
            return head
        buffer, about = io.BytesIO(), "positions, errors, torques and estimates over time"
        self._figure().savefig(buffer, format="png", dpi=80)
        return f'{head}<img alt="{about}" src="data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode()}"/>'

    def _figure(self, joints: Sequence[str] | None = None) -> Figure:
        from matplotlib.figure import Figure

        names = joint_names(self.p.shape[1], joints or self.joints or None)
        units = self.position_units or ("rad", "m")
        unit, small, force = (
            either(units),
            either(f"m{one}" for one in units),
            either("N m" if one == "rad" else "N" for one in units),
        )
        panels = [(self.p, f"position [{unit}]"), (1e3 * self.error, f"error [{small}]")]
        panels += [(self.applied, f"torque [{force}]")]
        panels += [(self.estimate, "estimates [SI units]")] if self.estimate.shape[1] else []
        figure = Figure(figsize=(8.0, 1.9 * len(panels)), layout="constrained")
        every = slice(None, None, max(1, -(-len(self.time) // MAX_PLOTTED_SAMPLES)))
        for axes, (values, label) in zip(figure.subplots(len(panels), 1, sharex=True), panels, strict=True):
            axes.plot(self.time[every], values[every], linewidth=1.2)
            axes.set_ylabel(label, size=8)
            axes.grid(alpha=0.3)
            axes.tick_params(labelsize=8)
        figure.axes[0].set_prop_cycle(None)
        figure.axes[0].plot(self.time[every], self.reference_p[every], linestyle=":", linewidth=1.0)
        figure.axes[0].set_title("positions (solid) and reference (dotted)", size=9)
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
        interrupted: bool = False,
        position_units: Sequence[str] = (),
    ) -> Rollout:
        """
        Make a run from logged arrays.

        Parameters
        ----------
        p : array_like
            Positions (T, r) in rad (m if prismatic), T at least 2.
        torque : array_like
            Commanded torques (T, r) in N m (N).
        reference_p : array_like
            The reference's positions (T, r) in rad (m).
        control_period : float
            Time from one sample to the next in s.
        v : array_like, optional
            Velocities (T, r) in rad/s (m/s). Default: differences of the positions, central, one-sided at both ends.
        reference_v, reference_a : array_like, optional
            The reference's velocities (T, r) in rad/s (m/s) and accelerations in rad/s^2 (m/s^2). Default: differences.
        applied : array_like, optional
            Torques at the joints (T, r) in N m (N). Default: those commanded.
        estimate : array_like, optional
            Parameter estimates (T, k) in SI units. Default: none.
        time : array_like, optional
            Times (T,) in s. Default: control periods from zero.
        interrupted : bool, default False
            True for a run that was cut off.
        position_units : sequence of str, default ()
            Joint units (r,), "rad" or "m". Default: empty, not known.

        Returns
        -------
        Rollout
            Run with NaN for the energy, zero reward, and `clipped` 1 where `applied` is not `torque`.

        Raises
        ------
        InputError
            If shapes do not fit, the period is not positive, times do not increase or units are unknown.
        NonFiniteError
            If a number is NaN or infinite.

        Examples
        --------
        >>> logged = adaptctl.Rollout.from_arrays(run.p, run.torque, run.reference_p, 0.001)
        >>> bool(np.allclose(logged.error, run.error))
        True
        """
        period = positive_period(control_period, "control_period")
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
            interrupted=interrupted,
            position_units=stated_units(shape[1], position_units),
        )

    @classmethod
    @needed("Rollout.load")
    def load(cls, path: str | Path, accept_edited: bool = False) -> Rollout:
        """
        Read a run that `Rollout.save` or `simulate` wrote.

        Parameters
        ----------
        path : str or Path
            Parquet file.
        accept_edited : bool, default False
            True to read a file whose numbers are not those that were written. Refused by default.

        Returns
        -------
        Rollout
            The run.

        Raises
        ------
        FileError
            If the file cannot be read, is damaged or edited, or was not written so.
        MissingExtraError
            If pyarrow is not installed.
        """
        columns, flags, about = read_rollout(path, accept_edited)
        try:
            whole = {name: about[name] for name in STORED_ENTRIES if name in about or name in RUN_ENTRIES}
            units = stated_units(columns["p"].shape[1], whole.pop("position_units", ()))
            return cls(**columns, flags=flags, **whole, position_units=units)
        except (KeyError, TypeError, ValueError) as error:
            raise FileError(f"{path}: {type(error).__name__}: {error}; the file is incomplete") from error


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
