"""What is kept in files here, for tests that compare it with what is so now."""

from __future__ import annotations

import json
from typing import Any

from golden import capture

AFTERWARDS = "if it is meant, `make golden UPDATE=1` writes it anew; say why in the commit"


def kept(part: str) -> dict[str, Any]:
    """What a part's file holds."""
    found: dict[str, Any] = json.loads((capture.HERE / f"{part}.json").read_text())
    return found


def validate_same(before: Any, now: Any) -> None:
    """Assert that there is no difference beyond round-off."""
    differences = list(capture.compared(before, json.loads(json.dumps(now))))
    assert not differences, "\n".join([*differences, AFTERWARDS])
