"""HTML from jinja2 templates: text is escaped, a missing value is an error."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup


@cache
def environment(*folders: Path) -> Environment:
    """The templates of some folders, the first that has a name wins."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    made = Environment(
        loader=FileSystemLoader(folders), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    made.filters["code"] = code
    return made


def render(template: str, *folders: Path, **values: Any) -> str:
    """Fills a template, a file in one of the folders, with the values of its variables."""
    return environment(*folders).get_template(template).render(values)


def code(text: str) -> Markup:
    """Escaped text with `code` between backticks."""
    from markupsafe import Markup

    pieces = text.split("`")
    return Markup().join(p if i % 2 == 0 else Markup("<code>{}</code>").format(p) for i, p in enumerate(pieces))
