"""Time of a fresh process to the first tick of an adaptive controller for the PUMA.

    python -m benchmarks.start_up [REPETITIONS] [--publish]

The tick is compiled then and there (cold), or an earlier process has left it in the cache. Each time is the median over
processes that take turns; the processor's time is what a machine with nothing else to do would take. OpenBLAS, which
NumPy brings, has one thread: the others would only wait here, but in a loop, which counts as the processor's time.
With `--publish` they are kept in start_up.json, and docs/compilation.md shows them.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeAlias

NUMBERS = Path(__file__).with_name("start_up.json")
PUBLISH = "python -m benchmarks.start_up --publish"
Split: TypeAlias = dict[str, tuple[float, float]]
"""Seconds of each stage: on the clock, and of the processor."""


def stages() -> Iterator[str]:
    """The lines of a user's script; the name of each stage is yielded when it is done."""
    import numpy as np

    yield "import numpy"
    import adaptctl

    arm = adaptctl.load("puma560")
    yield "load"
    basis = adaptctl.fundamental_basis(adaptctl.essential_space(arm))
    yield "essential space, basis"
    model = adaptctl.ReducedModel(arm, basis)
    learn = adaptctl.adaptation_gain(model)
    controller = adaptctl.SlotineLi(model, 8.0, [90.0, 150.0, 70.0, 20.0, 16.0, 18.0], learn)
    yield "controller"
    reference = adaptctl.MinimumJerk([[0.0] * 6, [0.5] * 6], [0.0, 1.0])
    p, v = np.zeros(6), np.zeros(6)
    state = controller.init(p, v)
    yield "init"
    controller.step(state, p, v, reference(0.0))
    yield "first tick"


def split() -> Split:
    """The stages of this process."""
    found: Split = {"Python itself": (0.0, time.process_time())}
    clock, processor = time.perf_counter(), time.process_time()
    for stage in stages():
        now = time.perf_counter(), time.process_time()
        found[stage] = now[0] - clock, now[1] - processor
        clock, processor = time.perf_counter(), time.process_time()
    return found


def fresh(cache: Path, bytecode: Path) -> Split:
    """The stages of another process, which finds the library's bytecode, as an installed one does."""
    import subprocess  # here, since what is measured should not pay for it

    folders = {"ADAPTCTL_CACHE": str(cache), "PYTHONPYCACHEPREFIX": str(bytecode)}
    environment = os.environ | folders | {"OPENBLAS_NUM_THREADS": "1"}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    command = [sys.executable, "-W", "ignore", __file__, "--split"]
    start = time.perf_counter()
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE) as process:
        line, whole = process.stdout.readline(), time.perf_counter() - start
    found: dict[str, list[float]] = json.loads(line)
    found["Python itself"][0] = whole - sum(clock for clock, _ in found.values())
    return {**found, "together": (whole, sum(processor for _, processor in found.values()))}


def median(splits: list[Split]) -> Split:
    import statistics

    return {
        stage: tuple(statistics.median(each) for each in zip(*(split[stage] for split in splits), strict=True))
        for stage in splits[0]
    }


def measured(repetitions: int) -> tuple[Split, Split]:
    """Cold and cached."""
    import tempfile

    cold, cached = [], []
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        fresh(place / "warm", place / "bytecode")
        for k in range(repetitions):
            cold.append(fresh(place / str(k), place / "bytecode"))
            cached.append(fresh(place / str(k), place / "bytecode"))
    return median(cold), median(cached)


def shown(kept: dict[str, Any]) -> str:
    """Text of a page on the times that were kept, in Markdown: the processor's, in milliseconds."""
    cold, cached = kept["cold"], kept["cached"]
    rows = [f"| {stage} | {1e3 * cold[stage][1]:.0f} | {1e3 * cached[stage][1]:.0f} |" for stage in cold]
    head = ["| ms of the processor | cold | cached |", "|---|---|---|"]
    where = f"Measured by `{PUBLISH}` on {kept['machine']}, under a load of {kept['load']}."
    return f"{where}\n\n" + "\n".join((*head, *rows)) + "\n"


def publish(cold: Split, cached: Split) -> None:
    """Keep the times, and put their table into the page."""
    from benchmarks.machine import Machine
    from benchmarks.published import inserted

    about = {"schema": "adaptctl/start-up/1", "machine": str(Machine.here()), "load": round(os.getloadavg()[0], 1)}
    kept = {**about, "cold": cold, "cached": cached}
    NUMBERS.write_text(json.dumps(kept, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    page = NUMBERS.parent.parent / "docs" / "compilation.md"
    page.write_text(inserted(page.read_text(encoding="utf-8"), shown(json.loads(json.dumps(kept))), PUBLISH), "utf-8")


def main() -> None:
    if sys.argv[1:] == ["--split"]:
        print(json.dumps(split()))
        return
    asked = [int(word) for word in sys.argv[1:] if word != "--publish"]
    cold, cached = measured(*asked or [7])
    if "--publish" in sys.argv:
        publish(cold, cached)
    print(f"{'ms':24}{'cold':>8}{'(processor)':>13}{'cached':>10}{'(processor)':>13}")
    for stage in cold:
        times = [1e3 * seconds for seconds in (*cold[stage], *cached[stage])]
        print(f"{stage:24}{times[0]:8.0f}{times[1]:13.0f}{times[2]:10.0f}{times[3]:13.0f}")


if __name__ == "__main__":
    main()
