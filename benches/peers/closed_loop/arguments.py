"""The command line."""

import argparse
from pathlib import Path

EPILOG = """\
Examples:
  run.py                                      everything, four minutes; tables on standard output
  run.py --json peers.json --markdown peers.md
  run.py --quick                              three scenarios, under a minute
  run.py --scenarios swap8 circle-20 --laws certified orca-best
  run.py --self-check                         both evaluators on our own runs; no network

Exit codes: 0 done, 1 the two evaluators disagree, 2 the command line or the environment is wrong.
"""


def parser() -> argparse.ArgumentParser:
    """The parser of `run.py`."""
    p = argparse.ArgumentParser(
        prog="run.py",
        description="Drive the same scenarios with Clearway and its peers, and evaluate all alike.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("--quick", action="store_true", help="three scenarios")
    p.add_argument("--scenarios", nargs="+", metavar="NAME", help="these built-in scenarios or files")
    p.add_argument("--laws", nargs="+", metavar="KEY", help="these laws; keys as in the JSON")
    p.add_argument("--json", type=Path, metavar="OUT", help="write every run to this file")
    p.add_argument("--markdown", type=Path, metavar="OUT", help="write the tables to this file as well")
    p.add_argument("--self-check", action="store_true", help="only hold the two evaluators together")
    p.add_argument("--clearway", type=Path, metavar="BINARY", help="this program instead of building it")
    p.add_argument("--venv", type=Path, metavar="DIR", help="virtual environment for the peers")
    return p
