//! When periods start: pure arithmetic on an absolute schedule, `t_k = t_0 + k T`.
//!
//! Reads and writes nothing else; nanoseconds in `u64`. At the shortest period of 200 µs the tick
//! number lasts a hundred million years, and `k T` overflows only with time itself, after 584 years:
//! there both stand still and neither wraps.
//!
//! An overrun skips every period that has passed as a whole and keeps the phase:
//!
//! ```
//! use clearway::schedule::Schedule;
//! let s = Schedule::new(1_000, 100, 10);
//! assert_eq!(s.resume(5, 1_550), 5); // half a period late: period 5 starts late
//! assert_eq!(s.resume(5, 1_820), 8); // 3.2 periods late: 5, 6 and 7 are lost, 8 starts 20 late
//! ```

/// No period from this one on is released: the two after a period that runs have numbers too, and
/// `u64::MAX` is nobody's.
pub const TICK_MAX: u64 = u64::MAX - 2;

/// An absolute, phase-keeping schedule.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Schedule {
    start_ns: u64,
    period_ns: u64,
    margin_ns: u64,
    first_tick: u64,
}

impl Schedule {
    /// Period 0 starts at `start_ns`; output is due `margin_ns` before the end of each period.
    ///
    /// A period of 0 counts as 1, and a margin of a whole period or more as all but 1 ns of it;
    /// the configuration refuses both before they get here.
    pub fn new(start_ns: u64, period_ns: u64, margin_ns: u64) -> Self {
        let period_ns = period_ns.max(1);
        Self { start_ns, period_ns, margin_ns: margin_ns.min(period_ns - 1), first_tick: 0 }
    }

    /// The same with `first_tick` for the number of the first period, at most [`TICK_MAX`].
    #[must_use]
    pub fn numbered_from(self, first_tick: u64) -> Self {
        Self { first_tick: first_tick.min(TICK_MAX), ..self }
    }

    /// Number of the first period.
    pub fn first_tick(&self) -> u64 {
        self.first_tick
    }

    /// T, ns.
    pub fn period_ns(&self) -> u64 {
        self.period_ns
    }

    /// Start `t_k` of period `tick`, ns.
    pub fn release_ns(&self, tick: u64) -> u64 {
        let since_start = tick.saturating_sub(self.first_tick);
        self.start_ns.saturating_add(since_start.saturating_mul(self.period_ns))
    }

    /// When the output of period `tick` is due, ns.
    pub fn deadline_ns(&self, tick: u64) -> u64 {
        self.release_ns(tick.saturating_add(1)) - self.margin_ns
    }

    /// The period that runs at `now_ns`, when `planned` was to be the next one.
    ///
    /// It is `planned` up to one period after its start, however late; beyond that, the one whose
    /// time it is. The difference to `planned` is the number of periods lost.
    pub fn resume(&self, planned: u64, now_ns: u64) -> u64 {
        planned.saturating_add(now_ns.saturating_sub(self.release_ns(planned)) / self.period_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::{Clock, VirtualClock};
    use proptest::prelude::*;

    const T: u64 = 80_000_000;

    /// Runs periods whose work takes `work_ns(tick)`, and returns (tick, lateness) of each release.
    fn run(periods: usize, work_ns: impl Fn(u64) -> u64) -> Vec<(u64, u64)> {
        let clock = VirtualClock::new(12_345);
        let schedule = Schedule::new(12_345 + T, T, T / 10);
        let (mut planned, mut released) = (0, Vec::new());
        for _ in 0..periods {
            clock.sleep_until(schedule.release_ns(planned));
            let tick = schedule.resume(planned, clock.now_ns());
            released.push((tick, clock.now_ns() - schedule.release_ns(tick)));
            clock.advance(work_ns(tick));
            planned = tick + 1;
        }
        released
    }

    /// Work in period 3 ends `tenths` tenths of a period after that period's end.
    fn after_overrun(tenths: u64) -> Vec<(u64, u64)> {
        run(6, |tick| if tick == 3 { T + T / 10 * tenths } else { T / 4 })
    }

    #[test]
    fn half_a_period_starts_the_next_one_late_and_loses_none() {
        assert_eq!(after_overrun(5), [(0, 0), (1, 0), (2, 0), (3, 0), (4, T / 2), (5, 0)]);
    }

    #[test]
    fn one_and_a_half_periods_lose_one() {
        assert_eq!(after_overrun(15), [(0, 0), (1, 0), (2, 0), (3, 0), (5, T / 2), (6, 0)]);
    }

    #[test]
    fn three_point_two_periods_lose_three() {
        assert_eq!(after_overrun(32), [(0, 0), (1, 0), (2, 0), (3, 0), (7, T / 5), (8, 0)]);
    }

    #[test]
    fn twenty_periods_lose_twenty_and_the_phase_stays() {
        assert_eq!(after_overrun(200), [(0, 0), (1, 0), (2, 0), (3, 0), (24, 0), (25, 0)]);
    }

    #[test]
    fn weeks_at_the_shortest_period() {
        let s = Schedule::new(u64::from(u32::MAX), 200_000, 20_000);
        let six_weeks = 6 * 7 * 24 * 3600 * 5_000_u64;
        assert_eq!(s.release_ns(six_weeks), u64::from(u32::MAX) + 6 * 7 * 24 * 3600 * 1_000_000_000);
        assert_eq!(s.resume(six_weeks, s.release_ns(six_weeks) + 199_999), six_weeks);
        // The end of time is a standstill, not a wrap.
        assert_eq!(s.release_ns(u64::MAX), u64::MAX);
        assert!(s.deadline_ns(u64::MAX) < u64::MAX);
    }

    /// Whatever the tick and however near the end of time: no wrap, and never backwards.
    fn is_sound_around(schedule: Schedule, tick: u64) {
        let mut before = 0;
        for tick in (0..6).map(|ahead| tick.saturating_add(ahead).min(TICK_MAX)) {
            let (release, next) = (schedule.release_ns(tick), schedule.release_ns(tick + 1));
            assert!(before <= release && release <= next && next <= schedule.release_ns(tick + 2));
            assert!(schedule.deadline_ns(tick) <= next);
            // At the end of time the last period is cut short.
            assert!(schedule.deadline_ns(tick) >= release || next - release < schedule.period_ns());
            if release < u64::MAX {
                assert_eq!(schedule.resume(tick, release), tick);
                assert_eq!(schedule.resume(tick, release.saturating_sub(1)), tick);
            }
            assert!(schedule.resume(tick, u64::MAX) >= tick);
            before = release;
        }
    }

    #[test]
    fn numbers_may_be_as_large_as_they_can() {
        for edge in [1 << 31, 1 << 32, 1 << 48, 1 << 53, 1 << 63, TICK_MAX] {
            for first in [edge - 3, edge] {
                let s = Schedule::new(1 << 40, T, T / 10).numbered_from(first);
                assert_eq!(s.release_ns(s.first_tick()), 1 << 40);
                assert_eq!(s.release_ns(s.first_tick() + 1), (1 << 40) + T);
                is_sound_around(s, s.first_tick());
                // The same in time: the clock itself is near its end.
                is_sound_around(Schedule::new(edge - 3, T, T / 10), 0);
            }
        }
    }

    proptest! {
        #[test]
        fn no_tick_and_no_time_wraps(
            start in any::<u64>(), first in any::<u64>(), tick in any::<u64>(), period in 1..=1_000_000_000u64,
        ) {
            let schedule = Schedule::new(start, period, period / 10).numbered_from(first);
            is_sound_around(schedule, tick.max(first));
            is_sound_around(schedule, first.saturating_add(tick % 1_000_000));
        }

        /// Whatever the lateness: never a past tick, never two releases in one period, phase kept.
        #[test]
        fn resumes_in_the_period_whose_time_it_is(
            planned in 0..1_000_000u64, late in 0..1_000_000_000_000u64, period in 200_000..1_000_000_000u64,
        ) {
            let s = Schedule::new(7, period, period / 10);
            let now = s.release_ns(planned) + late;
            let tick = s.resume(planned, now);
            prop_assert!(s.release_ns(tick) <= now && now < s.release_ns(tick + 1));
            prop_assert_eq!(tick - planned, late / period);
            prop_assert!(s.deadline_ns(tick) < s.release_ns(tick + 1));
        }
    }
}
