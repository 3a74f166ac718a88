use std::sync::PoisonError;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use super::Shared;
use super::answer::{Facts, Tally};
use super::kept::Unkept;
use super::plan::Plan;
use super::refusal::{Refusal, busy, check_header, ending, expired};
use super::under_way::{Pending, UnderWay, is_hold, is_stop, stop_in_force};
use crate::channel::{AdminServer, Asked, Attached, Attachment};
use crate::clock::Clock;
use crate::controller::PreparedRoute;
use crate::runtime::board::Released;
use crate::runtime::desk::{Batch, Change, Outcome};
use crate::wire::{AdminCode, AdminKind, NO_ROBOT, RobotState};

/// Requests looked at in one round.
const REQUESTS_A_ROUND: usize = 64;
/// Of these, the ones that want more than a line: who is attached, a long text.
const QUERIES_A_ROUND: usize = 16;
/// How long it is remembered who is attached.
const ATTACHED_FOR: Duration = Duration::from_millis(200);

/// The thread's state.
pub(in crate::runtime) struct Admin<C: Clock> {
    clock: C,
    node: Attachment,
    server: AdminServer,
    pub(super) shared: Shared,
    plan: Plan,
    /// The plan without what is still with the loop.
    pub(super) carried_out: Plan,
    /// What is with the loop, in its order.
    under_way: Vec<UnderWay>,
    pending: Vec<Pending>,
    /// What is done and has to be kept before it is answered.
    pub(super) unkept: Vec<Unkept>,
    next_key: u64,
    refusals_known: u64,
    tally: Tally,
    attached: Option<(Instant, Attached)>,
    started: Instant,
}

impl<C: Clock> Admin<C> {
    pub(in crate::runtime) fn new(clock: C, node: Attachment, server: AdminServer, shared: Shared) -> Self {
        let plan = Plan::new(&shared.config).held(shared.hold);
        Self {
            clock,
            node,
            server,
            carried_out: plan.clone(),
            plan,
            shared,
            under_way: Vec::new(),
            pending: Vec::new(),
            unkept: Vec::new(),
            next_key: 0,
            refusals_known: 0,
            tally: Tally::default(),
            attached: None,
            started: Instant::now(),
        }
    }

    /// Answers until the run is over.
    pub(super) fn run(mut self) {
        // A look at an empty channel takes a microsecond.
        let pause = Duration::from_nanos(self.shared.config.timing.period_ns / 4)
            .clamp(Duration::from_millis(1), Duration::from_millis(5));
        loop {
            let over = self.shared.board.released(None) == Released::Over;
            self.round(over);
            if over {
                self.wait_for_kept();
                for Pending { asked, .. } in std::mem::take(&mut self.pending) {
                    self.refuse(asked, &ending());
                }
                return;
            }
            std::thread::sleep(pause);
        }
    }

    /// Answers what has come back from the loop, and looks at what is asked.
    pub(in crate::runtime) fn round(&mut self, over: bool) {
        self.settle();
        self.answer_kept();
        self.serve(over);
    }

    /// Answers what has come back from the loop.
    fn settle(&mut self) {
        while let Some(batch) = self.shared.desk.done.pop() {
            let Some(at) = self.under_way.iter().position(|one| one.key == batch.key) else { continue };
            self.under_way.remove(at);
            if let Some(shelf) = &self.shared.desk.shelf {
                batch.routes.iter().for_each(|(place, _)| shelf.sweep(*place));
            }
            if let Outcome::Done { .. } = batch.outcome {
                batch.changes.iter().for_each(|change| self.carried_out.apply(change));
                self.keep(&batch.changes);
            }
            self.refusals_known +=
                u64::from(matches!(batch.outcome, Outcome::Expired | Outcome::TooClose { .. }));
            self.plan_anew();
            let (mine, others) = std::mem::take(&mut self.pending)
                .into_iter()
                .partition(|pending: &Pending| pending.key == batch.key);
            self.pending = others;
            for Pending { asked, .. } in mine {
                // It was with a stop that expired before it does.
                if batch.outcome == Outcome::Expired
                    && is_stop(&batch.changes)
                    && self.clock.now_ns() < asked.header().expires_ns
                {
                    self.accept(asked, AdminKind::Stop);
                } else {
                    self.tell(asked, &batch);
                }
            }
        }
    }

    /// What was carried out, and what will be. The loop does not carry out what was checked before it
    /// refused something.
    fn plan_anew(&mut self) {
        self.plan = self.carried_out.clone();
        for one in &self.under_way {
            if one.refusals_known == self.refusals_known || is_hold(&one.changes) {
                one.changes.iter().for_each(|change| self.plan.apply(change));
            }
        }
    }

    fn tell(&mut self, asked: Asked, batch: &Batch) {
        let refusal = match batch.outcome {
            Outcome::Done { tick } => {
                log_change(asked.header().kind, tick, &batch.changes);
                return self.done_once_kept(asked, tick + 1);
            }
            Outcome::Expired => expired(),
            Outcome::Waiting | Outcome::Outdated => {
                Refusal::fleet(AdminCode::Busy, "the fleet changed meanwhile: try again".to_owned())
            }
            Outcome::TooClose { id } => {
                let text = format!("it would stand too close to robot {id}, or in its way of this period");
                Refusal::of(id, AdminCode::TooClose, text)
            }
        };
        self.refuse(asked, &refusal);
    }

    fn serve(&mut self, over: bool) {
        let mut queries = 0;
        let next = || self.server.next().ok().flatten();
        let round = std::iter::from_fn(next).take(REQUESTS_A_ROUND);
        // What holds the fleet or lets it go does not wait for long work, and keeps its order.
        let (holds, others): (Vec<_>, Vec<_>) = round.partition(is_about_hold);
        for asked in holds.into_iter().chain(others) {
            if over {
                self.refuse(asked, &ending());
                continue;
            }
            let kind = match self.check(&asked) {
                Ok(kind) => kind,
                Err(refusal) => {
                    self.refuse(asked, &refusal);
                    continue;
                }
            };
            match kind {
                _ if kind.is_question() => {
                    queries += 1;
                    if queries > QUERIES_A_ROUND {
                        self.refuse(asked, &busy("too many questions at a time"));
                    } else {
                        self.inform(asked, kind);
                    }
                }
                _ => self.accept(asked, kind),
            }
        }
    }

    /// Whether a request is to be looked at at all.
    fn check(&self, asked: &Asked) -> Result<AdminKind, Refusal> {
        check_header(asked.header(), self.shared.epoch, self.clock.now_ns())
    }

    /// Passes a request that changes something on to the loop, if it is sound.
    fn accept(&mut self, asked: Asked, kind: AdminKind) {
        if kind == AdminKind::Stop {
            if let Some(key) = stop_in_force(&self.under_way) {
                self.pending.push(Pending { key, asked });
                return;
            }
        } else {
            // A period takes this many; a client half of them, so that another one finds room.
            let most = self.shared.config.admin.changes_per_period;
            let mine = self.under_way.iter().filter(|one| one.client == asked.client()).count();
            let all = self.under_way.iter().filter(|one| !is_stop(&one.changes)).count();
            if all >= most || mine >= most.div_ceil(2) {
                self.refuse(asked, &busy("too many changes in one period"));
                return;
            }
        }
        let changes = if asked.len() > self.plan.capacity() {
            Err(Refusal::malformed("the request is about more robots than the fleet has room for"))
        } else {
            self.plan.changes(kind, &asked.robots())
        };
        match changes {
            Ok(changes) => self.pass_on(asked, changes),
            Err(refusal) => self.refuse(asked, &refusal),
        }
    }

    fn pass_on(&mut self, asked: Asked, changes: Vec<Change>) {
        for change in &changes {
            self.plan.apply(change);
        }
        let routes = self.prepare_routes(&changes);
        let key = self.next_key;
        let batch = Batch {
            key,
            expires_ns: asked.header().expires_ns,
            refusals_known: self.refusals_known,
            changes: changes.clone(),
            routes,
            outcome: Outcome::Waiting,
        };
        if self.shared.desk.todo.push(Box::new(batch)).is_err() {
            // Answers that nobody fetched yet take the room of a stop.
            self.refuse(asked, &busy("too many changes in one period"));
            self.plan_anew();
            return;
        }
        self.next_key += 1;
        let (client, refusals_known) = (asked.client(), self.refusals_known);
        self.under_way.push(UnderWay { key, client, refusals_known, changes });
        self.pending.push(Pending { key, asked });
    }

    /// Builds what the workers will need, before the loop tells them.
    fn prepare_routes(&self, changes: &[Change]) -> Vec<(usize, Option<Box<PreparedRoute>>)> {
        let scenario = &self.shared.config.scenario;
        let build = |change: &Change| {
            let (Change::Goal { place, .. } | Change::Add { place, .. }) = *change else { return None };
            let robot = RobotState::at_start(self.plan.robot(place)?);
            let margin_m = scenario.limits.safety_margin_m;
            let route = PreparedRoute::build(&scenario.obstacles, margin_m, &robot);
            Some((place, Some(Box::new(route))))
        };
        changes.iter().filter_map(build).collect()
    }

    /// Answers a request that changes nothing.
    fn inform(&mut self, asked: Asked, kind: AdminKind) {
        if !asked.is_empty() {
            self.refuse(asked, &Refusal::about_no_robot());
            return;
        }
        let text = match kind {
            AdminKind::Configuration => self.shared.config.to_toml(),
            AdminKind::Scenario => self.carried_out.scenario(&self.shared.config.scenario).to_toml(),
            _ => self.shared.realtime.degraded.join("\n"),
        };
        self.done(asked, 0, &text);
    }

    pub(super) fn done(&mut self, asked: Asked, acts_from_tick: u64, text: &str) {
        self.tally.done += 1;
        let facts = self.facts();
        let offset = usize::try_from(asked.header().offset).unwrap_or(usize::MAX);
        let piece = text.as_bytes().get(offset..).unwrap_or_default();
        let header = facts.answer(asked.header(), AdminCode::Done, NO_ROBOT, acts_from_tick, text.len());
        send(asked, &header, piece);
    }

    pub(super) fn refuse(&mut self, asked: Asked, refusal: &Refusal) {
        if refusal.code == AdminCode::Busy {
            self.tally.busy += 1;
        } else {
            self.tally.refused += 1;
            tracing::info!(
                kind = AdminKind::from_code(asked.header().kind).map_or("unknown", AdminKind::name),
                code = refusal.code.name(),
                "refused: {}",
                refusal.text
            );
        }
        let header = self.facts().answer(asked.header(), refusal.code, refusal.robot, 0, refusal.text.len());
        send(asked, &header, refusal.text.as_bytes());
    }

    fn facts(&mut self) -> Facts<'_> {
        let fresh = self.attached.is_some_and(|(at, _)| at.elapsed() < ATTACHED_FOR);
        if !fresh {
            self.attached = Some((Instant::now(), self.node.attached()));
        }
        let progress = self.shared.progress.lock().unwrap_or_else(PoisonError::into_inner).clone();
        Facts {
            progress,
            hold: self.carried_out.hold(),
            robots: self.carried_out.robots().count(),
            capacity: self.carried_out.capacity(),
            attached: self.attached.map(|(_, attached)| attached).unwrap_or_default(),
            uptime: self.started.elapsed(),
            tally: self.tally,
            now_ns: self.clock.now_ns(),
            worker_panics: self.shared.board.worker_panics.load(Ordering::Relaxed),
            shared: &self.shared,
        }
    }
}

fn is_about_hold(asked: &Asked) -> bool {
    let kind = AdminKind::from_code(asked.header().kind);
    let holds = [AdminKind::Stop, AdminKind::Pause, AdminKind::Resume, AdminKind::Clear];
    kind.is_some_and(|kind| holds.contains(&kind))
}

fn send(asked: Asked, header: &crate::wire::AdminAnswer, text: &[u8]) {
    if let Err(e) = asked.answer(header, text) {
        tracing::debug!("an operator's answer is lost: {e}");
    }
}

fn log_change(kind: u32, tick: u64, changes: &[Change]) {
    let kind = AdminKind::from_code(kind).map_or("unknown", AdminKind::name);
    match changes {
        [Change::Goal { .. }, ..] => tracing::debug!(tick, robots = changes.len(), "{kind}"),
        [Change::Add { robot, .. }] => tracing::info!(tick, robot = robot.id.0, "{kind}"),
        _ => tracing::info!(tick, "{kind}"),
    }
}
