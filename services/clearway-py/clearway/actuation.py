"""The gate that every receiver of commands applies before it moves anything.

A command acts from its valid-from time and never after its valid-until time; outside, the robot stands
still. A command of an older run, a repeated or reordered one, one that is not finite or beyond the limits or
whose times make no sense is refused, not clamped: such a command was never verified. Bits that changed on
the way are found before, by the reader of the sample.
"""

from __future__ import annotations

from enum import Enum
from typing import Any, NamedTuple

from .layout import CommandHeader

STOP = (0.0, 0.0)


class Refusal(Enum):
    """Why a command was refused."""

    WRONG_ROBOT = "wrong_robot"
    OLD_EPOCH = "old_epoch"
    """It comes from an older run of the daemon than the newest one seen."""
    OLD_TICK = "old_tick"
    """Repeated or out of order."""
    EXPIRED = "expired"
    """It had expired when it arrived."""
    VALIDITY = "validity"
    """It ends before it begins, would hold longer than allowed, or was published before the state that it
    answers or after it was to act."""
    FUTURE = "future"
    """By this machine's clock it is stamped in the future, or would act only when what it answers is long
    over: its sender has another clock."""
    INPUT = "input"
    """An input is not finite or outside the limits, or is not a stop and gives a reason for one."""


class _Held(NamedTuple):
    """A command and when it may act: [from_ns, until_ns)."""

    command: tuple[float, float] = STOP
    from_ns: int = 0
    until_ns: int = 0


class Gate:
    """What one robot may do now.

    ``v_mps`` and ``omega_radps`` are the limits of its inputs, m/s and rad/s, bounds included; nothing acts
    for longer than ``max_hold_ns``. Times are ``time.monotonic_ns()`` and do not run backwards from call to
    call.
    """

    def __init__(
        self,
        robot: int,
        *,
        max_hold_ns: int,
        v_mps: tuple[float, float] = (0.0, 5.0),
        omega_radps: tuple[float, float] = (-1.0, 1.0),
    ) -> None:
        self.robot = robot
        self.refused = 0
        """Commands refused so far."""
        self._max_hold_ns, self._v_mps, self._omega_radps = max_hold_ns, v_mps, omega_radps
        self._epoch = 0
        self._tick: int | None = None
        self._current = self._pending = _Held()

    def offer(self, header: CommandHeader, command: Any, now_ns: int) -> Refusal | None:
        """Takes an element of a command sample's ``robots``; the reason if it is refused.

        What was held before a refusal stays; the first command of a new run drops whatever an older one left.
        """
        refusal = self._check(header, command, now_ns)
        if refusal is not None:
            self.refused += 1
            return refusal
        if header.epoch > self._epoch:
            self._current = self._pending = _Held()
        self._promote(now_ns)
        self._epoch, self._tick = header.epoch, header.tick
        wanted = (float(command["v_mps"]), float(command["omega_radps"]))
        self._pending = _Held(wanted, header.valid_from_ns, header.valid_until_ns)
        return None

    def input(self, now_ns: int) -> tuple[float, float]:
        """(v_mps, omega_radps) that may act now: the held command inside its validity, otherwise a stop."""
        self._promote(now_ns)
        acts = self._current.from_ns <= now_ns < self._current.until_ns
        return self._current.command if acts else STOP

    def next_change_ns(self, now_ns: int) -> int | None:
        """When :meth:`input` can change next without a new command."""
        times = (self._current.until_ns, self._pending.from_ns, self._pending.until_ns)
        return min((time_ns for time_ns in times if time_ns > now_ns), default=None)

    def _promote(self, now_ns: int) -> None:
        if self._pending.until_ns > 0 and self._pending.from_ns <= now_ns:
            self._current, self._pending = self._pending, _Held()

    def _check(self, header: CommandHeader, command: Any, now_ns: int) -> Refusal | None:
        if int(command["id"]) != self.robot:
            return Refusal.WRONG_ROBOT
        if header.epoch < self._epoch:
            return Refusal.OLD_EPOCH
        if header.epoch == self._epoch and self._tick is not None and header.tick <= self._tick:
            return Refusal.OLD_TICK
        if not 0 < header.valid_until_ns - header.valid_from_ns <= self._max_hold_ns:
            return Refusal.VALIDITY
        if header.valid_until_ns <= now_ns:
            return Refusal.EXPIRED
        # Announced however early, a stop is a stop.
        is_stop = (float(command["v_mps"]), float(command["omega_radps"])) == STOP
        if not is_stop and not header.state_stamp_ns <= header.stamp_ns <= header.valid_from_ns:
            return Refusal.VALIDITY
        # A receiver may read its clock a little before the sample, and a period is published ahead.
        ahead_ns = now_ns + self._max_hold_ns
        early = not is_stop and header.valid_from_ns > ahead_ns + self._max_hold_ns
        if header.stamp_ns > ahead_ns or early:
            return Refusal.FUTURE
        if int(command["stop_reason"]) != 0 and not is_stop:
            return Refusal.INPUT
        # Comparisons with what is not a number are false.
        (v_min, v_max), (omega_min, omega_max) = self._v_mps, self._omega_radps
        if not (v_min <= command["v_mps"] <= v_max and omega_min <= command["omega_radps"] <= omega_max):
            return Refusal.INPUT
        return None
