"""An operator's requests and the daemon's answers."""

from __future__ import annotations

import ctypes
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from .codes import NO_ROBOT, AdminCode, AdminFlags, AdminKind
from .errors import AdminTimeoutError, InterruptedReadError, ReleasedError, TransferError
from .layout import AdminAnswer, AdminRequest, AdminRobot
from .refusals import RefusedError, refusal
from .subscriber import LOOK_EVERY_S
from .transport import Attachment
from .wheel import iox2

LONGEST_WAIT_S = 60.0
"""The daemon takes no request that expires later than this."""

BEGINNINGS = 8
"""How often a text is begun before it is given up."""


@dataclass(frozen=True)
class Done:
    """A request that was carried out."""

    epoch: int
    """Which run of the daemon."""
    acts_from_tick: int
    """Tick of the first commands that obey it; the state of the tick before already shows it."""


@dataclass(frozen=True)
class Status:
    """How the daemon is doing."""

    figures: AdminAnswer
    """All figures; the unit ends each field's name."""
    degraded: tuple[str, ...]
    """What the real-time set-up fell short in, a line each."""

    @property
    def flags(self) -> AdminFlags:
        """The flags among the figures."""
        return AdminFlags(self.figures.flags)

    @property
    def is_paused(self) -> bool:
        """Whether the fleet is paused until it is resumed."""
        return bool(self.flags & AdminFlags.PAUSED)

    @property
    def is_stopped(self) -> bool:
        """Whether an operator stopped the fleet until that is cleared."""
        return bool(self.flags & AdminFlags.STOPPED)


class AdminClient:
    """Asks the daemon for things, one at a time, and waits for the answer.

    Every request expires when its answer is not waited for any more, so that nothing is carried out late.
    All methods raise :class:`~clearway.AdminTimeoutError` when no answer comes in time and a
    :class:`~clearway.RefusedError` when the daemon refuses; its subclasses say why.
    """

    def __init__(self, node: Attachment) -> None:
        self._port = node.admin()
        self._tickets = 0
        self._timeout_s = 2.0

    @property
    def timeout_s(self) -> float:
        """How long an answer is waited for, s: above 0, at most a minute. 2 unless it is set."""
        return self._timeout_s

    @timeout_s.setter
    def timeout_s(self, timeout_s: float) -> None:
        if not 0.0 < timeout_s <= LONGEST_WAIT_S:
            raise ValueError(
                f"timeout_s is {timeout_s!r}: wanted is above 0 and at most {LONGEST_WAIT_S:g} s"
            )
        self._timeout_s = float(timeout_s)

    def status(self) -> Status:
        """How is the daemon doing?"""
        figures, text = self._read(AdminKind.STATUS)
        return Status(figures, tuple(text.splitlines()))

    def configuration(self) -> str:
        """The configuration in force, as TOML."""
        return self._read(AdminKind.CONFIGURATION)[1]

    def scenario(self) -> str:
        """The scenario as it is now, as TOML: robots, goals, obstacles."""
        return self._read(AdminKind.SCENARIO)[1]

    def set_goal(self, robot: int, x_m: float, y_m: float) -> Done:
        """Sends a robot to a new goal, m. Refused: it keeps the goal that it has."""
        return self.set_goals([(robot, x_m, y_m)])

    def set_goals(
        self, goals: Mapping[int, tuple[float, float]] | Iterable[tuple[int, float, float]]
    ) -> Done:
        """Sends several robots to new goals in the same period: all of them or none.

        ``goals``: ``{id: (x_m, y_m)}`` or a sequence of ``(id, x_m, y_m)``.
        """
        if isinstance(goals, Mapping):
            goals = [(robot, x_m, y_m) for robot, (x_m, y_m) in goals.items()]
        records = [AdminRobot(id=robot, goal_x_m=x_m, goal_y_m=y_m) for robot, x_m, y_m in goals]
        return self._order(AdminKind.SET_GOALS, records)

    def pause(self) -> Done:
        """Everybody holds until resumed."""
        return self._order(AdminKind.PAUSE)

    def resume(self) -> Done:
        """Goes on after a pause. Refused while the fleet is stopped."""
        return self._order(AdminKind.RESUME)

    def stop(self) -> Done:
        """Everybody stops, until that is cleared. No emergency stop in the sense of a safety standard."""
        return self._order(AdminKind.STOP)

    def clear(self) -> Done:
        """Takes the latch off a stop; the fleet is paused then."""
        return self._order(AdminKind.CLEAR)

    def add_robot(
        self, robot: int, *, radius_m: float, start: tuple[float, float, float], goal: tuple[float, float]
    ) -> Done:
        """One more robot, at rest at ``start`` (x_m, y_m, theta_rad), with the goal (x_m, y_m)."""
        record = AdminRobot(id=robot, radius_m=radius_m)
        record.start_x_m, record.start_y_m, record.start_theta_rad = start
        record.goal_x_m, record.goal_y_m = goal
        return self._order(AdminKind.ADD_ROBOT, [record])

    def remove_robot(self, robot: int) -> Done:
        """One robot fewer. The others keep clear of it no longer: it has to be out of their way."""
        return self._order(AdminKind.REMOVE_ROBOT, [AdminRobot(id=robot)])

    def close(self) -> None:
        """Leaves the channel."""
        self._port = None

    def _order(self, kind: AdminKind, robots: list[AdminRobot] | None = None) -> Done:
        answer, _ = self._ask(kind, robots or [])
        return Done(answer.epoch, answer.acts_from_tick)

    def _read(self, kind: AdminKind) -> tuple[AdminAnswer, str]:
        """A text, piece by piece if it is long, and all of it of one moment."""
        for _ in range(BEGINNINGS):
            first, text = self._ask(kind)
            while len(text) < first.text_bytes:
                try:
                    # Of the same run: another one would go on with another text.
                    answer, piece = self._ask(kind, offset=len(text), epoch=first.epoch)
                except RefusedError as error:
                    if error.code in (AdminCode.BUSY, AdminCode.OTHER_EPOCH):
                        break
                    raise
                if answer.text_bytes != first.text_bytes or not piece:
                    break
                text += piece
            if len(text) == first.text_bytes:
                return first, text.decode(errors="replace")
            time.sleep(LOOK_EVERY_S)
        raise InterruptedReadError(BEGINNINGS)

    def _ask(
        self,
        kind: AdminKind,
        robots: list[AdminRobot] | None = None,
        offset: int = 0,
        epoch: int = 0,
    ) -> tuple[AdminAnswer, bytes]:
        if self._port is None:
            raise ReleasedError("the admin client")
        robots = robots or []
        self._tickets += 1
        timeout_s = self._timeout_s
        end = time.monotonic() + timeout_s
        request = AdminRequest(
            ticket=self._tickets,
            expires_ns=time.monotonic_ns() + int(timeout_s * 1e9),
            epoch=epoch,
            offset=offset,
            kind=int(kind),
        )
        payload = (AdminRobot * len(robots))(*robots)
        try:
            loan = self._port.loan_slice_uninit(len(robots))
            ctypes.memmove(loan.payload_ptr, payload, ctypes.sizeof(payload))
            ctypes.memmove(loan.user_header_ptr, ctypes.addressof(request), ctypes.sizeof(request))
            pending = loan.assume_init().send()
        except (iox2.LoanError, iox2.RequestSendError) as error:
            raise TransferError(f"the channel 'admin' failed: {error}") from error
        while (response := self._received(pending)) is None:
            if time.monotonic() >= end:
                raise AdminTimeoutError(timeout_s)
            time.sleep(LOOK_EVERY_S)
        answer, text = response
        if answer.code == AdminCode.DONE:
            return answer, text
        robot = None if answer.robot == NO_ROBOT else answer.robot
        raise refusal(answer.code, robot, text.decode(errors="replace"))

    @staticmethod
    def _received(pending: object) -> tuple[AdminAnswer, bytes] | None:
        try:
            response = pending.receive()  # type: ignore[attr-defined]
        except iox2.ReceiveError as error:
            raise TransferError(f"the channel 'admin' failed: {error}") from error
        if response is None:
            return None
        answer = AdminAnswer.from_buffer_copy(response.user_header().contents)
        # The slice's own length counts bytes, which is right for text only.
        return answer, ctypes.string_at(response.payload_ptr, response.header.number_of_elements)
