"""Processor time of sweeps of PUMA runs, beside the same runs one by one.

    python -m benchmarks.sweeps [--single] [1000 10000 100000]

Runs of 10 s with learning, Runge-Kutta's method, and a bandwidth, a rate and a payload of their own, on two local
workers. The peers are a loop through Gymnasium, and a loop of a few lines over the experiment on Dask; they do a few of
the runs, and what all would take is extrapolated. Seconds are the processor's, those of all processes.
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from adaptctl.compilation.lanes import Precision
from adaptctl.experiments.puma560_adaptive import Puma560Adaptive
from adaptctl.simulation import rollout
from adaptctl.sweeps.cluster import Cluster, sweep
from adaptctl.sweeps.folder import Folder
from adaptctl.sweeps.rows import Row, rows_of
from adaptctl.sweeps.study import SweepStudy

CONTROLLER = "adaptive"
FEW = 4
"""Runs that a peer does."""
WORKERS = 2


def study(runs: int, precision: Precision = "double") -> SweepStudy:
    """The study of so many runs, drawn evenly, in a precision."""
    ranges = {"bandwidth": "4..10", "gain_scale": "0.2..1.5", "payload": "0..3", "duration": "10"}
    options: dict[str, Any] = {
        "controllers": (CONTROLLER,),
        "sampling": "latin-hypercube",
        "samples": runs,
        "precision": precision,
    }
    return SweepStudy.named("puma560-adaptive", ranges, **options)


def swept(runs: int, precision: Precision) -> list[Row]:
    """The rows by `adaptctl sweep`."""
    with tempfile.TemporaryDirectory() as out:
        folder = Folder.opened(Path(out) / "sweep", study(runs, precision), 256, [])
        return list(sweep(folder, Cluster(jobs=WORKERS)).to_pylist())


def through_gymnasium(settings: Mapping[str, Any]) -> float:
    """The error (rad, root mean square) of a run whose control periods go through Gymnasium one by one."""
    experiment = Puma560Adaptive(**settings)
    mechanism = experiment.mechanism()
    (one,) = (x for x in experiment.contenders(mechanism, _basis(mechanism)) if x.name == CONTROLLER)
    found = rollout(experiment.environment(mechanism), one.controller, seed=experiment.seed, options=experiment.options)
    return float((found.error**2).mean() ** 0.5)


def by_experiment(settings: Mapping[str, Any]) -> float:
    """The error (rad, root mean square) of a run as the experiment compares it."""
    runs = Puma560Adaptive(**settings).compare(lambda what, share: None).runs
    return float(next(run for run in runs if run.name == CONTROLLER).rms_error())


def by_hand(runs: int) -> list[float]:
    """Errors (rad) by a loop that a user of Dask would write over the experiment."""
    with Cluster(jobs=WORKERS).client() as client:
        return list(client.gather(client.map(by_experiment, list(study(runs).runs()), pure=False)))


def _basis(mechanism: Any) -> Any:
    from adaptctl.sweeps.rows import offline

    return offline(mechanism)


@contextmanager
def processor(report: Callable[[float, float], object]) -> Iterator[None]:
    """Tell the processor's seconds of what is done, in this process and its children, and those on the clock."""
    before, started = _spent(), time.perf_counter()
    yield
    report(_spent() - before, time.perf_counter() - started)


def _spent() -> float:
    own = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(each.ru_utime + each.ru_stime for each in own)


def _largest() -> float:
    """MB of the largest process so far."""
    return max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)) / 1024


def main(counts: list[int], precision: Precision) -> int:
    """Print a line for each number of runs and for each peer; 1 where they disagree."""
    warnings.simplefilter("ignore")
    some = list(study(FEW).runs())
    rows = rows_of("puma560-adaptive", some, (CONTROLLER,))
    expected = [row["rms_error"] for row in rows]

    def line(what: str, runs: int) -> Callable[[float, float], None]:
        return lambda spent, clock: print(
            f"{what}: {runs:,} runs, {spent:.1f} s of the processor, {clock:.1f} s on the clock, "
            f"{1e3 * spent / runs:.2f} ms a run; 100,000 would take {1e5 * spent / runs:,.0f} s; "
            f"largest process {_largest():.0f} MB",
            flush=True,
        )

    for count in counts:
        with processor(line(f"adaptctl sweep, {precision}", count)):
            done = swept(count, precision)
        print(f"    rows: {len(done)}, of which {sum(row['status'] == 'done' for row in done)} done", flush=True)
    with processor(line("one by one through Gymnasium", FEW)):
        alone = [through_gymnasium(one) for one in some]
    with processor(line("a loop by hand on Dask", FEW)):
        hand = by_hand(FEW)
    apart = max(abs(a - b) for peer in (alone, hand) for a, b in zip(peer, expected, strict=True))
    print(f"errors of the same runs agree within {apart:.1e} rad")
    return int(not apart < 1e-6)


if __name__ == "__main__":
    given = [x for x in sys.argv[1:] if x != "--single"]
    sys.exit(main([int(x) for x in given] or [1000], "single" if len(given) < len(sys.argv) - 1 else "double"))
