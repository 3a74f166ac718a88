//! What is run: kinds of disturbance × levels × patterns × scenarios.

use clearway::config::{Config, DisturbanceConfig, Pattern};
use clearway::model::Disturbance;
use clearway::scenario::Scenario;
use miette::Result;
use serde::Serialize;

/// How large the disturbance is, as a share of the full bounds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(transparent)]
pub(super) struct Level(pub(super) f64);

/// Whether the rows allow for the disturbance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Margin {
    /// Disturbed, and allowed for.
    On,
    /// Allowed for and not disturbed: what the margin alone costs.
    Only,
    /// Disturbed and not allowed for: the negative control.
    Off,
    /// Neither: what the others are compared with.
    None,
}

/// One run.
pub(super) struct Case {
    pub(super) kind: &'static str,
    pub(super) level: Level,
    pub(super) margin: Margin,
    pub(super) config: Config,
}

/// The full bounds: an indoor robot with odometry and a laser scanner, on a clean floor, whose wheels
/// follow after 50 ms and whose commands arrive a period late.
const FULL: Disturbance = Disturbance {
    position_m: 0.02,
    heading_rad: 0.02,
    slip: 0.05,
    turn_rate_radps: 0.05,
    lag_s: 0.05,
    delay_s: 0.08,
};

const NONE: Disturbance = Disturbance::NONE;

/// Kinds of disturbance at their full bounds.
const KINDS: [(&str, Disturbance); 5] = [
    ("noise", Disturbance { position_m: FULL.position_m, heading_rad: FULL.heading_rad, ..NONE }),
    ("slip", Disturbance { slip: FULL.slip, turn_rate_radps: FULL.turn_rate_radps, ..NONE }),
    ("lag", Disturbance { lag_s: FULL.lag_s, ..NONE }),
    ("delay", Disturbance { delay_s: FULL.delay_s, ..NONE }),
    ("all", FULL),
];

/// The scenarios: every family with room for the full noise.
const SCENARIOS: [&str; 12] = [
    "swap8",
    "swap8-zero",
    "swap8-heading-3",
    "circle-10",
    "rows-6",
    "columns-6",
    "doorway-4",
    "pillars-4",
    "head-on",
    "random-8-1",
    "random-20-1",
    "random-20-2",
];

/// Every run, those that the others are compared with first.
pub(super) fn all(quick: bool) -> Result<Vec<Case>> {
    let scenarios: &[&str] =
        if quick { &["swap8", "doorway-4", "pillars-4", "random-8-1"] } else { &SCENARIOS };
    let levels: &[f64] = if quick { &[1.0] } else { &[0.5, 1.0] };
    let mut cases = Vec::new();
    for (k, name) in (1..).zip(scenarios) {
        let scenario = Scenario::builtin(name)?;
        let mut add = |kind, level, margin, pattern, seed, bounds, amplitude| -> Result<()> {
            let mut config = Config::new(scenario.clone());
            config.robust = bounds;
            config.disturbance = DisturbanceConfig { pattern, seed, amplitude };
            // Slower for the margin; an end to runs that do not end.
            config.scenario.duration_s = 120.0;
            config.check_robust()?;
            cases.push(Case { kind, level: Level(level), margin, config });
            Ok(())
        };
        add("none", 0.0, Margin::None, Pattern::Random, 0, NONE, NONE)?;
        for (kind, full) in KINDS {
            for &level in levels {
                let d = full.scaled(level);
                add(kind, level, Margin::Only, Pattern::Random, 0, d, NONE)?;
                for seed in [k, k + 100] {
                    add(kind, level, Margin::On, Pattern::Random, seed, d, d)?;
                }
                add(kind, level, Margin::On, Pattern::Adversarial, k, d, d)?;
            }
            add(kind, 1.0, Margin::Off, Pattern::Adversarial, k, NONE, full)?;
        }
    }
    Ok(cases)
}
