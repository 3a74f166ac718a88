use crate::channel::Asked;
use crate::runtime::desk::Change;
use crate::wire::state_flags;

/// A request whose changes are with the loop.
pub(super) struct Pending {
    pub(super) key: u64,
    pub(super) asked: Asked,
}

/// A request's changes that are with the loop.
pub(super) struct UnderWay {
    pub(super) key: u64,
    pub(super) client: u128,
    pub(super) refusals_known: u64,
    pub(super) changes: Vec<Change>,
}

pub(super) fn is_hold(changes: &[Change]) -> bool {
    changes.iter().all(|change| matches!(change, Change::Hold { .. }))
}

pub(super) fn is_stop(changes: &[Change]) -> bool {
    matches!(changes, [Change::Hold { set: state_flags::STOPPED, .. }])
}

/// A stop on its way to the loop that serves for a new one too: nothing after it takes it back.
pub(super) fn stop_in_force(under_way: &[UnderWay]) -> Option<u64> {
    let of_stop = |change: &Change| matches!(change, Change::Hold { set, clear } if (set | clear) & state_flags::STOPPED != 0);
    let last = under_way.iter().rev().find(|one| one.changes.iter().any(of_stop))?;
    is_stop(&last.changes).then_some(last.key)
}

#[cfg(test)]
mod tests {
    use super::*;

    const STOP: Change = Change::Hold { set: state_flags::STOPPED, clear: 0 };
    const CLEAR: Change = Change::Hold { set: state_flags::PAUSED, clear: state_flags::STOPPED };
    const RESUME: Change = Change::Hold { set: 0, clear: state_flags::PAUSED };

    fn under_way(changes: &[Change]) -> Vec<UnderWay> {
        let one = |(key, change): (u64, &Change)| UnderWay {
            key,
            client: 0,
            refusals_known: 0,
            changes: vec![*change],
        };
        (0..).zip(changes).map(one).collect()
    }

    #[test]
    fn a_stop_relies_on_another_only_if_nothing_takes_that_back() {
        let goal = Change::Goal { place: 0, goal_m: crate::geometry::Vec2::new(0.0, 0.0) };
        let served_by = |changes: &[Change]| stop_in_force(&under_way(changes));
        assert_eq!(served_by(&[]), None);
        assert_eq!(served_by(&[goal]), None);
        assert_eq!(served_by(&[STOP]), Some(0));
        assert_eq!(served_by(&[STOP, goal, RESUME]), Some(0));
        assert_eq!(served_by(&[STOP, CLEAR]), None);
        assert_eq!(served_by(&[STOP, CLEAR, RESUME]), None);
        assert_eq!(served_by(&[STOP, CLEAR, RESUME, STOP]), Some(3));
        // Whatever comes, the fleet stands after its last stop.
        for before in [&[STOP, CLEAR, RESUME][..], &[STOP, CLEAR], &[CLEAR], &[STOP], &[RESUME]] {
            let mut all = before.to_vec();
            if served_by(&all).is_none() {
                all.push(STOP);
            }
            let hold = all.iter().fold(0, |hold, change| match change {
                Change::Hold { set, clear } => hold & !clear | set,
                _ => hold,
            });
            assert_ne!(hold & state_flags::STOPPED, 0, "{before:?}");
        }
    }
}
