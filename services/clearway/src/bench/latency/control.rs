//! State → command: the daemon's own loop and workers in this process, a reader in another one.

use std::ops::Range;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use clearway::channel::CommandReader;
use clearway::clock::{Clock, MonotonicClock};
use clearway::config::{Config, PublishAt, RealTimeConfig, Wakeup};
use clearway::controller::{ControllerError, Decision, Remembered, RobotGroup};
use clearway::figures::LatencyHistogram;
use clearway::report::Report;
use clearway::runtime::{Daemon, Decider, Until};
use clearway::scenario::Scenario;
use clearway::wire::{CommandHeader, RobotState, StopReason};
use miette::{IntoDiagnostic, Result};
use serde::{Deserialize, Serialize};

use super::CONTROL_FLEET;
use super::child::{Child, Findings, Role, Task, say_ready};
use super::plan::{Seats, duration, enter_real_time};
use super::world::{Interrupt, World};

/// The reader polls from this long before a command can come, ns; at most a quarter of the period.
const POLL_LEAD_NS: u64 = 100_000;
/// Speed of the robots, m/s; the way is made as long as they drive in the time of the run.
const SPEED_MPS: f64 = 5.0;

/// What is to be measured.
#[derive(Debug, Clone, Copy)]
pub(super) struct Setting {
    pub(super) period_ns: u64,
    pub(super) samples: u64,
    pub(super) priority: u8,
    pub(super) wakeup: Wakeup,
    pub(super) publish: PublishAt,
}

/// What was.
#[derive(Debug)]
pub(super) struct Controlled {
    /// Stamp of the state → another process has the commands.
    pub(super) state_to_command: LatencyHistogram,
    /// Stamp of the commands → another process has them.
    pub(super) command_to_reader: LatencyHistogram,
    /// A worker's whole decision, all of its robots.
    pub(super) step: LatencyHistogram,
    /// Commands that the reader did not see.
    pub(super) missed: u64,
    /// Commands that the reader saw when they were no longer valid: in no histogram.
    pub(super) expired: u64,
    pub(super) refused: Vec<String>,
    pub(super) report: Report,
}

/// Runs the daemon for `samples` periods.
pub(super) fn measure(
    world: &World,
    seats: &Seats,
    setting: Setting,
    interrupt: &Interrupt,
) -> Result<Controlled> {
    let config = config(world, seats, setting)?;
    let task = ReaderTask {
        places: config.places(),
        period_ns: setting.period_ns,
        // Commands come when they are complete, or at the deadline.
        expected_ns: match setting.publish {
            PublishAt::Complete => 0,
            PublishAt::Deadline => setting.period_ns - config.timing.margin_ns(),
        },
    };
    // Below the daemon's own threads, so that it keeps them from nothing.
    let priority = setting.priority.saturating_sub(2).max(1);
    let limit = duration(setting.period_ns, setting.samples + 10) + Duration::from_secs(10);
    let (child, ready) = Child::start(&Task::new(world, Role::Reader(task), seats.reader, priority, limit))?;

    let (times, steps) = channel();
    let for_workers = config.clone();
    let daemon =
        Daemon::start_with(config, Until::Stopped, move |owned| Timed::new(&for_workers, owned, &times))?;
    while !daemon.is_finished() {
        if interrupt.is_set() {
            daemon.stop();
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    let report = daemon.join()?;
    let findings = child.finish()?;
    interrupt.check()?;
    Ok(Controlled {
        state_to_command: findings.histogram("state_to_command")?,
        command_to_reader: findings.histogram("command_to_reader")?,
        step: together(&steps)?,
        missed: findings.count("missed"),
        expired: findings.count("expired"),
        refused: ready.refused,
        report,
    })
}

/// The paper's eight robots, with so long a way that they drive from the first period to the last.
fn config(world: &World, seats: &Seats, setting: Setting) -> Result<Config> {
    let mut scenario = Scenario::builtin("swap8")?;
    let seconds = duration(setting.period_ns, setting.samples).as_secs_f64();
    let shortest_m = 9.0;
    let scale = (SPEED_MPS * seconds * 1.2 / shortest_m).max(1.0);
    for robot in &mut scenario.robots {
        robot.start.position_m *= scale;
        robot.goal_m *= scale;
    }
    scenario.duration_s = scenario.duration_s.max(2.0 * seconds);
    let mut config = Config::new(scenario);
    CONTROL_FLEET.clone_into(&mut config.fleet);
    config.channel = world.channel.clone();
    config.timing.period_ns = setting.period_ns;
    config.timing.publish = setting.publish;
    config.timing.workers = Some(1);
    config.timing.ticks = Some(setting.samples);
    config.realtime = RealTimeConfig {
        loop_cpu: Some(seats.own),
        worker_cpus: vec![seats.other.unwrap_or(seats.own)],
        ..super::plan::asked(setting.priority, setting.wakeup)
    };
    Ok(config)
}

fn together(steps: &Receiver<LatencyHistogram>) -> Result<LatencyHistogram> {
    let mut all = LatencyHistogram::new().into_diagnostic()?;
    // The senders are gone with the workers.
    for one in steps.try_iter() {
        all.merge(&one);
    }
    Ok(all)
}

/// The daemon's controller with a stop-watch around it.
struct Timed {
    group: RobotGroup,
    times: LatencyHistogram,
    at_end: Sender<LatencyHistogram>,
}

impl Timed {
    fn new(config: &Config, owned: Range<usize>, at_end: &Sender<LatencyHistogram>) -> Result<Self, String> {
        let group = RobotGroup::new(config, owned).map_err(|e: ControllerError| e.to_string())?;
        let times = LatencyHistogram::new().map_err(|e| e.to_string())?;
        Ok(Self { group, times, at_end: at_end.clone() })
    }
}

impl Decider for Timed {
    fn decide(&mut self, fleet: &[RobotState], each: &mut dyn FnMut(usize, &Decision)) {
        let begun_ns = MonotonicClock.now_ns();
        self.group.decide(fleet, each);
        self.times.record(MonotonicClock.now_ns() - begun_ns);
    }

    fn checkpoint(&self, each: &mut dyn FnMut(usize, &Remembered)) {
        Decider::checkpoint(&self.group, each);
    }
}

impl Drop for Timed {
    fn drop(&mut self) {
        let _ = self.at_end.send(self.times.clone());
    }
}

/// What the reader has to know.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(super) struct ReaderTask {
    places: usize,
    period_ns: u64,
    /// Earliest time of a command after the release of its period, ns.
    expected_ns: u64,
}

/// What the reading process runs: asleep until shortly before the next command, then polling.
pub(super) fn read_commands(task: &Task, reader: ReaderTask, over: &Interrupt) -> Result<Findings> {
    let node = task.transport(CONTROL_FLEET)?.attach("bench-reader")?;
    let mut commands: CommandReader = node.reader_or_create(reader.places)?;
    let mut watch = Watch::new()?;
    say_ready(enter_real_time(task.priority, task.cpu).refused)?;
    let clock = MonotonicClock;
    let lead_ns = POLL_LEAD_NS.min(reader.period_ns / 4);
    let mut poll_from_ns = 0;
    while !over.is_set() {
        clock.sleep_until(poll_from_ns);
        // One period without a command is the daemon's; the reader goes on with the next.
        let give_up_ns = poll_from_ns + reader.period_ns + lead_ns;
        loop {
            if let Some(sample) = commands.next()? {
                let now_ns = clock.now_ns();
                let header = *sample.header();
                let stopping = sample.robots().iter().any(|command| {
                    matches!(
                        StopReason::from_code(command.stop_reason),
                        Some(StopReason::Finished | StopReason::Operator)
                    )
                });
                watch.see(&header, now_ns, stopping);
                // Commands act from the release of the next period, which has the next state.
                poll_from_ns = (header.valid_from_ns + reader.expected_ns).saturating_sub(lead_ns);
                break;
            }
            let now_ns = clock.now_ns();
            if over.is_set() || (poll_from_ns > 0 && now_ns > give_up_ns) {
                poll_from_ns += if poll_from_ns > 0 { reader.period_ns } else { 0 };
                break;
            }
            if poll_from_ns == 0 || watch.ended {
                // Nobody drives: there is nothing to be measured, and others may want the CPU.
                std::thread::sleep(Duration::from_micros(200));
            }
            std::hint::spin_loop();
        }
    }
    Ok(watch.findings())
}

/// What the reader sees.
struct Watch {
    state_to_command: LatencyHistogram,
    command_to_reader: LatencyHistogram,
    last: Option<u64>,
    missed: u64,
    expired: u64,
    ended: bool,
}

impl Watch {
    fn new() -> Result<Self> {
        Ok(Self {
            state_to_command: LatencyHistogram::new().into_diagnostic()?,
            command_to_reader: LatencyHistogram::new().into_diagnostic()?,
            last: None,
            missed: 0,
            expired: 0,
            ended: false,
        })
    }

    fn see(&mut self, header: &CommandHeader, now_ns: u64, stopping: bool) {
        // The first and the last commands of a run answer no state.
        if header.tick > 0 && !stopping && now_ns >= header.valid_until_ns {
            // Nobody may act on it any more: it is not delivered.
            self.expired += 1;
        } else if header.tick > 0 && !stopping {
            self.state_to_command.record(now_ns.saturating_sub(header.state_stamp_ns));
            self.command_to_reader.record(now_ns.saturating_sub(header.stamp_ns));
        }
        self.missed += self.last.map_or(0, |last| header.tick.saturating_sub(last + 1));
        self.last = Some(header.tick);
        self.ended = stopping;
    }

    fn findings(&self) -> Findings {
        let mut findings = Findings::default();
        findings.add("state_to_command", &self.state_to_command);
        findings.add("command_to_reader", &self.command_to_reader);
        findings.counts.push(("missed".to_owned(), self.missed));
        findings.counts.push(("expired".to_owned(), self.expired));
        findings
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_that_is_seen_when_it_has_expired_is_counted_and_not_timed() {
        let mut watch = Watch::new().unwrap();
        let header = |tick| CommandHeader { tick, valid_until_ns: 1000, ..CommandHeader::default() };
        watch.see(&header(1), 999, false);
        watch.see(&header(2), 1000, false);
        watch.see(&header(4), 999, false);
        watch.see(&header(5), 2000, true);
        assert_eq!((watch.missed, watch.expired), (1, 1));
        assert_eq!((watch.state_to_command.summary().count, watch.command_to_reader.summary().count), (2, 2));
    }
}
