//! The thread that answers operators, round by round, with a loop that the test plays.

use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use super::thread::{Admin, Fault};
use super::{Shared, desk_size};
use crate::channel::{AdminPort, Transport, Waiting};
use crate::clock::{Clock, MonotonicClock};
use crate::config::{Config, Wakeup};
use crate::journal::{Kept, StoppedBy, file};
use crate::model::Obstacle;
use crate::realtime::Achieved;
use crate::runtime::board::Board;
use crate::runtime::desk::{Batch, Change, Desk, Outcome};
use crate::runtime::keeping::{Keeper, Opened};
use crate::runtime::tests::support::{World, config, lanes};
use crate::runtime::{Progress, Until};
use crate::scenario::Scenario;
use crate::wire::{AdminAnswer, AdminCode, AdminKind, AdminRequest, AdminRobot, admin_flags, state_flags};

struct Rig {
    admin: Admin<MonotonicClock>,
    desk: Arc<Desk>,
    board: Arc<Board>,
    ports: [AdminPort; 4],
    ticks: u64,
    keeper: Option<Keeper>,
    _world: World,
}

impl Rig {
    fn new(name: &str, scenario: Scenario) -> Self {
        Self::make(name, scenario, false)
    }

    /// With a journal.
    fn kept(name: &str, scenario: Scenario) -> Self {
        Self::make(name, scenario, true)
    }

    fn make(name: &str, scenario: Scenario, kept: bool) -> Self {
        let world = World::new(name);
        let mut config: Config = config(&world, scenario, 10_000_000);
        config.source.arena_m = 1e5;
        config.journal.path = kept.then(|| world.channel.root.join("journal"));
        std::fs::create_dir_all(&world.channel.root).unwrap();
        let (config, opened) = Opened::open(config, Until::Stopped).unwrap();
        let keeper = opened.map(|opened| {
            let mut keeper = opened.keeper(7);
            keeper.begin().unwrap();
            keeper
        });
        let transport = Transport::new("default", &world.channel).unwrap();
        let node = transport.attach("test").unwrap();
        let server = node.admin_server(4).unwrap();
        let ports = [(); 4].map(|()| node.admin().unwrap());
        let (board, desk) =
            (Arc::new(Board::new(vec![0], 1, Wakeup::Futex)), Arc::new(Desk::new(desk_size(&config))));
        let shared = Shared {
            config: Arc::new(config),
            board: Arc::clone(&board),
            desk: Arc::clone(&desk),
            progress: Arc::new(Mutex::new(Progress::default())),
            realtime: Achieved::default(),
            workers: 1,
            epoch: 7,
            hold: 0,
            journal: keeper.as_ref().map(Keeper::journal),
            until: Until::Stopped,
        };
        let admin = Admin::new(MonotonicClock, node, server, shared);
        Self { admin, desk, board, ports, ticks: 0, keeper, _world: world }
    }

    fn ask(&self, client: usize, kind: AdminKind, offset: u64, robots: &[AdminRobot]) -> Waiting {
        let expires_ns = MonotonicClock.now_ns() + 50_000_000_000;
        let request = AdminRequest { expires_ns, offset, kind: kind as u32, ..AdminRequest::default() };
        self.ports[client].ask(&request, robots).unwrap()
    }

    /// Rounds until there is an answer, and how many they were.
    fn answer(&mut self, waiting: &Waiting) -> (AdminAnswer, Vec<u8>, usize) {
        for rounds in 1..10_000 {
            self.admin.round(false);
            if let Some((answer, text)) = waiting.answer().unwrap() {
                return (answer, text, rounds);
            }
            if self.keeper.is_some() {
                std::thread::sleep(std::time::Duration::from_millis(1));
            }
        }
        panic!("never answered");
    }

    /// What the journal's file holds.
    fn on_disk(&self) -> Kept {
        let path = self.keeper.as_ref().unwrap().path();
        Kept::decode(&file::load(path).unwrap().unwrap()).unwrap()
    }

    /// Carries out what waits, as the loop does.
    fn carry_out(&mut self) -> Vec<Batch> {
        let mut seen = Vec::new();
        while let Some(mut batch) = self.desk.todo.pop() {
            batch.outcome = Outcome::Done { tick: self.ticks };
            let Batch { key, expires_ns, refusals_known, outcome, .. } = *batch;
            let changes = batch.changes.clone();
            seen.push(Batch { key, expires_ns, refusals_known, changes, routes: Vec::new(), outcome });
            self.desk.done.push(batch).unwrap();
        }
        self.ticks += 1;
        seen
    }
}

fn goal(id: u32, y_m: f64) -> AdminRobot {
    AdminRobot { id, goal_x_m: 30.0, goal_y_m: y_m, ..AdminRobot::default() }
}

/// All of a large fleet to new goals among pillars.
fn crowd(robots: u32, obstacles: u32) -> (Scenario, Vec<AdminRobot>) {
    let mut scenario = lanes(robots, 20.0);
    let pillar = |k| Obstacle::Circle {
        centre_m: crate::geometry::Vec2::new(10.0, -5.0 - 3.0 * f64::from(k)),
        radius_m: 0.5,
    };
    scenario.obstacles = (0..obstacles).map(pillar).collect();
    let goals = scenario.robots.iter().map(|robot| goal(robot.id.0, robot.goal_m.y)).collect();
    (scenario, goals)
}

#[test]
fn a_stop_is_taken_up_in_the_next_round_however_much_is_in_work() {
    let (scenario, goals) = crowd(10_000, 12);
    let mut rig = Rig::new("admin_slices", scenario);
    let slow = rig.ask(0, AdminKind::SetGoals, 0, &goals);
    let text = rig.ask(0, AdminKind::Scenario, 0, &[]);
    let mut rounds = 0;
    // In every part of the work: the checks, the cells, the routes.
    loop {
        assert!(rig.admin.round(false), "it goes on without a pause");
        rounds += 1;
        assert!(rounds < 10_000);
        if !rig.desk.todo.is_empty() {
            break;
        }
        if rounds % 8 == 1 {
            let stop = rig.ask(1, AdminKind::Stop, 0, &[]);
            rig.admin.round(false);
            let seen = rig.carry_out();
            let stops = [Change::Hold { set: state_flags::STOPPED, clear: 0 }];
            assert!(seen.first().is_some_and(|batch| batch.changes == stops), "in round {rounds}");
            if seen.len() > 1 {
                break;
            }
            let (answer, _, more) = rig.answer(&stop);
            assert_eq!((answer.code, more), (AdminCode::Done as u32, 1));
        }
    }
    rig.carry_out();
    let (answer, _, _) = rig.answer(&slow);
    assert_eq!(answer.code, AdminCode::Done as u32);
    assert!(rounds > 40, "{rounds} rounds");
    // The text waited, and shows the goals.
    let (answer, _, _) = rig.answer(&text);
    assert!(answer.code == AdminCode::Done as u32 && answer.text_bytes > 1_000_000);
}

#[test]
fn what_one_request_in_work_was_checked_against_stays_so_or_it_is_answered_busy() {
    let (scenario, goals) = crowd(3000, 12);
    let mut rig = Rig::new("admin_outdated", scenario);
    // With the loop already, and refused there while the other one is checked.
    let first = rig.ask(1, AdminKind::SetGoals, 0, &[goal(0, -100.0)]);
    rig.admin.round(false);
    let slow = rig.ask(0, AdminKind::SetGoals, 0, &goals[1..]);
    assert!(rig.admin.round(false));
    let mut batch = rig.desk.todo.pop().unwrap();
    batch.outcome = Outcome::Expired;
    rig.desk.done.push(batch).unwrap();
    assert_eq!(rig.answer(&first).0.code, AdminCode::Expired as u32);
    assert_eq!(rig.answer(&slow).0.code, AdminCode::Busy as u32);
    assert!(rig.desk.todo.is_empty());
    // Asked again, it is carried out.
    let again = rig.ask(0, AdminKind::SetGoals, 0, &goals[1..]);
    while rig.desk.todo.is_empty() {
        rig.admin.round(false);
    }
    assert_eq!(rig.carry_out()[0].changes.len(), goals.len() - 1);
    assert_eq!(rig.answer(&again).0.code, AdminCode::Done as u32);
}

#[test]
fn a_text_in_pieces_is_that_of_one_moment() {
    let (scenario, _) = crowd(2000, 0);
    let mut rig = Rig::new("admin_pieces", scenario.clone());
    let ask = |rig: &mut Rig, client, offset: usize| {
        let waiting = rig.ask(client, AdminKind::Scenario, offset as u64, &[]);
        rig.answer(&waiting)
    };
    let (answer, mut before, _) = ask(&mut rig, 0, 0);
    let whole = usize::try_from(answer.text_bytes).unwrap();
    assert!(before.len() < whole / 10);
    while before.len() < whole {
        // The fleet changes between any two pieces, and another client reads what it has become.
        let moved = rig.ask(1, AdminKind::SetGoals, 0, &[goal(0, -1.0 - rig.ticks as f64)]);
        rig.admin.round(false);
        rig.carry_out();
        rig.answer(&moved);
        ask(&mut rig, 1, 0);
        let (answer, piece, rounds) = ask(&mut rig, 0, before.len());
        assert_eq!((answer.text_bytes, rounds), (whole as u64, 1));
        before.extend(piece);
    }
    assert_eq!(String::from_utf8(before).unwrap(), scenario.to_toml());
    // Read whole, it is not kept; whoever goes on with nothing has to begin again.
    let (answer, _, _) = ask(&mut rig, 0, 100);
    assert_eq!(answer.code, AdminCode::Busy as u32);
    let (_, after, _) = ask(&mut rig, 0, 0);
    assert!(String::from_utf8_lossy(&after).contains(&format!("y_m = -{:?}", rig.ticks as f64)));
}

/// A disk that does not answer: whoever opens a pipe for writing waits for somebody who reads.
struct StuckDisk {
    keeper: Keeper,
    pipe: PathBuf,
}

impl StuckDisk {
    fn new(rig: &mut Rig) -> Self {
        let mut config = Config::clone(&rig.admin.shared.config);
        std::fs::create_dir_all(&config.channel.root).unwrap();
        let path = config.channel.root.join("a.journal");
        config.journal.path = Some(path.clone());
        let (_, opened) = Opened::open(config, Until::Stopped).unwrap();
        let mut keeper = opened.unwrap().keeper(7);
        keeper.begin().unwrap();
        rig.admin.shared.journal = Some(keeper.journal());
        let pipe = path.with_extension("journal.new");
        let mode = rustix::fs::Mode::RUSR | rustix::fs::Mode::WUSR;
        rustix::fs::mknodat(rustix::fs::CWD, &pipe, rustix::fs::FileType::Fifo, mode, 0).unwrap();
        Self { keeper, pipe }
    }

    /// The one write that waits fails, and those after it do not.
    fn mend(self) {
        let reader = std::fs::File::open(&self.pipe).unwrap();
        std::fs::remove_file(&self.pipe).unwrap();
        drop(self.keeper);
        drop(reader);
    }
}

#[test]
fn a_disk_that_does_not_answer_keeps_no_client_from_a_stop_and_leaves_nobody_without_an_answer() {
    let mut rig = Rig::new("admin_slow_disk", lanes(2, 20.0));
    let disk = StuckDisk::new(&mut rig);
    let mut waiting = Vec::new();
    for n in 0..8 {
        waiting.push(rig.ask(0, AdminKind::SetGoals, 0, &[goal(0, 3.0 + f64::from(n))]));
        rig.admin.round(false);
        rig.carry_out();
        rig.admin.round(false);
    }
    let tries = (0..1000).take_while(|_| !disk.keeper.journal().is_slow());
    assert!(tries.map(|_| std::thread::sleep(Duration::from_millis(10))).count() < 1000);
    rig.admin.round(false);
    let answers: Vec<_> = waiting.iter().map(|one| one.answer().unwrap()).collect();
    let codes: Vec<_> = answers.iter().map(|answer| answer.as_ref().map(|(answer, _)| answer.code)).collect();
    let not_kept = Some(AdminCode::NotKept as u32);
    assert_eq!(codes, [not_kept, not_kept, not_kept, not_kept, None, None, None, None]);
    let text = String::from_utf8_lossy(&answers[0].as_ref().unwrap().1).into_owned();
    assert!(text.contains("in force") && text.contains("not on the disk yet"), "{text}");
    // There is room for a stop again, and it waits for no disk.
    drop((answers, waiting.drain(..4)));
    let stop = rig.ask(0, AdminKind::Stop, 0, &[]);
    rig.admin.round(false);
    assert_eq!(rig.carry_out().len(), 1);
    let (answer, _, rounds) = rig.answer(&stop);
    assert_eq!((Some(answer.code), rounds), (not_kept, 1));
    // What is about to expire is answered before its client is gone.
    let expires_ns = MonotonicClock.now_ns() + 500_000_000;
    let request = AdminRequest { expires_ns, kind: AdminKind::Pause as u32, ..AdminRequest::default() };
    let pause = rig.ports[1].ask(&request, &[]).unwrap();
    rig.admin.round(false);
    rig.carry_out();
    rig.admin.round(false);
    assert!(pause.answer().unwrap().is_none());
    while MonotonicClock.now_ns() < expires_ns {
        std::thread::sleep(Duration::from_millis(5));
        rig.admin.round(false);
    }
    assert_eq!(pause.answer().unwrap().map(|(answer, _)| answer.code), not_kept);
    disk.mend();
}

#[test]
fn long_orders_of_others_leave_room_for_a_pause_and_a_resume() {
    let (scenario, goals) = crowd(3000, 12);
    let mut rig = Rig::new("admin_long", scenario);
    let share = crate::config::AdminConfig::default().changes_per_period / 2;
    let orders: Vec<_> = (0..2 * share).map(|n| rig.ask(n % 2, AdminKind::SetGoals, 0, &goals)).collect();
    rig.admin.round(false);
    assert!(orders.iter().all(|order| order.answer().unwrap().is_none()));
    let order = rig.ask(2, AdminKind::SetGoals, 0, &[goal(0, -100.0)]);
    assert_eq!(rig.answer(&order).0.code, AdminCode::Busy as u32);
    for kind in [AdminKind::Pause, AdminKind::Resume, AdminKind::Clear] {
        // Of these one client has half, too.
        let waiting: Vec<_> = (0..=share).map(|_| rig.ask(2, kind, 0, &[])).collect();
        rig.admin.round(false);
        assert_eq!(rig.carry_out().len(), share, "{kind:?}");
        let codes: Vec<_> = waiting.iter().map(|one| rig.answer(one).0.code).collect();
        assert!(codes[..share].iter().all(|code| *code == AdminCode::Done as u32), "{kind:?}: {codes:?}");
        assert_eq!(codes[share], AdminCode::Busy as u32);
    }
}

#[test]
fn a_request_about_too_many_robots_is_refused_before_it_waits_and_serves_nothing() {
    let (scenario, goals) = crowd(3000, 12);
    let mut rig = Rig::new("admin_number", scenario);
    let stop = rig.ask(0, AdminKind::Stop, 0, &[]);
    rig.admin.round(false);
    let _slow = rig.ask(0, AdminKind::SetGoals, 0, &goals);
    assert!(rig.admin.round(false));
    let more = [goals.clone(), goals.clone()].concat();
    let all = [
        (AdminKind::Stop, &more[..1]),
        (AdminKind::Pause, &more),
        (AdminKind::Resume, &more),
        (AdminKind::Clear, &more),
        (AdminKind::SetGoals, &more),
        (AdminKind::SetGoals, &[]),
        (AdminKind::AddRobot, &more),
        (AdminKind::RemoveRobot, &more),
        (AdminKind::Status, &more),
    ];
    for (kind, robots) in all {
        let waiting = rig.ask(1, kind, 0, robots);
        let (answer, _, rounds) = rig.answer(&waiting);
        assert_eq!((answer.code, rounds), (AdminCode::Malformed as u32, 1), "{kind:?}");
    }
    assert_eq!(rig.carry_out().len(), 1);
    assert_eq!(rig.answer(&stop).0.code, AdminCode::Done as u32);
}

#[test]
fn a_panic_costs_one_request_is_shown_and_not_the_round_that_it_came_in() {
    let mut rig = Rig::new("admin_panic", lanes(2, 20.0));
    for (n, kind) in [AdminKind::SetGoals, AdminKind::Pause].into_iter().enumerate() {
        rig.admin.fault = Some(Fault::Asked(kind));
        let robots = [goal(0, 5.0)];
        let lost = rig.ask(0, kind, 0, if n == 0 { &robots } else { &[] });
        let stop = rig.ask(1, AdminKind::Stop, 0, &[]);
        let more = rig.ask(1, AdminKind::AddRobot, 0, &[]);
        rig.admin.round(false);
        assert_eq!(rig.board.admin_panics.load(Ordering::Relaxed), n as u64 + 1);
        assert_eq!(rig.carry_out()[0].changes, [Change::Hold { set: state_flags::STOPPED, clear: 0 }]);
        assert_eq!(rig.answer(&stop).0.code, AdminCode::Done as u32);
        assert_eq!(rig.answer(&more).0.code, AdminCode::Malformed as u32);
        assert!(lost.answer().unwrap().is_none());
    }
    let status = rig.ask(1, AdminKind::Status, 0, &[]);
    let (answer, text, _) = rig.answer(&status);
    assert!(answer.has(admin_flags::DEGRADED) && answer.degraded == 1);
    assert!(String::from_utf8_lossy(&text).contains("panicked"));
}

#[test]
fn a_panic_over_an_answer_leaves_nothing_in_force_that_is_not_kept() {
    for fault in [Fault::Back(AdminKind::SetGoals), Fault::Kept(AdminKind::SetGoals)] {
        let mut rig = Rig::kept("admin_panic_kept", lanes(2, 20.0));
        rig.admin.fault = Some(fault);
        let (lost, stop) =
            (rig.ask(0, AdminKind::SetGoals, 0, &[goal(0, -5.0)]), rig.ask(1, AdminKind::Stop, 0, &[]));
        rig.admin.round(false);
        assert_eq!(rig.carry_out().len(), 2);
        assert_eq!(rig.answer(&stop).0.code, AdminCode::Done as u32, "{fault:?}");
        // It is done once the disk has it; so is what is kept with it.
        let kept = rig.on_disk();
        assert_eq!(kept.stopped, Some(StoppedBy::Operator));
        assert!((kept.robots[0].goal_m.y + 5.0).abs() < 1e-12, "{fault:?}: {kept:?}");
        while rig.board.admin_panics.load(Ordering::Relaxed) == 0 {
            rig.admin.round(false);
        }
        assert!(lost.answer().unwrap().is_none());
    }
}

#[test]
fn what_comes_back_together_is_handed_to_the_journal_once() {
    let mut rig = Rig::kept("admin_kept_once", lanes(2, 20.0));
    let journal = rig.admin.shared.journal.clone().unwrap();
    let waiting: Vec<_> =
        (0..4).map(|n| rig.ask(n, AdminKind::SetGoals, 0, &[goal(0, -5.0 - n as f64)])).collect();
    rig.admin.round(false);
    assert_eq!(rig.carry_out().len(), 4);
    for one in &waiting {
        assert_eq!(rig.answer(one).0.code, AdminCode::Done as u32);
    }
    // This is the second change.
    assert_eq!(journal.keep(|_| ()), 2);
    assert!((rig.on_disk().robots[0].goal_m.y + 8.0).abs() < 1e-12);
    // A stop that was cleared and given again in one period is the operator's.
    let kinds = [AdminKind::Stop, AdminKind::Clear, AdminKind::Stop];
    let _waiting = kinds.map(|kind| rig.ask(0, kind, 0, &[]));
    rig.admin.round(false);
    assert_eq!(rig.carry_out().len(), 3);
    rig.admin.round(false);
    assert_eq!(journal.keep(|_| ()), 4);
    assert_eq!(journal.condition().stopped, Some(StoppedBy::Operator));
}

#[test]
fn a_stop_that_relied_on_one_that_expired_is_passed_on_itself() {
    let mut rig = Rig::new("admin_expired_stop", lanes(2, 20.0));
    let first = rig.ask(0, AdminKind::Stop, 0, &[]);
    let second = rig.ask(1, AdminKind::Stop, 0, &[]);
    rig.admin.round(false);
    let mut batch = rig.desk.todo.pop().unwrap();
    assert!(rig.desk.todo.is_empty(), "one serves for both");
    batch.outcome = Outcome::Expired;
    rig.desk.done.push(batch).unwrap();
    // Neither has expired for who asked: both are passed on again, as one.
    rig.admin.round(false);
    assert!(first.answer().unwrap().is_none() && second.answer().unwrap().is_none());
    let seen = rig.carry_out();
    assert_eq!(seen.len(), 1);
    assert_eq!(seen[0].changes, [Change::Hold { set: state_flags::STOPPED, clear: 0 }]);
    for waiting in [&first, &second] {
        assert_eq!(rig.answer(waiting).0.code, AdminCode::Done as u32);
    }
}

#[test]
fn a_period_takes_its_share_of_requests_however_large_they_are_and_every_stop() {
    let (scenario, goals) = crowd(40, 3);
    let mut rig = Rig::new("admin_share", scenario);
    let most = crate::config::AdminConfig::default().changes_per_period;
    let waiting: Vec<_> =
        (0..2 * most).map(|n| rig.ask(n % 2, AdminKind::SetGoals, 0, &goals[..=n % 5])).collect();
    rig.admin.round(false);
    let busy = |one: &&Waiting| {
        one.answer().unwrap().is_some_and(|(answer, _)| answer.code == AdminCode::Busy as u32)
    };
    assert_eq!(waiting.iter().filter(busy).count(), most);
    drop(waiting);
    let stop = rig.ask(0, AdminKind::Stop, 0, &[]);
    while rig.admin.round(false) {}
    assert_eq!(rig.carry_out().len(), most + 1);
    assert_eq!(rig.answer(&stop).0.code, AdminCode::Done as u32);
}
