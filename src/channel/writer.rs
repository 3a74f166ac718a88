use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::ipc;
use iceoryx2::sample_mut::SampleMut;

use super::memory::LocalWriter;
use super::{ChannelError, Record};
use crate::wire::Seal;

/// Writes samples of a fixed number of records, in place.
#[derive(Debug)]
pub struct Writer<R: Record> {
    port: Port<R>,
    seal: Seal,
}

#[derive(Debug)]
enum Port<R: Record> {
    Shared(Shared<R>),
    Local(LocalWriter<R>),
}

/// A writer in shared memory.
#[derive(Debug)]
struct Shared<R: Record> {
    // Declared first: a loan must go back before its port.
    next: Option<SampleMut<ipc::Service, [R], R::Header>>,
    publisher: Publisher<ipc::Service, [R], R::Header>,
    robots: usize,
    discarded: Arc<AtomicU64>,
}

impl<R: Record> Writer<R> {
    pub(super) fn new(
        publisher: Publisher<ipc::Service, [R], R::Header>,
        robots: usize,
        seal: Seal,
        discarded: Arc<AtomicU64>,
    ) -> Self {
        Self { port: Port::Shared(Shared { next: None, publisher, robots, discarded }), seal }
    }

    pub(super) fn local(writer: LocalWriter<R>, seal: Seal) -> Self {
        Self { port: Port::Local(writer), seal }
    }

    pub(super) fn discard_counter() -> Arc<AtomicU64> {
        Arc::default()
    }

    /// Takes the memory of the next sample, if it is not there yet. One allocation of 48 bytes.
    ///
    /// # Errors
    /// [`ChannelError::NotLoaned`] when shared memory is exhausted.
    pub fn prepare(&mut self) -> Result<(), ChannelError> {
        match &mut self.port {
            Port::Shared(writer) => writer.prepare(),
            Port::Local(writer) => writer.prepare(),
        }
    }

    /// Fills the next sample with `fill`, seals and sends it. Allocates only if it was not prepared.
    ///
    /// # Errors
    /// [`ChannelError::NotLoaned`] when nothing went out; [`ChannelError::Transfer`] when it did, but
    /// not to every reader.
    pub fn publish(&mut self, fill: impl FnOnce(&mut R::Header, &mut [R])) -> Result<(), ChannelError> {
        let seal = self.seal;
        self.send(|header, records| {
            fill(header, records);
            seal.put(header, records);
        })
    }

    /// The same for large samples: `fill` writes a few records at a time, from the given one on, and each block is
    /// sealed while it is near. Nothing is filled when nothing can be sent.
    ///
    /// # Errors
    /// Those of [`Writer::publish`].
    pub fn publish_in_blocks(
        &mut self,
        header: &R::Header,
        fill: impl FnMut(usize, &mut [R]),
    ) -> Result<(), ChannelError> {
        let seal = self.seal;
        self.send(|head, records| {
            *head = *header;
            seal.put_in_blocks(head, records, fill);
        })
    }

    /// Sends a sample that `fill` fills and seals.
    fn send(&mut self, fill: impl FnOnce(&mut R::Header, &mut [R])) -> Result<(), ChannelError> {
        match &mut self.port {
            Port::Shared(writer) => writer.publish(fill),
            Port::Local(writer) => writer.publish(fill),
        }
    }

    /// Connects to readers that have joined, so that the next send need not.
    ///
    /// # Errors
    /// [`ChannelError::Transfer`] when a reader's memory cannot be mapped.
    pub fn connect(&self) -> Result<(), ChannelError> {
        match &self.port {
            Port::Shared(writer) => writer.connect(),
            Port::Local(_) => Ok(()),
        }
    }

    /// Samples that a reader did not get because it was too slow; 0 where the oldest is overwritten.
    pub fn discarded(&self) -> u64 {
        match &self.port {
            Port::Shared(writer) => writer.discarded.load(Ordering::Relaxed),
            Port::Local(writer) => writer.discarded(),
        }
    }
}

impl<R: Record> Shared<R> {
    fn prepare(&mut self) -> Result<(), ChannelError> {
        if self.next.is_none() {
            self.next = Some(self.loan()?);
        }
        Ok(())
    }

    fn publish(&mut self, fill: impl FnOnce(&mut R::Header, &mut [R])) -> Result<(), ChannelError> {
        let mut sample = match self.next.take() {
            Some(sample) => sample,
            None => self.loan()?,
        };
        let mut header = R::Header::default();
        fill(&mut header, sample.payload_mut());
        *sample.user_header_mut() = header;
        Self::hand_over(sample)
    }

    /// Sends `sample`. iceoryx2's part of a period; `.ci/realtime-sanitizer` knows it by this name.
    #[cfg_attr(clearway_rtsan, inline(never))]
    fn hand_over(sample: SampleMut<ipc::Service, [R], R::Header>) -> Result<(), ChannelError> {
        match sample.send() {
            Ok(_) => Ok(()),
            Err(_) => Err(Self::failed("a sample could not be sent to every reader")),
        }
    }

    fn connect(&self) -> Result<(), ChannelError> {
        self.publisher.update_connections().map_err(|_| Self::failed("a reader could not be connected"))
    }

    fn loan(&self) -> Result<SampleMut<ipc::Service, [R], R::Header>, ChannelError> {
        let sample = self.publisher.loan_slice_uninit(self.robots);
        sample
            .map(|sample| sample.write_from_fn(|_| R::default()))
            .map_err(|_| ChannelError::NotLoaned { channel: R::CHANNEL.name() })
    }

    fn failed(reason: &'static str) -> ChannelError {
        ChannelError::Transfer { channel: R::CHANNEL.name(), reason }
    }
}
