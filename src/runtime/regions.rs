//! Which part of the fleet each worker answers.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};

/// How much more than the average the busiest worker may work before the regions are changed, percent.
const UNEVEN_PERCENT: u64 = 5;

/// Regions of ground, one a worker: contiguous parts of the fleet in the order of its cells.
///
/// The order is that of the period's positions, which every worker sorts for itself anyway, so that a
/// robot that drives from one region into another changes hands with its memory, and one that joins is
/// in the region where it stands. What is stored is only where the parts begin and end. Housekeeping
/// asks for other cuts, and the loop adopts them before it releases a period.
#[derive(Debug)]
pub(super) struct Regions {
    places: usize,
    /// Of the period that runs: the beginnings, and the end of the last.
    cuts: Vec<AtomicUsize>,
    /// Of a later period, while `pending`.
    wanted: Vec<AtomicUsize>,
    pending: AtomicBool,
    adopted: AtomicU64,
}

impl Regions {
    /// Equal parts of `places` for `workers`.
    pub(super) fn new(places: usize, workers: usize) -> Self {
        let workers = workers.max(1);
        let cuts = || (0..=workers).map(|w| AtomicUsize::new(w * places / workers)).collect();
        Self {
            places,
            cuts: cuts(),
            wanted: cuts(),
            pending: AtomicBool::new(false),
            adopted: AtomicU64::new(0),
        }
    }

    /// Places of a region at most: half as many again as in an equal part.
    pub(super) fn room(&self) -> usize {
        let equal = self.places.div_ceil(self.cuts.len() - 1);
        self.places.min(equal + equal / 2 + 1)
    }

    /// The part of worker `index`, of the fleet in spatial order.
    pub(super) fn of(&self, index: usize) -> Range<usize> {
        let cut = |at: usize| self.cuts.get(at).map_or(self.places, |cut| cut.load(Ordering::Relaxed));
        cut(index)..cut(index + 1)
    }

    /// Where the regions begin, and the end.
    pub(super) fn cuts(&self) -> Vec<usize> {
        self.cuts.iter().map(|cut| cut.load(Ordering::Relaxed)).collect()
    }

    /// Asks for other regions, for one thread only; false when the last ones are not adopted yet.
    pub(super) fn want(&self, cuts: &[usize]) -> bool {
        if self.pending.load(Ordering::Acquire) {
            return false;
        }
        for (wanted, cut) in self.wanted.iter().zip(cuts) {
            wanted.store(*cut, Ordering::Relaxed);
        }
        self.pending.store(true, Ordering::Release);
        true
    }

    /// Puts the wanted regions in force. For the loop, between two periods.
    pub(super) fn adopt(&self) {
        if self.pending.load(Ordering::Acquire) {
            for (cut, wanted) in self.cuts.iter().zip(&self.wanted) {
                cut.store(wanted.load(Ordering::Relaxed), Ordering::Relaxed);
            }
            self.adopted.fetch_add(1, Ordering::Relaxed);
            self.pending.store(false, Ordering::Release);
        }
    }

    /// How often they have changed.
    #[cfg(test)]
    pub(super) fn adopted(&self) -> u64 {
        self.adopted.load(Ordering::Relaxed)
    }

    /// Regions of equal work, when with `work_ns` of each worker lately they are uneven; as even as
    /// `room` allows.
    pub(super) fn balanced(&self, work_ns: &[u64]) -> Option<Vec<usize>> {
        let (workers, cuts) = (work_ns.len() as u64, self.cuts());
        let (total, most) = (work_ns.iter().sum::<u64>(), work_ns.iter().copied().max()?);
        let uneven = most * workers * 100 > total * (100 + UNEVEN_PERCENT);
        if !uneven || work_ns.contains(&0) || cuts.len() != work_ns.len() + 1 {
            return None;
        }
        let balanced = balance(&cuts, work_ns, self.room());
        (balanced != cuts).then_some(balanced)
    }
}

/// Cuts such that every region has the same work, if the work of each was spread evenly over it, and none
/// has more than `room` places.
fn balance(cuts: &[usize], work_ns: &[u64], room: usize) -> Vec<usize> {
    let workers = work_ns.len();
    let places = cuts.last().copied().unwrap_or(0);
    let total: u128 = work_ns.iter().map(|ns| u128::from(*ns)).sum();
    let mut balanced = vec![0];
    for worker in 1..workers {
        // The region in which this much of the work is done, and where in it.
        let share = total * worker as u128 / workers as u128;
        let (mut before, mut cut) = (0, places);
        for (part, ns) in cuts.windows(2).zip(work_ns) {
            let (ns, length) = (u128::from(*ns), part[1].saturating_sub(part[0]) as u128);
            if before + ns >= share {
                let into = ((share - before) * length).checked_div(ns).unwrap_or(0);
                cut = part[0] + usize::try_from(into).unwrap_or(0);
                break;
            }
            before += ns;
        }
        let last = balanced.last().copied().unwrap_or(0);
        let rest = places.saturating_sub(room * (workers - worker));
        balanced.push(cut.max(last).min(last + room).max(rest));
    }
    balanced.push(places);
    balanced
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regions_are_balanced_by_work_and_bounded_by_room() {
        let regions = Regions::new(100, 2);
        assert_eq!((regions.of(0), regions.of(1), regions.room()), (0..50, 50..100, 76));
        assert_eq!(regions.balanced(&[100, 104]), None);
        assert_eq!(regions.balanced(&[100, 0]), None);
        // 2 and 4 ns a place: 25 · 4 more places of the second part would be too many.
        assert_eq!(regions.balanced(&[100, 200]), Some(vec![0, 62, 100]));
        assert_eq!(regions.balanced(&[1, 1_000_000]), Some(vec![0, 74, 100]));
        assert_eq!(balance(&[0, 50, 100], &[1_000_000, 1], 76), [0, 25, 100]);
        assert_eq!(balance(&[0, 0, 10, 10], &[0, 7, 0], 4), [0, 2, 6, 10]);
        assert_eq!(Regions::new(3, 8).room(), 2);
    }

    #[test]
    fn what_is_wanted_is_in_force_once_it_is_adopted() {
        let regions = Regions::new(10, 3);
        assert!(regions.want(&[0, 1, 2, 10]) && !regions.want(&[0, 9, 9, 10]));
        assert_eq!((regions.of(1), regions.adopted()), (3..6, 0));
        regions.adopt();
        regions.adopt();
        assert_eq!((regions.of(1), regions.of(2), regions.adopted()), (1..2, 2..10, 1));
        assert!(regions.want(&[0, 9, 9, 10]));
    }
}
