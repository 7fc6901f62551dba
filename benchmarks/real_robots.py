"""Every URDF file of the example-robot-data wheel: rank, gap and seconds. Run: python benchmarks/real_robots.py"""

from __future__ import annotations

import sys
import time
import warnings
from importlib.metadata import files
from pathlib import Path

from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import AdaptctlError
from adaptctl.identifiability import essential_space

SLOWEST = 10.0
"""s that any file may take"""


def robots() -> list[Path]:
    """The wheel's URDF files, by name."""
    found = [Path(str(f.locate())) for f in files("example-robot-data") or () if f.suffix == ".urdf"]
    return sorted(found, key=lambda path: path.name)


def measured(path: Path, floating: bool) -> tuple[float, str]:
    """Seconds from file to certificate, and a line about it."""
    begin = time.perf_counter()
    try:
        mechanism = load(path, floating_base=floating)
        text = _certified(mechanism)
    except AdaptctlError as error:
        text = f"{type(error).__name__}: {str(error).split(': ', 1)[-1][:150]}"
    return time.perf_counter() - begin, text


def _certified(mechanism: Mechanism) -> str:
    found = essential_space(mechanism).certificate
    near = found.near_right_angles
    remark = f"; {len(near)} near-right angles, {near[0]}" if near else ""
    size = f"{len(mechanism.links):3d} links {mechanism.dof:3d} joints"
    return f"{size}  rank {found.rank:4d}  gap {found.gap:.1e}  smallest {found.relative_smallest:.1e}{remark}"


def main(floating: bool) -> int:
    """Print a line per file; 1 when one is too slow."""
    worst = 0.0
    for path in robots():
        seconds, text = measured(path, floating)
        worst = max(worst, seconds)
        print(f"{path.parent.parent.name + '/' + path.name:55s} {seconds:6.2f} s  {text}", flush=True)
    print(f"slowest: {worst:.2f} s")
    return int(worst > SLOWEST)


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    sys.exit(main("--floating" in sys.argv[1:]))
