//! The two ends of `admin`: one server, many clients, a request and its answer.

use std::sync::Arc;

use iceoryx2::active_request::ActiveRequest;
use iceoryx2::pending_response::PendingResponse;
use iceoryx2::port::client::Client;
use iceoryx2::port::server::Server;
use iceoryx2::prelude::ipc;

use super::ChannelError;
use super::memory::{LocalAnswer, LocalRequest, Memory};
use crate::wire::{AdminAnswer, AdminRequest, AdminRobot};

pub(super) const NAME: &str = "admin";

/// Requests of one client that wait for their answers at a time.
pub(super) const WAITING_MAX: usize = 8;

/// Longest text of one answer, bytes; longer texts come in pieces.
pub const TEXT_MAX: usize = 16 * 1024;

/// Answers to one request that wait, that its client holds, and that the server is writing.
pub(super) const BUFFERED: usize = 1;
pub(super) const BORROWED: usize = 2;
pub(super) const LOANED: usize = 1;

/// What iceoryx2 adds to an answer.
const ANSWER_OVERHEAD_BYTES: usize = 128;

/// What the server sets aside for its answers to `clients`. It can still hold as many requests again that
/// their clients have given up.
pub(super) fn server_bytes(clients: usize) -> usize {
    let answers = 2 * WAITING_MAX * (BUFFERED + BORROWED + LOANED);
    clients * answers * (TEXT_MAX + size_of::<AdminAnswer>() + ANSWER_OVERHEAD_BYTES)
}

type SharedRequest = ActiveRequest<ipc::Service, [AdminRobot], AdminRequest, [u8], AdminAnswer>;
type SharedPending = PendingResponse<ipc::Service, [AdminRobot], AdminRequest, [u8], AdminAnswer>;

#[derive(Debug)]
enum Request {
    Shared(SharedRequest),
    Local(LocalRequest),
}

impl Request {
    fn robots(&self) -> &[AdminRobot] {
        match self {
            Self::Shared(request) => request.payload(),
            Self::Local(request) => &request.robots,
        }
    }
}

/// The daemon's end.
#[derive(Debug)]
pub struct AdminServer {
    end: ServerEnd,
}

#[derive(Debug)]
enum ServerEnd {
    Shared(Server<ipc::Service, [AdminRobot], AdminRequest, [u8], AdminAnswer>),
    Local(Arc<Memory>),
}

impl AdminServer {
    pub(super) fn new(server: Server<ipc::Service, [AdminRobot], AdminRequest, [u8], AdminAnswer>) -> Self {
        Self { end: ServerEnd::Shared(server) }
    }

    pub(super) fn local(memory: Arc<Memory>) -> Self {
        Self { end: ServerEnd::Local(memory) }
    }

    /// The oldest request that has not been taken, if there is one. Does not wait.
    ///
    /// # Errors
    /// [`ChannelError::Transfer`] when a client's memory cannot be mapped.
    pub fn next(&self) -> Result<Option<Asked>, ChannelError> {
        let server = match &self.end {
            ServerEnd::Shared(server) => server,
            ServerEnd::Local(memory) => {
                return Ok(memory
                    .next_request()
                    .map(|request| Asked { header: request.header, request: Request::Local(request) }));
            }
        };
        let received = server.receive().map_err(|_| failed("a client's memory could not be mapped"))?;
        Ok(received.map(|request| {
            // The client can go on writing to its memory: what is checked has to be a copy.
            let header = std::hint::black_box(*request.user_header());
            Asked { header, request: Request::Shared(request) }
        }))
    }
}

/// A request that waits for its answer.
#[derive(Debug)]
pub struct Asked {
    header: AdminRequest,
    request: Request,
}

impl Asked {
    /// What is asked.
    pub fn header(&self) -> &AdminRequest {
        &self.header
    }

    /// A copy of the robots that it is about.
    pub fn robots(&self) -> Vec<AdminRobot> {
        self.request.robots().iter().map(|robot| std::hint::black_box(*robot)).collect()
    }

    /// How many they are.
    pub fn len(&self) -> usize {
        self.request.robots().len()
    }

    /// Whether it is about the fleet.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Which client asked: unique to a client and never used again.
    pub fn client(&self) -> u128 {
        match &self.request {
            Request::Shared(request) => request.origin().value(),
            Request::Local(request) => request.client,
        }
    }

    /// Answers with at most [`TEXT_MAX`] bytes of text.
    ///
    /// # Errors
    /// [`ChannelError::NotLoaned`] or [`ChannelError::Transfer`]: the client does not get it.
    pub fn answer(self, header: &AdminAnswer, text: &[u8]) -> Result<(), ChannelError> {
        let text = &text[..text.len().min(TEXT_MAX)];
        let request = match self.request {
            Request::Shared(request) => request,
            Request::Local(request) => {
                request.answer.put(header, text);
                return Ok(());
            }
        };
        let response = request.loan_slice_uninit(text.len());
        let mut response =
            response.map_err(|_| ChannelError::NotLoaned { channel: NAME })?.write_from_slice(text);
        *response.user_header_mut() = *header;
        response.send().map_err(|_| failed("an answer could not be sent"))
    }
}

/// An operator's end.
#[derive(Debug)]
pub struct AdminPort {
    end: ClientEnd,
}

#[derive(Debug)]
enum ClientEnd {
    Shared(Client<ipc::Service, [AdminRobot], AdminRequest, [u8], AdminAnswer>),
    Local { memory: Arc<Memory>, client: u128 },
}

impl AdminPort {
    pub(super) fn new(client: Client<ipc::Service, [AdminRobot], AdminRequest, [u8], AdminAnswer>) -> Self {
        Self { end: ClientEnd::Shared(client) }
    }

    pub(super) fn local(memory: Arc<Memory>) -> Self {
        let client = memory.identity();
        Self { end: ClientEnd::Local { memory, client } }
    }

    /// Sends a request; the answer comes later, or never.
    ///
    /// # Errors
    /// [`ChannelError::NotLoaned`] when too many answers are waited for, [`ChannelError::Transfer`] when
    /// the daemon could not be reached.
    pub fn ask(&self, header: &AdminRequest, robots: &[AdminRobot]) -> Result<Waiting, ChannelError> {
        let shared = match &self.end {
            ClientEnd::Shared(shared) => shared,
            ClientEnd::Local { memory, client } => {
                return Ok(Waiting { pending: Pending::Local(memory.ask(*client, *header, robots)) });
            }
        };
        let request = shared.loan_slice_uninit(robots.len());
        let mut request =
            request.map_err(|_| ChannelError::NotLoaned { channel: NAME })?.write_from_slice(robots);
        *request.user_header_mut() = *header;
        let pending = request.send().map_err(|_| failed("the request could not be sent"))?;
        Ok(Waiting { pending: Pending::Shared(pending) })
    }
}

/// An answer that is waited for. The connection outlives a daemon that was killed: nobody may wait
/// without a time limit.
#[derive(Debug)]
pub struct Waiting {
    pending: Pending,
}

#[derive(Debug)]
enum Pending {
    Shared(SharedPending),
    Local(Arc<LocalAnswer>),
}

impl Waiting {
    /// The answer and its text, once it is there. Does not wait.
    ///
    /// # Errors
    /// [`ChannelError::Transfer`] when the daemon's memory cannot be mapped.
    pub fn answer(&self) -> Result<Option<(AdminAnswer, Vec<u8>)>, ChannelError> {
        let pending = match &self.pending {
            Pending::Shared(pending) => pending,
            Pending::Local(answer) => return Ok(answer.take()),
        };
        let received = pending.receive().map_err(|_| failed("the daemon's memory could not be mapped"))?;
        Ok(received.map(|response| (*response.user_header(), response.payload().to_vec())))
    }

    /// Daemons that the request went to: 0 when none runs.
    pub fn servers(&self) -> usize {
        match &self.pending {
            Pending::Shared(pending) => pending.number_of_server_connections(),
            Pending::Local(_) => 1,
        }
    }
}

fn failed(reason: &'static str) -> ChannelError {
    ChannelError::Transfer { channel: NAME, reason }
}
