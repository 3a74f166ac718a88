//! The barrier rows of one robot: what every body near it leaves of its speed.

use super::Law;
use super::bodies::Body;
use crate::certificate::barrier::{Approach, Turning, approach_linear, budget_m};
use crate::config::BarrierForm;
use crate::geometry::Vec2;
use crate::programme::{Programme, Row};
use crate::solver::optimal_turn_rate;

/// How fast bodies are approached by unit speed along `ahead` at one turn rate.
pub(super) struct Approaching<'a> {
    law: &'a Law,
    ahead: Vec2,
    turning: Turning,
}

impl<'a> Approaching<'a> {
    pub(super) fn new(law: &'a Law, ahead: Vec2, omega_radps: f64) -> Self {
        Self { law, ahead, turning: Turning::new(omega_radps, law.period_s) }
    }

    /// In the form that the programme is to have.
    fn in_form(&self, body: &Body) -> Approach {
        let law = self.law;
        match law.control.barrier {
            BarrierForm::Linear if !body.anywhere && law.margin.is_none() => {
                let n = body.normal;
                let turn_rate_radps = law.limits.turn_rate_radps();
                approach_linear(n.dot(&self.ahead), n.perp(&self.ahead), turn_rate_radps, law.period_s)
            }
            _ => self.exact(body),
        }
    }

    /// In the exact form, whatever the programme has; in that for disturbed robots where they are.
    pub(super) fn exact(&self, body: &Body) -> Approach {
        let n = body.normal;
        if let Some(margin) = &self.law.margin {
            let blind = if body.anywhere { 1.0 } else { body.blind };
            // Whatever the turn rates, for all time.
            return margin.approach(n.dot(&self.ahead), body.gap_m, blind);
        }
        if body.anywhere {
            return Approach { forward: self.law.period_s, backward: self.law.period_s };
        }
        self.turning.approach(n.dot(&self.ahead), n.perp(&self.ahead))
    }
}

/// How far at most full speed leads towards a body within the period at any turn rate up to `turn_rate_radps`,
/// forwards or backwards, m: the heading turns by no more than that.
fn towards_m(law: &Law, ahead: Vec2, turn_rate_radps: f64, body: &Body) -> f64 {
    let (along, turn) = (body.normal.dot(&ahead), turn_rate_radps * law.period_s);
    let forward_m = (turn - along).max(0.0) * law.limits.v_max_mps;
    let backward_m = (turn + along).max(0.0) * -law.limits.v_min_mps;
    forward_m.max(backward_m) * law.period_s
}

/// Whether no command at this turn rate comes near a body's line, `budget_m` away; `ahead` is the heading.
/// True of most bodies, and decided without the closed form.
pub(super) fn is_out_of_reach(
    law: &Law,
    ahead: Vec2,
    turn_rate_radps: f64,
    body: &Body,
    budget_m: f64,
) -> bool {
    law.margin.is_none() && !body.anywhere && towards_m(law, ahead, turn_rate_radps, body) <= budget_m
}

/// Fills the safety and comfort rows of a robot that heads along `ahead`, the rest of whose programme is filled; false
/// when there is no room for all of them.
pub(super) fn fill(law: &Law, ahead: Vec2, bodies: &[Body], programme: &mut Programme) -> bool {
    let rate = law.control.gamma.min(law.control.comfort_gamma);
    let is_within = |body: &Body, turn_rate_radps: f64| {
        let budget_m = budget_m(body.gap_m, rate, body.share);
        !is_out_of_reach(law, ahead, turn_rate_radps, body, budget_m)
    };
    // Most bodies are out of reach even at the largest turn rate, and so at every smaller one: when all are, none is
    // asked for.
    let most_radps = law.limits.turn_rate_radps();
    let Some(first) = bodies.iter().position(|body| is_within(body, most_radps)) else { return true };
    // Form F1 needs ω before the rows in v: the programme separates, so ω is already decided.
    let (omega_radps, turn_rate_radps) = match law.control.barrier {
        BarrierForm::Exact => {
            let omega_radps = optimal_turn_rate(programme);
            (omega_radps, omega_radps.abs())
        }
        BarrierForm::Linear => (0.0, most_radps),
    };
    let approaching = Approaching::new(law, ahead, omega_radps);
    for body in bodies[first..].iter().filter(|body| is_within(body, turn_rate_radps)) {
        let approach = approaching.in_form(body);
        let safety = budget_m(body.gap_m, law.control.gamma, body.share);
        let comfort = budget_m(body.gap_m, law.control.comfort_gamma, body.share);
        let mut push = |coefficient: f64, speed_mps: f64| {
            // A row that full speed cannot reach does not bind.
            let binds = |bound: f64| coefficient.abs() * speed_mps > bound;
            (!binds(safety) || programme.push_safety(Row { coefficient, bound: safety }))
                && (!binds(comfort) || programme.push_comfort(Row { coefficient, bound: comfort }))
        };
        if !push(approach.forward, law.limits.v_max_mps) || !push(-approach.backward, -law.limits.v_min_mps) {
            return false;
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use crate::controller::Timing;
    use crate::evaluation::initial_fleet;
    use crate::geometry::unit;
    use crate::scenario::Scenario;
    use proptest::prelude::*;

    proptest! {
        /// What is left out without its closed form is what the closed form would have left out.
        #[test]
        fn what_is_out_of_reach_takes_no_more_than_its_budget_at_any_speed(
            theta in -3.1..3.1f64, at in -3.1..3.1f64, gap_m in -0.1..0.6f64, turn in -1.0..1.0f64,
            limits in (-4.0..=0.0f64, 0.1..5.0f64, -2.0..-0.1f64, 0.1..2.0f64), exact in any::<bool>(),
            share in prop_oneof![Just(0.5), Just(1.0)], speed in -1.0..1.0f64,
        ) {
            let mut scenario = Scenario::builtin("head-on").unwrap();
            let l = &mut scenario.limits;
            (l.v_min_mps, l.v_max_mps, l.omega_min_radps, l.omega_max_radps) = limits;
            let mut config = Config::new(scenario);
            config.controller.barrier = if exact { BarrierForm::Exact } else { BarrierForm::Linear };
            let mut law = Law::new(&config);
            law.prepare(&initial_fleet(&config), Timing::default());
            let omega = if turn < 0.0 { -turn * limits.2 } else { turn * limits.3 };
            let v = if speed < 0.0 { -speed * limits.0 } else { speed * limits.1 };
            let body = Body { normal: unit(at), gap_m, share, anywhere: false, blind: 0.0 };
            let budget = budget_m(gap_m, law.control.comfort_gamma, share);
            let turn_rate = if exact { omega.abs() } else { law.limits.turn_rate_radps() };
            let used = |a: Approach| if v < 0.0 { -v * a.backward } else { v * a.forward };
            let approaching = Approaching::new(&law, unit(theta), omega);
            if is_out_of_reach(&law, unit(theta), turn_rate, &body, budget) {
                prop_assert!(used(approaching.in_form(&body)) <= budget + 1e-12);
                prop_assert!(used(approaching.exact(&body)) <= budget + 1e-12);
            }
            let anywhere = Body { anywhere: true, ..body };
            prop_assert!(!is_out_of_reach(&law, unit(theta), turn_rate, &anywhere, budget));
            // Facing away it is, and straight at what touches it is not.
            let ahead = Body { gap_m: 0.0, ..body };
            prop_assert!(!is_out_of_reach(&law, -body.normal, turn_rate, &ahead, 0.0));
        }
    }
}
