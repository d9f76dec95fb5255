"""A diagnosis for people: `report_html` makes an HTML file, `print_summary` prints a summary."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from exodrake.report.diagnosis_html import report_html
    from exodrake.report.terminal import print_summary

__all__ = ["print_summary", "report_html"]
HOMES = {"report_html": "diagnosis_html", "print_summary": "terminal"}


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name not in HOMES:
        raise AttributeError(name)
    return getattr(import_module(f"exodrake.report.{HOMES[name]}"), name)
