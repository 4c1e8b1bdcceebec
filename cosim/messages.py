"""How messages about bad input say what would be right."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def did_you_mean(wrong: str, known: Iterable[str], all_if_few: int = 8) -> str:
    """The end of a message about an unknown name: the close ones, or all where they are few."""
    names = sorted(set(known))
    close = difflib.get_close_matches(wrong, names, n=3, cutoff=0.6)
    if close:
        return "; did you mean " + " or ".join(f"'{name}'" for name in close) + "?"
    if not names:
        return "; there are none"
    shown = ", ".join(names[:all_if_few]) + (", ..." if len(names) > all_if_few else "")
    return f"; known: {shown}"
