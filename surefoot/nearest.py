"""Suggestion of the allowed word that is most similar to a wrong one, for error messages."""

from collections.abc import Iterable


def nearest(word: str, others: Iterable[str]) -> str:
    """Return the most similar one of other words, or an empty string if none is similar."""
    import difflib

    return next(iter(difflib.get_close_matches(word, list(others), n=1, cutoff=0.6)), "")


def did_you_mean(word: str, allowed: Iterable[str]) -> str:
    """Return ` (did you mean 'x'?)` for the nearest allowed word, or an empty string."""
    near = nearest(word, allowed)
    return f" (did you mean {near!r}?)" if near else ""
