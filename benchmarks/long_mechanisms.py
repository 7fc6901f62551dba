"""Times of the first and of a later step of long chains, in native code.

    python -m benchmarks.long_mechanisms [--publish]

Each number of links is a fresh process with an empty cache: the plant's first step, a later one, and the same of a tick
of Slotine and Li's law on all parameters; of the processor's time. With `--publish` they are kept in
long_mechanisms.json, and docs/compilation.md shows them.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from adaptctl.control import ReferencePoint, SlotineLi
from adaptctl.dynamics import Mechanism

NUMBERS = Path(__file__).with_name("long_mechanisms.json")
PUBLISH = "python -m benchmarks.long_mechanisms --publish"
LINKS = (8, 16, 20, 32, 48)
ROUNDS, STEPS = 20, 20
"""Of steps whose times are compared, and steps in a round."""


def law(arm: Mechanism) -> SlotineLi:
    """Slotine and Li's law on all parameters of a chain."""
    import numpy as np

    from adaptctl.identifiability import ReducedModel

    model = ReducedModel.full(arm)
    return SlotineLi(model, 2.0, np.full(arm.dof, 1.0), np.full(len(model.columns), 1e-3))


def row(links: int) -> dict[str, float]:
    """Seconds of the processor's time in this process, and the operations of a tick."""
    import numpy as np

    from adaptctl.simulation import Plant
    from benchmarks.offline import chain

    arm, still = chain(links), np.zeros(links)
    plant, controller = Plant(arm, 1e-3), law(arm)
    standing, state = plant.init(still, still), controller.init(still, still)
    goal = ReferencePoint(still, still, still)
    first_step, step = timed(lambda: plant.step(standing, still))
    first_tick, tick = timed(lambda: controller.step(state, still, still, goal))
    times = {"first_step": first_step, "step": step, "first_tick": first_tick, "tick": tick}
    return {"links": links, "flops": flops(controller), **times}


def flops(controller: SlotineLi) -> int:
    """Floating-point operations of a tick."""
    assert controller.kernel is not None
    return controller.kernel.operations.flops


def timed(call: Callable[[], object]) -> tuple[float, float]:
    """Seconds of the first call, and of a later one: the least of several rounds."""
    begin = time.process_time()
    call()
    first, later = time.process_time() - begin, []
    for _ in range(ROUNDS):
        begin = time.process_time()
        for _ in range(STEPS):
            call()
        later.append((time.process_time() - begin) / STEPS)
    return first, min(later)


def fresh(links: int) -> dict[str, float]:
    """The row of another process."""
    import subprocess

    environment = os.environ | {"ADAPTCTL_CACHE": "off", "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-W", "ignore", "-m", "benchmarks.long_mechanisms", "--row", str(links)]
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    found: dict[str, float] = json.loads(done.stdout)
    return found


def shown(kept: dict[str, Any]) -> str:
    """Text of a page on the times that were kept, in Markdown."""
    from benchmarks.published import table

    head = (
        "links", "first step of a plant (RK4)", "each",
        "first tick of Slotine and Li's law on all parameters", "each", "operations of a tick",
    )  # fmt: skip
    rows = [
        (
            f"{one['links']}", f"{one['first_step']:.1f} s", f"{1e6 * one['step']:.2g} µs",
            f"{one['first_tick']:.1f} s", f"{1e6 * one['tick']:.2g} µs", f"{one['flops']:,}",
        )
        for one in kept["rows"]
    ]  # fmt: skip
    where = f"Measured by `{PUBLISH}` on chains of equal links, in time of the processor, with an empty cache,"
    return f"{where} on {kept['machine']}, under a load of {kept['load']}.\n\n{table(head, rows)}"


def publish(rows: list[dict[str, float]]) -> None:
    """Keep the times, and put their table into the page."""
    from benchmarks.machine import Machine
    from benchmarks.published import inserted

    about = {
        "schema": "adaptctl/long-mechanisms/1",
        "machine": str(Machine.here()),
        "load": round(os.getloadavg()[0], 1),
    }
    kept = {**about, "rows": rows}
    NUMBERS.write_text(json.dumps(kept, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    page = NUMBERS.parent.parent / "docs" / "compilation.md"
    page.write_text(inserted(page.read_text(encoding="utf-8"), shown(kept), PUBLISH), encoding="utf-8")


def main() -> None:
    if sys.argv[1:2] == ["--row"]:
        print(json.dumps(row(int(sys.argv[2]))))
        return
    rows = [fresh(links) for links in LINKS]
    if "--publish" in sys.argv:
        publish(rows)
    print(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
