"""An operator's requests to a real daemon."""

import signal

import clearway
from clearway import AdminFlags, StateFlags, StopReason, refusals

from .world import PATIENCE_S, WorldTestCase, until


class Admin(WorldTestCase):
    def start_fleet(self, *settings: str):
        self.running = self.daemon("--set", "admin.capacity=9", "--set", "source.arena_m=100", *settings)
        self.client = self.attach()
        self.admin = self.client.admin
        self.admin.timeout_s = 60.0

    def state_of(self, tick: int):
        """The first state from a tick on."""
        return until(lambda: (s := self.client.states.next()) and s.header.tick >= tick and s).robots.copy()

    def test_goals_are_set_together_or_not_at_all(self):
        self.start_fleet()
        done = self.admin.set_goal(3, 20.0, -5.5)
        robots = self.state_of(done.acts_from_tick - 1)
        self.assertEqual((robots[3]["goal_x_m"], robots[3]["goal_y_m"]), (20.0, -5.5))
        done = self.admin.set_goals({0: (30.0, 1.0), 1: (30.0, -1.0)})
        robots = self.state_of(done.acts_from_tick - 1)
        self.assertEqual(robots["goal_x_m"][:2].tolist(), [30.0, 30.0])
        with self.assertRaises(refusals.GoalTakenError) as refused:
            self.admin.set_goals([(0, 10.0, 1.0), (1, 20.0, -5.5)])
        self.assertIn(refused.exception.robot, (1, 3))
        self.assertEqual(self.admin.set_goal(3, 20.0, -5.5).epoch, done.epoch)
        tick = self.client.states.wait(PATIENCE_S).header.tick
        self.assertEqual(self.state_of(tick)["goal_x_m"][:2].tolist(), [30.0, 30.0])
        self.assertEqual(self.stop(self.running)["violations"], 0)

    def test_refusals_are_exceptions_with_the_daemons_reason(self):
        self.start_fleet()
        cases = [
            (lambda: self.admin.set_goal(99, 0.0, 0.0), refusals.UnknownRobotError, 99, "no robot 99"),
            (lambda: self.admin.set_goal(3, float("nan"), 0.0), refusals.NotFiniteError, 3, "finite"),
            (lambda: self.admin.set_goal(3, 101.0, 0.0), refusals.OutsideArenaError, 3, "arena"),
            (lambda: self.admin.set_goals([(3, 9, 9), (3, 8, 8)]), refusals.RepeatedRobotError, 3, "twice"),
            (lambda: self.admin.set_goals([]), refusals.MalformedError, None, ""),
            (lambda: self.admin.remove_robot(99), refusals.UnknownRobotError, 99, "no robot 99"),
        ]
        for request, kind, robot, words in cases:
            with self.assertRaises(kind) as refused:
                request()
            self.assertIsInstance(refused.exception, clearway.RefusedError)
            self.assertEqual(refused.exception.robot, robot)
            self.assertIn(words, refused.exception.text)
        self.assertEqual(self.admin.status().figures.requests_refused, len(cases))

    def test_pause_stop_clear_and_resume(self):
        self.start_fleet()
        held = self.admin.pause()
        self.assertTrue((self.state_of(held.acts_from_tick - 1)["flags"][:8] & StateFlags.PAUSED).all())
        command = until(
            lambda: (c := self.client.commands.next()) and c.header.tick >= held.acts_from_tick and c
        )
        self.assertEqual(set(command.robots["stop_reason"][:8]), {StopReason.PAUSED})
        self.assertTrue(self.admin.status().is_paused)
        self.admin.stop()
        with self.assertRaises(refusals.StoppedError):
            self.admin.resume()
        self.assertTrue(self.admin.status().is_stopped)
        self.admin.clear()
        status = self.admin.status()
        self.assertEqual((status.is_stopped, status.is_paused), (False, True))
        driven = self.admin.resume()
        self.assertFalse((self.state_of(driven.acts_from_tick - 1)["flags"][:8] & StateFlags.PAUSED).any())

    def test_robots_come_and_go(self):
        self.start_fleet()
        self.assertEqual(len(self.client.states.wait(PATIENCE_S).present()), 8)
        place = {"radius_m": 0.2, "start": (-30.0, -9.0, 1.0), "goal": (-30.0, 9.0)}
        done = self.admin.add_robot(12, **place)
        robots = self.state_of(done.acts_from_tick - 1)
        self.assertEqual((robots[8]["id"], robots[8]["radius_m"], robots[8]["goal_y_m"]), (12, 0.2, 9.0))
        with self.assertRaises(refusals.TakenIdError):
            self.admin.add_robot(12, **place)
        with self.assertRaises(refusals.FullError):
            self.admin.add_robot(13, **{**place, "start": (-40.0, 0.0, 0.0), "goal": (-40.0, 1.0)})
        done = self.admin.remove_robot(12)
        robots = self.state_of(done.acts_from_tick - 1)
        self.assertEqual((robots[8]["id"], robots[8]["flags"]), (clearway.NO_ROBOT, StateFlags.VACANT))
        self.assertEqual(self.stop(self.running)["violations"], 0)

    def test_status_configuration_and_scenario(self):
        self.start_fleet()
        status = until(lambda: (s := self.admin.status()).figures.periods > 0 and s)
        self.assertEqual((status.figures.robots, status.figures.capacity), (8, 9))
        self.assertEqual(status.figures.period_ns, 10_000_000)
        self.assertEqual(len(status.degraded), status.figures.degraded)
        self.assertEqual(bool(status.degraded), bool(status.flags & AdminFlags.DEGRADED))
        self.assertFalse(status.flags & AdminFlags.OBSERVED)
        self.assertIn("period_us = 10000", self.admin.configuration())
        self.assertEqual(self.admin.scenario().count("[[robot]]"), 8)

    def test_a_long_text_comes_in_pieces(self):
        self.daemon("--scenario", "circle-200", period_us=80_000)
        admin = self.attach().admin
        admin.timeout_s = 60.0
        text = admin.scenario()
        self.assertGreater(len(text), 16 * 1024)
        self.assertEqual(text.count("[[robot]]"), 200)

    def test_a_long_text_is_that_of_one_moment(self):
        self.daemon("--scenario", "circle-200", "--set", "source.arena_m=100", period_us=80_000)
        admin, other = self.attach().admin, self.attach().admin
        admin.timeout_s = other.timeout_s = 60.0
        ask, pieces = admin._ask, []

        def ask_while_the_fleet_changes(kind, *rest, **where):
            answered = ask(kind, *rest, **where)
            pieces.append(answered)
            # The first robot and the last one move together.
            apart = float(len(pieces))
            other.set_goals({0: (60.0, apart), 199: (70.0, apart)})
            other.scenario()
            return answered

        before = admin.scenario()
        admin._ask = ask_while_the_fleet_changes
        self.assertEqual(admin.scenario(), before)
        self.assertGreater(len(pieces), 1)
        admin._ask = ask
        after = admin.scenario()
        moved = f"y_m = {float(len(pieces))}"
        self.assertEqual((after.count("x_m = 60.0, " + moved), after.count("x_m = 70.0, " + moved)), (1, 1))

    def test_a_text_that_is_put_away_is_read_from_its_beginning(self):
        self.start_fleet()
        ask, refused = self.admin._ask, []

        def ask_in_vain(kind, robots=None, offset=0, epoch=0):
            answer, text = ask(kind, robots)
            if offset > 0:
                refused.append(offset)
                raise refusals.BusyError(clearway.AdminCode.BUSY, None, "not kept any more")
            answer.text_bytes = len(text) + 1
            return answer, text

        self.admin._ask = ask_in_vain
        with self.assertRaises(clearway.InterruptedReadError):
            self.admin.scenario()
        self.assertEqual(len(refused), 8)

    def test_what_is_not_answered_in_time_is_not_carried_out_later(self):
        self.start_fleet()
        self.running.send_signal(signal.SIGSTOP)
        self.admin.timeout_s = 0.1
        with self.assertRaises(clearway.AdminTimeoutError) as timeout:
            self.admin.pause()
        self.assertIsInstance(timeout.exception, TimeoutError)
        self.running.send_signal(signal.SIGCONT)
        self.admin.timeout_s = 60.0
        # What was asked before has had its turn when this is answered, and its time to act after that.
        tick = self.admin.status().figures.tick
        status = until(lambda: (s := self.admin.status()).figures.tick > tick + 20 and s)
        self.assertFalse(status.is_paused)
        self.assertFalse((self.state_of(tick + 20)["flags"] & StateFlags.PAUSED).any())

    def test_a_wait_has_to_be_possible(self):
        self.start_fleet()
        for timeout_s in (0.0, -1.0, 61.0, float("nan"), float("inf")):
            with self.assertRaises(ValueError):
                self.admin.timeout_s = timeout_s
        self.assertEqual(self.admin.timeout_s, 60.0)
