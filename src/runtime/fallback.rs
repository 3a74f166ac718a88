//! What goes out for a robot: what its worker staged, or a stop in its place.

use crate::model::{Limits, RobotId};
use crate::wire::{RobotCommand, RobotIntent, RobotState, StopReason, state_flags};

/// What the loop has to know of a robot to answer it: the head of its state.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Told {
    id: u32,
    flags: u32,
}

impl Told {
    fn has(self, flags: u32) -> bool {
        self.flags & flags == flags
    }
}

impl From<&RobotState> for Told {
    fn from(state: &RobotState) -> Self {
        Self { id: state.id, flags: state.flags }
    }
}

/// The command and the intent of the robot that was `told`.
///
/// `staged` goes out if the robot may be driven, has a state that is trusted, and is to drive within
/// `limits`; otherwise a stop does, and why: nobody to be driven before orders, orders before a missing
/// state, that before `missing`, which is said when nothing was staged. A robot whose command is not the
/// one that its worker chose rests, and means what it meant `before`.
pub(super) fn answer(
    told: Told,
    staged: Option<(RobotCommand, RobotIntent)>,
    missing: StopReason,
    limits: &Limits,
    before: &RobotIntent,
) -> (RobotCommand, RobotIntent) {
    let stop = |reason| RobotCommand::stop(RobotId(told.id), reason);
    let command = match staged {
        _ if told.has(state_flags::VACANT) => stop(StopReason::Vacant),
        _ if told.has(state_flags::FOREIGN) => stop(StopReason::Foreign),
        _ if told.has(state_flags::STOPPED) => stop(StopReason::Stopped),
        _ if told.has(state_flags::PAUSED) => stop(StopReason::Paused),
        _ if !told.has(state_flags::VALID) => stop(StopReason::NoState),
        _ if told.has(state_flags::OUT_OF_STEP) => stop(StopReason::OutOfStep),
        None => stop(missing),
        Some((staged, _)) if staged.stop_reason != 0 => {
            RobotCommand { id: told.id, v_mps: 0.0, omega_radps: 0.0, ..staged }
        }
        Some((staged, _)) if limits.admits(staged.command()) => RobotCommand { id: told.id, ..staged },
        Some(_) => stop(StopReason::Unverified),
    };
    let intent = match staged {
        Some((staged, meant))
            if told.has(state_flags::VALID)
                && !told.has(state_flags::PAUSED)
                && !told.has(state_flags::STOPPED)
                && staged.stop_reason == command.stop_reason =>
        {
            meant
        }
        _ => resting(before),
    };
    (command, intent)
}

/// The intent of a robot that stands although it had other plans. Without one it would be taken to
/// drive to its goal at full speed.
pub(super) fn resting(intent: &RobotIntent) -> RobotIntent {
    RobotIntent { speed_mps: 0.0, ..*intent }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Command;
    use proptest::prelude::*;
    use state_flags::{ARRIVED, FOREIGN, OUT_OF_STEP, PAUSED, STOPPED, VACANT, VALID};

    fn state(flags: u32) -> RobotState {
        RobotState { id: 4, flags, ..RobotState::default() }
    }

    fn staged(stop_reason: u32, v_mps: f64, omega_radps: f64) -> (RobotCommand, RobotIntent) {
        // Its worker cannot say for whom it is.
        (RobotCommand { id: 99, stop_reason, v_mps, omega_radps }, intent(2.0))
    }

    fn intent(n: f64) -> RobotIntent {
        RobotIntent {
            speed_mps: n,
            heading_rad: n,
            blocked_s: n,
            target_x_m: n,
            rank: 3,
            valid: 1,
            ..RobotIntent::default()
        }
    }

    fn answered(flags: u32, staged: Option<(RobotCommand, RobotIntent)>) -> (RobotCommand, RobotIntent) {
        answer((&state(flags)).into(), staged, StopReason::Deadline, &Limits::default(), &intent(1.0))
    }

    #[test]
    fn of_several_reasons_the_one_that_lasts_longest_is_told() {
        let good = Some(staged(0, 1.0, 0.5));
        let cases = [
            (VALID | VACANT | FOREIGN | STOPPED | PAUSED, StopReason::Vacant),
            (VALID | FOREIGN | STOPPED | PAUSED, StopReason::Foreign),
            (VALID | STOPPED | PAUSED, StopReason::Stopped),
            (STOPPED, StopReason::Stopped),
            (VALID | PAUSED, StopReason::Paused),
            (PAUSED, StopReason::Paused),
            (0, StopReason::NoState),
            (OUT_OF_STEP, StopReason::NoState),
            (VALID | OUT_OF_STEP | PAUSED, StopReason::Paused),
            (ARRIVED, StopReason::NoState),
        ];
        for (flags, reason) in cases {
            for staged in [good, None] {
                let (command, intent) = answered(flags, staged);
                assert_eq!(command, RobotCommand::stop(RobotId(4), reason), "{flags:b}");
                assert_eq!(intent, RobotIntent { speed_mps: 0.0, ..super::tests::intent(1.0) });
            }
        }
        for missing in [StopReason::Deadline, StopReason::Corrupt] {
            let (command, rests) =
                answer((&state(VALID)).into(), None, missing, &Limits::default(), &intent(1.0));
            assert_eq!(command, RobotCommand::stop(RobotId(4), missing));
            assert_eq!(rests, resting(&intent(1.0)));
        }
    }

    #[test]
    fn a_robot_that_follows_nothing_is_told_that_this_is_known_whatever_was_staged() {
        for staged in [Some(staged(0, 1.0, 0.5)), None] {
            let (command, _) = answered(VALID | OUT_OF_STEP, staged);
            assert_eq!(command, RobotCommand::stop(RobotId(4), StopReason::OutOfStep));
        }
    }

    #[test]
    fn a_verified_command_goes_out_as_it_was_staged_for_this_robot() {
        let (command, meant) = answered(VALID | ARRIVED, Some(staged(0, 5.0, -1.0)));
        assert_eq!(command, RobotCommand::verified(RobotId(4), Command { v_mps: 5.0, omega_radps: -1.0 }));
        assert_eq!(meant, intent(2.0));
    }

    #[test]
    fn a_stop_of_the_worker_keeps_its_reason_and_its_intent() {
        let code = StopReason::Crowded as u32;
        let (command, meant) = answered(VALID, Some(staged(code, 3.0, f64::NAN)));
        assert_eq!(command, RobotCommand::stop(RobotId(4), StopReason::Crowded));
        assert_eq!(meant, intent(2.0));
    }

    #[test]
    fn what_is_not_admissible_is_not_sent_and_not_told() {
        for (v, omega) in [(5.1, 0.0), (-0.1, 0.0), (0.0, 1.1), (f64::NAN, 0.0), (0.0, f64::INFINITY)] {
            let (command, told) = answered(VALID, Some(staged(0, v, omega)));
            assert_eq!(command, RobotCommand::stop(RobotId(4), StopReason::Unverified), "{v} {omega}");
            assert_eq!(told, resting(&intent(1.0)));
        }
    }

    proptest! {
        /// Whatever was staged, in whatever state: a robot drives only if nothing speaks against it, and
        /// then as its worker says; everything else is a stop with its reason.
        #[test]
        fn a_robot_drives_only_when_nothing_speaks_against_it(
            flags in 0..64_u32,
            code in prop_oneof![Just(0_u32), 1..14_u32, any::<u32>()],
            bits in prop_oneof![(0.0..5.0f64, -1.0..1.0f64).prop_map(|(v, w)| [v.to_bits(), w.to_bits()]), any::<[u64; 2]>()],
            there in prop::bool::weighted(0.8),
        ) {
            let [v, omega] = bits.map(f64::from_bits);
            let (command, meant) = answered(flags, there.then(|| staged(code, v, omega)));
            let limits = Limits::default();
            let free = flags & (VACANT | FOREIGN | STOPPED | PAUSED) == 0 && flags & VALID != 0;
            let drives = free && there && code == 0 && limits.admits(Command { v_mps: v, omega_radps: omega });
            prop_assert_eq!(command.id, 4);
            prop_assert_eq!(command.stop_reason == 0, drives);
            let expected = if drives { [v, omega] } else { [0.0; 2] };
            prop_assert_eq!([command.v_mps, command.omega_radps].map(f64::to_bits), expected.map(f64::to_bits));
            // Its plan is told only with the command that belongs to it.
            prop_assert!(meant == intent(2.0) || meant == resting(&intent(1.0)));
            prop_assert!(meant != intent(2.0) || there && command.stop_reason == code);
            prop_assert!(!drives || meant == intent(2.0));
        }
    }
}
