use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::Ordering;

use super::board::{Board, Released};
use super::decider::Decider;
use super::event_count::Waiting;
use crate::cache;
use crate::channel::{Received, StateReader};
use crate::clock::Clock;
use crate::config::Wakeup;
use crate::controller::{Decision, Remembered};
use crate::telemetry::{Pool, SolveRecord};
use crate::wire::{RobotCheckpoint, RobotState, RobotTelemetry};

/// Panics after which a worker goes on at once. What fails more often is not an accident: it rests.
const RESTARTS_MAX: u64 = 3;
/// The first rest, in periods; each one that follows is twice as long, up to the longest.
const REST_PERIODS: u64 = 16;
const REST_PERIODS_MAX: u64 = 1024;
/// Periods in a row without a panic after which earlier ones are forgiven.
const FORGIVEN_AFTER: u64 = 1000;

/// How often a worker has failed lately.
#[derive(Debug, Default)]
struct Lapses {
    panics: u64,
    clean: u64,
}

impl Lapses {
    /// A period that was worked through; whether earlier panics are forgiven with it.
    fn clean(&mut self) -> bool {
        self.clean += 1;
        let forgiven = self.panics > 0 && self.clean >= FORGIVEN_AFTER;
        if forgiven {
            *self = Self::default();
        }
        forgiven
    }

    /// A panic; for how many periods the worker rests.
    ///
    /// Nobody takes its robots over meanwhile: what made it panic may lie in what one of them does, and
    /// would then bring down one worker after the other.
    fn panic(&mut self) -> u64 {
        *self = Self { panics: self.panics.saturating_add(1), clean: 0 };
        match self.panics.checked_sub(RESTARTS_MAX + 1) {
            None => 0,
            Some(again) => REST_PERIODS << again.min(u64::from((REST_PERIODS_MAX / REST_PERIODS).ilog2())),
        }
    }
}

/// What a worker keeps from period to period.
#[derive(Debug)]
pub(super) struct Shift<D> {
    /// None when it could not be made anew.
    decider: Option<D>,
    /// It rests until this tick.
    rests_until: Option<u64>,
    /// The tick that was worked through last.
    known: Option<u64>,
    lapses: Lapses,
}

impl<D> Shift<D> {
    pub(super) fn new(first: D) -> Self {
        Self { decider: Some(first), rests_until: None, known: None, lapses: Lapses::default() }
    }
}

/// One worker: the robots of `owned`, which nobody else touches, or those of its region and what the others have not
/// come to.
pub(super) struct Worker<C: Clock> {
    pub(super) index: usize,
    pub(super) wakeup: Wakeup,
    /// When the next period is to be released, ns.
    pub(super) due_ns: u64,
    pub(super) owned: Range<usize>,
    pub(super) robots: usize,
    pub(super) epoch: u64,
    pub(super) clock: C,
    pub(super) states: StateReader,
    pub(super) board: Arc<Board>,
    pub(super) records: Arc<Pool<SolveRecord>>,
}

impl<C: Clock> Worker<C> {
    /// Works until the run is over. `make` builds the controller, again after a panic.
    ///
    /// Sleeps between periods: no lock, no allocation, and a wake-up for no reason only looks at the
    /// board again.
    pub(super) fn run<D: Decider>(&mut self, first: D, make: impl Fn() -> Option<D>) {
        let mut shift = Shift::new(first);
        loop {
            let count = self.board.releases.count();
            match self.turn(&mut shift, &make) {
                Released::Over => return,
                Released::Tick(_) => {}
                Released::Nothing => {
                    let waiting = Waiting::new(self.wakeup, self.index, self.due_ns);
                    self.board.releases.wait(&self.clock, waiting, count, u64::MAX);
                }
            }
        }
    }

    /// Works through the period that runs, if it is a new one; what it found.
    pub(super) fn turn<D: Decider>(
        &mut self,
        shift: &mut Shift<D>,
        make: impl Fn() -> Option<D>,
    ) -> Released {
        let found = self.board.released(shift.known);
        let Released::Tick(tick) = found else { return found };
        shift.known = Some(tick);
        if shift.rests_until.is_some_and(|until| tick < until) {
            self.board.done(tick);
            return found;
        }
        if shift.rests_until.take().is_some() {
            self.board.rest(self.index, false);
        }
        // The decider is thrown away after a panic, so nobody sees it half changed.
        let worked = shift
            .decider
            .as_mut()
            .map(|current| catch_unwind(AssertUnwindSafe(|| self.period(tick, current))).is_ok());
        if worked == Some(true) {
            self.board.done(tick);
            if shift.lapses.clean() {
                self.board.regions.reserve(self.index, false);
            }
            return found;
        }
        let panicked = worked == Some(false);
        if panicked {
            self.board.regions.reserve(self.index, true);
            self.board.worker_panics.fetch_add(1, Ordering::Relaxed);
        }
        // Before it is done, which costs this period the time it takes: it brings back what the panic took, for
        // whoever claims it in the next one. What could not be made the last time is tried again.
        shift.decider = make();
        self.board.done(tick);
        if panicked || shift.decider.is_none() {
            self.rest(shift, tick);
        }
        found
    }

    /// After a failure in `tick`: rests, if it fails often.
    fn rest<D>(&self, shift: &mut Shift<D>, tick: u64) {
        let periods = shift.lapses.panic();
        if periods > 0 {
            shift.rests_until = Some(tick.saturating_add(1 + periods));
            self.board.rest(self.index, true);
        }
    }

    /// One period: from the state in shared memory to the staged commands.
    #[cfg_attr(clearway_rtsan, sanitize(realtime = "nonblocking"))]
    pub(super) fn period<D: Decider>(&mut self, tick: u64, decider: &mut D) {
        let corrupt = self.states.corrupt();
        // Without the state of this very period there is nothing to stage, and the robots stop.
        let Ok(Some(sample)) = self.states.newest() else {
            if self.states.corrupt() > corrupt {
                self.board.found_corrupt(tick);
            }
            return;
        };
        let header = *sample.header();
        if header.epoch != self.epoch || header.tick != tick || sample.robots().len() != self.robots {
            return;
        }
        self.due_ns = header.release_ns.saturating_add(header.period_ns);
        let clock = &self.clock;
        let since_state = || clock.now_ns().saturating_sub(header.stamp_ns);
        let state_to_worker_ns = since_state();
        let recorded = self.records.write(|record| {
            record.tick = tick;
            record.state_to_worker_ns = state_to_worker_ns;
            let (robots, checkpoints) = (&mut record.robots, &mut record.checkpoints);
            robots.clear();
            checkpoints.clear();
            // Lists have room for any region, and never grow here.
            let mut remember = |index, remembered: &Remembered| {
                if checkpoints.len() < checkpoints.capacity() {
                    expect_next(checkpoints);
                    checkpoints.push((index, RobotCheckpoint::default()));
                    if let Some((_, checkpoint)) = checkpoints.last_mut() {
                        remembered.write(checkpoint);
                    }
                }
            };
            self.decide(tick, decider, sample.robots(), &mut remember, |index, telemetry| {
                if robots.len() < robots.capacity() {
                    expect_next(robots);
                    robots.push((index, *telemetry));
                }
            });
            if self.was_struck(tick, &sample) {
                checkpoints.drain(..).for_each(|(index, before)| decider.undo(index, tick, &before));
                robots.clear();
            }
            record.state_to_staged_ns = since_state();
        });
        if !recorded {
            // What is to be undone goes with the record.
            self.decide(tick, decider, sample.robots(), &mut |_, _| {}, |_, _| {});
            self.was_struck(tick, &sample);
        }
    }

    /// Whether somebody wrote over the state while it was answered: what was decided may be of a fleet that
    /// never was, and nobody acts on it.
    fn was_struck(&self, tick: u64, sample: &Received<RobotState>) -> bool {
        let struck = !sample.is_intact();
        if struck {
            self.board.found_struck(tick);
        }
        struck
    }

    fn decide<D: Decider>(
        &self,
        tick: u64,
        decider: &mut D,
        fleet: &[RobotState],
        remember: &mut dyn FnMut(usize, &Remembered),
        mut tell: impl FnMut(usize, &RobotTelemetry),
    ) {
        let regional = decider.is_regional();
        let mut each = |index: usize, decision: &Decision| {
            // A slot has one writer: the worker that owns the robot, or has its controller.
            if regional || self.owned.contains(&index) {
                self.board.staging.put(index, tick, &decision.command, &decision.intent);
                tell(index, &decision.telemetry);
            }
        };
        if regional {
            let regions = &self.board.regions;
            // As many as a record has room for, which is more than its own region.
            let mut room = regions.room();
            let mut parts = || {
                let part = regions.claim(self.index, tick, room)?;
                room = room.saturating_sub(part.len());
                Some(part)
            };
            let mut remember = |index: usize, remembered: &Remembered| {
                self.board.staging.expect(index);
                remember(index, remembered);
            };
            decider.decide_parts((tick, &mut parts), fleet, &mut remember, &mut each);
        } else {
            decider.checkpoint(remember);
            decider.decide(fleet, &mut each);
        }
    }
}

/// Says that what comes after the next element will be written soon.
fn expect_next<T>(list: &mut Vec<T>) {
    if let Some(place) = list.spare_capacity_mut().get(1) {
        cache::expect(place);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rare_panics_are_forgiven_and_frequent_ones_are_not() {
        let mut rare = Lapses::default();
        for _ in 0..20 {
            assert_eq!(rare.panic(), 0);
            assert_eq!((0..FORGIVEN_AFTER).filter(|_| rare.clean()).count(), 1);
        }
        let mut frequent = Lapses::default();
        for _ in 0..RESTARTS_MAX {
            assert_eq!(frequent.panic(), 0);
            assert!((1..FORGIVEN_AFTER).all(|_| !frequent.clean()));
        }
        // Longer every time, and never for ever.
        let rests: Vec<u64> = (0..9).map(|_| frequent.panic()).collect();
        assert_eq!(rests, [16, 32, 64, 128, 256, 512, 1024, 1024, 1024]);
        assert!((1..FORGIVEN_AFTER).all(|_| !frequent.clean()) && frequent.clean());
        assert_eq!(frequent.panic(), 0);
    }
}
