"""The gate that every receiver of commands applies before it moves anything.

A command acts from its valid-from time and never after its valid-until time; outside, the robot stands
still. A command of an older run, a repeated or reordered one, one that is not finite or beyond the limits or
whose times make no sense is refused, not clamped: such a command was never verified. A command was computed
for where the one before it leads, so one that moves the robot is followed only if that one was, and not once
its time has begun. A robot that missed one, or was stopped by something else, stands until the daemon has heard
of it and says so in a stop, ``StopReason.OUT_OF_STEP``; :meth:`Gate.holding` is what it has to hear. Bits that
changed on the way are found before, by the reader of the sample.
"""

from __future__ import annotations

from enum import Enum
from typing import Any, NamedTuple

from .codes import Holding, StopReason
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
    LATE = "late"
    """It would have moved the robot, and its time had begun when it arrived."""
    OUT_OF_STEP = "out_of_step"
    """It would have moved the robot, which does not hold the command before it."""
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

    ``unreported``: of robots of which nobody tells the daemon what they hold. It would not hear that they stand,
    and never let them go on, so they follow commands that come late or after one that was missed. That none is
    lost is then for whoever connects them to see to.
    """

    def __init__(
        self,
        robot: int,
        *,
        max_hold_ns: int,
        v_mps: tuple[float, float] = (0.0, 5.0),
        omega_radps: tuple[float, float] = (-1.0, 1.0),
        unreported: bool = False,
    ) -> None:
        self.robot = robot
        self.unreported = unreported
        self.refused = 0
        """Commands refused so far."""
        self._max_hold_ns, self._v_mps, self._omega_radps = max_hold_ns, v_mps, omega_radps
        self._epoch = 0
        self._tick: int | None = None
        # The newest command that was taken in an unbroken sequence, and when that began.
        self._followed: tuple[int, int] | None = None
        self._current = _Held()
        # Those that wait for their time, in its order.
        self._pending: list[_Held] = []

    def offer(self, header: CommandHeader, command: Any, now_ns: int) -> Refusal | None:
        """Takes an element of a command sample's ``robots``; the reason if it is refused.

        What was held before a refusal stays; the first command of a new run drops whatever an older one left.
        """
        refusal = self._check(header, command, now_ns)
        if refusal is not None:
            self.refused += 1
            return refusal
        since_ns, reason = self._in_step_since_ns(header), int(command["stop_reason"])
        if since_ns is not None:
            self._followed = (header.tick, since_ns)
        elif reason == StopReason.OUT_OF_STEP:
            # Until it acts the daemon may believe that the robot moves.
            self._followed = (header.tick, header.valid_from_ns)
        elif header.epoch > self._epoch:
            # No command of this run came before its first.
            self._followed = (header.tick, now_ns) if reason == StopReason.START else None
        if header.epoch > self._epoch:
            self._current, self._pending = _Held(), []
        self._promote(now_ns)
        self._epoch, self._tick = header.epoch, header.tick
        wanted = (float(command["v_mps"]), float(command["omega_radps"]))
        held = _Held(wanted, header.valid_from_ns, header.valid_until_ns)
        # The clock may have been read a little before the sample came: the one before it then still waits, and
        # is driven before this one.
        waiting = [one for one in self._pending if one.from_ns < held.from_ns]
        if len(waiting) == 2:
            # What moves is never announced so early: a stop. To drop one that waits for its time would lead the
            # robot elsewhere than is known, so that it stands at once and tells.
            self.halt()
            waiting = []
        self._pending = [*waiting, held]
        return None

    def input(self, now_ns: int) -> tuple[float, float]:
        """(v_mps, omega_radps) that may act now: the held command inside its validity, otherwise a stop."""
        self._promote(now_ns)
        acts = self._current.from_ns <= now_ns < self._current.until_ns
        return self._current.command if acts else STOP

    def halt(self) -> None:
        """The robot has stopped by itself: an emergency stop, a blocked wheel. Call it for as long as that lasts.

        It is where no command has led it, so it follows none until the daemon has said in a stop that it knows.
        """
        self._current, self._pending = _Held(), []
        self._followed = None

    def holding(self, now_ns: int) -> int:
        """Which command the robot follows now: the code that goes with its pose into an observation.

        A command that it has taken and that waits for its time counts; a stop with which it begins anew counts
        from when it acts. Of a gate that is ``unreported`` nothing is told.
        """
        if self.unreported:
            return Holding.UNTOLD
        if self._followed is None or self._followed[1] > now_ns:
            return Holding.NOTHING
        return Holding.command(self._followed[0])

    def next_change_ns(self, now_ns: int) -> int | None:
        """When :meth:`input` can change next without a new command."""
        times = [time_ns for one in self._pending for time_ns in (one.from_ns, one.until_ns)]
        return min((time_ns for time_ns in (self._current.until_ns, *times) if time_ns > now_ns), default=None)

    def _promote(self, now_ns: int) -> None:
        while self._pending and self._pending[0].from_ns <= now_ns:
            self._current = self._pending.pop(0)

    def _in_step_since_ns(self, header: CommandHeader) -> int | None:
        """Since when commands have been taken without a gap, if this one comes after the newest of them."""
        if self._followed is None or (header.epoch, header.follows) != (self._epoch, self._followed[0]):
            return None
        return self._followed[1]

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
        # Announced however early, a stop is a stop, and however late.
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
        heeds = not is_stop and not self.unreported
        if heeds and header.valid_from_ns < now_ns:
            return Refusal.LATE
        if heeds and self._in_step_since_ns(header) is None:
            return Refusal.OUT_OF_STEP
        return None
