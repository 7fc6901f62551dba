"""Options whose values are pairs, WHAT=VALUE."""

from __future__ import annotations

Pairs = tuple[str, ...]
EXAMPLES = {
    "--columns": "WHAT=NAME, such as position=q{} torque=tau{}",
    "--units": "WHAT=UNIT, such as position=deg torque='N m'",
    "--payload": "LOG=LINK, such as loaded.csv=tool0",
}


def pairs(option: str, given: Pairs) -> dict[str, str]:
    """Values by what they are of."""
    from adaptctl.errors import InputError

    for i, pair in enumerate(given):
        if "=" not in pair:
            before = f"; if it is one more of the last: {given[i - 1]},{pair}" if i else ""
            raise InputError(f"{option}: expected {EXAMPLES[option]}, got {pair!r}{before}")
    parts = (pair.partition("=") for pair in given)
    return {what: value for what, _, value in parts}
