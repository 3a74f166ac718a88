"""The results as Markdown: what every law did overall, and a table for every group of scenarios."""

import math
from collections.abc import Callable, Iterable

Row = dict
NONE = "–"


def markdown(document: dict) -> str:
    """All tables of a run's document."""
    rows, reference = document["rows"], document["reference"]
    period_ms = document["period_s"] * 1e3
    sections = [_overall(rows, reference, period_ms), _makespans(rows)]
    for group in dict.fromkeys(row["group"] for row in rows):
        sections.append(f"**{group}**\n\n" + _group([r for r in rows if r["group"] == group], reference))
    return "\n\n".join(sections) + "\n"


def _overall(rows: list[Row], reference: str, period_ms: float) -> str:
    """One line for every law, over all scenarios."""
    head = ["law", "runs passed", "arrived", "pairs too close", "clearance m", "makespan × ours", "∫\\|dω\\|"]
    head += ["solve p50 µs", "µs a robot", "× ours", "periods", "worst ms", f"keeps {period_ms:.0f} ms"]
    ours = {row["scenario"]: row for row in rows if row["law"] == reference}
    lines = []
    for members in _by(rows, "law"):
        both = [(r, ours[r["scenario"]]) for r in members if r["scenario"] in ours]
        makespans = [r["makespan_s"] / o["makespan_s"] for r, o in both if _passed(r) and _passed(o)]
        slower = [r["step_ns_per_robot"] / o["step_ns_per_robot"] for r, o in both]
        solves = [r["solve_ns"]["p50"] for r in members if r["solve_ns"]]
        worst_ms = max(r["fleet_step_ns"]["max"] for r in members) / 1e6
        lines.append(
            [
                members[0]["title"],
                f"{sum(map(_passed, members))} of {len(members)}",
                f"{_sum(members, 'arrived')} of {_sum(members, 'robots')}",
                str(_sum(members, "violations")),
                _least(members),
                f"{_number(_geometric(makespans), 2)} ({len(makespans)})" if makespans else NONE,
                _mean_of(members, "omega_variation_rad", 1),
                _significant(_mean([s / 1e3 for s in solves])),
                _significant(_mean([r["step_ns_per_robot"] / 1e3 for r in members])),
                _significant(_geometric(slower)),
                str(sum(r["fleet_step_ns"]["count"] for r in members)),
                _significant(worst_ms),
                "yes" if worst_ms <= period_ms else "**no**",
            ]
        )
    return _table(head, lines)


def _makespans(rows: list[Row]) -> str:
    """One line for every law and a column for every group: when the last robot arrived."""
    groups = list(dict.fromkeys(row["group"] for row in rows))
    lines = []
    for members in _by(rows, "law"):
        of = {group: [r for r in members if r["group"] == group] for group in groups}
        lines.append([members[0]["title"], *(_makespan(of[group]) for group in groups)])
    return _table(["last arrival, s", *groups], lines)


def _makespan(rows: list[Row]) -> str:
    """The mean makespan, or how many arrived; in brackets the pairs that came too close."""
    if not rows:
        return "n/a"
    arrived, robots, close = (_sum(rows, key) for key in ("arrived", "robots", "violations"))
    when = f"{arrived} of {robots}"
    if arrived == robots:
        when = _number(_mean([row["makespan_s"] for row in rows]), 2)
    return f"{when} ({close})" if close else when


def _group(rows: list[Row], reference: str) -> str:
    """One line for every law, over the scenarios of a group."""
    head = ["law", "arrived", "pairs too close", "clearance m", "makespan s", "ratio", "path", "∫\\|dω\\|"]
    head += ["µs a robot", "× ours", "period p50 ms", "p99", "worst"]
    ours = [row["step_ns_per_robot"] for row in rows if row["law"] == reference]
    lines = []
    for members in _by(rows, "law"):
        complete = [r["makespan_s"] for r in members if r["makespan_s"] is not None]
        step_ns = _mean([r["step_ns_per_robot"] for r in members])
        lines.append(
            [
                members[0]["title"],
                f"{_sum(members, 'arrived')} of {_sum(members, 'robots')}",
                str(_sum(members, "violations")),
                _least(members),
                _number(_mean(complete), 2) if len(complete) == len(members) else NONE,
                _mean_of(members, "arrival_ratio", 2),
                _mean_of(members, "path_ratio", 2),
                _mean_of(members, "omega_variation_rad", 1),
                _significant(step_ns / 1e3),
                _significant(step_ns / _mean(ours)) if ours else NONE,
                _significant(_mean([r["fleet_step_ns"]["p50"] for r in members]) / 1e6),
                _significant(max(r["fleet_step_ns"]["p99"] for r in members) / 1e6),
                _significant(max(r["fleet_step_ns"]["max"] for r in members) / 1e6),
            ]
        )
    return _table(head, lines)


def _passed(row: Row) -> bool:
    return row["arrived"] == row["robots"] and row["violations"] == 0


def _by(rows: list[Row], key: str) -> Iterable[list[Row]]:
    """Rows with the same value under `key`, in the order of their first."""
    for value in dict.fromkeys(row[key] for row in rows):
        yield [row for row in rows if row[key] == value]


def _sum(rows: list[Row], key: str) -> int:
    return sum(row[key] for row in rows)


def _least(rows: list[Row]) -> str:
    values = [row["min_clearance_m"] for row in rows if row["min_clearance_m"] is not None]
    return _number(min(values), 4) if values else NONE


def _mean_of(rows: list[Row], key: str, digits: int) -> str:
    return _number(_mean([row[key] for row in rows if row[key] is not None]), digits)


def _mean(values: list[float]) -> float | None:
    return sum(values) / len(values) if values else None


def _geometric(values: list[float]) -> float | None:
    positive = [math.log(value) for value in values if value > 0.0]
    return math.exp(sum(positive) / len(positive)) if positive else None


def _number(value: float | None, digits: int) -> str:
    if value is None:
        return NONE
    # No minus sign on what is shown as zero.
    return f"{0.0 if abs(value) < 0.5 * 10.0**-digits else value:.{digits}f}"


def _significant(value: float | None) -> str:
    """Two significant digits, and all digits before the point."""
    if value is None or value <= 0.0:
        return NONE
    return f"{value:,.{max(0, 1 - math.floor(math.log10(value)))}f}"


def _table(head: list[str], lines: list[list[str]]) -> str:
    cell: Callable[[list[str]], str] = lambda cells: "| " + " | ".join(cells) + " |"  # noqa: E731
    return "\n".join([cell(head), "|---" + "|---:" * (len(head) - 1) + "|", *map(cell, lines)])
