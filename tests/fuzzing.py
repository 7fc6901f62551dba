"""Mutants of good files, made by a seed: read and sound, or refused; never a crash, a hang or another error.

``python tests/fuzzing.py 100000 --seed 1`` makes as many as one likes, and prints what became of them as JSON.
"""

from __future__ import annotations

import argparse
import json
import random
import re
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

import numpy as np
from bad_files import CHAIN, CONSTRAINTS, GOOD, PRIORITY

from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import AdaptctlError
from adaptctl.identifiability import (
    Constraints,
    FundamentalBasis,
    Priority,
    ReducedModel,
    constrained,
    essential_space,
    fundamental_basis,
)

NUMBERS = (
    "nan",
    "inf",
    "-1",
    "0",
    "-0",
    "1e300",
    "1e-300",
    "1e200",
    "-1e18",
    "1e9",
    "2.5",
    "1_0",
    "\u0661",
    "9" * 400,
    "",
)
WORDS = ("arm", "first", "link1", "ground", "", "\x1b[2J", "\u202e", "x" * 5000, "${x}", "../../etc/passwd")
LONGEST = 2.0
"""s of processor time a mutant may take"""


class Outcome(Enum):
    """What became of a mutant."""

    READ = "read"
    REFUSED = "refused"
    FAILED = "failed"


@dataclass
class Report:
    """How many mutants were read, refused or failed, the slowest one's time (s), and what failed."""

    counts: Counter[Outcome] = field(default_factory=Counter)
    slowest: float = 0.0
    failures: list[str] = field(default_factory=list)


def mutant(text: str, rng: random.Random) -> bytes:
    """The text with one to three changes: of a number, a word, a line, a stretch, or a byte."""
    for _ in range(rng.randint(1, 3)):
        text = rng.choice(CHANGES)(text, rng)
    data = bytearray(text.encode("utf-8", "surrogatepass"))
    if data and rng.random() < 0.15:
        data[rng.randrange(len(data))] = rng.randrange(256)
    return bytes(data)


def _number(text: str, rng: random.Random) -> str:
    return _replaced(text, r"-?\d+(?:\.\d+)?(?:e-?\d+)?", NUMBERS, rng)


def _word(text: str, rng: random.Random) -> str:
    return _replaced(text, r"[A-Za-z_]\w+", WORDS, rng)


def _replaced(text: str, pattern: str, choices: tuple[str, ...], rng: random.Random) -> str:
    places = list(re.finditer(pattern, text))
    if not places:
        return text
    place = rng.choice(places)
    other = rng.choice(places).group() if rng.random() < 0.3 else rng.choice(choices)
    return text[: place.start()] + other + text[place.end() :]


def _line(text: str, rng: random.Random) -> str:
    lines = text.splitlines(keepends=True) or [""]
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    lines[i : i + 1] = rng.choice(([], [lines[i]] * 2, [lines[j]], [lines[i]] * 300))
    return "".join(lines)


def _stretch(text: str, rng: random.Random) -> str:
    i = rng.randrange(len(text) + 1)
    j = min(len(text), i + rng.randint(1, 60))
    return rng.choice((text[:i] + text[j:], text[:j] + text[i:j] * rng.randint(1, 50) + text[j:]))


def _punctuation(text: str, rng: random.Random) -> str:
    return _replaced(text, r"[<>\"=\[\]{}/.]", ("<", ">", '"', "=", "[", "}", "&#0;", "<!--", "]]>", "\0"), rng)


CHANGES: tuple[Callable[[str, random.Random], str], ...] = (
    _number,
    _number,
    _number,
    _word,
    _line,
    _stretch,
    _punctuation,
)


def fuzz(count: int, seed: int, folder: Path) -> Report:
    """What became of so many mutants."""
    rng, report = random.Random(seed), Report()
    (folder / "two.toml").write_text(CHAIN)
    chain = load(folder / "two.toml")
    fundamental_basis(essential_space(chain)).save(folder / "good.json")
    texts = {**GOOD, ".c.toml": CONSTRAINTS, ".p.toml": PRIORITY, ".json": (folder / "good.json").read_text()}
    for i in range(count):
        kind = rng.choice(tuple(texts))
        path = folder / f"mutant{kind}"
        path.write_bytes(mutant(texts[kind], rng))
        start = time.process_time()
        outcome, why = _outcome(path, kind, chain)
        spent = time.process_time() - start
        if outcome is not Outcome.FAILED and spent > LONGEST:
            outcome, why = Outcome.FAILED, f"{spent:.1f} s"
        report.counts[outcome] += 1
        report.slowest = max(report.slowest, spent)
        if outcome is Outcome.FAILED:
            kept = folder / f"failed-{seed}-{i}{kind}"
            kept.write_bytes(path.read_bytes())
            report.failures.append(f"{kept}: {why}")
    return report


def _outcome(path: Path, kind: str, chain: Mechanism) -> tuple[Outcome, str]:
    try:
        if kind == ".c.toml":
            _validate_sound(constrained(chain, Constraints.read(path)))
        elif kind == ".p.toml":
            Priority.read(path, chain)
        elif kind == ".json":
            ReducedModel(chain, FundamentalBasis.load(path))
        else:
            _validate_sound(load(path))
    except AdaptctlError as error:
        plain = all(c.isprintable() or c == "\n" for c in str(error))
        return (Outcome.REFUSED, "") if plain else (Outcome.FAILED, f"control characters in {str(error)!r}")
    except Exception as error:
        return Outcome.FAILED, f"{type(error).__name__}: {error}"
    return Outcome.READ, ""


def _validate_sound(arm: Mechanism) -> None:
    """Raise ValueError for a mechanism that should have been refused."""
    names = [*arm.parameter_names, *(link.joint.name for link in arm.links), arm.name]
    masses = [v for v, name in zip(arm.inertial_parameters, arm.parameter_names, strict=True) if name.endswith(".m")]
    p, v = arm.neutral_configuration, np.linspace(0.1, 0.3, arm.dof)
    energy, torque = arm.energy_regressor(p, v), arm.inverse_dynamics(p, v, -v)
    for what, sound in (
        ("numbers", np.isfinite(arm.inertial_parameters).all()),
        ("masses", all(mass >= 0.0 for mass in masses)),
        ("axes", all(abs(np.linalg.norm(link.joint.axis) - 1.0) < 1e-12 for link in arm.links)),
        ("energy", np.isfinite(energy).all()),
        ("torque", np.isfinite(torque).all()),
        ("names", all(name.isprintable() and len(name) <= 520 for name in names)),
    ):
        if not sound:
            raise ValueError(f"accepted with wrong {what}")


def main() -> None:
    """Mutate and print the report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    warnings.simplefilter("error", RuntimeWarning)
    folder = Path(tempfile.mkdtemp(prefix="mutants-"))
    start = time.process_time()
    report = fuzz(given.count, given.seed, folder)
    counts = {outcome.value: report.counts[outcome] for outcome in Outcome}
    print(json.dumps({**counts, "slowest": report.slowest, "seconds": time.process_time() - start}, indent=2))
    print("\n".join(report.failures[:50]))


if __name__ == "__main__":
    main()
