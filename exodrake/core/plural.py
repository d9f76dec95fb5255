"""Nouns after numbers."""


def plural(count: int, noun: str) -> str:
    """A noun after a number: `robot` after 1, else `robots`."""
    return noun if count == 1 else f"{noun}s"
