"""Words for what is wrong with the contents of a file."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from types import NoneType
from typing import Annotated, Any, Literal, get_args, get_origin

import msgspec

MOST_TOLD = 12
"""errors of one file that are told"""
RENAMED_PAGE = "docs/renamed.md"
"""page of former names and file schemas"""
KINDS = {
    "object": "a table",
    "array": "a list",
    "str": "text",
    "float": "a number",
    "int": "a whole number",
    "bool": "true or false",
    "null": "nothing",
}
"""of msgspec's names of types"""
FILES = {
    **dict.fromkeys(("mechanism", "denavit-hartenberg"), "a robot file"),
    **{"drives": "a drives file", "study": "a study of a sweep", "contest": "a contest", "priority": "a priority"},
}
"""kinds of files by their schemas"""
_TYPES = rf"`((?:{'|'.join(KINDS)})(?: \| (?:{'|'.join(KINDS)}))*)`"


def in_words(message: str) -> str:
    """msgspec's message for readers of files, such as "expected a number, got text - at `$.links[0].mass`"."""
    message = re.sub(r"^Object missing required field (`[^`]*`)", r"\1 is missing", message)
    message = re.sub(r"^Object contains unknown field", "unknown field", message)
    return re.sub(_TYPES, _named, re.sub("^Expected ", "expected ", message))


def _named(found: re.Match[str]) -> str:
    """Kinds of values; what may be left out is not told, since no file says nothing by a value."""
    names = found.group(1).split(" | ")
    return " or ".join(KINDS[name] for name in names if name != "null" or len(names) == 1)


def errors_of(plain: object, kind: Any, place: str = "$") -> Iterator[str]:
    """Errors of contents that should be a `kind`, in words: of every key, where msgspec tells the first alone."""
    own, single = _plain_kind(kind), _plain_kind(next(iter(get_args(_plain_kind(kind))), None))
    if _is_struct(own) and isinstance(plain, dict):
        yield from _errors_of_keys(plain, own, place)
    elif get_origin(own) is list and _is_struct(single) and isinstance(plain, list) and plain:
        for i, entry in enumerate(plain):
            yield from errors_of(entry, single, f"{place}[{i}]")
    else:
        try:
            msgspec.convert(plain, kind)
        except (msgspec.ValidationError, OverflowError, RecursionError) as error:
            told, _, inner = str(error).partition(" - at `$")
            yield in_words(told + _at(place + inner.removesuffix("`"))) + _remedy(kind, str(error))


def _errors_of_keys(plain: dict[str, Any], kind: Any, place: str) -> Iterator[str]:
    fields = {field.encode_name: field for field in msgspec.structs.fields(kind)}
    schema = (
        [(plain["schema"], fields["schema"].type)] if place == "$" and "schema" in fields and "schema" in plain else []
    )
    if other := [told for value, own in schema for told in errors_of(value, own, "$.schema")]:
        yield from other  # whose keys have other names
        return
    unknown = [name for name in plain if name not in fields] if kind.__struct_config__.forbid_unknown_fields else []
    if unknown:
        what = f"unknown field{'s' if len(unknown) > 1 else ''} {', '.join(f'`{name}`' for name in unknown)}"
        yield f"{what}{_at(place)}; expected one of {', '.join(fields)}"
    for name, field in fields.items():
        if name in plain:
            yield from errors_of(plain[name], field.type, f"{place}.{name}")
        elif field.required:
            yield f"`{name}` is missing{_written(name, field.type)}{_at(place)}"


def _at(place: str) -> str:
    return "" if place == "$" else f" - at `{place}`"


def _is_struct(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, msgspec.Struct)


def _plain_kind(kind: Any) -> Any:
    """Kind without its bounds, and without None beside it."""
    while get_origin(kind) is Annotated:
        kind = get_args(kind)[0]
    others = [one for one in get_args(kind) if one is not NoneType]
    return _plain_kind(others[0]) if NoneType in get_args(kind) and len(others) == 1 else kind


def _written(name: str, kind: Any) -> str:
    """A line of TOML that a missing key may have, where its kind tells one."""
    told = [repr(one) for one in get_args(kind)] if get_origin(kind) is Literal else []
    for meta in get_args(kind)[1:] if get_origin(kind) is Annotated else ():
        told += [str(one) for one in getattr(meta, "examples", None) or ()]
    return f", such as {name} = {told[0]}".replace("'", '"') if told else ""


def _remedy(kind: Any, message: str) -> str:
    """Values that a wrong one could be, where these are few."""
    if "enum value" not in message:
        return ""
    info = msgspec.inspect.type_info(kind)
    kinds = getattr(info, "types", (info,))
    choices = [repr(value) for one in kinds for value in getattr(one, "values", ())]
    numbers = ["a number"] if any(isinstance(one, msgspec.inspect.FloatType) for one in kinds) else []
    listed = ", ".join([*choices, *numbers])
    first = choices[0].strip("'") if choices else ""
    return f"; expected one of {listed}{_other_kind(message, choices)}" + (
        earlier_schema(message, first) if first else ""
    )


def _other_kind(message: str, choices: Sequence[str]) -> str:
    """Words on a file of a kind that another argument takes."""
    own = re.search(r"'adaptctl/([a-z-]+)/\d", message)
    told = FILES.get(own[1], "") if own else ""
    is_expected = own is not None and any(f"adaptctl/{own[1]}/" in choice for choice in choices)
    return f"; this is {told}" if told and not is_expected else ""


def earlier_schema(told: str, expected: str) -> str:
    """Hint at renamed names if a schema number differs from `expected`."""
    kind, _, number = expected.rpartition("/")
    return f". {RENAMED_PAGE} tells what {kind}/{number} renames" if re.search(rf"{kind}/\d+", told) else ""


def told_all(found: list[str]) -> str:
    """One line of all errors, numbered where there are several."""
    if len(found) == 1:
        return found[0]
    told = "; ".join(f"({i}) {one}" for i, one in enumerate(found[:MOST_TOLD], 1))
    return f"{len(found)} errors: {told}" + ("; ..." if len(found) > MOST_TOLD else "")
