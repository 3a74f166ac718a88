use iceoryx2::port::ReceiveError;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::ipc;
use iceoryx2::sample::Sample;

use super::{ChannelError, Record};
use crate::wire::{RobotState, state_flags};

/// Reads samples in place.
#[derive(Debug)]
pub struct Reader<R: Record> {
    subscriber: Subscriber<ipc::Service, [R], R::Header>,
}

impl<R: Record> Reader<R> {
    pub(super) fn new(subscriber: Subscriber<ipc::Service, [R], R::Header>) -> Self {
        Self { subscriber }
    }

    /// The oldest sample that has not been read, if there is one. Does not wait.
    ///
    /// # Errors
    /// [`ChannelError::Transfer`] when too many samples are held, or a writer's memory cannot be
    /// mapped.
    #[expect(clippy::should_implement_trait, reason = "an iterator would end at the first gap")]
    pub fn next(&mut self) -> Result<Option<Received<R>>, ChannelError> {
        let received = self.subscriber.receive().map_err(|e| ChannelError::Transfer {
            channel: R::CHANNEL.name(),
            reason: match e {
                ReceiveError::ExceedsMaxBorrows => "too many samples are held at a time",
                ReceiveError::ConnectionFailure(_) => "a writer's memory could not be mapped",
            },
        })?;
        Ok(received.map(|sample| Received { sample }))
    }

    /// The newest sample, if any arrived; drops those before it.
    ///
    /// # Errors
    /// Those of [`Reader::next`].
    pub fn newest(&mut self) -> Result<Option<Received<R>>, ChannelError> {
        let mut newest = None;
        while let Some(sample) = self.next()? {
            newest = Some(sample);
        }
        Ok(newest)
    }
}

impl Received<RobotState> {
    /// The robots of the fleet: the records without the free places.
    pub fn present(&self) -> impl Iterator<Item = &RobotState> {
        self.robots().iter().filter(|robot| !robot.has(state_flags::VACANT))
    }
}

/// A sample in shared memory; it goes back to its writer when it is dropped.
#[derive(Debug)]
pub struct Received<R: Record> {
    sample: Sample<ipc::Service, [R], R::Header>,
}

impl<R: Record> Received<R> {
    /// What stands once at its head.
    pub fn header(&self) -> &R::Header {
        self.sample.user_header()
    }

    /// One record for each place of the fleet, in the same order in every sample of a run.
    pub fn robots(&self) -> &[R] {
        self.sample.payload()
    }

    /// Which writer sent it: unique to a writer and never used again.
    pub fn writer(&self) -> u128 {
        self.sample.origin().value()
    }
}
