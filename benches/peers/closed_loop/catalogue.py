"""Which scenarios are run, and which laws."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

from .law import Law
from .orca import Orca, OrcaParameters, TrackedOrca, TrackerParameters
from .programme import CorrectedProgramme, PrintedProgramme
from .scenario import Scenario

# Groups of scenarios that share a table; the names are those of `clearway scenario`.
SCENARIOS = {
    "swap8": ["swap8"],
    "swap8-zero": ["swap8-zero"],
    "swap8-heading-0…4": [f"swap8-heading-{seed}" for seed in range(5)],
    "circle-10": ["circle-10"],
    "circle-20": ["circle-20"],
    "circle-50": ["circle-50"],
    "random-20-0…2": [f"random-20-{seed}" for seed in range(3)],
    "doorway-6": ["doorway-6"],
    "doorway-both-6": ["doorway-both-6"],
}
QUICK_SCENARIOS = {name: [name] for name in ("swap8", "circle-10", "doorway-4")}


@dataclass(frozen=True, slots=True)
class Ours:
    """One of our own laws: what `clearway eval` is called with."""

    key: str
    title: str
    arguments: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Candidate:
    """One set of parameters of a peer."""

    parameters: dict
    make: Callable[[Scenario, float], Law]


@dataclass(frozen=True, slots=True)
class Peer:
    """A peer; with several candidates each scenario gets the one that does best in it."""

    key: str
    title: str
    candidates: tuple[Candidate, ...]
    obstacles: bool = True


OURS = (
    Ours("certified", "certified"),
    Ours("certified-ideal", "certified, acts at once", ("--timing", "ideal")),
    Ours("certified-clarabel", "certified, Clarabel", ("--solver", "clarabel")),
    Ours("exp", "exp", ("--profile", "exp")),
    Ours("paper", "paper", ("--profile", "paper", "--timing", "ideal")),
    Ours(
        "unguided",
        "certified, no guidance",
        ("--timing", "ideal", "--set", "controller.guidance=false", "--set", "controller.barrier=linear"),
    ),
)
# What all ratios refer to.
REFERENCE = OURS[0].key


def _holonomic(parameters: OrcaParameters) -> Candidate:
    return Candidate(parameters.as_dict(), lambda s, t: Orca(s, t, parameters))


def _tracked(parameters: OrcaParameters, tracker: TrackerParameters) -> Candidate:
    both = {**parameters.as_dict(), **tracker.as_dict()}
    return Candidate(both, lambda s, t: TrackedOrca(s, t, parameters, tracker))


# At the shortest horizon circles collide, at the longest most fleets jam.
HOLONOMIC_GRID = tuple(
    _holonomic(OrcaParameters(horizon, inflation=inflation, perturbation=perturbation))
    for horizon, inflation, perturbation in product(
        (0.25, 0.5, 1.0, 2.0, 4.0), (1.0, 1.1, 1.25), (1e-4, 0.02, 0.2)
    )
)
TRACKED_GRID = tuple(
    _tracked(OrcaParameters(horizon, inflation=inflation, perturbation=0.02), TrackerParameters(stop))
    for horizon, inflation, stop in product((0.25, 0.5, 1.0, 2.0, 8.0), (1.0, 1.2, 1.5), (0.5, 1.57))
)
GUARDED_GRID = tuple(
    _tracked(OrcaParameters(horizon, inflation=inflation, perturbation=0.02), TrackerParameters(0.5, True))
    for horizon, inflation in product((0.25, 0.5, 1.0, 4.0), (1.0, 1.2))
)

PEERS = (
    Peer("orca-0.5s", "ORCA holonomic, τ = 0.5 s", (_holonomic(OrcaParameters(0.5)),)),
    Peer("orca-2s", "ORCA holonomic, τ = 2 s", (_holonomic(OrcaParameters(2.0)),)),
    Peer("orca-best", f"ORCA holonomic, best of {len(HOLONOMIC_GRID)}", HOLONOMIC_GRID),
    Peer("tracked-2s", "ORCA + tracker, τ = 2 s", (_tracked(OrcaParameters(2.0), TrackerParameters(0.5)),)),
    Peer(
        "tracked-0.5s",
        "ORCA + tracker, τ = 0.5 s, discs × 1.2",
        (_tracked(OrcaParameters(0.5, inflation=1.2, perturbation=0.02), TrackerParameters(0.5)),),
    ),
    Peer("tracked-best", f"ORCA + tracker, best of {len(TRACKED_GRID)}", TRACKED_GRID),
    Peer("tracked-guarded", f"ORCA + tracker + our hard rows, best of {len(GUARDED_GRID)}", GUARDED_GRID),
    Peer(
        "ipopt-printed",
        "IPOPT, (33) as printed",
        (Candidate({"q_sign": -1}, lambda s, t: PrintedProgramme(s, t, -1.0)),),
        obstacles=False,
    ),
    Peer(
        "ipopt-printed-q",
        "IPOPT, (33), Q's sign mended",
        (Candidate({"q_sign": 1}, lambda s, t: PrintedProgramme(s, t, 1.0)),),
        obstacles=False,
    ),
    Peer("ipopt-corrected", "IPOPT, corrected, no guidance", (Candidate({}, CorrectedProgramme),)),
)
