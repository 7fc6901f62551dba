"""Summary of the replication as JSON: every printed entry beside the computed one, with its verdict."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from adaptctl.experiments.replication.result import Replication
from adaptctl.experiments.replication.verdict import Check, Claim, Item, Outturn
from adaptctl.files import write_json

SCHEMA = "adaptctl/replication/1"


def write_summary(path: str | Path, replication: Replication) -> None:
    """Write the summary of a `replication` of Sheu and Walker (1991) as a JSON file at `path`, whole or not at all:
    every printed entry beside the computed one, with its verdict. Nothing is returned. Raises `FileError` where the
    file cannot be written, and for a number that is NaN or infinite."""
    write_json(path, summary(replication))


def summary(replication: Replication) -> dict[str, Any]:
    """Summary of a `replication` of Sheu and Walker (1991), a dict in JSON's types: "schema", "complete", "experiment",
    "seed", "seeds" (how many), "seconds" taken and "settings"; counts by verdict of printed "numbers", of "marks"
    (crosses and blanks) and of items, "items_by_verdict"; the names of items in "errata" and "not_reproduced"; and
    "items" (tables, figures, sections) by name, each with "title", "verdict", "summary", "chosen", "claims",
    "evidence", "relations" and "checks"."""
    items = replication.items
    return {
        "schema": SCHEMA,
        "complete": replication.complete,
        "experiment": replication.experiment,
        "seed": replication.study.seed,
        "seeds": replication.study.seeds,
        "seconds": replication.seconds,
        "numbers": asdict(replication.numbers),
        "marks": asdict(replication.marks),
        "items_by_verdict": {v.value: sum(item.verdict is v for item in items) for v in Outturn},
        "errata": list(replication.errata),
        "not_reproduced": list(replication.not_reproduced),
        "items": {item.name: _item(item) for item in items},
        "settings": {setting.name: setting.value for setting in replication.settings},
    }


def _item(item: Item) -> dict[str, Any]:
    return {
        "title": item.title,
        "verdict": item.verdict.value,
        "summary": item.summary,
        "chosen": list(item.chosen),
        "claims": [_claim(claim) for claim in item.claims],
        "evidence": [{"sentence": one.sentence, "values": list(one.values)} for one in item.evidence],
        "relations": {one.heading: list(one.lines) for one in item.relations},
        "checks": [_check(check) for check in item.checks],
    }


def _claim(claim: Claim) -> dict[str, Any]:
    return {
        "section": claim.saying.where,
        "quote": claim.saying.quote,
        "measured": claim.measured,
        "found": claim.found,
        "verdict": claim.verdict.value,
        "share_of_seeds": claim.share,
    }


def _check(check: Check) -> dict[str, Any]:
    return asdict(check) | {"verdict": check.verdict.value}
