//! When robots will have arrived.

use crate::certificate::Decrease;
use crate::config::Config;

/// Steps that a forecast looks ahead; what takes longer is `u32::MAX`.
const STEPS_MAX: u32 = 250;

/// Predicts from the recursion of the position certificate in how many steps robots arrive.
///
/// The recursion, [`Decrease::settling_steps`], has hundreds of steps with a power in each, too long for
/// every robot of a large fleet in every period. What is left after a step grows with what there was, so
/// that the answer is how many of a few hundred thresholds lie below. A table tells how many do that are smaller by
/// more than a sixteenth or so; the one or two that are left are looked at.
#[derive(Debug, Clone)]
pub(super) struct Forecast {
    /// ½d² from which on one more step is needed, ascending, m².
    thresholds_m2: Vec<f64>,
    /// How many of them are of a lower [`class`], for each class from that of the first threshold to the last's.
    lower: Vec<usize>,
}

/// The class of a number, 0 or more, in steps of a sixteenth of a power of two.
fn class(number: f64) -> u64 {
    number.to_bits() >> 48
}

impl Forecast {
    pub(super) fn new(config: &Config) -> Self {
        let limits = &config.scenario.limits;
        let reach_m = limits.v_max_mps * config.timing.period_s();
        Self::of(&Decrease::of(&config.controller), reach_m, config.scenario.tolerance_m)
    }

    fn of(decrease: &Decrease, reach_m: f64, tolerance_m: f64) -> Self {
        let left = |z: f64| (z - decrease.position((2.0 * z).sqrt(), reach_m)).max(0.0);
        let mut below = 0.5 * tolerance_m * tolerance_m;
        let mut thresholds_m2 = vec![below];
        for _ in 0..STEPS_MAX {
            // The last number from which a step leads to `below`. Floating-point numbers of one sign are
            // in the order of their bits.
            let (mut near, mut far) = (below.to_bits(), f64::MAX.to_bits());
            while far - near > 1 {
                let middle = near + (far - near) / 2;
                if left(f64::from_bits(middle)) <= below { near = middle } else { far = middle }
            }
            below = f64::from_bits(near);
            thresholds_m2.push(below);
        }
        let classes = class(0.5 * tolerance_m * tolerance_m)..=class(below);
        let lower = classes.map(|c| thresholds_m2.partition_point(|t| class(*t) < c)).collect();
        Self { thresholds_m2, lower }
    }

    /// Steps from ½d² = `lyapunov_position_m2` to inside the tolerance.
    pub(super) fn settling_steps(&self, lyapunov_position_m2: f64) -> u32 {
        let is_below = |threshold: &&f64| lyapunov_position_m2 > **threshold;
        let Some(first) = self.thresholds_m2.first().filter(is_below) else { return 0 };
        let beyond = usize::try_from(class(lyapunov_position_m2) - class(*first));
        let lower = beyond.ok().and_then(|beyond| self.lower.get(beyond).copied());
        let lower = lower.unwrap_or(self.thresholds_m2.len());
        let steps = lower + self.thresholds_m2.iter().skip(lower).take_while(is_below).count();
        u32::try_from(steps).ok().filter(|steps| *steps <= STEPS_MAX).unwrap_or(u32::MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{ControllerConfig, Profile};

    #[test]
    fn the_thresholds_are_the_recursions() {
        for profile in [Profile::Certified, Profile::Exponential, Profile::Paper] {
            let decrease = Decrease::of(&ControllerConfig { profile, ..ControllerConfig::default() });
            let (reach_m, tolerance_m) = (0.12, 0.05);
            let forecast = Forecast::of(&decrease, reach_m, tolerance_m);
            for k in 0..4000 {
                let d_m = 0.0107 * f64::from(k);
                let steps = decrease.settling_steps(d_m, reach_m, tolerance_m, STEPS_MAX);
                let told = forecast.settling_steps(0.5 * d_m * d_m);
                assert_eq!(told, steps.unwrap_or(u32::MAX), "{profile:?} {d_m}");
            }
            assert_eq!(forecast.settling_steps(f64::INFINITY), u32::MAX);
            assert_eq!([0.0, -1.0, f64::NAN].map(|z| forecast.settling_steps(z)), [0; 3]);
            for (steps, threshold) in (0..=STEPS_MAX).zip(&forecast.thresholds_m2) {
                assert!(forecast.settling_steps(*threshold) <= steps, "{profile:?} {steps}");
                let beyond = forecast.settling_steps(threshold.next_up());
                assert!(beyond > steps || *threshold == f64::MAX, "{profile:?} {steps}");
            }
        }
    }
}
