use super::Scenario;
use super::read::SCHEMA;
use crate::model::{Obstacle, RobotSpec};
use std::fmt::{self, Write};

/// The scenario as TOML that reads back to the bit: Rust prints the shortest digits that do.
pub(super) fn to_toml(s: &Scenario) -> String {
    let mut text = ScenarioText::default();
    while !text.advance(s, usize::MAX) {}
    text.finish()
}

/// The text of a scenario on its way: that of a large fleet takes long, and can be written in parts.
#[derive(Debug, Default)]
pub(crate) struct ScenarioText {
    out: String,
    /// Robots and obstacles that are written, once the head is.
    written: Option<usize>,
}

impl ScenarioText {
    /// Writes the next `parts` robots and obstacles of `s`, which is the same in each call; whether all is
    /// written.
    pub(crate) fn advance(&mut self, s: &Scenario, parts: usize) -> bool {
        let Self { out, written } = self;
        let first = *written.get_or_insert_with(|| {
            // Writing to a string cannot fail.
            let _ = write_head(s, out);
            0
        });
        let end = first.saturating_add(parts).min(s.robots.len() + s.obstacles.len());
        for part in first..end {
            let _ = match part.checked_sub(s.robots.len()) {
                None => write_robot(&s.robots[part], out),
                Some(obstacle) => write_obstacle(&s.obstacles[obstacle], out),
            };
        }
        *written = Some(end);
        end == s.robots.len() + s.obstacles.len()
    }

    /// What is written.
    pub(crate) fn finish(self) -> String {
        self.out
    }
}

fn write_head(s: &Scenario, out: &mut String) -> fmt::Result {
    let l = &s.limits;
    writeln!(out, "schema = {SCHEMA}")?;
    writeln!(out, "name = {}", toml::Value::String(s.name.clone()))?;
    writeln!(out, "tolerance_m = {:?}", s.tolerance_m)?;
    writeln!(out, "duration_s = {:?}\n", s.duration_s)?;
    writeln!(out, "[limits]")?;
    writeln!(out, "v_mps = [{:?}, {:?}]", l.v_min_mps, l.v_max_mps)?;
    writeln!(out, "omega_radps = [{:?}, {:?}]", l.omega_min_radps, l.omega_max_radps)?;
    writeln!(out, "safety_margin_m = {:?}", l.safety_margin_m)
}

fn write_robot(r: &RobotSpec, out: &mut String) -> fmt::Result {
    let (p, theta) = (r.start.position_m, r.start.theta_rad);
    writeln!(out, "\n[[robot]]\nid = {}\nradius_m = {:?}", r.id, r.radius_m)?;
    writeln!(out, "start = {{ x_m = {:?}, y_m = {:?}, theta_rad = {theta:?} }}", p.x, p.y)?;
    match r.foreign_speed_mps {
        None => writeln!(out, "goal = {{ x_m = {:?}, y_m = {:?} }}", r.goal_m.x, r.goal_m.y),
        Some(speed) => writeln!(out, "foreign_speed_mps = {speed:?}"),
    }
}

fn write_obstacle(obstacle: &Obstacle, out: &mut String) -> fmt::Result {
    writeln!(out, "\n[[obstacle]]")?;
    match *obstacle {
        Obstacle::Circle { centre_m: c, radius_m } => {
            writeln!(out, "circle = {{ x_m = {:?}, y_m = {:?}, radius_m = {radius_m:?} }}", c.x, c.y)
        }
        Obstacle::Segment { from_m: a, to_m: b } => {
            writeln!(out, "segment = {{ from_m = [{:?}, {:?}], to_m = [{:?}, {:?}] }}", a.x, a.y, b.x, b.y)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose;
    use crate::model::{Limits, RobotId};
    use nalgebra::Vector2;
    use proptest::prelude::*;

    #[test]
    fn built_in_scenarios_survive_the_round_trip() {
        for name in ["circle-3", "swap8-heading-5", "random-40-9", "pillars-8", "doorway-both-6"] {
            let scenario = Scenario::builtin(name).unwrap();
            assert_eq!(Scenario::parse(&scenario.to_toml(), "written.toml").unwrap(), scenario);
            let (mut parts, mut turns) = (ScenarioText::default(), 1);
            while !parts.advance(&scenario, 3) {
                turns += 1;
            }
            assert_eq!(parts.finish(), scenario.to_toml());
            assert_eq!(turns, (scenario.robots.len() + scenario.obstacles.len()).div_ceil(3));
        }
    }

    proptest! {
        #[test]
        fn what_is_accepted_reads_back_to_the_bit(
            name in "[ -~é\"\\\\]{1,20}", x in -1e5..1e5f64, y in -1e5..1e5f64, theta in -3.0..3.0f64,
            radius in 1e-9..100f64, v_min in -100.0..=0f64, duration in 1e-9..1e6f64,
        ) {
            let robot = RobotSpec {
                id: RobotId(u32::MAX),
                radius_m: radius,
                start: Pose::new(x, y, theta),
                goal_m: Vector2::new(y, x), foreign_speed_mps: None };
            let scenario = Scenario {
                name,
                tolerance_m: 0.1,
                duration_s: duration,
                limits: Limits { v_min_mps: v_min, ..Limits::default() },
                robots: vec![robot],
                obstacles: Vec::new(),
            };
            prop_assert!(scenario.check().is_ok());
            prop_assert_eq!(Scenario::parse(&scenario.to_toml(), "written.toml").unwrap(), scenario);
        }
    }
}
