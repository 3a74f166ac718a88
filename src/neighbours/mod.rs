//! Who is near: the other robots within a range, nearest first, the smaller id breaking ties.
//!
//! Reads a fleet's states, writes an index list. Cost: one distance for every robot of the fleet and
//! a sort of those in range. The list has room for the whole fleet from the start, so nothing is
//! ever truncated and nothing allocates.

use crate::wire::{RobotState, state_flags};

/// Another robot of the fleet, seen from one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearby {
    /// Distance of the centres, m.
    pub distance_m: f64,
    /// Its id.
    pub id: u32,
    /// Its index in the fleet.
    pub index: usize,
}

/// The robots near one robot.
#[derive(Debug, Clone)]
pub struct Neighbourhood {
    list: Vec<Nearby>,
}

impl Neighbourhood {
    /// With room for a fleet of `robots`.
    pub fn with_capacity(robots: usize) -> Self {
        Self { list: Vec::with_capacity(robots) }
    }

    /// Lists the robots within `range_m` of robot `me`.
    ///
    /// A fleet larger than the capacity would allocate; the controller never passes one.
    pub fn gather(&mut self, fleet: &[RobotState], me: usize, range_m: f64) -> &[Nearby] {
        let here = fleet[me].position_m();
        self.list.clear();
        self.list.extend(fleet.iter().enumerate().filter(|(index, _)| *index != me).filter_map(
            |(index, other)| {
                if other.has(state_flags::VACANT) {
                    return None;
                }
                let squared = (other.position_m() - here).norm_squared();
                (squared <= range_m * range_m).then(|| Nearby {
                    distance_m: squared.sqrt(),
                    id: other.id,
                    index,
                })
            },
        ));
        self.list.sort_unstable_by(|a, b| a.distance_m.total_cmp(&b.distance_m).then(a.id.cmp(&b.id)));
        &self.list
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(id: u32, x_m: f64, y_m: f64) -> RobotState {
        RobotState { id, x_m, y_m, ..RobotState::default() }
    }

    #[test]
    fn nearest_first_and_the_smaller_id_breaks_ties() {
        let fleet = [at(9, 1.0, 0.0), at(3, 0.0, 0.0), at(4, 0.0, 1.0), at(7, 0.5, 0.0), at(5, 30.0, 0.0)];
        let mut near = Neighbourhood::with_capacity(fleet.len());
        let ids: Vec<u32> = near.gather(&fleet, 1, 8.0).iter().map(|n| n.id).collect();
        assert_eq!(ids, [7, 4, 9]);
        assert!(near.gather(&fleet, 4, 8.0).is_empty());
        // A free place is nobody.
        let mut fleet = fleet;
        fleet[0] = RobotState::vacant();
        let ids: Vec<u32> = near.gather(&fleet, 1, 8.0).iter().map(|n| n.id).collect();
        assert_eq!(ids, [7, 4]);
    }
}
