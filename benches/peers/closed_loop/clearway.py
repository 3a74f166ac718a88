"""Our own runs: `clearway eval`, and the check that both evaluators say the same about them."""

import json
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from .figures import Evaluator, Figures
from .motion import Motion
from .scenario import Scenario, parse

# How far two evaluators may differ in a figure, relative to 1 + |figure|: rounding, and the width of
# the enclosures of minimum distances.
AGREEMENT = 1e-9


class ClearwayError(Exception):
    """`clearway` could not be run, or said what it should not."""


@dataclass(frozen=True, slots=True)
class Clearway:
    """The program `clearway`."""

    binary: Path

    def scenario(self, name: str) -> Scenario:
        """The scenario called `name`: a built-in one, or a file."""
        return parse(self._run(["scenario", name], ok=(0,)))

    def version(self) -> str:
        """What the program calls itself."""
        return self._run(["--version"], ok=(0,)).strip()

    def evaluate(self, names: Sequence[str], arguments: Sequence[str]) -> list[tuple[dict, dict]]:
        """For every scenario `eval`'s result and the trajectory behind it.

        One scenario at a time, so that the times are those of a core that has nothing else to do.
        """
        with tempfile.TemporaryDirectory(prefix="clearway-peers-") as folder:
            files = Path(folder, "results.jsonl"), Path(folder, "trajectories.jsonl")
            command = ["eval", *names, *arguments, "--jobs", "1"]
            command += ["--jsonl", str(files[0]), "--trajectories", str(files[1])]
            # 1: not everybody arrived, or somebody came too close; that is a result.
            self._run(command, ok=(0, 1))
            results, trajectories = (
                [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()] for file in files
            )
        if not len(results) == len(trajectories) == len(names):
            raise ClearwayError(f"eval was asked for {len(names)} scenarios and wrote {len(results)}")
        return list(zip(results, trajectories, strict=True))

    def _run(self, arguments: list[str], ok: tuple[int, ...]) -> str:
        command = [str(self.binary), *arguments]
        try:
            done = subprocess.run(command, capture_output=True, text=True, check=False)
        except OSError as error:
            raise ClearwayError(f"{self.binary} cannot be run: {error}") from error
        if done.returncode not in ok:
            raise ClearwayError(f"{' '.join(command)} failed with {done.returncode}:\n{done.stderr}")
        return done.stdout


def figures_of(trajectory: dict, scenario: Scenario) -> Figures:
    """Our evaluator's figures of a trajectory that `eval` wrote."""
    evaluator = Evaluator(scenario, trajectory["period_s"])
    for tick, fleet in enumerate(trajectory["states"]):
        evaluator.observe(tick, [Motion(*state) for state in fleet])
    return evaluator.finish()


def disagreements(figures: Figures, result: dict) -> list[str]:
    """Where the two evaluators differ, as lines for a person; none if they agree."""
    found = []
    for field in fields(figures):
        here, there = getattr(figures, field.name), result[field.name]
        if here is None or there is None or isinstance(here, int):
            same = here == there
        else:
            same = abs(here - there) <= AGREEMENT * (1.0 + abs(there))
        if not same:
            found.append(f"{result['scenario']}: {field.name} is {here} here and {there} there")
    return found
