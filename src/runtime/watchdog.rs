/// Periods in a row without an answer after which a worker counts as silent.
const SILENT_AFTER: u32 = 2;

/// Notices workers that hang, crashed too often or are too slow for their robots.
#[derive(Debug, Default)]
pub(super) struct Watchdog {
    workers: Vec<Watched>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Watched {
    answered: Option<u64>,
    missed: u32,
}

/// What changed about a worker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Change {
    /// It has not answered for [`SILENT_AFTER`] periods; its robots stand still.
    FellSilent(usize),
    /// It answers again.
    Returned(usize),
}

impl Watchdog {
    pub(super) fn new(workers: usize) -> Self {
        Self { workers: vec![Watched::default(); workers] }
    }

    /// Worker `index` answered the state of `tick`.
    pub(super) fn answered(&mut self, index: usize, tick: u64) {
        if let Some(worker) = self.workers.get_mut(index) {
            worker.answered = worker.answered.max(Some(tick));
        }
    }

    /// Period `tick` is over; `tell` hears what changed.
    pub(super) fn period_over(&mut self, tick: u64, mut tell: impl FnMut(Change)) {
        for (index, worker) in self.workers.iter_mut().enumerate() {
            if worker.answered >= Some(tick) {
                if worker.missed >= SILENT_AFTER {
                    tell(Change::Returned(index));
                }
                worker.missed = 0;
            } else {
                worker.missed = worker.missed.saturating_add(1);
                if worker.missed == SILENT_AFTER {
                    tell(Change::FellSilent(index));
                }
            }
        }
    }

    /// Whether every worker answered the period that was over last, `but` those that it says.
    pub(super) fn all_answered(&self, but: impl Fn(usize) -> bool) -> bool {
        self.workers.iter().enumerate().all(|(index, worker)| worker.missed == 0 || but(index))
    }

    /// Workers that are silent now.
    pub(super) fn silent(&self) -> usize {
        self.workers.iter().filter(|worker| worker.missed >= SILENT_AFTER).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn silence_is_noticed_within_two_periods_and_so_is_its_end() {
        let mut dog = Watchdog::new(2);
        let mut heard = Vec::new();
        for tick in 0..8 {
            dog.answered(0, tick);
            if !(3..6).contains(&tick) {
                dog.answered(1, tick);
            }
            dog.period_over(tick, |change| heard.push((tick, change)));
            assert_eq!(dog.silent(), usize::from((4..6).contains(&tick)));
            assert_eq!(dog.all_answered(|_| false), !(3..6).contains(&tick));
            assert!(dog.all_answered(|worker| worker == 1));
        }
        assert_eq!(heard, [(4, Change::FellSilent(1)), (6, Change::Returned(1))]);
    }
}
