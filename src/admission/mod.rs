//! What an observation must be like before a robot moves by it.
//!
//! Reads copies of observation samples, writes accepted poses. The memory they come from belongs
//! to somebody else and can hold anything, so every record is checked: finite, inside the arena, a
//! known robot, once a sample, from the one writer that speaks for it, in sequence, of this run,
//! neither stale nor from the future, and no further from the last good pose than the robot can
//! have driven, nor turned by more than it can have turned. What fails is counted under its own reason
//! and changes nothing else; a robot without an accepted pose is told to stop by whoever asks
//! [`Admission::pose`].
//!
//! World frame, metres, radians, `CLOCK_MONOTONIC` ns. About 50 ns a record plus a binary search;
//! allocates only when it is made.

mod rejection;
mod sequence;
mod track;

pub use rejection::{Rejection, Rejections};

use std::f64::consts::PI;

use crate::config::SourceConfig;
use crate::geometry::Pose;
use crate::model::{Disturbance, RobotSpec};
use crate::scenario::Scenario;
use crate::wire::{Holding, ObservationHeader, RobotObservation};
use sequence::{Numbered, Sequence, Taken};
use track::{Bounds, Track};

/// Writers whose sequence is remembered; a new one takes the place of the one silent the longest.
const WRITERS: usize = 64;

/// The gate between observations and the fleet's state.
#[derive(Debug)]
pub struct Admission {
    /// Ids in ascending order, each with its place. With room for every place.
    ids: Vec<(u32, usize)>,
    tracks: Vec<Track>,
    writers: Vec<Sequence>,
    arena_m: f64,
    max_age_ns: u64,
    /// Of robots that take commands.
    bounds: Bounds,
    rejections: Rejections,
}

impl Admission {
    /// Admission for the robots of `scenario`, none of them seen yet.
    pub fn new(scenario: &Scenario, config: &SourceConfig, period_ns: u64) -> Self {
        let ids = scenario.robots.iter().enumerate().map(|(index, robot)| (robot.id.0, index)).collect();
        let own = Bounds {
            speed_mps: scenario.limits.speed_mps(),
            margin_m: config.jump_margin_m,
            turn_rate_radps: scenario.limits.turn_rate_radps(),
            margin_rad: config.turn_margin_rad,
        };
        // One that takes no commands does not keep to our limits either, and may turn as it likes.
        let bounds = |robot: &RobotSpec| match robot.foreign_speed_mps {
            Some(speed_mps) => Bounds { speed_mps, margin_rad: PI, ..own },
            None => own,
        };
        let tracks = scenario.robots.iter().map(|robot| Track::new(robot.start, bounds(robot))).collect();
        Self {
            ids,
            tracks,
            writers: Vec::with_capacity(WRITERS),
            arena_m: config.arena_m,
            max_age_ns: config.max_age_or_default_ns(period_ns),
            bounds: own,
            rejections: Rejections::default(),
        }
    }

    /// With room for as many robots as there are places.
    #[must_use]
    pub(crate) fn with_places(mut self, places: usize) -> Self {
        self.ids.reserve_exact(places.saturating_sub(self.ids.len()));
        let bounds = self.bounds;
        self.tracks.resize_with(places.max(self.tracks.len()), || Track::new(Pose::default(), bounds));
        self
    }

    /// Robot `robot` takes the `index`-th place, not seen yet. Allocates nothing when the fleet was made
    /// with places for it.
    pub(crate) fn admit(&mut self, index: usize, robot: &RobotSpec) {
        self.dismiss(index);
        let at = self.ids.partition_point(|(id, _)| *id < robot.id.0);
        self.ids.insert(at, (robot.id.0, index));
        if let Some(track) = self.tracks.get_mut(index) {
            *track = Track::new(robot.start, self.bounds);
        }
    }

    /// Nobody stands in the `index`-th place any more: what is observed of it is unknown.
    pub(crate) fn dismiss(&mut self, index: usize) {
        self.ids.retain(|(_, place)| *place != index);
        if let Some(track) = self.tracks.get_mut(index) {
            *track = Track::new(Pose::default(), self.bounds);
        }
    }

    /// Accepts what noise and slip within `bounds` explain: a robot that seems to have driven or
    /// turned further.
    #[must_use]
    pub fn tolerating(mut self, bounds: &Disturbance) -> Self {
        self.bounds.tolerate(bounds);
        self.tracks.iter_mut().for_each(|track| track.tolerate(bounds));
        self
    }

    /// Counts a sample that was refused before anybody looked at what it says.
    pub(crate) fn refuse(&mut self, reason: Rejection) {
        self.rejections.count(reason);
    }

    /// Takes one sample of writer `writer`, its checksum already verified, received at `now_ns` by a daemon whose run is `epoch`.
    ///
    /// The slice is foreign memory: each record is copied before it is looked at.
    pub fn sample(
        &mut self,
        writer: u128,
        header: &ObservationHeader,
        records: &[RobotObservation],
        epoch: u64,
        now_ns: u64,
    ) {
        // A copy that the compiler cannot undo by reading the original again.
        let header = std::hint::black_box(*header);
        if let Err(reason) = self.check_header(writer, &header, records.len(), epoch, now_ns) {
            self.rejections.count(reason);
            return;
        }
        for record in records {
            let record = std::hint::black_box(*record);
            if let Err(reason) = self.record(writer, &header, &record, now_ns) {
                self.rejections.count(reason);
            }
        }
    }

    fn check_header(
        &mut self,
        writer: u128,
        header: &ObservationHeader,
        records: usize,
        epoch: u64,
        now_ns: u64,
    ) -> Result<(), Rejection> {
        if records > self.ids.len() {
            return Err(Rejection::Oversize);
        }
        // 0: the writer has not seen this run yet.
        if header.epoch != 0 && header.epoch != epoch {
            return Err(Rejection::Epoch);
        }
        if header.stamp_ns > now_ns {
            return Err(Rejection::Future);
        }
        if now_ns - header.stamp_ns > self.max_age_ns {
            return Err(Rejection::Stale);
        }
        let next = Numbered { sequence: header.sequence, stamp_ns: header.stamp_ns };
        self.check_sequence(writer, next, now_ns)
    }

    fn check_sequence(&mut self, writer: u128, next: Numbered, now_ns: u64) -> Result<(), Rejection> {
        if let Some(known) = self.writers.iter_mut().find(|known| known.writer() == writer) {
            match known.take(next, now_ns)? {
                Taken::After(lost) => self.rejections.skipped_samples += lost,
                Taken::Resynchronised => self.rejections.resynchronised_writers += 1,
            }
            return Ok(());
        }
        let entry = Sequence::new(writer, next, now_ns);
        if self.writers.len() < WRITERS {
            self.writers.push(entry);
        } else if let Some(oldest) = self.writers.iter_mut().min_by_key(|known| known.heard_ns()) {
            *oldest = entry;
        }
        Ok(())
    }

    fn record(
        &mut self,
        writer: u128,
        header: &ObservationHeader,
        record: &RobotObservation,
        now_ns: u64,
    ) -> Result<(), Rejection> {
        let Ok(at) = self.ids.binary_search_by_key(&record.id, |(id, _)| *id) else {
            return Err(Rejection::UnknownRobot);
        };
        let (_, index) = self.ids[at];
        if ![record.x_m, record.y_m, record.theta_rad].iter().all(|x| x.is_finite()) {
            return Err(Rejection::NotFinite);
        }
        if record.x_m.abs().max(record.y_m.abs()) > self.arena_m {
            return Err(Rejection::OutOfRange);
        }
        let pose = Pose::new(record.x_m, record.y_m, record.theta_rad);
        let silent_since = now_ns.saturating_sub(self.max_age_ns);
        let track = &mut self.tracks[index];
        if track.speaks_for_another(writer, silent_since) {
            return Err(Rejection::ForeignWriter);
        }
        // Of another run it holds nothing of this one.
        let holding = match record.holding {
            told if told != Holding::Untold.code() && header.epoch == 0 => Holding::Nothing.code(),
            told => told,
        };
        track.accept(writer, header, pose, holding)
    }

    /// The accepted pose of the `index`-th robot and its stamp, unless it is stale at `now_ns`.
    pub fn pose(&self, index: usize, now_ns: u64) -> Option<(Pose, u64)> {
        let track = self.tracks.get(index)?;
        let (pose, stamp_ns) = track.current()?;
        (now_ns.saturating_sub(stamp_ns) <= self.max_age_ns).then_some((pose, stamp_ns))
    }

    /// The last good pose of the `index`-th robot and its stamp, however old; none before the first.
    pub fn last_good(&self, index: usize) -> Option<(Pose, u64)> {
        self.tracks.get(index)?.last_good()
    }

    /// What the `index`-th robot told with its last good pose: a code of [`Holding`].
    pub fn holding(&self, index: usize) -> u32 {
        self.tracks.get(index).map_or(0, Track::holding)
    }

    /// The last good pose of the `index`-th robot, however old: its start before the first one.
    pub fn last_pose(&self, index: usize) -> Option<Pose> {
        self.tracks.get(index).map(Track::last_pose)
    }

    /// What was refused so far.
    pub fn rejections(&self) -> &Rejections {
        &self.rejections
    }
}

#[cfg(test)]
mod tests;
