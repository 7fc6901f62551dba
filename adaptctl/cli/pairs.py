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

    for pair in given:
        if "=" not in pair:
            raise InputError(f"{option}: expected {EXAMPLES[option]}, got {pair!r}")
    parts = (pair.partition("=") for pair in given)
    return {what: value for what, _, value in parts}
