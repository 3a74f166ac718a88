//! The recorder: a thread that reads shared memory, a bounded queue, a thread that writes files.

use crate::files::Files;
use crate::status::{Notice, Shared, Status};
use crate::tap::Tap;
use crate::writer::WriterThread;
use crate::{Options, RecordError};
use clearway::channel::Transport;
use clearway::config::ChannelConfig;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, channel, sync_channel};
use std::thread::JoinHandle;

/// Samples that wait for the writer at most, whatever their size.
const QUEUE_SAMPLES: usize = 1 << 14;

/// A recording that goes on.
#[derive(Debug)]
pub struct Recorder {
    shared: Arc<Shared>,
    notices: Receiver<Notice>,
    tap: JoinHandle<Result<(), RecordError>>,
    writer: JoinHandle<()>,
}

impl Recorder {
    /// Makes the first file, and begins to wait for the fleet's daemon.
    ///
    /// # Errors
    /// [`RecordError`] when the file cannot be made or shared memory cannot be joined.
    pub fn start(
        fleet: &str,
        channel_config: &ChannelConfig,
        options: &Options,
    ) -> Result<Self, RecordError> {
        let transport = Transport::new(fleet, channel_config)?;
        let shared = Arc::new(Shared::default());
        let (notify, notices) = channel();
        let tap_notices = notify.clone();
        let (queue, queued) = sync_channel(QUEUE_SAMPLES);
        let (made, making) = sync_channel(1);

        let writer = {
            let (shared, options, fleet) = (Arc::clone(&shared), options.clone(), fleet.to_owned());
            let channel = channel_config.clone();
            spawn("record-write", move || match Files::create(&options, notify) {
                Ok(files) => {
                    let _ = made.send(Ok(()));
                    WriterThread::new(&fleet, channel, options, shared, files).run(&queued);
                }
                Err(e) => {
                    let _ = made.send(Err(e));
                }
            })?
        };
        making.recv().map_err(|_| RecordError::Panicked { thread: "writing" })??;
        let tap = Tap {
            transport,
            options: options.clone(),
            shared: Arc::clone(&shared),
            queue,
            notices: tap_notices,
        };
        let tap = spawn("record-read", move || tap.run())?;
        Ok(Self { shared, notices, tap, writer })
    }

    /// How it goes.
    pub fn status(&self) -> Status {
        self.shared.status()
    }

    /// What happened since the last time.
    pub fn notices(&self) -> impl Iterator<Item = Notice> + '_ {
        self.notices.try_iter()
    }

    /// Whether it has ended by itself.
    pub fn is_finished(&self) -> bool {
        self.tap.is_finished()
    }

    /// Asks it to end.
    pub fn stop(&self) {
        self.shared.stop.store(true, Ordering::Release);
    }

    /// Waits for the end, and for the files to be complete.
    ///
    /// # Errors
    /// [`RecordError`]: no daemon appeared, or shared memory failed. The files are complete all the same.
    pub fn join(self) -> (Status, Vec<Notice>, Result<(), RecordError>) {
        let read = self.tap.join().unwrap_or(Err(RecordError::Panicked { thread: "reading" }));
        // The queue's only sender is gone: the writer takes what is left and ends.
        let written = self.writer.join().map_err(|_| RecordError::Panicked { thread: "writing" });
        (self.shared.status(), self.notices.try_iter().collect(), read.and(written))
    }
}

fn spawn<T: Send + 'static>(
    name: &str,
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<JoinHandle<T>, RecordError> {
    let builder = std::thread::Builder::new().name(name.to_owned());
    builder.spawn(work).map_err(|source| RecordError::Create { path: PathBuf::from(name), source })
}
