"""Logger for real-time control loops."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import frozen, positive_period
from adaptctl.control.controller import ReferencePoint
from adaptctl.errors import InputError, LostSamplesWarning, warn
from adaptctl.files import validate_place
from adaptctl.simulation.rollout_file import RolloutFile, joint_names, stated_units
from adaptctl.simulation.run import Rollout

MAX_MEMORY_SHARE = 0.5
"""of the computer's memory"""


class RunLogger:
    """
    Logger for a real control loop, with bounded memory.

    Parameters
    ----------
    dof : int
        Number r of joints.
    control_period : float
        Time from one sample to the next in s.
    path : str or Path, optional
        Parquet file that is written when the context ends. Default: no file.
    estimates : int, default 0
        Length k of the controller's parameter estimate. Zero for a controller without.
    capacity : int, default 300000
        Number of latest samples that are kept: 300 s at 1 kHz. All memory is allocated at construction.
    joints : tuple of str, optional
        Joint names (r,) in the file. Default: joint1, joint2, ...
    position_units : tuple of str, default ()
        Joint units (r,), "rad" or "m". Default: empty, not known.
    flags : tuple of str, default ()
        Names (f,) of further numbers of each sample, `flags` of the run. Default: none.

    Raises
    ------
    InputError
        If a number, name or unit is not as above, or the log would take over half of the computer's memory.
    FileError
        If the file cannot be written.
    MissingExtraError
        If a path is given and pyarrow is not installed.

    Notes
    -----
    `append` neither allocates nor touches files. `count` is the number of samples appended, `faulty` of those left out,
    `lost` of those overwritten. When the context ends, also by an exception, a file of at least two samples is saved;
    `LostSamplesWarning` reports missing ones.

    Examples
    --------
    >>> with adaptctl.RunLogger(2, period, tmp / "log.parquet") as log:
    ...     for k in range(3):
    ...         log.append(k * period, p, v, reference(k * period), torque=[0.0, 0.0])
    >>> log
    <RunLogger: 3 samples, 0 lost, 0 faulty>
    >>> log.rollout().p.shape
    (3, 2)
    """

    def __init__(
        self,
        dof: int,
        control_period: float,
        path: str | Path | None = None,
        *,
        estimates: int = 0,
        capacity: int = 300_000,
        joints: tuple[str, ...] | None = None,
        position_units: tuple[str, ...] = (),
        flags: tuple[str, ...] = (),
    ) -> None:
        for what, number, least in (("dof", dof, 1), ("estimates", estimates, 0), ("capacity", capacity, 2)):
            if isinstance(number, bool) or not isinstance(number, int) or number < least:
                raise InputError(f"{what}: expected a whole number of at least {least}, got {number!r}")
        self.control_period = positive_period(control_period, "control_period")
        width = 7 * dof + estimates + len(flags) + 1
        _validate_memory(8 * capacity * width, capacity)
        self._joints, self._units = joint_names(dof, joints), stated_units(dof, position_units)
        if path is not None:  # what is missing should be known before the loop, not after it
            RolloutFile(path, dof, joints)
            validate_place(path)
        self._rows, self._dof, self._path = np.zeros((capacity, width)), dof, path
        self._sample, self._lengths = np.zeros(width), [dof] * 7 + [estimates, len(flags)]
        self.flags = tuple(flags)
        """names (f,) of further numbers of a sample"""
        self.count, self.faulty = 0, 0
        """appended samples, and those refused"""

    def __repr__(self) -> str:
        return f"<RunLogger: {self.count} samples, {self.lost} lost, {self.faulty} faulty>"

    @property
    def lost(self) -> int:
        """Number of samples overwritten."""
        return max(0, self.count - len(self._rows))

    def append(
        self,
        time: float,
        p: ArrayLike,
        v: ArrayLike,
        reference: ReferencePoint,
        torque: ArrayLike,
        applied: ArrayLike | None = None,
        estimate: ArrayLike = (),
        flags: ArrayLike = (),
    ) -> None:
        """
        Append a sample, or only count it if it is faulty.

        Parameters
        ----------
        time : float
            Time in s.
        p, v : array_like
            Measured positions in rad (m if prismatic) and velocities in rad/s (m/s), (r,).
        reference : ReferencePoint
            The reference's positions, velocities and accelerations (r,).
        torque : array_like
            Commanded torque (r,) in N m (N).
        applied : array_like, optional
            Torque at the joints (r,) in N m (N). Default: the commanded one.
        estimate : array_like, default ()
            Parameter estimates (k,) in SI units. Default: empty, for a controller without.
        flags : array_like, default ()
            Further numbers (f,), in the order of their names.

        Examples
        --------
        >>> logger = adaptctl.RunLogger(2, period)
        >>> logger.append(0.0, p, v, reference(0.0), torque=[1.0, 0.5])
        >>> logger.count
        1
        """
        row = self._sample
        try:
            given = (p, v, *reference, torque, torque if applied is None else applied, estimate, flags)
            fits = [len(part) for part in given] == self._lengths  # type: ignore[arg-type]
            np.concatenate(given, out=row[1:])
            row[0] = time
        except (TypeError, ValueError):
            fits = False
        if fits and np.isfinite(row).all():
            self._rows[self.count % len(self._rows)] = row
            self.count += 1
        else:
            self.faulty += 1

    def rollout(self, interrupted: bool = False) -> Rollout:
        """
        Return the run so far, its oldest sample first.

        Parameters
        ----------
        interrupted : bool, default False
            True for a run that was cut off.

        Returns
        -------
        Rollout
            The run.

        Raises
        ------
        InputError
            If there are fewer than two samples or their times do not increase.
        """
        if self.count < 2:
            raise InputError(f"a run needs at least 2 samples, got {self.count} ({self.faulty} faulty)")
        first = self.count % len(self._rows) if self.lost else 0
        rows = np.roll(self._rows, -first, axis=0)[: min(self.count, len(self._rows))]
        r, own = self._dof, np.shape(rows)[1] - len(self.flags)
        p, v, rp, rv, ra, torque, applied = (rows[:, 1 + k * r : 1 + (k + 1) * r] for k in range(7))
        run = Rollout.from_arrays(
            p,
            torque,
            rp,
            self.control_period,
            v=v,
            reference_v=rv,
            reference_a=ra,
            applied=applied,
            estimate=rows[:, 1 + 7 * r : own],
            time=rows[:, 0],
            interrupted=interrupted,
            position_units=self._units,
        )
        flags = {name: frozen(column.copy()) for name, column in zip(self.flags, rows[:, own:].T, strict=True)}
        return replace(run, flags=flags) if flags else run

    def __enter__(self) -> RunLogger:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.lost or self.faulty:
            text = f"of {self.count + self.faulty} samples, {self.lost} were overwritten and {self.faulty} omitted"
            warn(f"log: {text}: `capacity` is {len(self._rows)}", LostSamplesWarning)
        if self._path is not None and self.count >= 2:
            self.rollout(interrupted=kind is not None).save(self._path, self._joints)


def _validate_memory(size: int, capacity: int) -> None:
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if size > MAX_MEMORY_SHARE * memory:
        raise InputError(
            f"capacity: {capacity} samples need {size / 1e9:.3g} GB, but this computer has {memory / 1e9:.3g} GB: at "
            f"most {int(MAX_MEMORY_SHARE * memory / size * capacity)} fit into half of that"
        )
