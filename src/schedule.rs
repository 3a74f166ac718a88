//! When periods start: pure arithmetic on an absolute schedule, `t_k = t_0 + k T`.
//!
//! Reads and writes nothing else; nanoseconds in `u64`. At the shortest period of 200 µs the tick
//! number lasts a hundred million years, and `k T` overflows only with time itself, after 584 years.
//!
//! An overrun skips every period that has passed as a whole and keeps the phase:
//!
//! ```
//! use clearway::schedule::Schedule;
//! let s = Schedule::new(1_000, 100, 10);
//! assert_eq!(s.resume(5, 1_550), 5); // half a period late: period 5 starts late
//! assert_eq!(s.resume(5, 1_820), 8); // 3.2 periods late: 5, 6 and 7 are lost, 8 starts 20 late
//! ```

/// An absolute, phase-keeping schedule.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(clippy::struct_field_names, reason = "the unit is part of the name")]
pub struct Schedule {
    start_ns: u64,
    period_ns: u64,
    margin_ns: u64,
}

impl Schedule {
    /// Period 0 starts at `start_ns`; output is due `margin_ns` before the end of each period.
    ///
    /// A period of 0 counts as 1, and a margin of a whole period or more as all but 1 ns of it;
    /// the configuration refuses both before they get here.
    pub fn new(start_ns: u64, period_ns: u64, margin_ns: u64) -> Self {
        let period_ns = period_ns.max(1);
        Self { start_ns, period_ns, margin_ns: margin_ns.min(period_ns - 1) }
    }

    /// T, ns.
    pub fn period_ns(&self) -> u64 {
        self.period_ns
    }

    /// Start `t_k` of period `tick`, ns.
    pub fn release_ns(&self, tick: u64) -> u64 {
        self.start_ns.saturating_add(tick.saturating_mul(self.period_ns))
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

    proptest! {
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
