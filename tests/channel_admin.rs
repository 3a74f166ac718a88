//! The `admin` channel between its two ends, without a daemon.

mod support;

use clearway::channel::{ChannelError, Transport};
use clearway::wire::{AdminAnswer, AdminKind, AdminRequest, AdminRobot};
use support::World;

fn request(ticket: u64) -> AdminRequest {
    AdminRequest { ticket, kind: AdminKind::SetGoals as u32, ..AdminRequest::default() }
}

#[test]
fn a_request_is_answered_with_its_text() {
    let world = World::new("admin_ends");
    let transport = Transport::new("default", &world.channel).unwrap();
    let node = transport.attach("test").unwrap();
    assert!(matches!(node.admin(), Err(ChannelError::NoDaemon { .. })));
    let server = node.admin_server(2).unwrap();
    assert!(matches!(node.admin_server(2), Err(ChannelError::Port { .. })));
    let port = node.admin().unwrap();
    assert_eq!(node.attached().admin_clients, 1);

    // About three robots, and about none.
    for robots in [3, 0] {
        let records: Vec<AdminRobot> = (0..robots)
            .map(|id| AdminRobot { id, goal_x_m: f64::from(id), ..AdminRobot::default() })
            .collect();
        let waiting = port.ask(&request(7), &records).unwrap();
        assert_eq!((waiting.servers(), waiting.answer().unwrap()), (1, None));
        let asked = server.next().unwrap().unwrap();
        assert_eq!((*asked.header(), asked.robots()), (request(7), records));
        let answer = AdminAnswer { ticket: 7, code: 3, ..AdminAnswer::default() };
        asked.answer(&answer, "weil es so ist".as_bytes()).unwrap();
        assert_eq!(waiting.answer().unwrap(), Some((answer, b"weil es so ist".to_vec())));
        assert_eq!(waiting.answer().unwrap(), None);
    }
    assert!(server.next().unwrap().is_none());
}

/// A client that floods fills its own share and no more; it is told at once.
#[test]
fn a_client_cannot_have_more_than_its_share_waiting() {
    let world = World::new("admin_flood");
    let transport = Transport::new("default", &world.channel).unwrap();
    let node = transport.attach("test").unwrap();
    let server = node.admin_server(2).unwrap();
    let (flood, other) = (node.admin().unwrap(), node.admin().unwrap());
    let mut waiting = Vec::new();
    let refused = (0..100).filter(|n| flood.ask(&request(*n), &[]).map(|w| waiting.push(w)).is_err()).count();
    assert_eq!((waiting.len(), refused), (8, 92));
    let others = other.ask(&request(1000), &[]).unwrap();
    let mut answered = 0;
    while let Some(asked) = server.next().unwrap() {
        let answer = AdminAnswer { ticket: asked.header().ticket, ..AdminAnswer::default() };
        asked.answer(&answer, &[]).unwrap();
        answered += 1;
    }
    assert_eq!(answered, 9);
    assert_eq!(others.answer().unwrap().map(|(answer, _)| answer.ticket), Some(1000));
    for (n, waiting) in (0..).zip(&waiting) {
        assert_eq!(waiting.answer().unwrap().map(|(answer, _)| answer.ticket), Some(n));
    }
    drop(waiting);
    assert!(flood.ask(&request(0), &[]).is_ok());
}
