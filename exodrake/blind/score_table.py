"""A score as a table on the terminal, as JSON, and as Markdown."""

import math

HEADINGS = ("measure", "wanted", "found", "95 % interval", "of")


def rows_of(shares):
    """Cells of share rows."""
    rows = []
    for item in shares:
        low, high = item.interval
        value = "-" if not item.total else f"{100 * item.value:.1f} %"
        span = "-" if not item.total else f"{100 * low:.1f}-{100 * high:.1f} %"
        rows.append((item.name, item.wanted, value, span, f"{item.hits}/{item.total}"))
    return rows


def sections(score):
    """Rows of the table: shares, plain quantities, baselines."""
    quantities = [
        (name, "", "-" if math.isnan(value) else f"{value:.3g}", "", "") for name, value in score.quantities.items()
    ]
    baselines = [(f"baseline: {row[0]}", *row[1:]) for row in rows_of(score.baselines)]
    return rows_of(score.shares) + quantities + baselines


def title_of(score):
    lacking = f", {len(score.missing)} without a diagnosis" if score.missing else ""
    failed = f", {len(score.failed)} of them failed" if score.failed else ""
    return f"{score.cases} cases{failed}{lacking}"


def as_table(score):
    """rich table of the score."""
    from rich.table import Table

    table = Table(title=title_of(score))
    for heading in HEADINGS:
        table.add_column(heading, justify="left" if heading == "measure" else "right")
    for row in sections(score):
        table.add_row(*row)
    return table


def confusion_table(score):
    """rich table of truth against answer, one line per pair that occurs; wrong ones in red."""
    from rich.table import Table

    table = Table(title="Truth and answer")
    for heading in ("truth", "answer", "cases"):
        table.add_column(heading, justify="right" if heading == "cases" else "left")
    for (truth, answer), many in score.confusion.items():
        table.add_row(truth, answer if is_right(truth, answer) else f"[red]{answer}[/red]", str(many))
    return table


def is_right(truth, answer):
    """For colouring only: the scoring rules are score.py's."""
    if truth == "healthy":
        return answer in ("NO_GAP", "RETUNE")
    if truth.startswith("outside."):
        return answer == "UNKNOWN"
    return set(truth.split(" + ")) <= set(answer.split(" + "))


def as_json(score):
    """Plain data of the score."""

    def plain(item):
        low, high = item.interval
        value = item.value if item.total else None
        return {"hits": item.hits, "total": item.total, "value": value, "low": low, "high": high, "wanted": item.wanted}

    confusion = [{"truth": truth, "answer": answer, "cases": many} for (truth, answer), many in score.confusion.items()]
    quantities = {name: None if math.isnan(value) else value for name, value in score.quantities.items()}
    return {
        "cases": score.cases,
        "missing": list(score.missing),
        "failed": list(score.failed),
        "shares": {item.name: plain(item) for item in score.shares},
        "numbers": quantities,
        "baselines": {item.name: plain(item) for item in score.baselines},
        "confusion": confusion,
    }


def as_markdown(score):
    """The score as Markdown."""
    lines = [title_of(score), "", "| " + " | ".join(HEADINGS) + " |", "|" + "---|" * len(HEADINGS)]
    lines += ["| " + " | ".join(row) + " |" for row in sections(score)]
    lines += ["", "| truth | answer | cases |", "|---|---|---|"]
    lines += [f"| {truth} | {answer} | {many} |" for (truth, answer), many in score.confusion.items()]
    return "\n".join(lines) + "\n"
