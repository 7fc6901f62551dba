"""Laws x arms x conditions x seeds, from a TOML file to a table: python -m benchmarks.law_comparison FILE --out DIR

Each arm under each condition is a shard, a Parquet file; shards that are there are kept, so that a run resumes. All
laws of a shard have the gains and the reference that `tune` finds from the arm's description, and common seeds.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache, partial
from importlib.metadata import files
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

import adaptctl
from adaptctl.arrays import Array
from adaptctl.control import Controller, PDGravity
from adaptctl.description.description import Link
from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism
from adaptctl.errors import AdaptctlError
from adaptctl.files import hashed, read_toml, replacing
from adaptctl.identifiability import ReducedModel
from adaptctl.simulation import Plant, simulate_many
from adaptctl.simulation.effects import PlantEffects
from adaptctl.simulation.integrator import integration
from adaptctl.simulation.transmission import Transmission
from adaptctl.tuning import tune, with_friction
from adaptctl.tuning.verification import base_model
from benchmarks.law_conditions import CONDITIONS, PlantCondition, Scene

WINDOWS = {"mrad_at_2_s": (1.5, 2.5), "mrad_at_10_s": (10.0, 11.0), "mrad": (18.0, 20.0)}
"""Columns of RMS errors over all joints, and their times in s."""
DURATION, RECORDED = 20.0, 10
DIVERGED = 2.0
"""rad (m) beyond which a run has failed"""

Law = Callable[[Scene, ReducedModel, Array], Controller[Any]]
"""Function from a scene, a model with friction parameters and the plant's true parameters (P,) to a law."""


class LawComparison(msgspec.Struct, forbid_unknown_fields=True):
    """Laws, arms, conditions and seeds. An arm is a built-in name or a file, which {example-robot-data} may begin."""

    purpose: str
    arms: list[str]
    laws: list[str]
    conditions: list[str]
    seeds: list[int]


def _true(scene: Scene, model: ReducedModel, parameters: Array) -> Controller[Any]:
    return replace(scene.tuning.controller(model, adaptation=False), initial=model.regrouping @ parameters)


def _pd(scene: Scene, model: ReducedModel, parameters: Array) -> Controller[Any]:
    gains = scene.tuning.gains
    return PDGravity(scene.mechanism, gains.bandwidth * gains.damping, gains.damping, parameters)


LAWS: dict[str, Law] = {
    "true": _true,
    "learning": lambda scene, model, parameters: scene.tuning.controller(model, anyway=True),
    "gradient": lambda scene, model, parameters: scene.tuning.controller(model, "gradient", anyway=True),
    "pd-gravity": _pd,
}
"""Laws by name; `path.py:function` names another."""


def law_of(name: str) -> Law:
    """Law of this name."""
    path, _, function = name.rpartition(":")
    if not path:
        return LAWS[name]
    spec = importlib.util.spec_from_file_location(Path(path).stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    found: Law = getattr(module, function)
    return found


@cache
def scene_of(arm: str, control_period: float) -> tuple[Scene, ReducedModel]:
    """Arm with friction parameters, its tuning, and its base parameters."""
    inside = arm.removeprefix("{example-robot-data}/")
    packaged = (one for one in files("example-robot-data") or () if str(one).endswith(inside))
    mechanism = with_friction(adaptctl.load(arm if inside == arm else str(next(packaged).locate())))
    return Scene(mechanism, tune(mechanism, control_period=control_period)), base_model(mechanism)


@dataclass(frozen=True)
class ComparisonShard:
    """Rows of one arm under one condition."""

    arm: str
    condition: str
    laws: tuple[str, ...]
    seeds: tuple[int, ...]

    @property
    def name(self) -> str:
        """Name of its file, which tells all of its content."""
        return f"{Path(self.arm).stem}.{self.condition}.{hashed([self.arm, self.laws, self.seeds])[:8]}.parquet"

    def rows(self) -> Iterator[dict[str, Any]]:
        """Rows by law and seed; a law that fails has its reason."""
        condition = CONDITIONS[self.condition]
        scene, model = scene_of(self.arm, condition.control_period)
        for law in self.laws:
            about = {"arm": Path(self.arm).stem, "k": len(model.names), "condition": self.condition, "law": law}
            for seed in self.seeds:
                row = {**about, "seed": seed, "reason": "", **dict.fromkeys((*WINDOWS, "largest"), float("inf"))}
                try:
                    yield row | _measured(scene, model, condition, law, seed)
                except AdaptctlError as error:
                    yield row | {"reason": str(error).splitlines()[0]}


def _measured(scene: Scene, model: ReducedModel, condition: PlantCondition, law: str, seed: int) -> dict[str, Any]:
    tuning, parameters = scene.tuning, condition.parameters(scene, seed)
    runs = simulate_many(
        _plant(scene, condition), law_of(law)(scene, model, parameters), tuning.reference, duration=DURATION,
        p=tuning.reference(0.0).p + tuning.initial_error, parameters=parameters, seed=seed, batch_size=1,
        record_every=RECORDED, divergence_bound=DIVERGED,
    )  # fmt: skip
    if np.isfinite(runs.diverged_at[0]):
        return {"reason": f"exceeds {DIVERGED:g} rad at {runs.diverged_at[0]:.2f} s"}
    squares, time = np.mean(runs.error[:, 0] ** 2, axis=-1), runs.time
    means = {name: squares[(time >= first) & (time < last)].mean() for name, (first, last) in WINDOWS.items()}
    found = {name: 1e3 * float(np.sqrt(mean)) for name, mean in means.items()}
    return {**found, "largest": 1e3 * float(runs.largest_error.max())}


def _plant(scene: Scene, condition: PlantCondition) -> Plant:
    (arm, tuning), effects = scene, condition.effects(scene)
    found = PlantEffects.of(effects)
    springs = None if found.elastic is None else Transmission.of(arm, found.elastic)
    steps = integration(_rubbing(arm, condition, scene), found.joints, tuning.control_period, None, springs)
    return Plant(arm, tuning.control_period, *steps, torque_limits=tuning.torque_limits, effects=effects)


def _rubbing(arm: Mechanism, condition: PlantCondition, scene: Scene) -> Mechanism:
    """Arm with the friction that it has under a condition."""
    values = dict(zip(arm.parameter_names, condition.parameters(scene, 0), strict=True))

    def drive(link: Link) -> Drive:
        named = {kind: values.get(f"{link.joint.name}.{kind}") for kind in ("viscous", "coulomb")}
        return replace(link.joint.drive, **{kind: x for kind, x in named.items() if x is not None})

    return arm.with_drives([drive(link) for link in arm.links])


def run_shard(shard: ComparisonShard, out: Path) -> str:
    """Write the rows of a shard, unless they are there."""
    place = out / shard.name
    if not place.exists():
        warnings.simplefilter("ignore")
        with replacing(place) as beside:
            pq.write_table(pa.Table.from_pylist(list(shard.rows())), beside)
    return shard.name


def table(rows: pa.Table) -> str:
    """
    Table by condition: medians over arms and seeds, and in brackets the worst.

    Ratios are of runs in which both laws went on to the end; failures are counted as learning/true/gradient.
    """
    lines = ["| condition | true, mrad | learning, mrad | over true | over gradient | over PD with gravity | failed |"]
    lines.append("|---|---|---|---|---|---|---|")
    of: dict[str, dict[str, dict[tuple[str, int], float]]] = {}
    for row in rows.to_pylist():
        of.setdefault(row["condition"], {}).setdefault(row["law"], {})[row["arm"], row["seed"]] = row["mrad"]
    for condition, laws in of.items():
        middle = [_median(x for x in laws[name].values() if np.isfinite(x)) for name in ("true", "learning")]
        told = [_ratios(laws["learning"], laws[other]) for other in ("true", "gradient", "pd-gravity")]
        failed = "/".join(str(sum(not np.isfinite(x) for x in laws[name].values())) for name in FAILING)
        lines.append(f"| {condition} | {middle[0]:.3g} | {middle[1]:.3g} | {' | '.join(told)} | {failed} |")
    return "\n".join(lines)


FAILING = ("learning", "true", "gradient")
"""Laws whose failures are counted."""


def _ratios(own: dict[Any, float], other: dict[Any, float]) -> str:
    both = [own[key] / other[key] for key in own if np.isfinite([own[key], other[key]]).all()]
    return f"{_median(both):.2g} ({max(both):.2g})" if both else "-"


def _median(values: Iterable[float]) -> float:
    found = list(values)
    return float(np.median(found)) if found else float("nan")


def main() -> int:
    """Run what is missing and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    asked = read_toml(given.file, LawComparison)
    given.out.mkdir(parents=True, exist_ok=True)
    laws, seeds = tuple(asked.laws), tuple(asked.seeds)
    shards = [ComparisonShard(arm, condition, laws, seeds) for arm in asked.arms for condition in asked.conditions]
    with ProcessPoolExecutor(given.workers) as workers:
        for name in workers.map(partial(run_shard, out=given.out), shards):
            print(name, file=sys.stderr, flush=True)
    whole = pa.concat_tables([pq.read_table(given.out / shard.name) for shard in shards])
    pq.write_table(whole, given.out / "comparison.parquet")
    print(table(whole))
    return 0


if __name__ == "__main__":
    sys.exit(main())
