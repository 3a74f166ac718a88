//! What goes wrong inside a worker: its solver, its decisions, itself.

use std::cell::Cell;
use std::rc::Rc;

use crate::controller::{Decision, Remembered, RobotGroup};
use crate::model::{Command, RobotId};
use crate::programme::{Programme, Solution};
use crate::runtime::{Claims, Decider};
use crate::solver::{ExactSolver, Outcome, Solver};
use crate::wire::{RobotCommand, RobotState};

/// What a worker does wrong now.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum Wrong {
    #[default]
    Nothing,
    /// Panics after so many robots.
    Panic(usize),
    Nan,
    Beyond,
    Almost,
    GivesUp,
    /// Stages what no robot can do.
    Wild,
    /// Drives where it must not, and says that it was verified.
    Reckless,
    /// Changes a command by its last bit.
    #[cfg(test)]
    Nudge,
    /// Takes everybody to be where commands lead.
    #[cfg(test)]
    Trusting,
}

/// Tells a worker what to do wrong, and hears how often it could.
#[derive(Debug, Default)]
pub(crate) struct Switch {
    pub(crate) wrong: Cell<Wrong>,
    pub(crate) applied: Cell<u64>,
}

impl Switch {
    fn note(&self) {
        self.applied.set(self.applied.get() + 1);
    }
}

/// The exact solver, or one that answers wrongly.
pub(crate) struct FaultySolver(pub(crate) Rc<Switch>);

impl Solver for FaultySolver {
    fn solve(&mut self, programme: &Programme, solution: &mut Solution) -> Outcome {
        let outcome = ExactSolver.solve(programme, solution);
        let wrong = self.0.wrong.get();
        match wrong {
            Wrong::Nan => (solution.v_mps, solution.omega_radps) = (f64::NAN, f64::NAN),
            Wrong::Beyond => (solution.v_mps, solution.omega_radps) = (1e3, -1e3),
            // To a thousandth: what a solver calls almost solved.
            Wrong::Almost => {
                let v_mps = solution.v_mps;
                solution.v_mps = if v_mps > 0.5 { v_mps - 1e-3 } else { v_mps + 1e-3 };
                solution.omega_radps += if solution.omega_radps > 0.0 { -1e-3 } else { 1e-3 };
            }
            Wrong::GivesUp => {
                self.0.note();
                return Outcome::NotConverged;
            }
            _ => return outcome,
        }
        self.0.note();
        outcome
    }
}

/// A worker's group, and what it does wrong.
pub(crate) struct Hand {
    pub(crate) group: RobotGroup,
    pub(crate) switch: Rc<Switch>,
}

impl Decider for Hand {
    fn decide(&mut self, fleet: &[RobotState], each: &mut dyn FnMut(usize, &Decision)) {
        Decider::decide(&mut self.group, fleet, each);
    }

    fn is_regional(&self) -> bool {
        true
    }

    fn decide_parts(
        &mut self,
        (tick, parts): (u64, Claims),
        fleet: &[RobotState],
        remember: &mut dyn FnMut(usize, &Remembered),
        each: &mut dyn FnMut(usize, &Decision),
    ) {
        let (switch, mut answered) = (&self.switch, 0);
        let mut answer = |index: usize, decision: &Decision| {
            if switch.wrong.get() == Wrong::Panic(answered) {
                switch.note();
                // Not the hook's affair: it is meant.
                std::panic::resume_unwind(Box::new("a fault, injected"));
            }
            answered += 1;
            let mut decision = *decision;
            // The same on every machine.
            decision.telemetry.step_ns = 5_000 + u64::from(decision.telemetry.id % 64) * 50;
            decision.telemetry.solve_ns = 100;
            spoil(switch, fleet.get(index), &mut decision);
            each(index, &decision);
        };
        #[cfg(test)]
        if switch.wrong.get() == Wrong::Trusting {
            switch.note();
            let nobody_stands = |state: &RobotState| RobotState {
                flags: state.flags & !crate::wire::state_flags::MAY_STAND,
                ..*state
            };
            let fleet: Vec<RobotState> = fleet.iter().map(nobody_stands).collect();
            return Decider::decide_parts(&mut self.group, (tick, parts), &fleet, remember, &mut answer);
        }
        Decider::decide_parts(&mut self.group, (tick, parts), fleet, remember, &mut answer);
    }
}

fn spoil(switch: &Switch, state: Option<&RobotState>, decision: &mut Decision) {
    let Some(state) = state else { return };
    let id = RobotId(state.id);
    match switch.wrong.get() {
        Wrong::Wild if decision.command.stop_reason == 0 => {
            switch.note();
            let wild = Command { v_mps: f64::INFINITY, omega_radps: 1e9 };
            decision.command = RobotCommand::verified(id, wild);
        }
        Wrong::Reckless => {
            switch.note();
            decision.command = RobotCommand::verified(id, Command { v_mps: 5.0, omega_radps: 0.0 });
        }
        #[cfg(test)]
        Wrong::Nudge if decision.command.stop_reason == 0 && decision.command.omega_radps != 0.0 => {
            switch.note();
            let omega = &mut decision.command.omega_radps;
            *omega = f64::from_bits(omega.to_bits() - 1);
        }
        _ => {}
    }
}
