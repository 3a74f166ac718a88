use crate::config::Config;
use crate::disturbance::DisturbedFleet;
use crate::figures::Accumulator;
use crate::model::{Command, RobotId};
use crate::wire::RobotState;

/// What the plant's robots really do when they are disturbed.
///
/// States are what is seen, and figures are about what is. The same seed disturbs a second fleet in
/// the same way under the recorded commands, outside of the real-time threads.
#[derive(Debug)]
pub(super) struct Truth {
    fleet: Option<DisturbedFleet>,
    states: Vec<RobotState>,
    next_tick: u64,
}

impl Truth {
    /// The truth about a daemon with its own plant; another source's is not known, and its states count.
    pub(super) fn new(config: &Config) -> Self {
        let own = config.source.kind == crate::config::SourceKind::Plant;
        let disturbed = own && !config.disturbance.amplitude.is_none();
        let fleet = || DisturbedFleet::new(&config.scenario, &config.disturbance, config.timing.period_s());
        Self { fleet: disturbed.then(fleet), states: Vec::new(), next_tick: 0 }
    }

    /// Adds the period that starts at `tick` with `states` and the commands in force to the figures.
    pub(super) fn observe(&mut self, figures: &mut Accumulator, tick: u64, states: &[RobotState]) {
        let Some(fleet) = &mut self.fleet else {
            figures.observe_period(tick, states);
            return;
        };
        fleet.make_room(states.len());
        // Who was added since stands where it was put.
        for (index, state) in states.iter().enumerate() {
            if fleet.id(index) != Some(state.id) {
                fleet.place(index, RobotId(state.id), state.pose());
            }
        }
        // Nobody has a command in a period without a record.
        while self.next_tick < tick {
            pass(fleet, figures, |_| Command::STOP);
            self.next_tick += 1;
        }
        self.states.clear();
        self.states.extend_from_slice(states);
        for (index, state) in self.states.iter_mut().enumerate() {
            if let Some(pose) = fleet.pose(index) {
                state.set_pose(pose);
            }
        }
        figures.observe_progress(tick, &self.states);
        pass(fleet, figures, |index| states[index].command());
        self.next_tick = tick + 1;
    }
}

fn pass(fleet: &mut DisturbedFleet, figures: &mut Accumulator, command: impl Fn(usize) -> Command) {
    let step_s = fleet.step_s();
    for _ in 0..DisturbedFleet::STEPS {
        let arcs = fleet.step(&command);
        figures.observe_motion(arcs, step_s);
    }
}
