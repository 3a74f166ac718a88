//! One fleet, driven by the daemon in real time and watched over its telemetry channel.

use super::carousel::Carousel;
use super::report::{Case, Samples};
use clearway::channel::{StateReader, TelemetryReader, Transport};
use clearway::config::Config;
use clearway::neighbours::{Neighbourhood, Sight, Surroundings};
use clearway::runtime::{Daemon, Until};
use clearway::scenario::Scenario;
use clearway::wire::RobotState;
use miette::{IntoDiagnostic, Result, WrapErr};
use std::num::NonZeroU64;
use std::time::Duration;

/// Readers of each channel besides the workers that the daemon insists on.
const READERS: usize = 8;
/// Robots whose neighbours are counted.
const COUNTED: usize = 1000;

/// What is to be driven.
#[derive(Debug, Clone, Copy)]
pub(super) struct Drive {
    pub(super) robots: usize,
    pub(super) workers: usize,
    pub(super) warm_up: u64,
    pub(super) periods: u64,
    /// How much slower the daemon's time passes.
    pub(super) slowdown: NonZeroU64,
    /// What the machine's memory copies.
    pub(super) copy_bytes_per_s: f64,
}

impl Drive {
    /// Drives the fleet; `progress` hears of each period.
    pub(super) fn run(self, mut progress: impl FnMut(u64)) -> Result<Case> {
        let mut config = Config::new(Scenario::builtin(&format!("field-{}-1", self.robots))?);
        config.fleet = format!("bench-scale-{}", std::process::id());
        config.timing.workers = Some(self.workers);
        config.timing.ticks = Some(self.warm_up + self.periods);
        config.channel = config.channel.with_environment();
        config.channel.max_readers = self.workers + READERS;
        let transport = Transport::new(&config.fleet, &config.channel).into_diagnostic()?;
        let node = transport.attach("bench").into_diagnostic()?;
        let mut telemetry: TelemetryReader = node.reader_or_create(self.robots).into_diagnostic()?;
        let mut states: StateReader = node.reader_or_create(self.robots).into_diagnostic()?;
        let (limits, gamma) = (config.scenario.limits, config.controller.gamma);
        let period_ns = config.timing.period_ns;
        let reach_m = limits.safety_margin_m
            + 2.0 * config.scenario.robots.first().map_or(0.0, |r| r.radius_m)
            + 2.0 * limits.v_max_mps * config.timing.period_s() / gamma;
        let daemon = Daemon::start_slowed(config, Until::Stopped, self.slowdown, |config, start_ns| {
            Box::new(Carousel::new(config, start_ns))
        })
        .into_diagnostic()
        .wrap_err_with(|| format!("the daemon of {} robots does not start", self.robots))?;
        let mut samples = Samples::default();
        let mut neighbours_mean = 0.0;
        loop {
            let over = daemon.is_finished();
            while let Some(sample) = telemetry.next().into_diagnostic()? {
                let header = sample.header();
                progress(header.tick);
                let slowdown = self.slowdown.get();
                if header.tick >= self.warm_up {
                    samples.add(header, sample.robots(), slowdown);
                } else {
                    samples.add_early(header, slowdown);
                }
            }
            if let Some(sample) = states.newest().into_diagnostic()?
                && sample.header().tick >= self.warm_up
                && neighbours_mean == 0.0
            {
                neighbours_mean = neighbours(sample.robots(), reach_m);
            }
            if over {
                break;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        let report = daemon.join().into_diagnostic()?;
        Ok(Case::new(self, neighbours_mean, period_ns, &samples, &report))
    }
}

/// Others within `reach_m`, on average.
fn neighbours(fleet: &[RobotState], reach_m: f64) -> f64 {
    let mut around = Surroundings::with_capacity(fleet.len(), reach_m);
    around.build(fleet);
    let mut near = Neighbourhood::with_capacity(fleet.len());
    let sight = Sight { all_m: reach_m, nearest_m: reach_m, nearest: 0 };
    let counted = (0..fleet.len()).step_by(fleet.len().div_ceil(COUNTED));
    let counts: Vec<usize> =
        counted.map(|me| near.gather(&around, fleet, me, sight, reach_m).len()).collect();
    counts.iter().sum::<usize>() as f64 / counts.len() as f64
}
