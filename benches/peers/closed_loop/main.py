"""What `run.py` does once its environment stands."""

import argparse
import json
import platform
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path

from .clearway import Clearway, disagreements, figures_of

PERIOD_S = 0.08
# Every kind of motion, obstacles, violations and robots that never arrive.
SELF_CHECK = (
    (("swap8", "swap8-zero", "circle-10", "random-8-0", "doorway-4", "pillars-4", "parked-wall-3"), ()),
    (("swap8", "swap8-heading-1", "circle-10"), ("--profile", "paper")),
)


def self_check(clearway: Clearway) -> int:
    """Both evaluators on our own runs; 1 if they differ anywhere."""
    found, count = [], 0
    for names, arguments in SELF_CHECK:
        runs = clearway.evaluate(names, arguments)
        for name, (result, trajectory) in zip(names, runs, strict=True):
            found += disagreements(figures_of(trajectory, clearway.scenario(name)), result)
            count += 1
    print("\n".join(found) if found else f"both evaluators agree on {count} runs")
    return 1 if found else 0


def measure(args: argparse.Namespace, clearway: Clearway) -> int:
    """All runs, the JSON file and the tables."""
    from . import catalogue, report, rows  # They need the peers' packages.

    known = [law.key for law in (*catalogue.OURS, *catalogue.PEERS)]
    keys = args.laws or known
    if unknown := [key for key in keys if key not in known]:
        print(f"there is no law {', '.join(unknown)}; known: {', '.join(known)}", file=sys.stderr)
        return 2
    groups = catalogue.QUICK_SCENARIOS if args.quick else catalogue.SCENARIOS
    if args.scenarios:
        groups = {name: [name] for name in args.scenarios}
    total, started, done = len(keys) * sum(map(len, groups.values())), time.monotonic(), [0]

    def progress(scenario: str, title: str) -> None:
        done[0] += 1
        elapsed_s = time.monotonic() - started
        print(
            f"{done[0]:4} of ≤ {total}  {elapsed_s:4.0f} s  {scenario}: {title}", file=sys.stderr, flush=True
        )

    try:
        results = list(rows.measure(clearway, groups, keys, PERIOD_S, progress))
    except rows.DisagreementError as error:
        print(f"the two evaluators disagree:\n{error}", file=sys.stderr)
        return 1
    document = {
        "machine": machine(),
        "versions": {
            "clearway": clearway.version(),
            "commit": _output(["git", "-C", str(Path(__file__).parent), "rev-parse", "--short", "HEAD"]),
            "python": platform.python_version(),
            **{package: version(package) for package in ("pyrvo", "casadi", "numpy")},
        },
        "period_s": PERIOD_S,
        "reference": catalogue.REFERENCE,
        "elapsed_s": round(time.monotonic() - started, 1),
        "rows": results,
    }
    tables = report.markdown(document)
    if args.json:
        args.json.write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    if args.markdown:
        args.markdown.write_text(tables, encoding="utf-8")
    print(tables, end="")
    return 0


def machine() -> dict:
    """What the times depend on."""
    model = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.is_file():
        lines = cpuinfo.read_text(encoding="utf-8", errors="replace").splitlines()
        model = next(
            (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), model
        )
    return {
        "cpu": model,
        "architecture": platform.machine(),
        "cpus": len(cpus) if (cpus := _cpus()) else None,
        "kernel": f"{platform.system()} {platform.release()}",
    }


def _cpus() -> set[int]:
    import os

    return os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set(range(os.cpu_count() or 0))


def _output(command: list[str]) -> str | None:
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return None
