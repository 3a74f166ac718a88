"""From runs to rows: one JSON object for every scenario and law, with one set of keys for all."""

from collections.abc import Callable, Iterator, Sequence

import ipopt

from .catalogue import OURS, PEERS, Ours, Peer
from .clearway import Clearway, disagreements, figures_of
from .figures import Figures
from .law import Outcome, run
from .scenario import Scenario

Progress = Callable[[str, str], None]


class DisagreementError(Exception):
    """The two evaluators do not agree on one of our own runs."""


def quantiles(ns: list[int]) -> dict[str, int] | None:
    """Nearest-rank quantiles of times, ns, with their count; `None` without a time."""
    return {"count": len(ns), **ipopt.quantiles(ns)} if ns else None


def measure(
    clearway: Clearway, groups: dict[str, list[str]], keys: Sequence[str], period_s: float, progress: Progress
) -> Iterator[dict]:
    """Every chosen law in every scenario, scenario by scenario so that drifts of the machine cancel."""
    for group, names in groups.items():
        for name in names:
            scenario = clearway.scenario(name)
            for ours in OURS:
                if ours.key in keys:
                    progress(name, ours.title)
                    yield {"group": group, **our_row(clearway, scenario, ours, name)}
            for peer in PEERS:
                if peer.key in keys and (peer.obstacles or not scenario.obstacles):
                    progress(name, peer.title)
                    yield {"group": group, **peer_row(scenario, peer, period_s)}


def our_row(clearway: Clearway, scenario: Scenario, ours: Ours, name: str) -> dict:
    """Our own run, evaluated by both evaluators."""
    ((result, trajectory),) = clearway.evaluate([name], ours.arguments)
    figures = figures_of(trajectory, scenario)
    if found := disagreements(figures, result):
        raise DisagreementError("\n".join(found))
    arrived = figures.arrived == figures.robots
    return {
        "scenario": scenario.name,
        "law": ours.key,
        "title": ours.title,
        "parameters": {"arguments": list(ours.arguments)},
        "holonomic": False,
        "ended_by": "arrival" if arrived else "time",
        **figures.as_dict(),
        "not_solved": result["fallback_commands"],
        "solve_ns": result["solve_ns"],
        "step_ns_per_robot": result["step_ns_per_robot"],
        "fleet_step_ns": result["fleet_step_ns"],
    }


def peer_row(scenario: Scenario, peer: Peer, period_s: float) -> dict:
    """The peer's run, with the parameters that do best in this scenario."""
    outcomes = []
    for candidate in peer.candidates:
        law = candidate.make(scenario, period_s)
        outcomes.append((run(scenario, law, period_s), candidate, law.holonomic))
    outcome, candidate, holonomic = min(outcomes, key=lambda o: rank(o[0].figures))
    return {
        "scenario": scenario.name,
        "law": peer.key,
        "title": peer.title,
        "parameters": candidate.parameters,
        "candidates": len(peer.candidates),
        "candidates_passed": sum(o[0].figures.passed for o in outcomes),
        "holonomic": holonomic,
        "ended_by": outcome.ended_by,
        **outcome.figures.as_dict(),
        "not_solved": outcome.not_solved,
        **_times(outcome),
    }


def rank(figures: Figures) -> tuple[int, float, float]:
    """The better of two runs has the smaller rank.

    Fewest robots that did not arrive and pairs that came too close; then the last arrival; then the
    mean one.
    """
    failed = figures.robots - figures.arrived + figures.violations
    far = float("inf")
    makespan = far if figures.makespan_s is None else figures.makespan_s
    return failed, makespan, far if figures.mean_arrival_s is None else figures.mean_arrival_s


def _times(outcome: Outcome) -> dict:
    times, figures = outcome.times, outcome.figures
    one_call_a_fleet = len(times.solve_ns) == len(times.fleet_step_ns)
    return {
        # ORCA has no solve of its own for a robot: its step is one call for the whole fleet.
        "solve_ns": None if one_call_a_fleet else quantiles(times.solve_ns),
        "step_ns_per_robot": round(sum(times.fleet_step_ns) / (figures.steps * figures.robots)),
        "fleet_step_ns": quantiles(times.fleet_step_ns),
    }
