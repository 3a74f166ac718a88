use std::sync::Arc;

use iceoryx2::port::ReceiveError;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{PayloadHeader, ipc};
use iceoryx2::sample::Sample;

use super::memory::{Message, Queue};
use super::{ChannelError, Record};
use crate::wire::{Header, RobotState, Seal, state_flags};

/// Reads samples in place. What is not as its writer sealed it is never handed out, but counted.
#[derive(Debug)]
pub struct Reader<R: Record> {
    port: Port<R>,
    seal: Seal,
    corrupt: u64,
}

#[derive(Debug)]
enum Port<R: Record> {
    Shared(Subscriber<ipc::Service, [R], R::Header>),
    Local(Arc<Queue<R>>),
}

impl<R: Record> Reader<R> {
    pub(super) fn new(subscriber: Subscriber<ipc::Service, [R], R::Header>, seal: Seal) -> Self {
        Self { port: Port::Shared(subscriber), seal, corrupt: 0 }
    }

    pub(crate) fn local(queue: Arc<Queue<R>>, seal: Seal) -> Self {
        Self { port: Port::Local(queue), seal, corrupt: 0 }
    }

    /// What waits for it, where it reads inside this process.
    pub(crate) fn queue(&self) -> Option<&Arc<Queue<R>>> {
        match &self.port {
            Port::Shared(_) => None,
            Port::Local(queue) => Some(queue),
        }
    }

    /// The oldest sample that has not been read, if there is one. Does not wait. Samples that were
    /// corrupted are left out.
    ///
    /// # Errors
    /// [`ChannelError::Transfer`] when too many samples are held, or a writer's memory cannot be
    /// mapped.
    #[expect(clippy::should_implement_trait, reason = "an iterator would end at the first gap")]
    pub fn next(&mut self) -> Result<Option<Received<R>>, ChannelError> {
        while let Some(sample) = self.next_unverified()? {
            if self.verified(&sample) {
                return Ok(Some(sample));
            }
        }
        Ok(None)
    }

    /// The newest sample, if any arrived and it is intact; drops those before it.
    ///
    /// # Errors
    /// Those of [`Reader::next`].
    pub fn newest(&mut self) -> Result<Option<Received<R>>, ChannelError> {
        let mut newest = None;
        while let Some(sample) = self.next_unverified()? {
            newest = Some(sample);
        }
        Ok(newest.filter(|sample| self.verified(sample)))
    }

    /// Copies the oldest sample that has not been read to `records`, if there is one, and verifies the
    /// copy; its header. For gates: what changes in shared memory afterwards moves nobody. Does not wait,
    /// and allocates only where `records` has to grow.
    ///
    /// # Errors
    /// Those of [`Reader::next`].
    pub fn next_copy(&mut self, records: &mut Vec<R>) -> Result<Option<R::Header>, ChannelError> {
        while let Some(sample) = self.next_unverified()? {
            if let Ok(header) = sample.copy_to(records, usize::MAX) {
                return Ok(Some(header));
            }
            self.corrupt += 1;
        }
        Ok(None)
    }

    /// As [`Reader::next`], for who verifies a copy of it.
    pub(crate) fn next_unverified(&mut self) -> Result<Option<Received<R>>, ChannelError> {
        let seal = self.seal;
        let subscriber = match &self.port {
            Port::Shared(subscriber) => subscriber,
            Port::Local(queue) => {
                return Ok(queue.take().map(|message| Received { sample: Held::Local(message), seal }));
            }
        };
        let received = subscriber.receive().map_err(|e| ChannelError::Transfer {
            channel: R::CHANNEL.name(),
            reason: match e {
                ReceiveError::ExceedsMaxBorrows => "too many samples are held at a time",
                ReceiveError::ConnectionFailure(_) => "a writer's memory could not be mapped",
            },
        })?;
        Ok(received.map(|sample| Received { sample: Held::Shared(sample), seal }))
    }

    fn verified(&mut self, sample: &Received<R>) -> bool {
        let intact = sample.is_intact();
        self.corrupt += u64::from(!intact);
        intact
    }

    /// Samples so far that were not as their writer had sealed them, and were not handed out.
    pub fn corrupt(&self) -> u64 {
        self.corrupt
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
    seal: Seal,
}

#[derive(Debug)]
enum Held<R: Record> {
    Shared(Sample<ipc::Service, [R], R::Header>),
    Local(Message<R>),
}

/// Why there is no copy of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum NotCopied {
    /// It is not what its writer sealed.
    Corrupt,
    /// It has more records than are wanted.
    TooLong,
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

    /// Whether it still is what its writer sealed. It was when it was handed out; the memory belongs to
    /// somebody else. Who acts on a part of it takes a copy of that part and asks again.
    pub fn is_intact(&self) -> bool {
        // Before the records: a wrong number of them would reach beyond the sample.
        self.has_as_many() && self.seal.holds(self.header(), self.robots())
    }

    fn has_as_many(&self) -> bool {
        let records = match &self.sample {
            Held::Shared(sample) => sample.header().number_of_elements(),
            Held::Local(message) => message.robots.len() as u64,
        };
        records == u64::from(self.header().records())
    }

    /// Copies at most `most` records to `records` and verifies the copy: what changes in shared memory
    /// afterwards changes nothing any more. The header.
    pub(crate) fn copy_to(&self, records: &mut Vec<R>, most: usize) -> Result<R::Header, NotCopied> {
        records.clear();
        let header = *self.header();
        if !self.has_as_many() {
            return Err(NotCopied::Corrupt);
        }
        if self.robots().len() > most {
            return Err(NotCopied::TooLong);
        }
        records.extend_from_slice(self.robots());
        // The compiler must not look at the original again.
        let header = std::hint::black_box(header);
        if self.seal.holds(&header, records) { Ok(header) } else { Err(NotCopied::Corrupt) }
    }

    /// Which writer sent it: unique to a writer and never used again.
    pub fn writer(&self) -> u128 {
        match &self.sample {
            Held::Shared(sample) => sample.origin().value(),
            Held::Local(message) => message.writer,
        }
    }
}
