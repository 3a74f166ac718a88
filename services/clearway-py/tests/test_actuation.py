"""The gate does what the daemon's own gate does."""

import math
import unittest

import numpy as np

from clearway import Gate, Refusal
from clearway.layout import CommandHeader, RobotCommand


def header(epoch, tick, **more):
    return CommandHeader(
        **{
            "epoch": epoch,
            "tick": tick,
            "valid_from_ns": tick * 100,
            "valid_until_ns": (tick + 1) * 100,
            **more,
        }
    )


def go(v_mps, robot=3, omega_radps=0.0, stop_reason=0):
    return np.array([(robot, stop_reason, v_mps, omega_radps)], RobotCommand.dtype())[0]


class TheGate(unittest.TestCase):
    def setUp(self):
        self.gate = Gate(3, max_hold_ns=1000)

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
        self.gate.offer(header(2, 0, valid_from_ns=0, valid_until_ns=100), go(1.0), 50)
        self.assertEqual(self.gate.input(60), (1.0, 0.0))
        self.assertIs(self.gate.offer(header(1, 99), go(1.0), 60), Refusal.OLD_EPOCH)
