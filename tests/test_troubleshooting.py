"""Each message that the troubleshooting page explains is one that the package has."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LEAST = 7
"""characters of a fixed part of a message"""


def fixed_parts(message: str) -> list[str]:
    """Parts of a message between its names and numbers."""
    parts = re.split(r"'[^']*'|--[a-z-]+|[\d.]+|[A-Z]\w*Error|[;:,]", message)
    return [part.strip() for part in parts if len(part.strip()) >= LEAST]


def test_the_messages_are_those_of_the_package() -> None:
    page = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
    messages = [line.strip("`") for line in re.findall(r"^(`.*`)\n:", page, re.MULTILINE)]
    source = "\n".join(path.read_text(encoding="utf-8") for path in sorted((ROOT / "adaptctl").rglob("*.py")))
    source = re.sub(r'"\s*\n\s*f?"', "", source)
    assert len(messages) > 15
    for message in messages:
        words = [word for part in fixed_parts(message) for word in [max(part.split(" of "), key=len)]]
        assert any(word in source for word in words) or message in source, message
