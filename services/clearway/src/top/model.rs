//! What is known of a fleet: takes samples and answers in, is asked by the screen and by the JSON. It
//! does no input or output and reads no clock.

use clearway::attach::Status;
use clearway::channel::{Attached, Member};
use clearway::figures::LatencyHistogram;
use clearway::journal::StoppedBy;
use clearway::model::Obstacle;
use clearway::wire::{
    CommandHeader, RobotCommand, RobotState, RobotTelemetry, SolveStatus, StateHeader, StopReason,
    TelemetryHeader, admin_flags, state_flags,
};

use super::robot::Robot;
use super::times::{Measure, Times};

/// What the configuration in force says.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Law {
    /// Of which run.
    pub(crate) epoch: u64,
    pub(crate) profile: String,
    pub(crate) solver: String,
    /// Real-time policy.
    pub(crate) policy: String,
    pub(crate) scenario: String,
    pub(crate) obstacles: Vec<Obstacle>,
}

/// Samples of one channel in one run.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Seen {
    pub(crate) samples: u64,
    /// Ticks that are missing between samples.
    pub(crate) gaps: u64,
    last_tick: Option<u64>,
}

impl Seen {
    fn see(&mut self, tick: u64) -> u64 {
        let gap = self.last_tick.map_or(0, |last| tick.saturating_sub(last.saturating_add(1)));
        self.last_tick = Some(self.last_tick.map_or(tick, |last| last.max(tick)));
        self.samples += 1;
        self.gaps += gap;
        gap
    }
}

/// Counted since the monitor attached to this run.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Counters {
    /// Periods with a command that was not complete at the deadline.
    pub(crate) late: u64,
    pub(crate) skipped: u64,
    pub(crate) fallbacks: u64,
    /// Records that the daemon's telemetry lost.
    pub(crate) lost_records: u64,
    /// Samples of `telemetry` that this monitor was too slow for.
    pub(crate) dropped: u64,
    pub(crate) audited: u64,
    pub(crate) audit_disagreed: u64,
}

/// One run of the daemon, as far as it was watched.
#[derive(Debug)]
pub(crate) struct Run {
    pub(crate) epoch: u64,
    pub(crate) tick: u64,
    pub(crate) period_ns: u64,
    /// Stamp of the newest state.
    pub(crate) stamp_ns: u64,
    /// Stamp of the first state that was seen.
    pub(crate) since_ns: u64,
    /// Until when the newest commands hold.
    pub(crate) valid_until_ns: u64,
    /// Those present, in the order of the channel.
    pub(crate) robots: Vec<Robot>,
    pub(crate) times: Times,
    pub(crate) states: Seen,
    pub(crate) commands: Seen,
    pub(crate) telemetry: Seen,
    pub(crate) counters: Counters,
    /// Smallest clearance that telemetry reported, at the instants of the periods, m.
    pub(crate) clearance_m: f64,
    /// Corners of what robots and goals have taken up so far, m.
    pub(crate) extent_m: Option<([f64; 2], [f64; 2])>,
    places: Vec<Place>,
}

/// What the last samples said of a place of the fleet.
#[derive(Debug, Clone, Copy, Default)]
struct Place {
    command: Option<RobotCommand>,
    telemetry: Option<RobotTelemetry>,
}

impl Run {
    fn new(epoch: u64, empty: &LatencyHistogram) -> Self {
        Self {
            epoch,
            tick: 0,
            period_ns: 0,
            stamp_ns: 0,
            since_ns: 0,
            valid_until_ns: 0,
            robots: vec![],
            times: Times::new(empty),
            states: Seen::default(),
            commands: Seen::default(),
            telemetry: Seen::default(),
            counters: Counters::default(),
            clearance_m: f64::INFINITY,
            extent_m: None,
            places: vec![],
        }
    }

    /// Samples of `state` and `command` that were overwritten before they were read.
    pub(crate) fn overwritten(&self) -> u64 {
        let gaps = |seen: &Seen| seen.gaps.saturating_sub(self.counters.skipped);
        gaps(&self.states) + gaps(&self.commands)
    }

    fn include(&mut self, x_m: f64, y_m: f64) {
        if !(x_m.is_finite() && y_m.is_finite()) {
            return;
        }
        let (low, high) = self.extent_m.get_or_insert(([x_m, y_m], [x_m, y_m]));
        for (axis, value) in [x_m, y_m].into_iter().enumerate() {
            low[axis] = low[axis].min(value);
            high[axis] = high[axis].max(value);
        }
    }
}

/// Everything that is known.
#[derive(Debug)]
pub(crate) struct Model {
    pub(crate) fleet: String,
    /// Whether a daemon owns the fleet's channels.
    pub(crate) attached: bool,
    /// Since when there was nothing new, or since the monitor began.
    pub(crate) heard_ns: u64,
    /// Why channels cannot be read, if that has a reason beyond there being no daemon.
    pub(crate) trouble: Option<String>,
    pub(crate) run: Option<Run>,
    /// The last answer on `admin`.
    pub(crate) status: Option<Status>,
    /// Why there is no newer answer.
    pub(crate) unanswered: Option<String>,
    pub(crate) law: Option<Law>,
    pub(crate) ports: Option<Attached>,
    pub(crate) members: Vec<Member>,
    empty: LatencyHistogram,
}

impl Model {
    /// Nothing is known yet at `now_ns`.
    pub(crate) fn new(fleet: &str, empty: LatencyHistogram, now_ns: u64) -> Self {
        Self {
            fleet: fleet.to_owned(),
            attached: false,
            heard_ns: now_ns,
            trouble: None,
            run: None,
            status: None,
            unanswered: None,
            law: None,
            ports: None,
            members: vec![],
            empty,
        }
    }

    /// The run that a sample belongs to; `None` for one of an older run.
    fn enter(&mut self, epoch: u64) -> Option<&mut Run> {
        if self.run.as_ref().is_none_or(|run| run.epoch < epoch) {
            self.run = Some(Run::new(epoch, &self.empty));
            self.status = self.status.take().filter(|status| status.figures.epoch == epoch);
            self.law = self.law.take().filter(|law| law.epoch == epoch);
        }
        self.run.as_mut().filter(|run| run.epoch == epoch)
    }

    /// A sample of `state`.
    pub(crate) fn state(&mut self, header: &StateHeader, robots: &[RobotState]) {
        let Some(run) = self.enter(header.epoch) else { return };
        run.states.see(header.tick);
        if run.states.samples == 1 {
            run.since_ns = header.stamp_ns;
        }
        (run.tick, run.period_ns, run.stamp_ns) = (header.tick, header.period_ns, header.stamp_ns);
        run.places.resize(robots.len(), Place::default());
        run.robots.clear();
        for (state, place) in robots.iter().zip(&run.places) {
            if !state.has(state_flags::VACANT) {
                let telemetry = place.telemetry.filter(|telemetry| telemetry.id == state.id);
                let command = place.command.filter(|command| command.id == state.id);
                run.robots.push(Robot { state: *state, command, telemetry });
            }
        }
        for robot in robots.iter().filter(|robot| !robot.has(state_flags::VACANT)) {
            run.include(robot.x_m, robot.y_m);
            if !robot.has(state_flags::FOREIGN) {
                run.include(robot.goal_x_m, robot.goal_y_m);
            }
        }
        self.heard_ns = self.heard_ns.max(header.stamp_ns);
    }

    /// A sample of `command`.
    pub(crate) fn command(&mut self, header: &CommandHeader, robots: &[RobotCommand]) {
        let Some(run) = self.enter(header.epoch) else { return };
        run.commands.see(header.tick);
        run.valid_until_ns = header.valid_until_ns;
        run.places.resize(robots.len(), Place::default());
        for (place, command) in run.places.iter_mut().zip(robots) {
            place.command = Some(*command);
        }
    }

    /// A sample of `telemetry`.
    pub(crate) fn telemetry(&mut self, header: &TelemetryHeader, robots: &[RobotTelemetry]) {
        let Some(run) = self.enter(header.epoch) else { return };
        let first = run.telemetry.samples == 0;
        let gap = run.telemetry.see(header.tick);
        let counters = &mut run.counters;
        if !first {
            // Those of the first sample were before anybody watched.
            counters.skipped += header.skipped_periods;
            counters.lost_records += header.lost_records;
            counters.dropped +=
                gap.saturating_sub(header.skipped_periods.saturating_add(header.lost_records));
        }
        counters.fallbacks += header.fallback_commands;
        (counters.audited, counters.audit_disagreed) = (header.audited, header.audit_disagreed);
        let late = |robot: &RobotTelemetry| robot.stop_reason == StopReason::Deadline as u32;
        counters.late += u64::from(robots.iter().any(late));

        let at_ns = header.release_ns;
        let mut record = |what, ns| run.times.record(what, at_ns, ns);
        record(Measure::ReleaseLateness, header.release_lateness_ns);
        record(Measure::StatePublish, header.state_publish_ns);
        if header.state_to_staged_ns > 0 {
            record(Measure::StateToStaged, header.state_to_staged_ns);
        }
        record(Measure::StateToCommand, header.state_to_command_ns);
        for robot in robots.iter().filter(|robot| robot.status != SolveStatus::NotSolved as u32) {
            record(Measure::Solve, robot.solve_ns);
            record(Measure::Step, robot.step_ns);
        }

        run.places.resize(robots.len(), Place::default());
        for (place, telemetry) in run.places.iter_mut().zip(robots) {
            place.telemetry = Some(*telemetry);
            if telemetry.status != SolveStatus::NotSolved as u32 && telemetry.clearance_m.is_finite() {
                run.clearance_m = run.clearance_m.min(telemetry.clearance_m);
            }
        }
    }

    /// An answer on `admin`, or why there is none.
    pub(crate) fn answered(&mut self, answer: Result<Status, String>) {
        match answer {
            // One that is older than the samples is of a run that is over.
            Ok(status) if self.run.as_ref().is_some_and(|run| status.figures.epoch < run.epoch) => {}
            Ok(status) => (self.status, self.unanswered) = (Some(status), None),
            Err(why) => self.unanswered = Some(why),
        }
    }

    /// How old the newest state is, ns.
    pub(crate) fn age_ns(&self, now_ns: u64) -> u64 {
        let newest = self.run.as_ref().map_or(self.heard_ns, |run| run.stamp_ns);
        now_ns.saturating_sub(newest)
    }

    /// Whether states keep coming: one in the last second, or in the last four periods.
    pub(crate) fn is_live(&self, now_ns: u64) -> bool {
        let patience_ns = self.run.as_ref().map_or(0, |run| 4 * run.period_ns).max(1_000_000_000);
        self.attached && self.run.is_some() && self.age_ns(now_ns) <= patience_ns
    }

    /// What the fleet is told: by `state`, and by the operator's channel where nothing was seen yet.
    pub(crate) fn hold(&self) -> Option<&'static str> {
        let flagged = |flag| self.run.iter().flat_map(|run| &run.robots).any(|robot| robot.state.has(flag));
        if flagged(state_flags::STOPPED) {
            Some("STOPPED")
        } else {
            flagged(state_flags::PAUSED).then_some("PAUSED")
        }
    }

    /// What an operator should look at, the gravest first.
    pub(crate) fn alerts(&self, now_ns: u64) -> Vec<String> {
        let mut alerts = Vec::new();
        let ago = super::text::lasted(self.age_ns(now_ns));
        alerts.extend(self.trouble.clone());
        if !self.attached {
            let run = if self.run.is_some() { "the daemon has ended; " } else { "" };
            alerts.push(format!("{run}waiting for a daemon of this fleet ({ago})"));
        } else if !self.is_live(now_ns) {
            alerts.push(format!("no state for {ago}: the daemon is stopped, or was killed"));
        }
        if self.clearance_m().is_some_and(|clearance_m| clearance_m < clearway::figures::VIOLATION_M) {
            alerts.push("CLEARANCE VIOLATED".to_owned());
        }
        if let (true, Some(why)) = (self.attached, &self.unanswered) {
            alerts.push(format!("admin: {why}"));
        }
        if let Some(status) = &self.status {
            let figures = &status.figures;
            match status.stopped_at_start() {
                Some(StoppedBy::Restarts) => {
                    alerts.push(format!(
                        "STOPPED: restarted after a crash {} times; clear, then resume",
                        figures.restarts
                    ));
                }
                Some(_) => {
                    alerts.push("STOPPED: the journal could not be read; clear, then resume".to_owned());
                }
                None => {}
            }
            if figures.has(admin_flags::JOURNAL_FAILING) {
                alerts.push("the journal cannot be written: orders do not survive a restart".to_owned());
            }
            if figures.workers_silent > 0 {
                alerts.push(format!("{} workers are silent", figures.workers_silent));
            }
            if figures.worker_panics > 0 {
                alerts.push(format!("{} worker panics", figures.worker_panics));
            }
            if let Some(line) = status.degraded.first() {
                alerts.push(format!("DEGRADED: {line}"));
            }
        }
        if let Some(run) = self.run.as_ref().filter(|run| run.counters.dropped > 0) {
            alerts.push(format!("this monitor missed {} telemetry samples", run.counters.dropped));
        }
        alerts
    }

    /// Smallest clearance, m: over continuous time and since the start where the daemon answers, at the
    /// periods since the monitor attached where it does not.
    pub(crate) fn clearance_m(&self) -> Option<f64> {
        let told = self.status.as_ref().map(|status| status.figures.min_clearance_m);
        told.or(self.run.as_ref().map(|run| run.clearance_m)).filter(|clearance_m| clearance_m.is_finite())
    }
}
