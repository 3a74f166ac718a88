//! A node's ends of `admin`.

use std::fmt::Debug;

use iceoryx2::prelude::*;
use iceoryx2::service::builder::request_response::{
    RequestResponseOpenError, RequestResponseOpenOrCreateError,
};
use iceoryx2::service::port_factory::request_response::PortFactory as AdminService;

use super::ChannelError;
use super::admin::{self, AdminPort, AdminServer};
use super::node::{MAX_NODES, SharedNode};
use crate::wire::{AdminAnswer, AdminRequest, AdminRobot};

/// The service behind `admin`.
type Admin = AdminService<ipc::Service, [AdminRobot], AdminRequest, [u8], AdminAnswer>;

impl SharedNode {
    /// Attaches to `admin` as the fleet's server, with room for `max_clients`. Makes the
    /// channel if it does not exist.
    ///
    /// # Errors
    /// [`ChannelError::Port`] when there is a server already, and the reasons for which the channel
    /// cannot be opened.
    pub(super) fn admin_server(&self, max_clients: usize) -> Result<AdminServer, ChannelError> {
        let service = self
            .node
            .service_builder(&self.admin_service_name()?)
            .request_response::<[AdminRobot], [u8]>()
            .request_user_header::<AdminRequest>()
            .response_user_header::<AdminAnswer>()
            .max_servers(1)
            .max_clients(max_clients.max(1))
            .max_nodes(MAX_NODES)
            .max_active_requests_per_client(admin::WAITING_MAX)
            .max_response_buffer_size(admin::BUFFERED)
            .max_borrowed_responses_per_pending_response(admin::BORROWED)
            // What nobody takes is the newest request, not an older one's place.
            .enable_safe_overflow_for_requests(false)
            .enable_safe_overflow_for_responses(false)
            .enable_fire_and_forget_requests(false)
            .open_or_create()
            .map_err(|e| match e {
                RequestResponseOpenOrCreateError::RequestResponseOpenError(e) => self.admin_open_error(e),
                other => self.admin_open_failure(&other),
            })?;
        let created = service
            .server_builder()
            .initial_max_slice_len(admin::TEXT_MAX)
            .max_loaned_responses_per_request(admin::LOANED)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .set_request_degradation_handler(self.transport.counting())
            .set_response_degradation_handler(self.transport.counting())
            .create();
        created.map(AdminServer::new).map_err(|e| self.admin_port_error(&e))
    }

    /// Attaches to `admin` as a client.
    ///
    /// # Errors
    /// [`ChannelError::NoDaemon`] when the channel does not exist, and the reasons for which it cannot
    /// be opened.
    pub(super) fn admin(&self) -> Result<AdminPort, ChannelError> {
        let service = self.open_admin()?;
        let created = service
            .client_builder()
            // Most requests are about one robot; more memory is taken when one is about many.
            .initial_max_slice_len(16)
            .allocation_strategy(AllocationStrategy::PowerOfTwo)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create();
        created.map(AdminPort::new).map_err(|e| self.admin_port_error(&e))
    }

    pub(super) fn open_admin(&self) -> Result<Admin, ChannelError> {
        self.node
            .service_builder(&self.admin_service_name()?)
            .request_response::<[AdminRobot], [u8]>()
            .request_user_header::<AdminRequest>()
            .response_user_header::<AdminAnswer>()
            .open()
            .map_err(|e| self.admin_open_error(e))
    }

    fn admin_service_name(&self) -> Result<ServiceName, ChannelError> {
        let name = self.transport.admin_name();
        ServiceName::new(&name).map_err(|_| ChannelError::FleetName { name: self.transport.fleet.clone() })
    }

    fn admin_open_error(&self, error: RequestResponseOpenError) -> ChannelError {
        let service = self.transport.admin_name();
        match error {
            RequestResponseOpenError::DoesNotExist => ChannelError::NoDaemon { service },
            RequestResponseOpenError::IncompatibleRequestOrResponseType => ChannelError::Schema { service },
            other => self.admin_open_failure(&other),
        }
    }

    fn admin_open_failure(&self, reason: &dyn Debug) -> ChannelError {
        ChannelError::Open { service: self.transport.admin_name(), reason: format!("{reason:?}") }
    }

    fn admin_port_error(&self, reason: &dyn Debug) -> ChannelError {
        ChannelError::Port { service: self.transport.admin_name(), reason: format!("{reason:?}") }
    }
}
