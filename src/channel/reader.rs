use std::sync::Arc;

use iceoryx2::port::ReceiveError;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::ipc;
use iceoryx2::sample::Sample;

use super::memory::{Message, Queue};
use super::{ChannelError, Record};
use crate::wire::{RobotState, state_flags};

/// Reads samples in place.
#[derive(Debug)]
pub struct Reader<R: Record> {
    port: Port<R>,
}

#[derive(Debug)]
enum Port<R: Record> {
    Shared(Subscriber<ipc::Service, [R], R::Header>),
    Local(Arc<Queue<R>>),
}

impl<R: Record> Reader<R> {
    pub(super) fn new(subscriber: Subscriber<ipc::Service, [R], R::Header>) -> Self {
        Self { port: Port::Shared(subscriber) }
    }

    pub(super) fn local(queue: Arc<Queue<R>>) -> Self {
        Self { port: Port::Local(queue) }
    }

    /// What waits for it, where it reads inside this process.
    pub(crate) fn queue(&self) -> Option<&Arc<Queue<R>>> {
        match &self.port {
            Port::Shared(_) => None,
            Port::Local(queue) => Some(queue),
        }
    }

    /// The oldest sample that has not been read, if there is one. Does not wait.
    ///
    /// # Errors
    /// [`ChannelError::Transfer`] when too many samples are held, or a writer's memory cannot be
    /// mapped.
    #[expect(clippy::should_implement_trait, reason = "an iterator would end at the first gap")]
    pub fn next(&mut self) -> Result<Option<Received<R>>, ChannelError> {
        let subscriber = match &self.port {
            Port::Shared(subscriber) => subscriber,
            Port::Local(queue) => {
                return Ok(queue.take().map(|message| Received { sample: Held::Local(message) }));
            }
        };
        let received = subscriber.receive().map_err(|e| ChannelError::Transfer {
            channel: R::CHANNEL.name(),
            reason: match e {
                ReceiveError::ExceedsMaxBorrows => "too many samples are held at a time",
                ReceiveError::ConnectionFailure(_) => "a writer's memory could not be mapped",
            },
        })?;
        Ok(received.map(|sample| Received { sample: Held::Shared(sample) }))
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
    sample: Held<R>,
}

#[derive(Debug)]
enum Held<R: Record> {
    Shared(Sample<ipc::Service, [R], R::Header>),
    Local(Message<R>),
}

impl<R: Record> Received<R> {
    /// What stands once at its head.
    pub fn header(&self) -> &R::Header {
        match &self.sample {
            Held::Shared(sample) => sample.user_header(),
            Held::Local(message) => &message.header,
        }
    }

    /// One record for each place of the fleet, in the same order in every sample of a run.
    pub fn robots(&self) -> &[R] {
        match &self.sample {
            Held::Shared(sample) => sample.payload(),
            Held::Local(message) => &message.robots,
        }
    }

    /// Which writer sent it: unique to a writer and never used again.
    pub fn writer(&self) -> u128 {
        match &self.sample {
            Held::Shared(sample) => sample.origin().value(),
            Held::Local(message) => message.writer,
        }
    }
}
