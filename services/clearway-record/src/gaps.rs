//! What was published and not received, as far as the ticks tell.

use serde::Serialize;

/// The channels that are recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Recorded {
    /// `state`.
    State,
    /// `command`.
    Command,
    /// `telemetry`.
    Telemetry,
    /// `checkpoint`.
    Checkpoint,
}

impl Recorded {
    /// All of them, in the order of their numbers.
    pub const ALL: [Self; 4] = [Self::State, Self::Command, Self::Telemetry, Self::Checkpoint];

    /// The channel's name.
    pub fn name(self) -> &'static str {
        match self {
            Self::State => "state",
            Self::Command => "command",
            Self::Telemetry => "telemetry",
            Self::Checkpoint => "checkpoint",
        }
    }
}

/// One channel's ticks.
#[derive(Debug, Clone, Copy, Default)]
struct Ticks {
    first: Option<u64>,
    last: u64,
    received: u64,
    gaps: u64,
}

/// The ticks of one run of the daemon.
///
/// A tick that is not there was missed, unless the daemon skipped that period (a later telemetry or
/// checkpoint header says so) or was too late to publish its commands (its checkpoint says so).
#[derive(Debug, Clone, Copy, Default)]
pub struct Gaps {
    channels: [Ticks; 4],
    skipped: [u64; 2],
    /// Tick of the first header that tells of skips, and what was skipped before it.
    leading: Option<(u64, u64)>,
    late: u64,
}

impl Gaps {
    /// Takes note of a sample; `false` when it came before, as after attaching anew.
    pub fn see(&mut self, channel: Recorded, tick: u64) -> bool {
        let ticks = &mut self.channels[channel as usize];
        if ticks.first.is_some() && tick <= ticks.last {
            return false;
        }
        if ticks.first.is_some() {
            ticks.gaps += tick - ticks.last - 1;
        }
        ticks.first.get_or_insert(tick);
        ticks.last = tick;
        ticks.received += 1;
        true
    }

    /// A telemetry or checkpoint header says that `periods` before `tick` never ran.
    pub fn skipped(&mut self, channel: Recorded, tick: u64, periods: u64) {
        self.leading.get_or_insert((tick, periods));
        // Those before the first that was received are no gap of this channel.
        let since = self.channels[channel as usize].first.unwrap_or(tick);
        let counted = periods.min(tick.saturating_sub(since + 1));
        self.skipped[usize::from(channel == Recorded::Checkpoint)] += counted;
    }

    /// A checkpoint says that the commands of its period were too late to go out.
    pub fn too_late(&mut self) {
        self.late += 1;
    }

    /// Samples of a channel.
    pub fn received(&self, channel: Recorded) -> u64 {
        self.channels[channel as usize].received
    }

    /// First and last tick of a channel; `None` before the first.
    pub fn range(&self, channel: Recorded) -> Option<(u64, u64)> {
        let ticks = &self.channels[channel as usize];
        ticks.first.map(|first| (first, ticks.last))
    }

    /// Periods that the daemon skipped.
    pub fn skipped_periods(&self) -> u64 {
        self.skipped[0].max(self.skipped[1])
    }

    /// Samples between the first and the last of a channel that were published and not received.
    /// When the run is over, also those after the last: there is one for each state.
    pub fn missed(&self, channel: Recorded, over: bool) -> u64 {
        let ticks = &self.channels[channel as usize];
        let late = if channel == Recorded::Command { self.late } else { 0 };
        // Channels that began before the first header have a gap for what was skipped before it.
        let early = match (ticks.first, self.leading) {
            (Some(first), Some((tick, periods))) if first < tick => {
                let most = if channel == Recorded::Command { tick - first } else { tick - first - 1 };
                periods.min(most)
            }
            _ => 0,
        };
        let inside = ticks.gaps.saturating_sub(self.skipped_periods() + early + late);
        let states = &self.channels[Recorded::State as usize];
        let after_the_fact = matches!(channel, Recorded::Telemetry | Recorded::Checkpoint);
        let tail = match (ticks.first, states.first) {
            (Some(_), Some(_)) if over && after_the_fact => states.last.saturating_sub(ticks.last),
            (None, Some(_)) if over && after_the_fact => states.received,
            _ => 0,
        };
        inside + tail
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(channel: Recorded, ticks: impl IntoIterator<Item = u64>) -> Gaps {
        let mut gaps = Gaps::default();
        for tick in ticks {
            assert!(gaps.see(channel, tick));
        }
        gaps
    }

    #[test]
    fn what_is_not_there_was_missed() {
        let gaps = seen(Recorded::State, [5, 6, 9, 10, 20]);
        assert_eq!((gaps.received(Recorded::State), gaps.missed(Recorded::State, false)), (5, 2 + 9));
        assert_eq!(gaps.range(Recorded::State), Some((5, 20)));
        assert_eq!(gaps.missed(Recorded::Command, true), 0);
    }

    #[test]
    fn what_the_daemon_skipped_or_withheld_was_not() {
        let mut gaps = Gaps::default();
        for tick in [0, 1, 4, 5] {
            gaps.see(Recorded::State, tick);
            gaps.see(Recorded::Checkpoint, tick);
        }
        // The answer to 1 came too late, and 2 and 3 never ran: no command for 2, 3 and 4.
        for tick in [0, 1, 5, 6] {
            assert!(gaps.see(Recorded::Command, tick));
        }
        assert_eq!(gaps.missed(Recorded::State, false), 2);
        gaps.skipped(Recorded::Checkpoint, 4, 2);
        gaps.too_late();
        assert_eq!(Recorded::ALL.map(|channel| gaps.missed(channel, false)), [0, 0, 0, 0]);
        assert_eq!(gaps.skipped_periods(), 2);
    }

    #[test]
    fn skips_before_the_first_sample_explain_nothing() {
        let mut gaps = seen(Recorded::State, [100, 103]);
        gaps.see(Recorded::Telemetry, 100);
        gaps.skipped(Recorded::Telemetry, 100, 50);
        assert_eq!(gaps.missed(Recorded::State, false), 2);
    }

    #[test]
    fn periods_that_are_skipped_at_the_very_start_are_not_missed() {
        let mut gaps = Gaps::default();
        for tick in [0, 90, 91] {
            assert!(gaps.see(Recorded::Command, tick));
        }
        for tick in [89, 90] {
            gaps.see(Recorded::State, tick);
            gaps.see(Recorded::Telemetry, tick);
            gaps.skipped(Recorded::Telemetry, tick, if tick == 89 { 89 } else { 0 });
        }
        assert_eq!(Recorded::ALL[..3].iter().map(|c| gaps.missed(*c, true)).sum::<u64>(), 0);
    }

    #[test]
    fn a_sample_that_comes_again_is_not_counted() {
        let mut gaps = seen(Recorded::Command, [3, 4]);
        assert!(!gaps.see(Recorded::Command, 4));
        assert!(!gaps.see(Recorded::Command, 3));
        assert_eq!(gaps.received(Recorded::Command), 2);
    }

    #[test]
    fn the_tail_counts_when_the_run_is_over() {
        let mut gaps = seen(Recorded::State, 0..10);
        for tick in 0..7 {
            assert!(gaps.see(Recorded::Telemetry, tick));
        }
        assert_eq!(gaps.missed(Recorded::Telemetry, false), 0);
        assert_eq!(gaps.missed(Recorded::Telemetry, true), 3);
        assert_eq!(gaps.missed(Recorded::Checkpoint, true), 10);
    }
}
