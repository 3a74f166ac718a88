"""The gate does what the daemon's own gate does."""

import math
import unittest

import numpy as np

from clearway import Gate, Holding, Refusal, StopReason
from clearway.layout import CommandHeader, RobotCommand


def header(epoch, tick, **more):
    return CommandHeader(
        **{
            "epoch": epoch,
            "tick": tick,
            "valid_from_ns": tick * 100,
            "valid_until_ns": (tick + 1) * 100,
            "follows": max(tick - 1, 0),
            **more,
        }
    )


def go(v_mps, robot=3, omega_radps=0.0, stop_reason=0):
    return np.array([(robot, stop_reason, v_mps, omega_radps)], RobotCommand.dtype())[0]


def stop(reason):
    return go(0.0, stop_reason=int(reason))


def held(gate, epoch, tick):
    """The first stop of a run, after which commands may move the robot."""
    begun = header(epoch, tick, valid_until_ns=tick * 100 + 1)
    assert gate.offer(begun, stop(StopReason.START), 0) is None


class TheGate(unittest.TestCase):
    def setUp(self):
        # It holds the stop of tick 4 of epoch 1.
        self.gate = Gate(3, max_hold_ns=1000)
        held(self.gate, 1, 4)

    def test_acts_inside_its_validity_and_stops_outside(self):
        self.assertIsNone(self.gate.offer(header(1, 5), go(2.0), 420))
        for now, v_mps in [(420, 0.0), (499, 0.0), (500, 2.0), (599, 2.0), (600, 0.0), (10_000, 0.0)]:
            self.assertEqual(self.gate.input(now), (v_mps, 0.0), now)

    def test_the_next_command_waits_for_its_time(self):
        self.gate.offer(header(1, 5), go(2.0), 420)
        self.assertEqual(self.gate.input(510), (2.0, 0.0))
        self.gate.offer(header(1, 6), go(3.0), 580)
        self.assertEqual(self.gate.input(599), (2.0, 0.0))
        self.assertEqual(self.gate.next_change_ns(599), 600)
        self.assertEqual(self.gate.input(600), (3.0, 0.0))
        self.assertEqual(self.gate.input(700), (0.0, 0.0))
        self.assertIsNone(self.gate.next_change_ns(700))

    def test_a_stop_that_acts_at_once_wins(self):
        self.gate.offer(header(1, 5), go(2.0), 420)
        self.gate.offer(header(1, 6), go(2.0), 520)
        self.gate.offer(header(1, 7, valid_from_ns=530, valid_until_ns=800), go(0.0), 530)
        self.assertEqual((self.gate.input(530), self.gate.input(610)), ((0.0, 0.0), (0.0, 0.0)))

    def test_every_refusal(self):
        held(self.gate, 2, 4)
        self.gate.offer(header(2, 5), go(2.0), 420)
        cases = [
            (header(2, 6), go(1.0, robot=4), 420, Refusal.WRONG_ROBOT),
            (header(1, 9), go(1.0), 420, Refusal.OLD_EPOCH),
            (header(2, 5), go(1.0), 420, Refusal.OLD_TICK),
            (header(2, 4), go(1.0), 420, Refusal.OLD_TICK),
            (header(2, 6, valid_until_ns=1), go(1.0), 420, Refusal.VALIDITY),
            (header(2, 6, valid_until_ns=2**64 - 1), go(1.0), 420, Refusal.VALIDITY),
            (header(2, 6, state_stamp_ns=401, stamp_ns=400), go(1.0), 420, Refusal.VALIDITY),
            (header(2, 6, state_stamp_ns=601, stamp_ns=601), go(1.0), 620, Refusal.VALIDITY),
            (header(2, 6, stamp_ns=1421, valid_from_ns=1500, valid_until_ns=1600), go(1.0), 420, Refusal.FUTURE),
            (header(2, 6, valid_from_ns=2421, valid_until_ns=2500), go(1.0), 420, Refusal.FUTURE),
            (header(2, 6), go(1.0, stop_reason=7), 420, Refusal.INPUT),
            (header(2, 6), go(1.0), 700, Refusal.EXPIRED),
            (header(2, 6), go(1.0), 601, Refusal.LATE),
            (header(2, 7), go(1.0), 601, Refusal.OUT_OF_STEP),
            (header(3, 6), go(1.0), 420, Refusal.OUT_OF_STEP),
            (header(2, 6), go(math.nan), 420, Refusal.INPUT),
            (header(2, 6), go(5.1), 420, Refusal.INPUT),
            (header(2, 6), go(1.0, omega_radps=-math.inf), 420, Refusal.INPUT),
        ]
        for head, command, now, refusal in cases:
            self.assertIs(self.gate.offer(head, command, now), refusal)
        self.assertEqual(self.gate.refused, len(cases))
        self.assertEqual({refusal for *_, refusal in cases}, set(Refusal))
        self.assertEqual(self.gate.input(550), (2.0, 0.0))

    def test_a_new_epoch_starts_over(self):
        self.gate.offer(header(1, 5), go(2.0), 420)
        self.assertEqual(self.gate.input(550), (2.0, 0.0))
        held(self.gate, 2, 6)
        self.assertEqual(self.gate.input(560), (0.0, 0.0))
        self.assertIsNone(self.gate.offer(header(2, 7), go(1.0), 570))
        self.assertEqual(self.gate.input(700), (1.0, 0.0))
        self.assertIs(self.gate.offer(header(1, 99), go(1.0), 700), Refusal.OLD_EPOCH)

    def test_a_robot_that_missed_a_command_stands_until_it_has_held_a_stop(self):
        gate = self.gate
        self.assertIsNone(gate.offer(header(1, 5), go(1.0), 420))
        self.assertEqual(gate.holding(420), Holding.command(5))
        # Tick 6 is lost: 7 and 8 were computed for a robot that had driven it.
        self.assertIs(gate.offer(header(1, 7), go(1.0), 620), Refusal.OUT_OF_STEP)
        self.assertIs(gate.offer(header(1, 8), go(1.0), 720), Refusal.OUT_OF_STEP)
        self.assertEqual((gate.input(650), gate.holding(720)), ((0.0, 0.0), Holding.command(5)))
        # Until the stop acts nobody may rely on where it is.
        self.assertIsNone(gate.offer(header(1, 9), stop(StopReason.OUT_OF_STEP), 820))
        self.assertEqual((gate.holding(820), gate.holding(899)), (Holding.NOTHING, Holding.NOTHING))
        self.assertEqual((gate.input(910), gate.holding(910)), ((0.0, 0.0), Holding.command(9)))
        self.assertIsNone(gate.offer(header(1, 10), go(1.0), 920))
        self.assertEqual((gate.input(1050), gate.holding(920)), ((1.0, 0.0), Holding.command(10)))

    def test_a_command_that_comes_as_its_time_begins_is_followed_and_later_it_is_missed(self):
        other = Gate(3, max_hold_ns=1000)
        held(other, 1, 4)
        self.assertIsNone(other.offer(header(1, 5), go(1.0), 500))
        self.assertIs(self.gate.offer(header(1, 5), go(1.0), 501), Refusal.LATE)
        self.assertIs(self.gate.offer(header(1, 6), go(1.0), 510), Refusal.OUT_OF_STEP)
        # However late, a stop is a stop.
        self.assertIsNone(self.gate.offer(header(1, 5), go(0.0), 510))

    def test_a_command_that_is_taken_while_the_one_before_still_waits_does_not_replace_it(self):
        gate = self.gate
        self.assertIsNone(gate.offer(header(1, 5), go(1.0), 420))
        # The clock was read at 499, and the sample came at 505.
        self.assertIsNone(gate.offer(header(1, 6, stamp_ns=504), go(2.0), 499))
        changes = [(now, gate.input(now)[0], gate.next_change_ns(now)) for now in (499, 500, 599, 600, 700)]
        self.assertEqual(
            changes, [(499, 0.0, 500), (500, 1.0, 600), (599, 1.0, 600), (600, 2.0, 700), (700, 0.0, None)]
        )
        # One that acts at once comes before all that wait.
        self.assertIsNone(gate.offer(header(1, 7, follows=6), go(1.0), 700))
        self.assertIsNone(gate.offer(header(1, 8), go(1.0), 700))
        self.assertIsNone(gate.offer(header(1, 9, valid_from_ns=710, valid_until_ns=900), stop(7), 710))
        self.assertEqual([gate.input(now)[0] for now in (705, 710, 750, 850)], [1.0, 0.0, 0.0, 0.0])

    def test_one_that_waits_is_driven_until_the_next_begins(self):
        gate = self.gate
        gate.offer(header(1, 5), go(1.0), 420)
        gate.offer(header(1, 6, valid_from_ns=550, valid_until_ns=650), stop(2), 430)
        self.assertEqual([gate.input(now)[0] for now in (510, 549, 550, 649)], [1.0, 1.0, 0.0, 0.0])

    def test_of_three_that_wait_none_is_dropped_while_the_robot_drives_on(self):
        gate = self.gate
        gate.offer(header(1, 5), go(1.0), 420)
        gate.offer(header(1, 6), go(1.0), 420)
        gate.offer(header(1, 9), stop(8), 430)
        self.assertEqual((gate.input(550), gate.input(650)), ((0.0, 0.0), (0.0, 0.0)))
        self.assertEqual(gate.holding(650), Holding.NOTHING)

    def test_commands_follow_each_other_over_periods_that_the_daemon_skipped(self):
        self.gate.offer(header(1, 5), go(1.0), 420)
        self.assertIsNone(self.gate.offer(header(1, 9, follows=5), go(2.0), 820))
        self.assertEqual((self.gate.input(750), self.gate.input(950)), ((0.0, 0.0), (2.0, 0.0)))

    def test_a_robot_that_stopped_by_itself_follows_nothing_until_it_has_held_a_stop(self):
        gate = self.gate
        gate.offer(header(1, 5), go(1.0), 420)
        gate.offer(header(1, 6), go(1.0), 520)
        gate.halt()
        self.assertEqual((gate.input(550), gate.input(650)), ((0.0, 0.0), (0.0, 0.0)))
        self.assertEqual(gate.holding(650), Holding.NOTHING)
        self.assertIs(gate.offer(header(1, 7), go(1.0), 620), Refusal.OUT_OF_STEP)
        # Stops for other reasons come from a daemon that takes it to be elsewhere.
        for tick, reason in ((8, StopReason.DEADLINE), (9, StopReason.NO_STATE), (10, StopReason.START)):
            self.assertIsNone(gate.offer(header(1, tick), stop(reason), tick * 100 - 80))
            self.assertIs(gate.offer(header(1, tick + 1), go(1.0), tick * 100 + 20), Refusal.OUT_OF_STEP)
            self.assertEqual(gate.holding(tick * 100), Holding.NOTHING)
        self.assertIsNone(gate.offer(header(1, 11), stop(StopReason.OUT_OF_STEP), 1080))
        self.assertEqual((gate.holding(1099), gate.holding(1100)), (Holding.NOTHING, Holding.command(11)))
        self.assertIsNone(gate.offer(header(1, 12), go(1.0), 1120))
        self.assertEqual((gate.input(1250), gate.holding(1250)), ((1.0, 0.0), Holding.command(12)))

    def test_a_robot_of_which_nobody_tells_what_it_holds_follows_whatever_comes(self):
        gate = Gate(3, max_hold_ns=1000, unreported=True)
        self.assertIsNone(gate.offer(header(1, 5), go(1.0), 550))
        self.assertEqual((gate.input(550), gate.holding(550)), ((1.0, 0.0), Holding.UNTOLD))
        self.assertIsNone(gate.offer(header(1, 9), go(2.0), 820))
        self.assertEqual(gate.input(950), (2.0, 0.0))

    def test_who_joins_a_run_that_goes_on_waits_until_the_daemon_knows(self):
        gate = Gate(3, max_hold_ns=1000)
        self.assertIsNone(gate.offer(header(1, 5), stop(StopReason.DEADLINE), 420))
        self.assertIs(gate.offer(header(1, 6), go(1.0), 520), Refusal.OUT_OF_STEP)
        self.assertEqual(gate.holding(520), Holding.NOTHING)
        self.assertIsNone(gate.offer(header(1, 7), stop(StopReason.OUT_OF_STEP), 620))
        self.assertEqual((gate.holding(699), gate.holding(700)), (Holding.NOTHING, Holding.command(7)))
        self.assertIsNone(gate.offer(header(1, 8), go(1.0), 720))

    def test_codes_tell_ticks_apart_and_from_no_command(self):
        code = Holding.command
        self.assertEqual((int(Holding.UNTOLD), int(Holding.NOTHING)), (0, 1))
        self.assertEqual((code(0), code(1), code(7)), (0x8000_0000, 0x8000_0001, 0x8000_0007))
        # Period numbers run on past what the code has room for.
        self.assertEqual((code(2**64 - 1), code(2**31)), (2**32 - 1, code(0)))
        self.assertEqual(Gate(3, max_hold_ns=1000).holding(0), Holding.NOTHING)
