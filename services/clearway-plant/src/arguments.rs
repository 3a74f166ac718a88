use std::path::PathBuf;
use std::time::Duration;

use clap::Parser;
use clearway::config::Config;
use clearway::document::ConfigError;
use clearway::robots::Link;
use clearway::scenario::Scenario;

const EXAMPLES: &str = "\
Examples:
  clearwayd --config docs/examples/attached.toml        in one terminal
  clearway-plant --config docs/examples/attached.toml   in another: all its robots

  clearwayd --set source.kind=observation               once, until all arrived
  clearway-plant --once

  clearway-plant --robots 0                  one process for each robot …
  clearway-plant --robots 1,2 --trajectory robots.jsonl
  clearway-plant --noise-m 0.005 --lag-ms 20 --delay-ms 5 --drop-out 0.1 --seed 7

Exit status:
  0  no clearance was violated; with --once also: every robot arrived
  1  a clearance was violated, or with --once a robot did not arrive
  2  the command line, the configuration or the scenario is wrong, or the daemon
     runs another one
  5  anything else: shared memory, files

Environment:
  CLEARWAY_IOX2_PREFIX, CLEARWAY_IOX2_ROOT  where the channels live, in place of
                                            channel.prefix and channel.root";

/// Robots as a process of their own: obeys the daemon's commands and tells it what is seen.
///
/// Give it the daemon's configuration. It may start before the daemon, and outlives it; robots whose
/// command has expired stand still. Ctrl-C ends it with a summary.
#[derive(Debug, Parser)]
#[command(name = "clearway-plant", version, after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// Configuration file (TOML), the same as the daemon's
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Scenario file, or the name of a built-in one
    #[arg(long, value_name = "FILE|NAME")]
    scenario: Option<String>,
    /// Name of the fleet
    #[arg(long, value_name = "NAME")]
    fleet: Option<String>,
    /// Ids of the robots that live here, separated by commas, or all
    #[arg(long, value_name = "IDS", default_value = "all")]
    robots: String,
    /// Sampling period of the daemon, µs
    #[arg(long, value_name = "US")]
    period_us: Option<u64>,
    /// Observations a second [default: eight a period]
    #[arg(long, value_name = "HZ", value_parser = rate)]
    rate_hz: Option<f64>,
    /// Seed of noise and losses
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Noise of observed positions, up to this, m
    #[arg(long, value_name = "M")]
    noise_m: Option<f64>,
    /// Noise of observed headings, up to this, rad
    #[arg(long, value_name = "RAD")]
    noise_rad: Option<f64>,
    /// Time constant with which wheels follow commands, ms
    #[arg(long, value_name = "MS", value_parser = milliseconds)]
    lag_ms: Option<f64>,
    /// Time that observations take, ms
    #[arg(long, value_name = "MS", default_value = "0", value_parser = milliseconds)]
    delay_ms: f64,
    /// Share of the observations that are lost, from 0 to 1
    #[arg(long, value_name = "SHARE", default_value = "0", value_parser = share)]
    drop_out: f64,
    /// Any key of the configuration, as section.key=value; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    settings: Vec<String>,
    /// End when the daemon ends its run
    #[arg(long)]
    pub(crate) once: bool,
    /// End after this time, s
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub(crate) duration: Option<f64>,
    /// Ask for a real-time priority, two below that of the daemon's loop
    #[arg(long)]
    pub(crate) realtime: bool,
    /// Write the summary as JSON
    #[arg(long, value_name = "OUT.json")]
    pub(crate) report: Option<PathBuf>,
    /// Write what every robot did, one arc a line, as JSON lines
    #[arg(long, value_name = "OUT.jsonl")]
    pub(crate) trajectory: Option<PathBuf>,
    /// Show errors only
    #[arg(long, short)]
    pub(crate) quiet: bool,
}

fn between(text: &str, low: f64, high: f64) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| format!("`{text}` is not a number"))?;
    if (low..=high).contains(&value) { Ok(value) } else { Err(format!("it has to be from {low} to {high}")) }
}

fn milliseconds(text: &str) -> Result<f64, String> {
    between(text, 0.0, 10_000.0)
}

fn rate(text: &str) -> Result<f64, String> {
    between(text, 0.1, 10_000.0)
}

fn share(text: &str) -> Result<f64, String> {
    between(text, 0.0, 1.0)
}

fn seconds(text: &str) -> Result<f64, String> {
    between(text, 0.0, 1e9)
}

/// A time in whole units of `per_ms` to the millisecond; the arguments are in range.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to 10 s")]
fn whole(ms: f64, per_ms: f64) -> u64 {
    (ms * per_ms).round() as u64
}

impl Arguments {
    /// The configuration that file and arguments make together.
    pub(crate) fn config(&self) -> Result<Config, ConfigError> {
        let mut overrides = self.settings.clone();
        let mut set = |key: &str, value: Option<String>| {
            overrides.extend(value.map(|value| format!("{key}={value}")));
        };
        let metres = |value: Option<f64>| value.map(|x| format!("{x:?}"));
        set("scenario", self.scenario.clone());
        set("fleet", self.fleet.clone());
        set("timing.period_us", self.period_us.map(|us| us.to_string()));
        set("disturbance.seed", self.seed.map(|seed| seed.to_string()));
        set("disturbance.position_m", metres(self.noise_m));
        set("disturbance.heading_rad", metres(self.noise_rad));
        set("disturbance.lag_us", self.lag_ms.map(|ms| whole(ms, 1e3).to_string()));
        let mut config = Config::with_overrides(self.config.as_deref(), &overrides)?;
        config.channel = config.channel.with_environment();
        Ok(config)
    }

    /// The part of the scenario that lives here.
    pub(crate) fn own(&self, scenario: &Scenario) -> Result<Scenario, String> {
        if self.robots == "all" {
            return Ok(scenario.clone());
        }
        let mut robots = Vec::new();
        for text in self.robots.split(',') {
            let id: u32 = text.trim().parse().map_err(|_| format!("--robots: `{text}` is not an id"))?;
            let Some(robot) = scenario.robots.iter().find(|robot| robot.id.0 == id) else {
                return Err(format!("--robots: the scenario {} has no robot {id}", scenario.name));
            };
            if robots.contains(robot) {
                return Err(format!("--robots: robot {id} stands there twice"));
            }
            robots.push(*robot);
        }
        Ok(Scenario { robots, ..scenario.clone() })
    }

    /// How observations travel.
    pub(crate) fn link(&self, config: &Config) -> Link {
        Link {
            delay_ns: whole(self.delay_ms, 1e6),
            drop_out: self.drop_out,
            seed: self.seed.unwrap_or(config.disturbance.seed),
        }
    }

    /// Time from one observation to the next.
    pub(crate) fn observe_every(&self, config: &Config) -> Duration {
        match self.rate_hz {
            Some(hz) => Duration::from_secs_f64(1.0 / hz),
            None => Duration::from_nanos(config.timing.period_ns / 8),
        }
    }
}
