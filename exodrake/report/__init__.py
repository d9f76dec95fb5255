"""A diagnosis for people: `report_html` makes a page, `print_summary` ten seconds' reading in a terminal."""

from typing import Any


def __getattr__(name: str) -> Any:
    if name == "report_html":
        from exodrake.report.html import report_html

        return report_html
    if name == "print_summary":
        from exodrake.report.summary import print_summary

        return print_summary
    raise AttributeError(name)
