use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::Ordering;
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

use super::Shared;
use super::answer::{Facts, Tally};
use super::job::{Job, Order, Routes, Text};
use super::kept::Unkept;
use super::plan::Plan;
use super::refusal::{Refusal, busy, check_header, ending, expired, outdated};
use super::texts::Texts;
use super::under_way::{Pending, UnderWay, is_hold, is_stop, stop_in_force};
use crate::channel::{AdminServer, Asked, Attached, Attachment, TEXT_MAX};
use crate::clock::Clock;
use crate::runtime::board::Released;
use crate::runtime::desk::{Batch, Change, Outcome};
use crate::wire::{AdminCode, AdminKind, NO_ROBOT};

/// Requests looked at in one round.
const REQUESTS_A_ROUND: usize = 64;
/// Of these, the ones that want more than a line: who is attached, a long text. So many wait, too.
const QUERIES_A_ROUND: usize = 16;
/// Looks at an obstacle, or what costs as much, that the work on long requests takes in one round: about
/// a millisecond.
const LOOKS_A_ROUND: usize = 100_000;
/// How long it is remembered who is attached.
const ATTACHED_FOR: Duration = Duration::from_millis(200);
/// How long the thread rests after a panic, so that one that repeats does not fill the log.
const REST: Duration = Duration::from_millis(20);

/// The thread's state.
pub(in crate::runtime) struct Admin<C: Clock> {
    pub(super) clock: C,
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
    /// What may take long, in the order in which it came.
    jobs: VecDeque<Job>,
    texts: Texts,
    /// Counts the changes of what is carried out.
    version: u64,
    next_key: u64,
    refusals_known: u64,
    tally: Tally,
    attached: Option<(Instant, Attached)>,
    started: Instant,
    /// Panics when such a request is looked at.
    #[cfg(test)]
    pub(super) fault: Option<AdminKind>,
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
            jobs: VecDeque::new(),
            texts: Texts::default(),
            version: 0,
            next_key: 0,
            refusals_known: 0,
            tally: Tally::default(),
            attached: None,
            started: Instant::now(),
            #[cfg(test)]
            fault: None,
        }
    }

    /// Answers until the run is over.
    pub(super) fn run(mut self) {
        // A look at an empty channel takes a microsecond.
        let pause = Duration::from_nanos(self.shared.config.timing.period_ns / 4)
            .clamp(Duration::from_millis(1), Duration::from_millis(5));
        loop {
            let over = self.shared.board.released(None) == Released::Over;
            let more = self.round_or_rest(over);
            self.shared.board.admin_rounds.fetch_add(1, Ordering::Relaxed);
            if over {
                for job in std::mem::take(&mut self.jobs) {
                    self.refuse(job.into_asked(), &ending());
                }
                self.wait_for_kept();
                for Pending { asked, .. } in std::mem::take(&mut self.pending) {
                    self.refuse(asked, &ending());
                }
                return;
            }
            if !more {
                std::thread::sleep(pause);
            }
        }
    }

    /// A round whose panic costs the request that was looked at, which is never answered, and nothing else.
    pub(super) fn round_or_rest(&mut self, over: bool) -> bool {
        // What was carried out changes in steps that do not fail, and the plan is made anew from it.
        let round = catch_unwind(AssertUnwindSafe(|| self.round(over)));
        round.unwrap_or_else(|_| {
            self.shared.board.admin_panics.fetch_add(1, Ordering::Relaxed);
            tracing::error!(
                "the thread that answers operators panicked: the request is lost, and it goes on"
            );
            self.plan_anew();
            std::thread::sleep(REST);
            false
        })
    }

    /// Answers what has come back from the loop, looks at what is asked, and goes on with what takes long;
    /// whether more of that waits. A stop waits for one round at most.
    pub(in crate::runtime) fn round(&mut self, over: bool) -> bool {
        self.settle();
        self.answer_kept();
        self.serve(over);
        self.work()
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
                self.version += u64::from(!is_hold(&batch.changes));
                self.keep(&batch.changes);
            } else {
                let refused = matches!(batch.outcome, Outcome::Expired | Outcome::TooClose { .. });
                self.refusals_known += u64::from(refused);
                self.plan_anew();
            }
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
            Outcome::Waiting | Outcome::Outdated => outdated(),
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
            #[cfg(test)]
            assert_ne!(self.fault, Some(kind), "a fault, injected");
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

    /// Goes on with what takes long; whether more of it waits.
    fn work(&mut self) -> bool {
        let mut looks = LOOKS_A_ROUND;
        while looks > 0 {
            let Some(job) = self.jobs.pop_front() else { return false };
            looks -= 1;
            if self.clock.now_ns() >= job.asked().header().expires_ns {
                self.refuse(job.into_asked(), &expired());
                continue;
            }
            match job {
                Job::Order(order) => self.go_on(order, &mut looks),
                Job::Text(text) => self.write(text, &mut looks),
            }
        }
        !self.jobs.is_empty()
    }

    fn go_on(&mut self, mut order: Order, looks: &mut usize) {
        if order.is_outdated(self.refusals_known) {
            self.refuse(order.finish().0, &outdated());
            return;
        }
        let scenario = &self.shared.config.scenario;
        let margin_m = scenario.limits.safety_margin_m;
        match order.advance((&self.plan, self.refusals_known), &scenario.obstacles, margin_m, looks) {
            Ok(true) => self.pass_on(order.finish()),
            Ok(false) => self.jobs.push_front(Job::Order(order)),
            Err(refusal) => self.refuse(order.finish().0, &refusal),
        }
    }

    fn write(&mut self, mut text: Text, looks: &mut usize) {
        if !text.is_begun() {
            if let Some(newest) = self.texts.newest(AdminKind::Scenario, self.version) {
                let (asked, _) = text.finish();
                return self.tell_text(asked, AdminKind::Scenario, &newest);
            }
            text.begin(self.carried_out.scenario(&self.shared.config.scenario), self.version);
            *looks = looks.saturating_sub(self.carried_out.capacity());
        }
        if !text.advance(looks) {
            self.jobs.push_front(Job::Text(text));
            return;
        }
        let version = text.version;
        let (asked, whole) = text.finish();
        let newest = self.texts.keep(AdminKind::Scenario, version, whole);
        self.tell_text(asked, AdminKind::Scenario, &newest);
    }

    /// Whether a request is to be looked at at all.
    fn check(&self, asked: &Asked) -> Result<AdminKind, Refusal> {
        check_header(asked.header(), self.shared.epoch, self.clock.now_ns())
    }

    /// Takes on a request that changes something: what holds the fleet or lets it go at once, anything else
    /// after what came before it.
    fn accept(&mut self, asked: Asked, kind: AdminKind) {
        if kind == AdminKind::Stop {
            if let Some(key) = stop_in_force(&self.under_way) {
                self.pending.push(Pending { key, asked });
                return;
            }
        } else if !self.has_room_for(&asked) {
            self.refuse(asked, &busy("too many changes in one period"));
            return;
        }
        if is_about_hold(&asked) {
            match self.plan.changes(kind, &asked.robots()) {
                Ok(changes) => self.pass_on((asked, changes, Vec::new(), self.refusals_known)),
                Err(refusal) => self.refuse(asked, &refusal),
            }
        } else {
            self.jobs.push_back(Job::Order(Order::new(asked, kind)));
        }
    }

    /// A period takes so many orders, however long some of them wait here, and as many pauses, resumes and
    /// clears beside them; of each a client half, so that another one finds room.
    fn has_room_for(&self, asked: &Asked) -> bool {
        let most = self.shared.config.admin.changes_per_period;
        let holds = is_about_hold(asked);
        let like_it = |one: &&UnderWay| is_hold(&one.changes) == holds && !is_stop(&one.changes);
        let under_way = self.under_way.iter().filter(like_it).map(|one| one.client);
        let orders = self.jobs.iter().filter(|job| job.is_order() && !holds);
        let clients: Vec<_> = under_way.chain(orders.map(|job| job.asked().client())).collect();
        let mine = clients.iter().filter(|client| **client == asked.client()).count();
        clients.len() < most && mine < most.div_ceil(2)
    }

    /// Passes a sound request on to the loop.
    fn pass_on(&mut self, (asked, changes, routes, refusals_known): (Asked, Vec<Change>, Routes, u64)) {
        let (key, client, expires_ns) = (self.next_key, asked.client(), asked.header().expires_ns);
        let outcome = Outcome::Waiting;
        let batch = Batch { key, expires_ns, refusals_known, changes: changes.clone(), routes, outcome };
        self.next_key += 1;
        for change in &changes {
            self.plan.apply(change);
        }
        // Before the loop may have it: whatever comes back is known.
        self.under_way.push(UnderWay { key, client, refusals_known, changes });
        if self.shared.desk.todo.push(Box::new(batch)).is_err() {
            // Answers that nobody fetched yet take the room of a stop.
            self.under_way.pop();
            self.plan_anew();
            self.refuse(asked, &busy("too many changes in one period"));
            return;
        }
        self.pending.push(Pending { key, asked });
    }

    /// Answers a request that changes nothing.
    fn inform(&mut self, asked: Asked, kind: AdminKind) {
        if !asked.is_empty() {
            self.refuse(asked, &Refusal::about_no_robot());
            return;
        }
        if asked.header().offset > 0 {
            match self.texts.go_on(asked.client(), kind, self.clock.now_ns()) {
                Some(text) => self.tell_text(asked, kind, &text),
                None => {
                    self.refuse(asked, &busy("this text is not kept any more: read it from its beginning"))
                }
            }
            return;
        }
        match kind {
            AdminKind::Configuration => {
                let known = self.texts.newest(kind, 0);
                let text = known.unwrap_or_else(|| self.texts.keep(kind, 0, self.shared.config.to_toml()));
                self.tell_text(asked, kind, &text);
            }
            AdminKind::Scenario => {
                if self.jobs.iter().filter(|job| !job.is_order()).count() >= QUERIES_A_ROUND {
                    self.refuse(asked, &busy("too many questions at a time"));
                } else {
                    self.jobs.push_back(Job::Text(Text::new(asked)));
                }
            }
            _ => {
                let text = self.facts().degraded().join("\n");
                self.tell_text(asked, kind, &text.into_bytes().into());
            }
        }
    }

    /// Answers with the piece of a text that is asked for.
    fn tell_text(&mut self, asked: Asked, kind: AdminKind, text: &Arc<[u8]>) {
        let offset = usize::try_from(asked.header().offset).unwrap_or(usize::MAX);
        let piece = text.get(offset..).unwrap_or_default();
        if piece.len() <= TEXT_MAX {
            self.texts.end(asked.client(), kind);
        } else if offset == 0 {
            self.texts.begin(asked.client(), kind, Arc::clone(text), self.clock.now_ns());
        }
        self.tally.done += 1;
        let header = self.facts().answer(asked.header(), AdminCode::Done, NO_ROBOT, 0, text.len());
        send(asked, &header, piece);
    }

    pub(super) fn done(&mut self, asked: Asked, acts_from_tick: u64) {
        self.tally.done += 1;
        let header = self.facts().answer(asked.header(), AdminCode::Done, NO_ROBOT, acts_from_tick, 0);
        send(asked, &header, &[]);
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
            robots: self.carried_out.len(),
            capacity: self.carried_out.capacity(),
            attached: self.attached.map(|(_, attached)| attached).unwrap_or_default(),
            uptime: self.started.elapsed(),
            tally: self.tally,
            now_ns: self.clock.now_ns(),
            worker_panics: self.shared.board.worker_panics.load(Ordering::Relaxed),
            admin_panics: self.shared.board.admin_panics.load(Ordering::Relaxed),
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
