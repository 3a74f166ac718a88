use std::collections::VecDeque;

use crate::disturbance::is_lost;
use crate::geometry::Pose;
use crate::model::RobotId;
use crate::wire::Holding;

/// A robot, where it was seen, and what it held then.
pub type Sighting = (RobotId, Pose, Holding);

/// How observations travel.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Link {
    /// Time from looking to sending, ns.
    pub delay_ns: u64,
    /// Share of the observations that is lost on the way, 0 to 1.
    pub drop_out: f64,
    /// Which of them: the same seed and first robot lose the same ones.
    pub seed: u64,
}

/// What the link lets out.
#[derive(Debug, Clone, PartialEq)]
pub enum Outgoing {
    /// Poses, what the robots held, and when that was seen, ns.
    Sample(u64, Vec<Sighting>),
    /// A sample that was lost.
    Lost,
}

/// Observations on their way.
#[derive(Debug, Clone)]
pub(super) struct Queue {
    link: Link,
    sender: u32,
    number: u64,
    waiting: VecDeque<(u64, Vec<Sighting>)>,
}

impl Queue {
    pub(super) fn new(link: Link, sender: u32) -> Self {
        Self { link, sender, number: 0, waiting: VecDeque::new() }
    }

    pub(super) fn push(&mut self, stamp_ns: u64, poses: Vec<Sighting>) {
        self.waiting.push_back((stamp_ns, poses));
    }

    /// The next one that has come to the end of the link by `now_ns`.
    pub(super) fn pop(&mut self, now_ns: u64) -> Option<Outgoing> {
        let delay_ns = self.link.delay_ns;
        let due =
            self.waiting.front().is_some_and(|(stamp_ns, _)| stamp_ns.saturating_add(delay_ns) <= now_ns);
        let (stamp_ns, poses) = if due { self.waiting.pop_front()? } else { return None };
        self.number += 1;
        let lost = is_lost(self.link.seed, self.sender, self.number, self.link.drop_out);
        Some(if lost { Outgoing::Lost } else { Outgoing::Sample(stamp_ns, poses) })
    }
}
