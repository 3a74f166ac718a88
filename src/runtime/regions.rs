//! Which part of the fleet each worker answers.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};

use crossbeam::utils::CachePadded;

/// By how many robots what a worker answers may differ from its region before the regions are changed, percent of
/// an equal part.
const UNEVEN_PERCENT: u64 = 5;

/// Pieces in which an equal part is claimed: at the end nobody waits for longer than one of them takes.
const PIECES: usize = 64;
/// Places of a piece at most.
const PIECE_MAX: usize = 64;

/// Bits of a claim for a place; above them is the tick modulo 2³².
const PLACE_BITS: u32 = 32;

/// Regions of ground, one a worker: contiguous parts of the fleet in the order of its cells.
///
/// The order is that of the period's positions, which every worker sorts for itself anyway, so that a
/// robot that drives from one region into another changes hands with its memory, and one that joins is
/// in the region where it stands. What is stored is only where the parts begin and end.
///
/// A worker claims its region piece by piece, and what is left of the others' when it is through: one that is
/// held up, for whatever reason, leaves no robot without an answer but those of its piece. Housekeeping asks for cuts
/// that give each worker what it answers anyway, and the loop adopts them before it releases a period.
///
/// The region of a worker that panicked lately is its own and its only one, and none is changed: what made it
/// panic may lie in one of the robots there, and would bring down the others as well; or in one of another's.
#[derive(Debug)]
pub(super) struct Regions {
    places: usize,
    /// Of the period that runs: the beginnings, and the end of the last.
    cuts: Vec<AtomicUsize>,
    /// Of each region: the tick, and the first place that nobody has claimed in it.
    claims: Vec<CachePadded<AtomicU64>>,
    /// Whose regions only they themselves may claim, and nothing else.
    reserved: Vec<AtomicBool>,
    /// Of a later period, while `pending`.
    wanted: Vec<AtomicUsize>,
    pending: AtomicBool,
    adopted: AtomicU64,
}

/// A claim up to `place` in period `tick`.
fn claim(tick: u64, place: usize) -> u64 {
    tick << PLACE_BITS | place as u64
}

impl Regions {
    /// Equal parts of `places` for `workers`. A fleet has fewer than 2³² places.
    pub(super) fn new(places: usize, workers: usize) -> Self {
        let workers = workers.max(1);
        let cuts = || (0..=workers).map(|w| AtomicUsize::new(w * places / workers)).collect();
        Self {
            places,
            cuts: cuts(),
            // Nothing is left of a tick that never comes.
            claims: (0..workers).map(|_| CachePadded::new(AtomicU64::new(u64::MAX))).collect(),
            reserved: (0..workers).map(|_| AtomicBool::new(false)).collect(),
            wanted: cuts(),
            pending: AtomicBool::new(false),
            adopted: AtomicU64::new(0),
        }
    }

    /// Places that a worker answers at most: half as many again as in an equal part.
    pub(super) fn room(&self) -> usize {
        let equal = self.places.div_ceil(self.cuts.len() - 1);
        self.places.min(equal + equal / 2 + 1)
    }

    /// The part of worker `index`, of the fleet in spatial order.
    pub(super) fn of(&self, index: usize) -> Range<usize> {
        let cut = |at: usize| self.cuts.get(at).map_or(self.places, |cut| cut.load(Ordering::Relaxed));
        cut(index)..cut(index + 1)
    }

    /// Claims the next places for `worker` in period `tick`: of its own region, then of what the others have not
    /// come to, at most `room` of these. None when all are claimed, and when a later period has begun.
    pub(super) fn claim(&self, worker: usize, tick: u64, room: usize) -> Option<Range<usize>> {
        let workers = self.claims.len();
        let piece = (self.places / (PIECES * workers)).clamp(1, PIECE_MAX);
        (0..workers).find_map(|turn| {
            let region = (worker + turn) % workers;
            if turn > 0 && (room == 0 || self.is_reserved(worker) || self.is_reserved(region)) {
                return None;
            }
            let most = if turn > 0 { piece.min(room) } else { piece };
            let end = self.of(region).end;
            let next = |claimed: u64| {
                let place = usize::try_from(claimed & claim(0, u32::MAX as usize)).unwrap_or(usize::MAX);
                let left = claimed == claim(tick, place) && place < end;
                left.then(|| (place, end.min(place + most)))
            };
            let claims = self.claims.get(region)?;
            let further = |claimed| next(claimed).map(|(_, to)| claim(tick, to));
            // What is claimed is read from shared memory that the release has made visible.
            let before = claims.fetch_update(Ordering::Relaxed, Ordering::Relaxed, further).ok()?;
            next(before).map(|(from, to)| from..to)
        })
    }

    fn is_reserved(&self, worker: usize) -> bool {
        self.reserved.get(worker).is_some_and(|region| region.load(Ordering::Relaxed))
    }

    fn any_reserved(&self) -> bool {
        (0..self.reserved.len()).any(|worker| self.is_reserved(worker))
    }

    /// Leaves the region of `worker` to it alone and it to its region, or both to all again.
    pub(super) fn reserve(&self, worker: usize, reserved: bool) {
        if let Some(region) = self.reserved.get(worker) {
            region.store(reserved, Ordering::Relaxed);
        }
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

    /// Puts the wanted regions in force and lets period `tick` claim them. For the loop, between two periods.
    pub(super) fn begin(&self, tick: u64) {
        if !self.any_reserved() && self.pending.load(Ordering::Acquire) {
            for (cut, wanted) in self.cuts.iter().zip(&self.wanted) {
                cut.store(wanted.load(Ordering::Relaxed), Ordering::Relaxed);
            }
            self.adopted.fetch_add(1, Ordering::Relaxed);
            self.pending.store(false, Ordering::Release);
        }
        for (claims, cut) in self.claims.iter().zip(&self.cuts) {
            claims.store(claim(tick, cut.load(Ordering::Relaxed)), Ordering::Relaxed);
        }
    }

    /// How often they have changed.
    #[cfg(test)]
    pub(super) fn adopted(&self) -> u64 {
        self.adopted.load(Ordering::Relaxed)
    }

    /// Regions as large as what each worker has `answered` lately, when that was uneven; none with more than
    /// there is [`room`](Self::room) for.
    pub(super) fn balanced(&self, answered: &[u64]) -> Option<Vec<usize>> {
        let cuts = self.cuts();
        if self.any_reserved() || cuts.len() != answered.len() + 1 {
            return None;
        }
        let (workers, total) =
            (answered.len() as u128, answered.iter().map(|n| u128::from(*n)).sum::<u128>());
        let regions = cuts.windows(2).map(|part| part[1].saturating_sub(part[0]) as u128);
        // Against what its region would have been.
        let uneven = answered.iter().zip(regions).any(|(answered, region)| {
            let (did, due) = (u128::from(*answered) * self.places as u128, region * total);
            did.abs_diff(due) * workers * 100 > total * self.places as u128 * u128::from(UNEVEN_PERCENT)
        });
        if !uneven {
            return None;
        }
        let balanced = balance(self.places, answered, self.room());
        (balanced != cuts).then_some(balanced)
    }
}

/// Cuts of `places` into regions in proportion to `answered`, none of them with more than `room` places.
fn balance(places: usize, answered: &[u64], room: usize) -> Vec<usize> {
    let workers = answered.len();
    let total: u128 = answered.iter().map(|n| u128::from(*n)).sum();
    let (mut balanced, mut before) = (vec![0], 0);
    for (worker, n) in answered.iter().enumerate().take(workers.saturating_sub(1)) {
        before += u128::from(*n);
        let cut = (before * places as u128).checked_div(total).unwrap_or(0);
        let last = balanced.last().copied().unwrap_or(0);
        let rest = places.saturating_sub(room * (workers - 1 - worker));
        balanced.push(usize::try_from(cut).unwrap_or(places).max(last).min(last + room).max(rest));
    }
    balanced.push(places);
    balanced
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regions_follow_what_is_answered_and_are_bounded_by_room() {
        let regions = Regions::new(100, 2);
        assert_eq!((regions.of(0), regions.of(1), regions.room()), (0..50, 50..100, 76));
        assert_eq!(regions.balanced(&[500, 500]), None);
        assert_eq!(regions.balanced(&[512, 488]), None);
        assert_eq!(regions.balanced(&[600, 400]), Some(vec![0, 60, 100]));
        assert_eq!(regions.balanced(&[0, 0]), None);
        assert_eq!(regions.balanced(&[1000, 0]), Some(vec![0, 76, 100]));
        assert_eq!(regions.balanced(&[1, 2, 3]), None);
        assert!(regions.want(&[0, 60, 100]));
        regions.begin(1);
        // What it is by now, and not what it would be if all were equal.
        assert_eq!(regions.balanced(&[600, 400]), None);
        assert_eq!(regions.balanced(&[500, 500]), Some(vec![0, 50, 100]));
        assert_eq!(balance(100, &[1_000_000, 1], 76), [0, 76, 100]);
        assert_eq!(balance(100, &[1, 1_000_000], 76), [0, 24, 100]);
        assert_eq!(balance(10, &[0, 7, 0], 4), [0, 2, 6, 10]);
        assert_eq!(Regions::new(3, 8).room(), 2);
    }

    #[test]
    fn nobody_else_claims_a_region_that_is_reserved_and_none_is_changed_meanwhile() {
        let regions = Regions::new(6, 2);
        regions.reserve(1, true);
        regions.begin(1);
        let of = |worker| std::iter::from_fn(|| regions.claim(worker, 1, 9)).flatten().collect::<Vec<_>>();
        assert_eq!((of(0), regions.balanced(&[500, 0])), (vec![0, 1, 2], None));
        assert_eq!(of(1), [3, 4, 5]);
        // Nor does who panicked meet what others have to answer.
        regions.begin(2);
        let own: Vec<_> = std::iter::from_fn(|| regions.claim(1, 2, 9)).flatten().collect();
        assert_eq!(own, [3, 4, 5]);
        assert!(regions.want(&[0, 1, 6]));
        regions.begin(2);
        assert_eq!(regions.of(1), 3..6);
        regions.reserve(1, false);
        regions.begin(2);
        assert_eq!(regions.of(1), 1..6);
        let of = |worker| std::iter::from_fn(|| regions.claim(worker, 2, 9)).flatten().collect::<Vec<_>>();
        assert_eq!((of(0), of(1)), ((0..6).collect(), vec![]));
        assert!(regions.balanced(&[500, 0]).is_some());
    }

    #[test]
    fn what_is_wanted_is_in_force_once_it_is_adopted() {
        let regions = Regions::new(10, 3);
        assert!(regions.want(&[0, 1, 2, 10]) && !regions.want(&[0, 9, 9, 10]));
        assert_eq!((regions.of(1), regions.adopted()), (3..6, 0));
        regions.begin(1);
        regions.begin(2);
        assert_eq!((regions.of(1), regions.of(2), regions.adopted()), (1..2, 2..10, 1));
        assert!(regions.want(&[0, 9, 9, 10]));
    }

    #[test]
    fn its_own_region_comes_first_and_a_period_that_is_over_has_nothing_left() {
        let regions = Regions::new(6, 2);
        assert_eq!(regions.claim(0, 0, 9), None);
        regions.begin(7);
        assert_eq!((regions.claim(1, 7, 9), regions.claim(0, 7, 9)), (Some(3..4), Some(0..1)));
        assert_eq!(regions.claim(0, 6, 9), None);
        let rest: Vec<_> = std::iter::from_fn(|| regions.claim(1, 7, 9)).collect();
        assert_eq!(rest, [4..5, 5..6, 1..2, 2..3]);
        assert_eq!(regions.claim(0, 7, 9), None);
        // What is its own it has room for, whatever it has answered.
        regions.begin(8);
        let own: Vec<_> = std::iter::from_fn(|| regions.claim(0, 8, 0)).collect();
        assert_eq!(own, [0..1, 1..2, 2..3]);
        // The tick is told apart to 32 bits, and the largest leaves no other bits behind.
        regions.begin(u64::MAX);
        assert_eq!((regions.claim(0, u64::MAX, 9), regions.claim(0, 7, 9)), (Some(0..1), None));
        // A piece is as large as the fleet makes it, and no larger than the room that is left.
        let large = Regions::new(100_000, 2);
        large.begin(1);
        assert_eq!((large.claim(0, 1, 5), large.claim(0, 1, 5)), (Some(0..64), Some(64..128)));
        assert!(
            std::iter::from_fn(|| large.claim(1, 1, 100))
                .take(50_000 / 64 + 1)
                .all(|part| part.start >= 50_000)
        );
        assert_eq!((large.claim(1, 1, 100), large.claim(1, 1, 5)), (Some(128..192), Some(192..197)));
    }

    /// Whoever is fast or slow: each place has one holder.
    #[test]
    fn workers_at_the_same_time_claim_each_place_once() {
        let regions = Regions::new(5_000, 3);
        for tick in 1..50 {
            regions.begin(tick);
            let claimed = std::thread::scope(|scope| {
                let worker = |worker: usize| {
                    let regions = &regions;
                    scope.spawn(move || {
                        std::iter::from_fn(|| regions.claim(worker, tick, 5_000))
                            .flatten()
                            .collect::<Vec<_>>()
                    })
                };
                let workers: Vec<_> = (0..3).map(worker).collect();
                workers.into_iter().flat_map(|worker| worker.join().unwrap()).collect::<Vec<_>>()
            });
            let mut sorted = claimed;
            sorted.sort_unstable();
            assert_eq!(sorted, (0..5_000).collect::<Vec<_>>());
        }
    }
}
