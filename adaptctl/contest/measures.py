"""Measures of runs, with their units."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array

RECORDED = 10
"""control periods from one sample to the next"""
DIVERGED = 2.0
"""rad (m) beyond which a run has failed"""
WINDOWS = {"error_2_s": (1.5, 2.5), "error_10_s": (10.0, 11.0), "error_20_s": (18.0, 20.0)}
FINAL_SHARE = 0.1
"""share of a run that is its end"""
RETURN_WINDOW, RETURN_RATIO = 0.5, 2.0
"""s over which errors are averaged, and ratio to those before an event below which a law has returned"""
CURVE = 20
"""points of the course of an error"""
COLUMNS = {
    "robot": ("string", "", "robot"),
    "condition": ("string", "", "condition"),
    "law": ("string", "", "law"),
    "seed": ("int64", "", "seed, the same for every law"),
    "knows": ("string", "", "what the law may know"),
    "gains": ("string", "", "how the law got its gains"),
    "reason": ("string", "", "why the run failed; empty if it did not"),
    "error": ("double", "mrad (mm)", "RMS error of all joints over the last 10 % of the run, by which laws are ranked"),
    "error_2_s": ("double", "mrad (mm)", "RMS error of all joints from 1.5 to 2.5 s"),
    "error_10_s": ("double", "mrad (mm)", "RMS error of all joints from 10 to 11 s"),
    "error_20_s": ("double", "mrad (mm)", "RMS error of all joints from 18 to 20 s"),
    "largest_error": ("double", "mrad (mm)", "largest error of any joint"),
    "return_time": ("double", "s", "time from an event until the error is below twice the earlier; null if never"),
    "unseen": ("double", "1", "RMS torque error of the last estimate on an unseen motion, over the RMS torque"),
    "torque": ("double", "1", "RMS torque over the limits"),
    "torque_rate": ("double", "1/s", "RMS change of the torques over the limits"),
    "saturated": ("double", "1", "share of samples with a torque at its limit"),
    "operations": ("int64", "1", "floating-point operations of a control step"),
    "parameters": ("int64", "1", "base parameters of the robot"),
    "curve": ("list", "mrad (mm)", "RMS error of all joints over each twentieth of the run"),
}
"""Kind, unit and meaning of each column of results.parquet."""
NOTHING: dict[str, Any] = {
    **{name: float("nan") for name, (kind, _, _) in COLUMNS.items() if kind == "double"},
    "operations": 0,
    "curve": [],
}
"""Measures of a run that failed."""


class ContestRuns(NamedTuple):
    """Samples (T,) in s and (T, S, r) of S runs, largest errors (S, r), when they diverged (S,), NaN if never, and
    last estimates (S, k)."""

    time: Array
    error: Array
    torque: Array
    largest_error: Array
    diverged_at: Array
    estimate: Array


def measured(runs: ContestRuns, k: int, limits: Array, event: float | None) -> dict[str, Any]:
    """Measures of run k, or the reason why it failed."""
    if reason := failure(runs, k):
        return {"reason": reason}
    squares, time = np.mean(runs.error[:, k] ** 2, axis=-1), runs.time
    end = time[-1] + time[1] - time[0]
    torque = runs.torque[:, k] / limits
    rates = np.diff(torque, axis=0) / np.diff(time)[:, None]
    found = {name: _rms(squares[(time >= low) & (time < high)]) for name, (low, high) in WINDOWS.items() if high <= end}
    return {
        **found,
        "error": _rms(squares[time >= (1.0 - FINAL_SHARE) * end]),
        "largest_error": 1e3 * float(runs.largest_error[k].max()),
        "return_time": _returned(squares, time, event),
        "torque": float(np.sqrt(np.mean(torque**2))),
        "torque_rate": float(np.sqrt(np.mean(rates**2))) if len(rates) else 0.0,
        "saturated": float(np.mean((np.abs(torque) >= 1.0 - 1e-9).any(axis=-1))),
        "curve": [_rms(part) for part in np.array_split(squares, min(CURVE, len(squares)))],
    }


def failure(runs: ContestRuns, k: int) -> str:
    """Reason why run k failed, or nothing."""
    wrong = np.flatnonzero(~np.isfinite(runs.torque[:, k]).all(axis=-1))
    diverged = float(runs.diverged_at[k])
    if wrong.size and not runs.time[wrong[0]] > diverged:
        return f"torque is not a number from {runs.time[wrong[0]]:.2f} s on"
    if np.isfinite(diverged):
        return f"error beyond {DIVERGED:g} rad at {diverged:.2f} s"
    return ""


def _rms(squares: Array) -> float:
    return 1e3 * float(np.sqrt(np.mean(squares)))


def _returned(squares: Array, time: Array, event: float | None) -> float:
    """Time in s from an event until the error over a window is below twice that before."""
    if event is None or event >= time[-1]:
        return float("nan")
    begin = min(event, 6.0)
    earlier = _rms(squares[(time >= begin - 2.0) & (time < begin)])
    width = max(1, round(RETURN_WINDOW / (time[1] - time[0])))
    coming = 1e3 * np.sqrt(np.convolve(squares, np.ones(width) / width, "valid"))
    back = np.flatnonzero((time[: len(coming)] >= event) & (coming < RETURN_RATIO * earlier))
    return float(time[back[0]]) - event if back.size else float("nan")
