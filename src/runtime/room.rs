//! How far a new robot has to stay from those that do not know of it yet.

use crate::certificate::robust::Margin;
use crate::config::Config;
use crate::controller::UNTRUSTED_PERIODS;
use crate::model::Command;
use crate::wire::{RobotState, state_flags};

/// Periods until a robot that is added is known to whoever answers one that is not ours.
const FOREIGN_PERIODS: f64 = 2.0;

/// What the robots of a fleet may do before their commands allow for a new one; the same terms as in
/// the rows of the controller.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Room {
    margin: Option<Margin>,
    period_s: f64,
    /// Of a robot whose pose is not trusted, m.
    untrusted_m: f64,
    lost_m: f64,
    /// Of the fastest that is not ours, m.
    foreign_m: f64,
}

impl Room {
    pub(super) fn new(config: &Config) -> Self {
        let (limits, period_s) = (&config.scenario.limits, config.timing.period_s());
        let bounds = config.robust;
        let margin = (!bounds.is_none()).then(|| Margin::new(bounds, limits, period_s, period_s));
        let max_age_s = config.source.max_age_or_default_ns(config.timing.period_ns) as f64 * 1e-9;
        let silent_s = max_age_s + UNTRUSTED_PERIODS * period_s;
        let foreign = config.scenario.robots.iter().filter_map(|robot| robot.foreign_speed_mps);
        let foreign_s = FOREIGN_PERIODS * period_s + margin.map_or(0.0, |m| m.rest_s());
        Self {
            margin,
            period_s,
            untrusted_m: UNTRUSTED_PERIODS * period_s * limits.speed_mps(),
            lost_m: margin.map_or(0.0, |m| m.lost_m(silent_s)),
            foreign_m: foreign_s * foreign.fold(0.0, f64::max),
        }
    }

    /// How far `other` may get from where it is seen, and a new robot at rest be from where it is said
    /// to be, m. The uncertainty of `other` includes what is left to travel.
    pub(super) fn way_m(&self, other: &RobotState) -> f64 {
        let driven_m = other.v_mps.abs() * self.period_s;
        let reach = |left_m, command| {
            self.margin.map_or(0.0, |margin| {
                let reach = margin.reach(left_m, command);
                reach.lead_m + reach.extent_m()
            })
        };
        let new_m = reach(0.0, Command::STOP);
        if other.has(state_flags::FOREIGN) {
            let noise_m = self.margin.map_or(0.0, |margin| margin.bounds().position_m);
            return new_m + noise_m + other.uncertainty_m + self.foreign_m;
        }
        let known_m = new_m + driven_m + reach(other.uncertainty_m, other.command());
        if other.has(state_flags::VALID) {
            // It may have come to a stand on the way that it is taken to have gone.
            let behind_m = if other.has(state_flags::MAY_STAND) { 2.0 * other.way_m.max(0.0) } else { 0.0 };
            return known_m + behind_m;
        }
        let spread = self.margin.map_or(0.0, |margin| margin.spread());
        known_m + self.untrusted_m.max(other.uncertainty_m + driven_m * (1.0 + spread)) + self.lost_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Disturbance;
    use crate::runtime::loop_memory::LoopMemory;
    use crate::scenario::Scenario;
    use crate::wire::StopReason;

    /// A fleet whose wheels lag 100 ms.
    fn lagging() -> Config {
        let mut config = Config::new(Scenario::builtin("swap8").unwrap());
        config.robust = Disturbance { lag_s: 0.1, position_m: 0.01, ..Disturbance::NONE };
        config
    }

    fn at_rest(config: &Config, flags: u32) -> RobotState {
        let state = RobotState::at_start(&config.scenario.robots[0]);
        RobotState { flags, ..state }
    }

    #[test]
    fn a_robot_that_was_told_to_stand_still_has_its_way_to_go() {
        let config = lagging();
        let room = Room::new(&config);
        let rolling = RobotState { uncertainty_m: 0.2, ..at_rest(&config, state_flags::VALID) };
        let standing = RobotState { uncertainty_m: 0.0, ..rolling };
        // Two poses that are off by a centimetre each.
        assert!(room.way_m(&standing) >= 0.02);
        assert!(room.way_m(&rolling) >= room.way_m(&standing) + 0.2);
        // One that is not trusted drove on for two periods.
        let lost = RobotState { flags: 0, ..standing };
        let (period_s, speed_mps) = (config.timing.period_s(), config.scenario.limits.speed_mps());
        assert!(room.way_m(&lost) >= 0.02 + 2.0 * period_s * speed_mps);
    }

    #[test]
    fn a_foreign_robot_may_come_at_its_own_speed() {
        let mut config = Config::new(Scenario::builtin("swap8").unwrap());
        config.scenario.robots[3].foreign_speed_mps = Some(2.0);
        let foreign = at_rest(&config, state_flags::VALID | state_flags::FOREIGN);
        assert!(Room::new(&config).way_m(&foreign) >= 2.0 * 2.0 * config.timing.period_s());
    }

    #[test]
    fn what_a_robot_had_left_to_travel_goes_with_it() {
        let config = lagging();
        let mut moving = at_rest(&config, state_flags::VALID);
        moving.set_command(Command { v_mps: 1.0, omega_radps: 0.0 });
        let mut memory = LoopMemory::new(vec![moving, moving]).allowing_for(&config);
        memory.count_travel(0);
        memory.replace(0, at_rest(&config, state_flags::VALID), StopReason::Start);
        memory.states.iter_mut().for_each(|state| state.uncertainty_m = 0.0);
        memory.count_travel(1);
        assert!(memory.states[0].uncertainty_m.abs() < 1e-12, "{}", memory.states[0].uncertainty_m);
        assert!(memory.states[1].uncertainty_m > 0.01);
    }
}
