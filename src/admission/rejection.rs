use serde::ser::{Serialize, SerializeMap, Serializer};

/// Why an observation was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rejection {
    /// A coordinate is NaN or infinite.
    NotFinite,
    /// A coordinate is outside the arena.
    OutOfRange,
    /// No robot of the fleet has this id.
    UnknownRobot,
    /// The robot stands more than once in one sample.
    DuplicateRobot,
    /// Another writer speaks for this robot.
    ForeignWriter,
    /// The sample has more records than the fleet has robots.
    Oversize,
    /// The writer's last sample again.
    Repeated,
    /// A sample older than the writer's last one.
    Reordered,
    /// A sample so far ahead of the writer's last one that its number cannot be right.
    Gap,
    /// The writer follows another run of the daemon.
    Epoch,
    /// Older than the largest age.
    Stale,
    /// Stamped later than it was received: the writer has another clock.
    Future,
    /// Further from the last good pose than the robot can have driven, or turned by more than it can have
    /// turned; in quarantine until enough samples agree with each other.
    Jump,
    /// Not what its writer sealed: changed in memory, half written, or meant for another channel or fleet.
    Corrupt,
}

impl Rejection {
    /// Every reason.
    pub const ALL: [Self; 14] = [
        Self::NotFinite,
        Self::OutOfRange,
        Self::UnknownRobot,
        Self::DuplicateRobot,
        Self::ForeignWriter,
        Self::Oversize,
        Self::Repeated,
        Self::Reordered,
        Self::Gap,
        Self::Epoch,
        Self::Stale,
        Self::Future,
        Self::Jump,
        Self::Corrupt,
    ];

    /// The name in reports and logs.
    pub fn name(self) -> &'static str {
        match self {
            Self::NotFinite => "not_finite",
            Self::OutOfRange => "out_of_range",
            Self::UnknownRobot => "unknown_robot",
            Self::DuplicateRobot => "duplicate_robot",
            Self::ForeignWriter => "foreign_writer",
            Self::Oversize => "oversize",
            Self::Repeated => "repeated",
            Self::Reordered => "reordered",
            Self::Gap => "gap",
            Self::Epoch => "epoch",
            Self::Stale => "stale",
            Self::Future => "future",
            Self::Jump => "jump",
            Self::Corrupt => "corrupt",
        }
    }
}

/// How often each reason occurred. As JSON: an object with one key a reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Rejections {
    counts: [u64; Rejection::ALL.len()],
    /// Samples that a writer numbered and that never arrived: not refused, only missed.
    pub skipped_samples: u64,
    /// Times that the numbers of a writer had been wrong when it was first heard, and were followed anew.
    pub resynchronised_writers: u64,
    /// Times that a robot's pose stopped changing although it was told to drive and its samples went
    /// on: not refused, but a reason to look at the robot and its localisation.
    pub frozen_robots: u64,
}

impl Rejections {
    /// How often `reason` occurred.
    pub fn get(&self, reason: Rejection) -> u64 {
        self.counts[reason as usize]
    }

    /// All of them together.
    pub fn total(&self) -> u64 {
        self.counts.iter().sum()
    }

    /// Each reason and how often it occurred.
    pub fn iter(&self) -> impl Iterator<Item = (Rejection, u64)> + '_ {
        Rejection::ALL.into_iter().map(|reason| (reason, self.get(reason)))
    }

    pub(super) fn count(&mut self, reason: Rejection) {
        self.counts[reason as usize] += 1;
    }
}

impl Serialize for Rejections {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        for (reason, count) in self.iter() {
            map.serialize_entry(reason.name(), &count)?;
        }
        map.serialize_entry("skipped_samples", &self.skipped_samples)?;
        map.serialize_entry("resynchronised_writers", &self.resynchronised_writers)?;
        map.serialize_entry("frozen_robots", &self.frozen_robots)?;
        map.end()
    }
}
