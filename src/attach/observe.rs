use crate::channel::{Attachment, ChannelError, StateReader, Writer};
use crate::geometry::Pose;
use crate::model::RobotId;
use crate::wire::{Holding, RobotObservation};

/// Tells the daemon where robots are. Keeps the sequence and follows the daemon's epoch.
#[derive(Debug)]
pub struct ObservationPublisher {
    writer: Writer<RobotObservation>,
    states: StateReader,
    robots: usize,
    epoch: u64,
    sequence: u64,
}

impl ObservationPublisher {
    pub(super) fn new(node: &Attachment, robots: usize) -> Result<Self, ChannelError> {
        let (writer, states) = (node.observer(robots)?, node.reader()?);
        Ok(Self { writer, states, robots, epoch: 0, sequence: 0 })
    }

    /// Publishes the poses that were true at `stamp_ns`, `CLOCK_MONOTONIC` ns: one for each robot that
    /// the publisher was made for, in the world frame, m and rad.
    ///
    /// For who does not know what the robots' drivers do: a localisation system. The daemon then takes
    /// them to get every command in time.
    ///
    /// # Errors
    /// [`ChannelError::Transfer`] for another number of poses, and when a reader could not be reached;
    /// [`ChannelError::NotLoaned`] when shared memory is exhausted.
    pub fn publish(&mut self, stamp_ns: u64, poses: &[(RobotId, Pose)]) -> Result<(), ChannelError> {
        self.send(stamp_ns, poses.len(), poses.iter().map(|(id, pose)| (*id, *pose, Holding::Untold)))
    }

    /// The same of a driver, with what each robot's gate [holds](crate::actuation::Gate::holding) at
    /// `stamp_ns`, so that one that missed a command is noticed.
    ///
    /// # Errors
    /// As [`publish`](Self::publish).
    pub fn report(&mut self, stamp_ns: u64, robots: &[(RobotId, Pose, Holding)]) -> Result<(), ChannelError> {
        self.send(stamp_ns, robots.len(), robots.iter().copied())
    }

    fn send(
        &mut self,
        stamp_ns: u64,
        robots: usize,
        seen: impl Iterator<Item = (RobotId, Pose, Holding)>,
    ) -> Result<(), ChannelError> {
        if robots != self.robots {
            let reason = "there have to be as many poses as the publisher was made for";
            return Err(ChannelError::Transfer { channel: "observation", reason });
        }
        if let Some(sample) = self.states.newest()? {
            self.follow(sample.header().epoch);
        }
        self.skip();
        let (epoch, sequence) = (self.epoch, self.sequence);
        self.writer.publish(|header, records| {
            (header.epoch, header.sequence, header.stamp_ns) = (epoch, sequence, stamp_ns);
            for (record, (id, pose, holding)) in records.iter_mut().zip(seen) {
                let (x_m, y_m) = (pose.position_m.x, pose.position_m.y);
                let (id, holding, theta_rad) = (id.0, holding.code(), pose.theta_rad);
                *record = RobotObservation { id, holding, x_m, y_m, theta_rad };
            }
        })
    }

    /// Speaks to the daemon's run `epoch` from now on, unless a newer one is known: for who hears of it
    /// before the run's first state, in a command.
    pub fn follow(&mut self, epoch: u64) {
        self.epoch = self.epoch.max(epoch);
    }

    /// Uses up the number of a sample that could not be sent, so that the daemon can count it as missing.
    pub fn skip(&mut self) {
        self.sequence = self.sequence.wrapping_add(1);
    }
}
