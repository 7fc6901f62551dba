"""Licences of every locked package, by what it asks: `make licences` prints them."""

from __future__ import annotations

import re
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

LOCK = Path(__file__).parent.parent / "requirements.lock"
COPYLEFT = re.compile(r"[AL]?GPL|General Public|MPL|Mozilla|EUPL", re.IGNORECASE)
UNKNOWN, ABSENT = "unknown", "not installed on this platform"


def locked() -> list[str]:
    """Names of the packages in the lock."""
    return sorted(set(re.findall(r"^([A-Za-z0-9._-]+)==", LOCK.read_text(), re.MULTILINE)))


def licence(name: str) -> str:
    """A package's licence, as its own metadata says."""
    try:
        return _stated(distribution(name))
    except PackageNotFoundError:
        return ABSENT


def _stated(found: Distribution) -> str:
    metadata = found.metadata
    classified = [c.rpartition(" :: ")[2] for c in metadata.get_all("Classifier", ()) if c.startswith("License ::")]
    text = (metadata.get("License") or "").strip().splitlines()
    choices = (metadata.get("License-Expression"), ", ".join(classified), text[0] if text else "")
    return next((choice for choice in choices if choice and choice != "OSI Approved"), UNKNOWN)


def noted() -> dict[str, str]:
    """Packages whose licence asks to share changes, or is not known, and those licences."""
    every = {name: licence(name) for name in locked()}
    return {name: text for name, text in every.items() if text == UNKNOWN or COPYLEFT.search(text)}


def main() -> None:
    """Print all licences, those to be noted first."""
    first = noted()
    for name in [*first, *(name for name in locked() if name not in first)]:
        print(f"{'!' if name in first else ' '} {name:<32} {licence(name)}")


if __name__ == "__main__":
    main()
