use crate::config::Config;
use crate::disturbance::{DisturbedFleet, Remaining};
use crate::figures::Accumulator;
use crate::geometry::{Arc, Integration};
use crate::wire::{RobotState, state_flags};

/// A robot that may still travel this much counts as standing, m.
const AT_REST_M: f64 = 1e-4;

/// What lies between the commands and the states: the exact plant, or a disturbed one.
pub(super) struct World {
    period_s: f64,
    /// How undisturbed robots move.
    plant: Integration,
    disturbed: Option<DisturbedFleet>,
    /// States with the true poses, where they are not the ones that are seen.
    truth: Vec<RobotState>,
    /// What the rows are told of earlier commands; `None` when they allow for nothing.
    remaining: Option<Remaining>,
    /// What the wheels of the disturbed plant have left.
    settling: Remaining,
    arcs: Vec<Arc>,
}

impl World {
    pub(super) fn new(config: &Config, fleet: &[RobotState]) -> Self {
        let period_s = config.timing.period_s();
        let amplitude = config.disturbance.amplitude;
        let disturbed = (!amplitude.is_none())
            .then(|| DisturbedFleet::new(&config.scenario, &config.disturbance, period_s));
        let remaining =
            (!config.robust.is_none()).then(|| Remaining::new(fleet.len(), &config.robust, period_s));
        Self {
            period_s,
            plant: config.source.plant,
            disturbed,
            truth: fleet.to_vec(),
            remaining,
            settling: Remaining::new(fleet.len(), &amplitude, period_s),
            arcs: Vec::with_capacity(fleet.len()),
        }
    }

    /// Replaces the poses by what is seen of them at `tick`.
    pub(super) fn show(&mut self, tick: u64, fleet: &mut [RobotState]) {
        for (index, state) in fleet.iter_mut().enumerate() {
            if let Some(pose) = self.disturbed.as_ref().and_then(|world| world.seen(index, tick)) {
                state.set_pose(pose);
            }
            if let (Some(remaining), false) = (&self.remaining, state.has(state_flags::FOREIGN)) {
                state.uncertainty_m = remaining.travel_m(index);
            }
        }
    }

    /// The states with the poses as they are.
    pub(super) fn truth<'a>(&'a mut self, fleet: &'a [RobotState]) -> &'a [RobotState] {
        let Some(world) = &self.disturbed else { return fleet };
        self.truth.copy_from_slice(fleet);
        for (index, state) in self.truth.iter_mut().enumerate() {
            if let Some(pose) = world.pose(index) {
                state.set_pose(pose);
            }
        }
        &self.truth
    }

    /// Whether nobody travels any more on the commands so far.
    pub(super) fn at_rest(&self) -> bool {
        self.disturbed.is_none() || (0..self.truth.len()).all(|i| self.settling.travel_m(i) < AT_REST_M)
    }

    /// A period passes under the commands in force.
    pub(super) fn pass(&mut self, fleet: &mut [RobotState], figures: &mut Accumulator) {
        for (index, state) in fleet.iter().enumerate() {
            self.settling.hold(index, state.command());
            if let Some(remaining) = &mut self.remaining {
                remaining.hold(index, state.command());
            }
        }
        let Some(world) = &mut self.disturbed else {
            self.arcs.clear();
            self.arcs.extend(fleet.iter().map(|state| self.plant.path(&state.arc())));
            figures.observe_motion(&self.arcs, self.period_s);
            for state in fleet {
                state.set_pose(self.plant.pose(&state.arc(), self.period_s));
            }
            return;
        };
        let step_s = world.step_s();
        for _ in 0..DisturbedFleet::STEPS {
            let arcs = world.step(|index| fleet[index].command());
            figures.observe_motion(arcs, step_s);
        }
    }
}
