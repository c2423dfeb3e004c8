"""Writes TOML: the values that scene files need."""

from math import isfinite


def value(item):
    """A value as TOML: a number, a string, true or false, a list, or a table in one line."""
    if isinstance(item, bool):
        return "true" if item else "false"
    if isinstance(item, int):
        return str(item)
    if isinstance(item, float):
        if not isfinite(item):
            raise ValueError(f"{item} is no number of a scene file")
        text = repr(item)
        return text if any(c in text for c in ".e") else text + ".0"
    if isinstance(item, str):
        return string(item)
    if isinstance(item, dict):
        return "{ " + ", ".join(f"{key} = {value(inner)}" for key, inner in item.items()) + " }"
    return "[" + ", ".join(value(inner) for inner in item) + "]"


def string(text):
    """A basic string. `$` is doubled, because `${NAME}` is a parameter in scene files."""
    escapes = {"\\": "\\\\", '"': '\\"', "\n": "\\n", "\t": "\\t", "\r": "\\r", "$": "$$"}

    def escaped(c):
        if c in escapes:
            return escapes[c]
        return f"\\u{ord(c):04X}" if ord(c) < 32 or ord(c) == 127 else c

    return '"' + "".join(escaped(c) for c in text) + '"'


def document(tables, head=()):
    """A document. `head`: pairs of the top level; `tables`: pairs of a header, as `[camera]` or `[[lights]]`, and a dict."""
    parts = [f"{key} = {value(item)}\n" for key, item in head]
    for header, table in tables:
        lines = "".join(f"{key} = {value(item)}\n" for key, item in table.items())
        parts.append(f"\n{header}\n{lines}")
    return "".join(parts)
