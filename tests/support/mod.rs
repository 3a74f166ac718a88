//! What the tests of the running daemon share: a world of their own in shared memory, a small
//! scenario, and controllers that are simple enough to predict.
#![allow(dead_code, unreachable_pub, reason = "each test file uses a part")]

pub mod process;
pub mod python;
pub mod sandbox;

use std::ops::Range;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU32, Ordering};

use clearway::config::{ChannelConfig, Config, RealTimeConfig, RealTimePolicy};
use clearway::controller::Decision;
use clearway::geometry::{Pose, Vec2};
use clearway::model::{Command, Limits, RobotId, RobotSpec};
use clearway::runtime::Decider;
use clearway::scenario::Scenario;
use clearway::wire::{RobotCommand, RobotIntent, RobotState, RobotTelemetry, SolveStatus};

/// A place in shared memory that nobody else uses; checked to be empty and removed at the end.
pub struct World {
    pub channel: ChannelConfig,
}

impl World {
    pub fn new(name: &str) -> Self {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let unique = format!("{name}_{}_{}", std::process::id(), NEXT.fetch_add(1, Ordering::Relaxed));
        let root = std::env::temp_dir().join(format!("clearway_{unique}"));
        Self { channel: ChannelConfig { prefix: format!("cw_{unique}_"), root, ..ChannelConfig::default() } }
    }

    /// Files of this world in shared memory.
    pub fn files(&self) -> Vec<PathBuf> {
        let Ok(entries) = std::fs::read_dir("/dev/shm") else { return vec![] };
        let ours = |path: &PathBuf| {
            path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(&self.channel.prefix))
        };
        entries.flatten().map(|entry| entry.path()).filter(ours).collect()
    }
}

impl Drop for World {
    fn drop(&mut self) {
        let mut left = self.files();
        for file in &left {
            let _ = std::fs::remove_file(file);
        }
        // iceoryx2 keeps one small file for each prefix as long as the machine is up.
        left.retain(|file| file.extension().is_none_or(|extension| extension != "global_mgmt"));
        let _ = std::fs::remove_dir_all(&self.channel.root);
        if !std::thread::panicking() {
            assert!(left.is_empty(), "left in shared memory: {left:?}");
        }
    }
}

/// `robots` robots on parallel lanes, `length_m` to go.
pub fn lanes(robots: u32, length_m: f64) -> Scenario {
    let robot = |id: u32| RobotSpec {
        id: RobotId(id * 3),
        radius_m: 0.15,
        start: Pose::new(0.0, f64::from(id), 0.0),
        goal_m: Vec2::new(length_m, f64::from(id)),
        foreign_speed_mps: None,
    };
    Scenario {
        name: "lanes".into(),
        tolerance_m: 0.05,
        duration_s: 20.0,
        limits: Limits::default(),
        robots: (0..robots).map(robot).collect(),
        obstacles: vec![],
    }
}

pub fn config(world: &World, scenario: Scenario, period_ns: u64) -> Config {
    let mut config = Config::new(scenario);
    config.channel = world.channel.clone();
    config.timing.period_ns = period_ns;
    config.realtime = RealTimeConfig { policy: RealTimePolicy::Off, ..RealTimeConfig::default() };
    config
}

/// Drives every robot straight to its goal.
pub struct Straight {
    pub owned: Range<usize>,
    pub period_s: f64,
}

impl Decider for Straight {
    fn decide(&mut self, fleet: &[RobotState], each: &mut dyn FnMut(usize, &Decision)) {
        for index in self.owned.clone() {
            let robot = &fleet[index];
            let next = robot.arc().pose(self.period_s);
            let left_m = robot.goal_x_m - next.position_m.x;
            // Close enough is close enough: rounding must not keep it from ever standing still.
            let v_mps = if left_m < 1e-3 { 0.0 } else { (left_m / self.period_s).min(5.0) };
            let command = Command { v_mps, omega_radps: 0.0 };
            let telemetry = RobotTelemetry {
                id: robot.id,
                status: SolveStatus::Verified as u32,
                solve_ns: 1000,
                step_ns: 2000,
                ..RobotTelemetry::default()
            };
            let command = RobotCommand::verified(robot.robot(), command);
            each(index, &Decision { command, intent: RobotIntent::default(), telemetry });
        }
    }
}

/// [`Straight`] for each worker.
pub fn straight(period_ns: u64) -> impl Fn(Range<usize>) -> Result<Straight, String> + Send + Sync + 'static {
    move |owned| Ok(Straight { owned, period_s: period_ns as f64 * 1e-9 })
}
