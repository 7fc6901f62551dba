"""
Logs with one fault each, and the words that name it: the table of the page on identification.

``python tests/faulty_logs.py 6 --seed 3`` identifies them all on an arm of six joints, from files as one has them.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from random_trees import random_chain
from synthetic_logs import motion

import adaptctl
from adaptctl.arrays import Array
from adaptctl.description.drive import Drive, Limits
from adaptctl.dynamics import Mechanism
from adaptctl.errors import AdaptctlError

RATE, DURATION, NOISE, FILE_SHARE, JOINT = 200.0, 20.0, 0.01, 0.8, 1
"""Hz, s, share of each torque, share of the masses in the robot's file, and the joint that has the fault"""
UNITS = {"time": "s", "position": "rad", "torque": "N m"}


@dataclass(frozen=True, eq=False)
class Log:
    """Columns of a log: times (n,), positions and torques (n, r), of a robot's true mechanism."""

    truth: Mechanism
    time: Array
    position: Array
    torque: Array

    @classmethod
    def of(cls, truth: Mechanism, seed: int = 0) -> Log:
        """A rich motion of a robot, and its torques with noise."""
        rng = np.random.default_rng(seed)
        time, p, v, a = motion(truth.dof, rng, DURATION, RATE)
        torque = truth.inverse_dynamics(p, v, a)
        noise = NOISE * np.sqrt(np.mean(torque**2, axis=0)) * rng.normal(size=p.shape)
        return cls(truth, time, p + 1e-6 * rng.normal(size=p.shape), torque + noise)

    def write(self, path: Path) -> Path:
        """Write the log as text, and return where it is."""
        names = [f"{what}.{joint.name}" for what in ("position", "torque") for joint in self.truth.primary_joints]
        rows = np.column_stack([self.time, self.position, self.torque])
        np.savetxt(path, rows, "%.12g", ",", header=",".join(["time", *names]), comments="")
        return path


Change = Callable[..., Log | list[Log]]


def limited(chain: Mechanism) -> Mechanism:
    """The chain with limits, which files have."""
    links = [replace(link, joint=replace(link.joint, limits=Limits(-6.0, 6.0, 20.0, 5000.0))) for link in chain.links]
    return type(chain)(replace(chain.description, links=tuple(links)))


def robot(links: int, seed: int) -> tuple[Mechanism, Mechanism]:
    """A random chain with friction and rotors, and what its file says of it: too little mass, no friction."""
    chain = limited(random_chain(seed, links))
    return chain.with_drives(Drive(0.1, 2.0, 1.5)), chain.with_parameters(FILE_SHARE * chain.inertial_parameters)


def scaled(log: Log, position: float = 1.0, torque: float = 1.0) -> Log:
    """The log whose faulty joint has other columns."""
    one = np.arange(log.truth.dof) == JOINT
    return replace(
        log, position=log.position * np.where(one, position, 1.0), torque=log.torque * np.where(one, torque, 1.0)
    )


def exchanged(log: Log, whats: tuple[str, ...] = ("torque",)) -> Log:
    """The log whose second and third columns are exchanged."""
    order = [0, 2, 1, *range(3, log.truth.dof)]
    return replace(log, **{what: getattr(log, what)[:, order] for what in whats})


def pulled(log: Log, gravity: tuple[float, float, float]) -> Log:
    """The log under another gravity."""
    still = np.zeros_like(log.position)
    other = type(log.truth)(replace(log.truth.description, gravity=np.array(gravity)))
    after, before = (m.inverse_dynamics(log.position, still, still) for m in (other, log.truth))
    return replace(log, torque=log.torque + after - before)


def late(log: Log, samples: int) -> Log:
    return replace(
        log, time=log.time[samples:], position=log.position[samples:], torque=log.torque[: len(log.torque) - samples]
    )


def put(log: Log, what: str, rows: slice | Array, value: float | Callable[[Array], Array]) -> Log:
    """The log whose faulty joint has another value in some rows of a column."""
    values = getattr(log, what).copy()
    values[rows, JOINT] = value(values[rows, JOINT]) if callable(value) else value
    return replace(log, **{what: values})


def moved(log: Log, by: float) -> Log:
    """The log whose faulty joint has another zero."""
    return replace(log, position=log.position + by * (np.arange(log.truth.dof) == JOINT))


def first(values: Array) -> Array:
    return np.full(len(values), values[0])


def dead(values: Array) -> Array:
    return 1e-4 * np.sin(np.arange(len(values)))


def spiked(values: Array) -> Array:
    return values + 3.0 * np.ptp(values)


def slipped(values: Array) -> Array:
    return values + 0.5


def lossy(log: Log) -> Log:
    kept = np.arange(len(log.time)) % 100 != 99
    return replace(log, time=log.time[: kept.sum()], position=log.position[kept], torque=log.torque[kept])


def thinned(log: Log, every: int = 2) -> Log:
    """The log at a lower rate from its middle on, at the stamps of the rate before."""
    half = len(log.time) // 2
    kept = np.r_[:half, half : len(log.time) : every]
    return replace(log, time=log.time[: len(kept)], position=log.position[kept], torque=log.torque[kept])


def copied(log: Log) -> Log:
    torque = log.torque.copy()
    torque[:, 2] = torque[:, 1]
    return replace(log, torque=torque)


def drifting(log: Log) -> Log:
    return put(log, "torque", slice(None), lambda values: values + np.linspace(0.0, 3.0 * np.std(values), len(values)))


def turned(log: Log) -> Log:
    """The log whose angles are between 0 and full turns of their own."""
    turns = [joint.kind.is_revolute for joint in log.truth.primary_joints]
    return replace(log, position=np.where(turns, np.mod(log.position, 2.0 * np.pi), log.position))


def clipped(log: Log) -> Log:
    most = float(np.quantile(np.abs(log.torque[:, JOINT]), 0.9))
    return put(log, "torque", slice(None), lambda values: np.clip(values, -most, most))


def zeroed(log: Log) -> Log:
    far = np.flatnonzero(np.abs(log.position[:, JOINT]) > np.quantile(np.abs(log.position[:, JOINT]), 0.5))
    return put(log, "position", far[[50, 450, 900, 1300, 1700]], 0.0)


def sprung(log: Log) -> Log:
    torque = log.torque.copy()
    torque[:, JOINT] += np.ptp(torque[:, JOINT]) * (log.position[:, JOINT] - 0.3)
    return replace(log, torque=torque)


def taken(log: Log, body: float = 2.0) -> list[Log]:
    """Two logs of other motions, in the second of which the last link carries a body (kg)."""
    loaded = log.truth.inertial_parameters.copy()
    last = 10 * (len(log.truth.description.bodies) - 1)
    loaded[last : last + 10] += body * np.array([1.0, 0.1, 0.0, 0.05, 0.03, 0.0, 0.03, 0.0, 0.0, 0.03])
    return [log, Log.of(log.truth.with_parameters(loaded), 1)]


OFTEN = np.arange(250, 3800, 60)
FAULTS: dict[str, tuple[Change, str]] = {
    "gravity-compensated torques": (partial(pulled, gravity=(0.0, 0.0, 0.0)), "gravity-compensated"),
    "torques on the motors' side of gears": (
        lambda log: replace(log, torque=0.02 * log.torque),
        "all about 0.02.: are they on the other side of gears",
    ),
    "sign of a torque": (partial(scaled, torque=-1.0), "column 'torque.{two}' has the other sign"),
    "a sign that turns": (
        partial(put, what="torque", rows=slice(2400, None), value=np.negative),
        "column 'torque.{two}' has the other sign from (12|11[.]9)[.0-9]* s on",
    ),
    "sign of all torques": (lambda log: replace(log, torque=-log.torque), "all torques have the other sign"),
    "sign of a position": (partial(scaled, position=-1.0), "column 'position.{two}' has the other sign"),
    "a mirrored joint": (
        partial(scaled, position=-1.0, torque=-1.0),
        "columns 'position.{two}' and 'torque.{two}' both have the other sign",
    ),
    "two torques exchanged": (exchanged, "columns 'torque.{two}' and 'torque.{three}' are exchanged"),
    "two positions exchanged": (
        partial(exchanged, whats=("position",)),
        "columns 'position.{two}' and 'position.{three}' are exchanged",
    ),
    "two joints exchanged": (
        partial(exchanged, whats=("position", "torque")),
        "all columns of {two} and {three} are exchanged",
    ),
    "hung from the ceiling": (partial(pulled, gravity=(0.0, 0.0, 9.81)), r"gravity is along \(.*, 9.\d+\) m/s\^2"),
    "zero of a joint": (partial(moved, by=-0.6), "{two} is at (3[345].* deg|0\\.[56].* m) where its column has 0"),
    "scale of a torque": (partial(scaled, torque=0.05), r"column 'torque.{two}' is about 0.05\d* times the torque"),
    "times of half the speed": (
        lambda log: replace(log, time=2.0 * log.time),
        r"true times are 0[.](49|5|51)\d* times the log's",
    ),
    "mA for N m": (lambda log: replace(log, torque=1e4 * log.torque), "check the unit of torque"),
    "degrees for radians": (
        lambda log: replace(log, position=np.degrees(log.position)),
        "check the gear ratio, and whether positions are in deg",
    ),
    "delay of 10 ms": (partial(late, samples=2), "the torques are (9|10|11)[.0-9]* ms later than the positions"),
    "delay of 30 ms": (partial(late, samples=6), "the torques are (29|30|31)[.0-9]* ms later than the positions"),
    "delay of 250 ms": (partial(late, samples=50), "the torques are (24|25|26)0 ms later than the positions"),
    "clipped": (clipped, "the torque of joint '{two}' is clipped: [0-9]+ rows"),
    "frozen": (
        partial(put, what="torque", rows=slice(2000, 2200), value=first),
        "the torque of joint '{two}' is frozen at",
    ),
    "dead": (
        partial(put, what="torque", rows=slice(None), value=dead),
        "the torque of joint '{two}' is .*its sensor seems dead",
    ),
    "jumps by full turns": (turned, "[1-9][0-9]* jumps by full turns removed"),
    "spikes": (
        partial(put, what="torque", rows=OFTEN, value=spiked),
        "joint '{two}' has [1-9][0-9]* torques that stand out",
    ),
    "zeros among positions": (
        zeroed,
        "joint '{two}' has 5 positions that it cannot reach",
    ),
    "a slip of an encoder": (
        partial(put, what="position", rows=slice(2000, None), value=slipped),
        "the position of joint '{two}' steps by 0[.](49|5)[0-9]* (rad|m) in row 2001, at 10 s, and stays there",
    ),
    "rows lost at even stamps": (lossy, "in [0-9]+ rows, the first row [0-9]+, .*, all joints move .* times as far"),
    "a sampling rate that changes": (thinned, "from (10|9[.]99)[0-9]* s on, all joints at once move (2|1[.]9) times"),
    "a copied column": (copied, "the torques of joints '{two}' and '{three}' are equal in all rows"),
    "absolute values": (
        partial(put, what="torque", rows=slice(None), value=np.abs),
        r"torques fall to 0 and are never negative, of joints '{two}' \([0-9]+ times\)",
    ),
    "a torque that drifts": (drifting, "most at {two}: check its columns|of {two}'s .* something changed"),
    "a spring": (sprung, "a spring is at {two}"),
    "a payload in one of two logs": (taken, "carries a body in .*second.csv"),
}


def told(links: int, kind: str, folder: Path, seed: int) -> str:
    """What an identification says of a log of a robot with a fault, the words of its refusal or its warnings."""
    truth, file = robot(links, seed)
    change = FAULTS[kind][0] if kind else lambda log: log
    found = change(Log.of(truth, seed))
    logs = found if isinstance(found, list) else [found]
    paths = [log.write(folder / f"{place}.csv") for log, place in zip(logs, ("first", "second"), strict=False)]
    try:
        result = adaptctl.identify(paths, file, units=UNITS)
    except AdaptctlError as error:
        return f"refused: {error}"
    meant = [trial.words for trial in result.hypotheses if trial.named]
    return "; ".join([*result.warnings, *meant])


def pattern(links: int, kind: str, seed: int) -> str:
    """Regular expression of the words that name a fault."""
    _, two, three = (joint.name for joint in robot(links, seed)[1].primary_joints[:3])
    return FAULTS[kind][1].replace("{two}", two).replace("{three}", three)


def main() -> None:
    """Identify each log, and print what is said of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("links", type=int)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    named = 0
    for kind in ("", *FAULTS):
        with TemporaryDirectory() as folder:
            said = told(given.links, kind, Path(folder), given.seed)
        found = bool(re.search(pattern(given.links, kind, given.seed), said)) if kind else not said
        named += found
        print(f"{'named' if found else 'NOT NAMED'}: {kind or 'a right log'}: {said}", flush=True)
    print(f"{named} of {len(FAULTS) + 1}")


if __name__ == "__main__":
    main()
