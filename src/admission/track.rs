use super::Rejection;
use crate::geometry::{Pose, wrap};
use crate::model::Disturbance;
use crate::wire::ObservationHeader;

/// Samples in a row that must agree with each other before a robot that jumped is believed again.
const READMIT_SAMPLES: u32 = 5;

/// How far a robot can have gone, and how far it can have turned.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bounds {
    pub(super) speed_mps: f64,
    pub(super) margin_m: f64,
    pub(super) turn_rate_radps: f64,
    pub(super) margin_rad: f64,
}

impl Bounds {
    /// Widens them by noise at both ends and by slip on the way.
    pub(super) fn tolerate(&mut self, disturbed: &Disturbance) {
        self.margin_m += 2.0 * disturbed.position_m;
        self.speed_mps *= 1.0 + disturbed.slip;
        self.margin_rad += 2.0 * disturbed.heading_rad;
        self.turn_rate_radps += disturbed.turn_rate_radps;
    }
}

/// A pose and when it was true.
#[derive(Debug, Clone, Copy)]
struct Seen {
    pose: Pose,
    stamp_ns: u64,
}

impl Seen {
    /// Whether a robot can have come from here to `next`. Who can have turned by π can have any heading.
    fn reaches(&self, next: &Self, bounds: &Bounds) -> bool {
        let elapsed_s = next.stamp_ns.saturating_sub(self.stamp_ns) as f64 * 1e-9;
        let moved_m = (next.pose.position_m - self.pose.position_m).norm();
        let turned_rad = wrap(next.pose.theta_rad - self.pose.theta_rad).abs();
        moved_m <= bounds.speed_mps * elapsed_s + bounds.margin_m
            && turned_rad <= bounds.turn_rate_radps * elapsed_s + bounds.margin_rad
    }
}

/// A robot whose position or heading jumped, and how many samples have agreed since.
#[derive(Debug, Clone, Copy)]
struct Quarantine {
    last: Seen,
    agreeing: u32,
}

/// One robot's accepted observations.
#[derive(Debug)]
pub(super) struct Track {
    start: Pose,
    bounds: Bounds,
    writer: u128,
    /// Writer and sequence of the sample taken last, to notice a robot that stands in it twice.
    sample: Option<(u128, u64)>,
    good: Option<Seen>,
    /// What was told with it: a code of [`Holding`](crate::wire::Holding).
    holding: u32,
    quarantine: Option<Quarantine>,
}

impl Track {
    pub(super) fn new(start: Pose, bounds: Bounds) -> Self {
        Self { start, bounds, writer: 0, sample: None, good: None, holding: 0, quarantine: None }
    }

    /// Widens the bounds.
    pub(super) fn tolerate(&mut self, disturbed: &Disturbance) {
        self.bounds.tolerate(disturbed);
    }

    /// The newest accepted pose; none in quarantine.
    pub(super) fn current(&self) -> Option<(Pose, u64)> {
        if self.quarantine.is_some() {
            return None;
        }
        self.last_good()
    }

    /// The last pose that was accepted and when it was true, however old, also in quarantine.
    pub(super) fn last_good(&self) -> Option<(Pose, u64)> {
        self.good.map(|seen| (seen.pose, seen.stamp_ns))
    }

    pub(super) fn last_pose(&self) -> Pose {
        self.good.map_or(self.start, |seen| seen.pose)
    }

    pub(super) fn holding(&self) -> u32 {
        self.holding
    }

    /// Whether a writer other than `writer` has spoken for this robot since `silent_since_ns`.
    pub(super) fn speaks_for_another(&self, writer: u128, silent_since_ns: u64) -> bool {
        self.writer != writer && self.good.is_some_and(|seen| seen.stamp_ns >= silent_since_ns)
    }

    pub(super) fn accept(
        &mut self,
        writer: u128,
        header: &ObservationHeader,
        pose: Pose,
        holding: u32,
    ) -> Result<(), Rejection> {
        let bounds = &self.bounds;
        if self.sample.replace((writer, header.sequence)) == Some((writer, header.sequence)) {
            // Which of the two is right cannot be known: neither counts.
            self.distrust(Seen { pose, stamp_ns: header.stamp_ns });
            return Err(Rejection::DuplicateRobot);
        }
        let seen = Seen { pose, stamp_ns: header.stamp_ns };
        if self.good.is_some_and(|good| seen.stamp_ns < good.stamp_ns) {
            return Err(Rejection::Reordered);
        }
        if let Some(quarantine) = &mut self.quarantine {
            let agrees = quarantine.last.reaches(&seen, bounds);
            *quarantine =
                Quarantine { last: seen, agreeing: if agrees { quarantine.agreeing + 1 } else { 0 } };
            if quarantine.agreeing < READMIT_SAMPLES {
                return Err(Rejection::Jump);
            }
        } else if self.good.is_some_and(|good| !good.reaches(&seen, bounds)) {
            self.distrust(seen);
            return Err(Rejection::Jump);
        }
        self.quarantine = None;
        self.writer = writer;
        (self.good, self.holding) = (Some(seen), holding);
        Ok(())
    }

    fn distrust(&mut self, last: Seen) {
        self.quarantine = Some(Quarantine { last, agreeing: 0 });
    }
}
