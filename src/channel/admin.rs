//! The two ends of `admin`: one server, many clients, a request and its answer.

use iceoryx2::active_request::ActiveRequest;
use iceoryx2::pending_response::PendingResponse;
use iceoryx2::port::client::Client;
use iceoryx2::port::server::Server;
use iceoryx2::prelude::ipc;

use super::ChannelError;
use crate::wire::{AdminAnswer, AdminRequest, AdminRobot};

pub(super) const NAME: &str = "admin";

/// Requests of one client that wait for their answers at a time.
pub(super) const WAITING_MAX: usize = 8;

/// Longest text of one answer, bytes; longer texts come in pieces.
pub const TEXT_MAX: usize = 16 * 1024;

type Request = ActiveRequest<ipc::Service, [AdminRobot], AdminRequest, [u8], AdminAnswer>;
type Pending = PendingResponse<ipc::Service, [AdminRobot], AdminRequest, [u8], AdminAnswer>;

/// The daemon's end.
#[derive(Debug)]
pub struct AdminServer {
    server: Server<ipc::Service, [AdminRobot], AdminRequest, [u8], AdminAnswer>,
}

impl AdminServer {
    pub(super) fn new(server: Server<ipc::Service, [AdminRobot], AdminRequest, [u8], AdminAnswer>) -> Self {
        Self { server }
    }

    /// The oldest request that has not been taken, if there is one. Does not wait.
    ///
    /// # Errors
    /// [`ChannelError::Transfer`] when a client's memory cannot be mapped.
    pub fn next(&self) -> Result<Option<Asked>, ChannelError> {
        let received = self.server.receive().map_err(|_| failed("a client's memory could not be mapped"))?;
        Ok(received.map(|request| {
            // The client can go on writing to its memory: what is checked has to be a copy.
            let header = std::hint::black_box(*request.user_header());
            Asked { header, request }
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
        self.request.payload().iter().map(|robot| std::hint::black_box(*robot)).collect()
    }

    /// How many they are.
    pub fn len(&self) -> usize {
        self.request.payload().len()
    }

    /// Whether it is about the fleet.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Which client asked: unique to a client and never used again.
    pub fn client(&self) -> u128 {
        self.request.origin().value()
    }

    /// Answers with at most [`TEXT_MAX`] bytes of text.
    ///
    /// # Errors
    /// [`ChannelError::NotLoaned`] or [`ChannelError::Transfer`]: the client does not get it.
    pub fn answer(self, header: &AdminAnswer, text: &[u8]) -> Result<(), ChannelError> {
        let text = &text[..text.len().min(TEXT_MAX)];
        let response = self.request.loan_slice_uninit(text.len());
        let mut response =
            response.map_err(|_| ChannelError::NotLoaned { channel: NAME })?.write_from_slice(text);
        *response.user_header_mut() = *header;
        response.send().map_err(|_| failed("an answer could not be sent"))
    }
}

/// An operator's end.
#[derive(Debug)]
pub struct AdminPort {
    client: Client<ipc::Service, [AdminRobot], AdminRequest, [u8], AdminAnswer>,
}

impl AdminPort {
    pub(super) fn new(client: Client<ipc::Service, [AdminRobot], AdminRequest, [u8], AdminAnswer>) -> Self {
        Self { client }
    }

    /// Sends a request; the answer comes later, or never.
    ///
    /// # Errors
    /// [`ChannelError::NotLoaned`] when too many answers are waited for, [`ChannelError::Transfer`] when
    /// the daemon could not be reached.
    pub fn ask(&self, header: &AdminRequest, robots: &[AdminRobot]) -> Result<Waiting, ChannelError> {
        let request = self.client.loan_slice_uninit(robots.len());
        let mut request =
            request.map_err(|_| ChannelError::NotLoaned { channel: NAME })?.write_from_slice(robots);
        *request.user_header_mut() = *header;
        let pending = request.send().map_err(|_| failed("the request could not be sent"))?;
        Ok(Waiting { pending })
    }
}

/// An answer that is waited for. The connection outlives a daemon that was killed: nobody may wait
/// without a time limit.
#[derive(Debug)]
pub struct Waiting {
    pending: Pending,
}

impl Waiting {
    /// The answer and its text, once it is there. Does not wait.
    ///
    /// # Errors
    /// [`ChannelError::Transfer`] when the daemon's memory cannot be mapped.
    pub fn answer(&self) -> Result<Option<(AdminAnswer, Vec<u8>)>, ChannelError> {
        let received =
            self.pending.receive().map_err(|_| failed("the daemon's memory could not be mapped"))?;
        Ok(received.map(|response| (*response.user_header(), response.payload().to_vec())))
    }

    /// Daemons that the request went to: 0 when none runs.
    pub fn servers(&self) -> usize {
        self.pending.number_of_server_connections()
    }
}

fn failed(reason: &'static str) -> ChannelError {
    ChannelError::Transfer { channel: NAME, reason }
}
