"""What the project computes and says, kept in tests/golden: `make golden` compares it with what is so now.

    python tests/golden/capture.py [--update] [PART ...]

Parts: robots (ranks, certificates, bases), exports (hashes of exported C), names (what packages offer), help (of all
commands), settings (defaults and bounds of all experiments), rules (gains and references of arms), runs (short ones),
pictures (what figures and recordings show), experiments (numbers in their summaries), or `experiments/NAME` for one.
`--update` writes the files anew.
"""

from __future__ import annotations

import argparse
import contextlib
import difflib
import hashlib
import io
import json
import math
import os
import re
import shlex
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from importlib.metadata import files
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
PARTS = ("names", "help", "settings", "robots", "exports", "rules", "runs", "pictures", "experiments")

SAME_EVERYWHERE: Mapping[str, str] = {
    "ADAPTCTL_PROCESSOR": "sse2",
    "OPENBLAS_CORETYPE": "Prescott",
    "OPENBLAS_NUM_THREADS": "1",
    "COLUMNS": "100",
    "NO_COLOR": "1",
    "TERM": "dumb",
    "ADAPTCTL_PROGRESS": "off",
}
"""Before NumPy is imported: with these, numbers differ less between processors."""

RELATIVE, ABSOLUTE = 1e-6, 1e-9
"""How far numbers may be off."""
LOOSE: Mapping[str, float] = {
    r"^svg ": 1e-4,  # which has one decimal place
    r"\.gap$": 0.15,  # the logarithm of a ratio to what is beyond the rank, which is round-off
    r"\.(gain|achieved|learning|exciting)\.|\.damping$": 1e-3,  # where a search of steps ends
    r"\.counterweights\.(weights\.\d+\.place|after)|runs\.\w+-after\.": 1e-3,  # where an optimisation ends
}
"""Relative tolerances of what differs by more between processors, by patterns of names."""
LEFT_OUT = re.compile(
    r"wall_time|realtime_factor|tick\.called|tick\.native|tick_floats|^seconds$|robot_sha256|^settings"  # times; words
    r"|^builds"  # by the compilers that are here
    r"|^links\.0\.cheapest\.place"  # masses on an upright first axis cost nothing, wherever they are
)
"""Names of what is not kept of an experiment's summary."""


def compared(kept: Any, now: Any, name: str = "") -> Iterator[str]:
    """Lines that say where two values of JSON differ; numbers within the tolerances, also those inside texts."""
    if isinstance(kept, dict) and isinstance(now, dict):
        for key in [*kept, *(key for key in now if key not in kept)]:
            yield from compared(kept.get(key, "nothing"), now.get(key, "nothing"), f"{name}.{key}" if name else key)
    elif isinstance(now, list) and now and all(isinstance(one, str) for one in now):
        before = kept if isinstance(kept, list) else []
        lines = difflib.unified_diff(before, now, lineterm="", n=0)
        yield from (f"{name}: {line}" for line in lines if not line.startswith(("---", "+++", "@@")))
    elif isinstance(kept, list) and isinstance(now, list) and len(kept) == len(now):
        for k, (one, other) in enumerate(zip(kept, now, strict=True)):
            yield from compared(one, other, f"{name}[{k}]")
    elif not alike(kept, now, next((wide for what, wide in LOOSE.items() if re.search(what, name)), RELATIVE)):
        yield f"{name}: {shown(kept)} -> {shown(now)}"


def alike(kept: Any, now: Any, relative: float) -> bool:
    """Whether two numbers, or two texts word by word, are the same within a tolerance."""
    if isinstance(kept, str) and isinstance(now, str):
        one, other = kept.split(), now.split()
        pairs = [(number(a), number(b)) for a, b in zip(one, other, strict=False) if a != b]
        same = all(a is not None and alike(a, b, relative) for a, b in pairs)  # words are not numbers
        return len(one) == len(other) and same
    if {type(kept), type(now)} in ({float}, {int, float}):
        return bool(abs(kept - now) <= relative * max(abs(kept), abs(now)) + ABSOLUTE)
    return type(kept) is type(now) and bool(kept == now)


def number(text: str) -> float | None:
    with contextlib.suppress(ValueError):
        return float(text)
    return None


def shown(value: Any) -> str:
    text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
    return text if len(text) < 400 else f"{text[:400]} ..."


# Robots: ranks, certificates and bases


def robots() -> dict[str, Any]:
    """Of all built-ins and of files that others wrote."""
    return {name: robot(source, **how) for name, (source, how) in sources().items()}


def sources() -> dict[str, tuple[str | Path, Mapping[str, bool]]]:
    """Robots by the names that they are kept under, and how each is loaded."""
    from adaptctl.description import builtin_names

    own = sorted(HERE.glob("files/*"))
    wheel = {
        path.name: Path(str(path.locate())) for path in files("example-robot-data") or () if path.suffix == ".urdf"
    }
    return {
        **{name: (name, {}) for name in builtin_names()},
        **{path.name: (path, FLOATING if "floating" in path.name else {}) for path in own},
        **{name: (wheel[name.split()[0]], how) for name, how in FOREIGN.items()},
    }


FLOATING = {"floating_base": True}
FOREIGN: Mapping[str, Mapping[str, bool]] = {
    "ur5_robot.urdf": {},
    "kinova.urdf": {},
    "z1.urdf": {},
    "xarm7.urdf": {},
    "panda.urdf": {},
    "pr2.urdf": {},
    "tiago.urdf": {},
    "double_pendulum.urdf": {},
    "double_pendulum.urdf floating": FLOATING,
    "a1.urdf floating": FLOATING,
    "solo12.urdf floating": FLOATING,
    "iris.urdf floating": FLOATING,
    "quadrotor_base.urdf floating": FLOATING,
    "talos_reduced.urdf floating": FLOATING,
    "simple_humanoid.urdf": {},
}
"""Robots of the example-robot-data wheel that the tests load."""


def robot(source: str | Path, **how: bool) -> dict[str, Any]:
    """Rank, certificate, and basis with its regrouping, to nine digits; or why there is none."""
    import numpy as np

    from adaptctl import essential_space, fundamental_basis, load
    from adaptctl.errors import AdaptctlError

    try:
        mechanism = load(source, **how)
        prove = len(mechanism.parameter_names) <= 150
        space = essential_space(mechanism, prove=prove)
        basis = fundamental_basis(space, prove=prove)
    except AdaptctlError as error:
        return {"refused": re.sub(r"(?<=[\s:(])/\S+/", "", f"{type(error).__name__}: {error}".replace(f"{ROOT}/", ""))}
    names, proof = space.parameter_names, space.certificate
    rows = {
        kept: " ".join(f"{row[j]:.9g} {names[j]}" for j in np.flatnonzero(np.abs(row) > 1e-11))
        for kept, row in zip(basis.names, basis.regrouping, strict=True)
    }
    return {
        "dof": mechanism.dof,
        "parameters": len(names),
        "rank": space.rank,
        "certificate": {
            "ranks": [proof.rank_energy, proof.rank_doubled],
            "by torques": proof.rank_torque,
            "by geometry": proof.rank_geometry,
            "exactly": proof.rank_exact,
            "exactly by": proof.proof_method,
            "gap": round(math.log10(proof.gap), 1),
            "relative_smallest": float(f"{proof.relative_smallest:.4g}"),
            "samples": proof.samples,
            "faults": list(proof.failures),
            "leftovers": len(proof.residual_singular_values),
        },
        "columns": " ".join(map(str, basis.columns)),
        "basis": rows,
    }


# Exported C


def exports() -> dict[str, Any]:
    """Hashes of each file of every law on two arms, and of laws on reduced models without their numbers, which are
    LAPACK's to the last digit and so may be the processor's."""
    from every_law import REDUCED, law_named

    found = {f"{arm}: {name}": exported(law) for arm, laws in arms().items() for name, law in laws.items()}
    found |= {f"reduced, without numbers: {name}": exported(law_named(name), numbers=False) for name in REDUCED}
    return found | {"three: gradient, float": exported(arms()["three"]["gradient"], scalar="float")}


@cache
def arms() -> dict[str, dict[str, Any]]:
    """Every law on arms of three and of two joints, which have the same digits everywhere."""
    from every_law import laws_on

    from adaptctl import ReducedModel, load

    three, two = (ReducedModel.full(load(HERE / "files" / f"{name}.toml")) for name in ("arm_of_three", "arm_of_two"))
    return {"three": laws_on(three, two), "two": laws_on(two, two)}


WORDS = ("README.md", "manifest.json")
"""Not hashed: words, and hashes of the other files."""
NUMBER = re.compile(r"-?\b0x[0-9a-f.]+p[+-]?\d+\b|-?\b\d+\.\d*(?:e[+-]?\d+)?", re.IGNORECASE)


def exported(law: Any, numbers: bool = True, **more: Any) -> dict[str, str]:
    import adaptctl

    with tempfile.TemporaryDirectory() as folder:
        made = adaptctl.export(
            law, Path(folder) / "law", name="law", without_safety_filter=True, large_stack=True, **more
        )
        texts = {path.name: path.read_text() for path in sorted(made.directory.iterdir())}
    if not numbers:
        texts = {name: NUMBER.sub("#", re.sub(r"[0-9a-f]{16,}", "#", text)) for name, text in texts.items()}
    kept = {name: text for name, text in texts.items() if name not in WORDS}
    return {name: hashlib.sha256(text.encode()).hexdigest()[:16] for name, text in kept.items()}


# What packages offer, and what commands say


def names() -> dict[str, Any]:
    """Public names of every package that says in `__all__` what it offers, with parameters and their defaults."""
    from importlib import import_module

    places = sorted(path.parent.relative_to(ROOT) for path in ROOT.glob("adaptctl/**/__init__.py"))
    packages = {".".join(place.parts): import_module(".".join(place.parts)) for place in places}
    return {
        name: {public: parameters_of(getattr(package, public)) for public in package.__all__}
        for name, package in packages.items()
        if hasattr(package, "__all__")
    }


def parameters_of(thing: Any) -> Any:
    """Parameters of a function with their defaults; of a class those of itself and of its public methods."""
    from enum import Enum

    if isinstance(thing, type) and issubclass(thing, Enum):
        return list(thing.__members__)
    if not isinstance(thing, type):
        return parameters(thing)
    methods = {name: parameters(value) for name, value in vars(thing).items() if not name.startswith("_")}
    return {"": parameters(thing)} | {name: told for name, told in methods.items() if "=" in told}


def parameters(thing: Any) -> str:
    """Parameters with their defaults, as text; nothing where Python tells none."""
    import inspect

    def told(default: Any) -> str:
        return getattr(default, "__name__", re.sub(r" at 0x\w+", "", repr(default)))

    try:
        found = inspect.signature(getattr(thing, "__func__", thing)).parameters.values()
    except (TypeError, ValueError):
        return ""
    return ", ".join(one.name if one.default is one.empty else f"{one.name}={told(one.default)}" for one in found)


def settings() -> dict[str, Any]:
    """Default, least and greatest value of each setting of all experiments, null for no bound."""
    from dataclasses import fields

    from adaptctl.experiments import EXPERIMENTS, find
    from adaptctl.files import finite_or_none

    def kept(entry: Any) -> list[Any]:
        return [entry.default, *(finite_or_none(entry.metadata[end]) for end in ("low", "high"))]

    return {one.name: {entry.name: kept(entry) for entry in fields(find(one.name))} for one in EXPERIMENTS}


def helps() -> dict[str, Any]:
    """`--help` of all commands, found by what each one lists."""
    found, waiting = {}, [("adaptctl",)]
    while waiting:
        command = waiting.pop(0)
        lines = found[" ".join(command)] = help_of(*command[1:])
        inside = lines[lines.index(head) :] if (head := next((x for x in lines if " Commands " in x), "")) else []
        told = [re.match(r"│ ([a-z][\w-]*) ", line) for line in inside]
        waiting += [(*command, name[1]) for name in told if name]
        if command[-2:] == ("experiment", "run"):
            waiting += [(*command, name) for name in known()]
    return found


def help_of(*command: str) -> list[str]:
    from adaptctl.cli.main import main

    with contextlib.redirect_stdout(io.StringIO()) as text, contextlib.redirect_stderr(text):
        main([*command, "--help"])
    return [line.rstrip() for line in text.getvalue().replace(str(ROOT), "").splitlines()]


def known() -> list[str]:
    """Names of the experiments."""
    from adaptctl.cli.main import main

    with contextlib.redirect_stdout(io.StringIO()) as text:
        main(["experiment", "list"])
    return [line.split()[0] for line in text.getvalue().splitlines() if line[:1].strip()]


def pictures() -> dict[str, Any]:
    from golden.pictures import pictures

    return pictures()


# Experiments


def experiment(kept: Mapping[str, Any]) -> dict[str, Any]:
    """What the kept command says now: numbers and answers by name, without words, settings and times. They are those of
    the summary in its folder, which stands for `{out}` in the command or is added as `--out`; of a command that prints
    its outcome, those printed with `--json`."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder, "out")
        words = shlex.split(kept["command"].replace("{out}", str(out)))[1:]
        printed = "--json" in words
        more = [] if printed or str(out) in words else ["--out", str(out)]
        run = [sys.executable, "-m", "adaptctl", *words, *more]
        done = subprocess.run(run, capture_output=True, text=True, cwd=ROOT, check=False)
        try:
            found = json.loads(done.stdout if printed else (out / "summary.json").read_text())
        except (OSError, ValueError):
            return {"command": kept["command"], "failed": done.stderr.replace(folder, "").splitlines()[-3:]}
    numbers = {name: value for name, value in flattened(found) if not LEFT_OUT.search(name)}
    return {"command": kept["command"], "numbers": numbers}


def flattened(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict | list):
        for key, part in value.items() if isinstance(value, dict) else enumerate(value):
            yield from flattened(part, f"{name}.{key}" if name else str(key))
    elif not isinstance(value, str) and not (value is None and name.startswith("items.")):
        yield name, value


def parts(asked: list[str]) -> Iterator[tuple[Path, Callable[[], Any]]]:
    """Files, and what says now what they ought to keep."""
    from golden.rules import rules
    from golden.runs import runs

    single = {"names": names, "help": helps, "settings": settings, "robots": robots, "exports": exports}
    single |= {"pictures": pictures, "rules": rules, "runs": runs}
    for part in asked:
        if part in single:
            yield HERE / f"{part}.json", single[part]
        else:
            pattern = "experiments/*" if part == "experiments" else part
            for path in sorted(HERE.glob(f"{pattern}.json")):
                yield path, lambda path=path: experiment(json.loads(path.read_text()))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", default=PARTS)
    parser.add_argument("--update", action="store_true", help="write the files anew")
    given = parser.parse_args()
    os.environ.update(SAME_EVERYWHERE)
    warnings.simplefilter("ignore")
    sys.path[:0] = [str(ROOT), str(ROOT / "tests")]
    different = 0
    for path, captured in parts(list(given.parts)):
        now = json.loads(json.dumps(captured()))
        kept = json.loads(path.read_text()) if path.exists() else {}
        lines = list(compared(kept, now))
        different += len(lines)
        print(f"{path.relative_to(HERE)}: {len(lines) or 'no'} differences", *lines, sep="\n  ", flush=True)
        if given.update and lines:
            path.write_text(json.dumps(now, indent=1, ensure_ascii=False) + "\n")
    return 1 if different and not given.update else 0


if __name__ == "__main__":
    sys.exit(main())
