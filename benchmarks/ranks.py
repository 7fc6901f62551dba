"""Ranks and kept parameters of random mechanisms against an exact oracle, and peers' rules on the same.

Run: nice python benchmarks/ranks.py [COUNT] [FIRST_SEED]; ten thousand take about half an hour on one core.
"""

from __future__ import annotations

import sys
import time
import warnings
from collections import Counter
from collections.abc import Iterator

import numpy as np

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.errors import AdaptctlError, RankError
from adaptctl.identifiability import EssentialSpace, Priority, essential_space, fundamental_basis
from benchmarks.rank_gears import draw_gears, draw_shafts
from benchmarks.rank_oracle import Case, Fraction, bent, five_bar, independent, tree, twist

MILLIMETRE = Fraction(1, 1000)


def drawn(seed: int) -> Case:
    """A random case by seed: of twenty, four chains, four trees, four trees with joints that follow others, four nearly
    special chains, three closed loops and one nearly special loop; two in five in millimetres or kilometres, and two in
    three of those not nearly special with rotors, on shafts of several joints or of one."""
    rng = np.random.default_rng([seed, 7])
    pick = seed % 20
    if pick < 12:
        case = tree(rng, int(rng.integers(1, 9)), pick >= 4)
    elif pick < 16:
        case = bent(rng, int(rng.integers(2, 7)))
    else:
        case = five_bar(rng, pick == 19)
    case.scale = (Fraction(1), Fraction(1), Fraction(1), MILLIMETRE, 1 / MILLIMETRE)[int(rng.integers(5))]
    turns = [link.turns for link in case.links]
    if 8 <= pick < 12 and len(turns) > 1:
        case.gears = draw_gears(rng, turns, lambda: twist(rng))
    if not case.miss and rng.random() < 2.0 / 3.0:
        case.shafts = draw_shafts(rng, len(turns))
    return case


def judged(seed: int) -> Iterator[str]:
    """Outcomes for one mechanism, in words to be counted."""
    case = drawn(seed)
    H = case.differences(seed)
    rank, mechanism = len(independent(H, range(H.shape[1]))), case.mechanism()
    kind = f"{case.kind}: " if case.miss else "shafts: " if case.shafts else "gears: " if case.gears else "generic: "
    for rule, found in peers(mechanism, seed).items():
        yield f"{kind}{rule} {'right' if found == rank else 'WRONG'}"
    order = np.random.default_rng(seed).permutation(H.shape[1]).tolist() if seed % 2 else None
    plain = mechanism.description.loops is None and not mechanism.description.drive_couplings
    for method in ("svd", "transfers") if plain else ("svd",):
        try:
            space = essential_space(mechanism, method=method, prove=None if seed % 3 else True)  # type: ignore[arg-type]
        except RankError as error:
            yield f"{kind}{method} refused"
            yield f"{kind}{method} refused, of which {reason(error, mechanism, method, rank)}"
            if not case.miss:
                print(f"seed {seed}, {case.kind}, {method} refused: {str(error)[:300]}", flush=True)
            continue
        yield f"{kind}{method} {'right' if space.rank == rank else 'WRONG'}"
        if space.rank != rank:
            print(f"seed {seed}, {case.kind}, {method}: {space.rank}, exactly {rank}, miss {case.miss:.1e}", flush=True)
        yield from kept(space, H, order, f"{kind}{method} basis", seed)


def reason(error: RankError, mechanism: Mechanism, method: str, rank: int) -> str:
    """Reason why a mechanism was refused, and the outcome if its user says that it is meant as it stands."""
    if "as the geometry stands" not in str(error):
        return "uncertain"
    try:
        found = essential_space(mechanism, method=method, as_written=True).rank  # type: ignore[arg-type]
    except RankError:
        return "two ranks are possible; as it is: uncertain"
    return f"two ranks are possible; as it is: {'right' if found == rank else 'WRONG'}"


def kept(space: EssentialSpace, H: Array, order: list[int] | None, what: str, seed: int) -> Iterator[str]:
    """Outcome, in words: the kept parameters are exactly those of the order, or not."""
    names = space.parameter_names
    priority = Priority() if order is None else Priority(tuple(names[i] for i in order))
    indices = priority.indices(names)
    try:
        basis = fundamental_basis(space, priority)
    except RankError as error:
        print(f"seed {seed}: {what} refused: {str(error)[:200]}", flush=True)
        yield f"{what} refused"
        return
    another = set(basis.columns) ^ set(independent(H, indices[::-1]))
    told = bool(basis.kept_despite_priority)
    if told is not bool(another):
        print(f"seed {seed}: {what}: {another}, told {basis.kept_despite_priority}", flush=True)
    outcomes = {(False, False): "exactly the order", (True, True): "named a choice", (True, False): "ANOTHER"}
    yield f"{what} {outcomes.get((bool(another), told), 'NAMED FOR NOTHING')}"


def peers(mechanism: Mechanism, seed: int) -> dict[str, int]:
    """Ranks by the rules of others, on torque regressors at 200 random states within +-pi, as SymPyBotics draws them.

    SymPyBotics counts diagonal entries of R of W = Q R that do not round to zero at ten decimals; NumPy's `matrix_rank`
    counts singular values above round-off of the largest.
    """
    rng = np.random.default_rng(seed)
    if mechanism.description.loops is not None:
        return {}
    W = mechanism.torque_regressor(*rng.uniform(-np.pi, np.pi, (3, 200, mechanism.dof)))
    W = W.reshape(-1, W.shape[-1])
    diagonal = np.diag(np.linalg.qr(W, mode="r"))
    return {"SymPyBotics' rule": int((diagonal.round(10) != 0).sum()), "matrix_rank": int(np.linalg.matrix_rank(W))}


def show(counted: Counter[str]) -> None:
    """A line for everything that happened."""
    for what, times in sorted(counted.items()):
        print(f"{times:6d}  {what}", flush=True)


def main(count: int, first: int) -> int:
    """Print how often what happened; 1 where a rank or a basis was silently wrong."""
    counted: Counter[str] = Counter()
    begin = time.process_time()
    for seed in range(first, first + count):
        try:
            counted.update(judged(seed))
        except AdaptctlError as error:
            print(f"seed {seed}: {type(error).__name__}: {error}", flush=True)
            counted["other errors"] += 1
        if (seed - first) % 500 == 499:
            print(f"after {seed - first + 1}, {time.process_time() - begin:.0f} s:", flush=True)
            show(counted)
    show(counted)
    ours = ("svd WRONG", "transfers WRONG", "ANOTHER", "NOTHING", "other errors")
    return int(any(what.endswith(ours) for what in counted))


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    given = [int(x) for x in sys.argv[1:3]]
    sys.exit(main(*(given + [10_000, 0][len(given) :])))
