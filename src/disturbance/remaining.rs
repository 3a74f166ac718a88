use crate::model::{Command, Disturbance};

/// What each robot may still travel on the commands that it was given earlier.
///
/// For wheels that follow with at most the bounded delay and lag. A command's travel |v| T is only ever
/// put off, so what remains is what was commanded less what the slowest wheels have done.
#[derive(Debug, Clone)]
pub struct Remaining {
    period_s: f64,
    delay_s: f64,
    lag_s: f64,
    robots: Vec<Wheels>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Wheels {
    /// Speed of the slowest wheels to follow, m/s.
    speed_mps: f64,
    /// Speed commanded over the last period, m/s.
    commanded_mps: f64,
}

impl Remaining {
    /// For `robots` robots at rest.
    pub fn new(robots: usize, bounds: &Disturbance, period_s: f64) -> Self {
        let (delay_s, lag_s) = (bounds.delay_s.min(period_s), bounds.lag_s);
        Self { period_s, delay_s, lag_s, robots: vec![Wheels::default(); robots] }
    }

    /// Bound on what robot `index` still travels on the commands so far, m.
    pub fn travel_m(&self, index: usize) -> f64 {
        let Some(w) = self.robots.get(index) else { return 0.0 };
        w.commanded_mps * self.delay_s + w.speed_mps * self.lag_s
    }

    /// Somebody else, at rest, is robot `index` from now on.
    pub fn reset(&mut self, index: usize) {
        if let Some(wheels) = self.robots.get_mut(index) {
            *wheels = Wheels::default();
        }
    }

    /// A period passes in which robot `index` holds `command`.
    pub fn hold(&mut self, index: usize, command: Command) {
        let (delay_s, acted_s) = (self.delay_s, self.period_s - self.delay_s);
        let lag_s = self.lag_s;
        let Some(w) = self.robots.get_mut(index) else { return };
        for (target, s) in [(w.commanded_mps, delay_s), (command.v_mps.abs(), acted_s)] {
            // Without a lag the wheels are there at once.
            let kept = if lag_s > 0.0 { libm::exp(-s / lag_s) } else { 0.0 };
            w.speed_mps = target + (w.speed_mps - target) * kept;
        }
        w.commanded_mps = command.v_mps.abs();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// What was commanded and is not yet travelled, against wheels that are integrated finely.
        #[test]
        fn remaining_travel_bounds_every_faster_wheel(
            speeds in prop::collection::vec(-5.0..5.0f64, 1..12),
            lag_s in 0.0..0.3f64, delay_s in 0.0..0.08f64, share in 0.0..1.0f64,
        ) {
            let t = 0.08;
            let bounds = Disturbance { lag_s, delay_s, ..Disturbance::NONE };
            let mut remaining = Remaining::new(1, &bounds, t);
            for v_mps in &speeds {
                remaining.hold(0, Command { v_mps: *v_mps, omega_radps: 0.0 });
            }
            // Wheels with a share of the bounds, driven on with stops until they stand.
            for share in [share, 1.0] {
                let (steps, mut wheel, mut travel) = (2000usize, 0.0f64, 0.0);
                let h = t / steps as f64;
                let late = (0..steps).filter(|k| (*k + 1) as f64 * h <= delay_s * share).count();
                for k in 0..steps * (speeds.len() + 40) {
                    let command = k.checked_sub(late).and_then(|k| speeds.get(k / steps)).map_or(0.0, |v| v.abs());
                    let lag = lag_s * share;
                    wheel = if lag > 0.0 { command + (wheel - command) * (-h / lag).exp() } else { command };
                    if k >= steps * speeds.len() {
                        travel += wheel * h;
                    }
                }
                prop_assert!(travel <= remaining.travel_m(0) + 5.0 * h + 1e-9, "{travel} {}", remaining.travel_m(0));
                if share == 1.0 {
                    prop_assert!(travel >= remaining.travel_m(0) - 0.01, "{travel} {}", remaining.travel_m(0));
                }
            }
        }
    }
}
