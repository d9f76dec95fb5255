"""python-control has no annotations, and what pyright infers of it is wrong: unions with lists, slices as indices."""

from typing import Any

def __getattr__(name: str) -> Any: ...
