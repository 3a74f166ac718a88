use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::Ordering;
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

use super::Shared;
use super::answer::{Facts, Tally};
use super::job::{Job, Order, Routes, Text};
use super::kept::{Unkept, Unsaved};
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
/// How long the thread rests after a round with a panic, so that one that repeats does not fill the log.
const REST: Duration = Duration::from_millis(20);

/// Where a test has it panic.
#[cfg(test)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Fault {
    /// When such a request is looked at.
    Asked(AdminKind),
    /// When such a request has come back from the loop.
    Back(AdminKind),
    /// When such a request is kept.
    Kept(AdminKind),
}

/// The thread's state.
pub(in crate::runtime) struct Admin<C: Clock> {
    pub(super) clock: C,
    node: Attachment,
    server: AdminServer,
    pub(super) shared: Shared,
    pub(super) plan: Plan,
    /// The plan without what is still with the loop.
    pub(super) carried_out: Plan,
    /// What is with the loop, in its order.
    pub(super) under_way: Vec<UnderWay>,
    pub(super) pending: Vec<Pending>,
    /// What has come back from the loop and is being answered.
    pub(super) back: Option<Arc<Batch>>,
    /// What of it the journal does not know yet.
    pub(super) unsaved: Unsaved,
    /// What is done and has to be kept before it is answered.
    pub(super) unkept: Vec<Unkept>,
    /// What was taken in and not looked at yet.
    inbox: VecDeque<Asked>,
    /// What may take long, in the order in which it came.
    jobs: VecDeque<Job>,
    texts: Texts,
    /// Counts the changes of what is carried out.
    pub(super) version: u64,
    next_key: u64,
    pub(super) refusals_known: u64,
    /// Something panicked since the thread rested.
    panicked: bool,
    tally: Tally,
    attached: Option<(Instant, Attached)>,
    started: Instant,
    #[cfg(test)]
    pub(super) fault: Option<Fault>,
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
            back: None,
            unsaved: Unsaved::default(),
            unkept: Vec::new(),
            inbox: VecDeque::new(),
            jobs: VecDeque::new(),
            texts: Texts::default(),
            version: 0,
            next_key: 0,
            refusals_known: 0,
            panicked: false,
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
            let more = self.round(over);
            self.shared.board.admin_rounds.fetch_add(1, Ordering::Relaxed);
            if over {
                self.guarded(Self::end);
                return;
            }
            if std::mem::take(&mut self.panicked) {
                std::thread::sleep(REST);
            } else if !more {
                std::thread::sleep(pause);
            }
        }
    }

    /// Answers whatever still waits when the run is over.
    fn end(&mut self) {
        for job in std::mem::take(&mut self.jobs) {
            self.refuse(job.into_asked(), &ending());
        }
        self.wait_for_kept();
        for Pending { asked, .. } in std::mem::take(&mut self.pending) {
            self.refuse(asked, &ending());
        }
    }

    /// Takes a step whose panic costs the request that it was about, which is never answered, and nothing
    /// else: no step takes more than that one out of `self`.
    fn guarded(&mut self, step: impl FnOnce(&mut Self)) {
        // What was carried out changes in steps that do not fail, and the plan is made anew from it.
        if catch_unwind(AssertUnwindSafe(|| step(self))).is_err() {
            self.panicked = true;
            self.shared.board.admin_panics.fetch_add(1, Ordering::Relaxed);
            tracing::error!(
                "the thread that answers operators panicked: the request is lost, and it goes on"
            );
            self.plan_anew();
        }
    }

    /// Answers what has come back from the loop, looks at what is asked, and goes on with what takes long;
    /// whether more of that waits. A stop waits for one round at most.
    pub(in crate::runtime) fn round(&mut self, over: bool) -> bool {
        self.guarded(Self::settle);
        self.guarded(Self::answer_kept);
        self.guarded(Self::take_in);
        let mut queries = 0;
        while let Some(asked) = self.inbox.pop_front() {
            self.guarded(|admin| admin.look_at(asked, over, &mut queries));
        }
        self.guarded(Self::work);
        !self.jobs.is_empty()
    }

    /// Takes in what is looked at in this round.
    fn take_in(&mut self) {
        while self.inbox.len() < REQUESTS_A_ROUND
            && let Ok(Some(asked)) = self.server.next()
        {
            self.inbox.push_back(asked);
        }
        // What holds the fleet or lets it go does not wait for long work, and keeps its order.
        self.inbox.make_contiguous().sort_by_key(|asked| !is_about_hold(asked));
    }

    fn look_at(&mut self, asked: Asked, over: bool, queries: &mut usize) {
        if over {
            return self.refuse(asked, &ending());
        }
        let kind = match self.check(&asked) {
            Ok(kind) => kind,
            Err(refusal) => return self.refuse(asked, &refusal),
        };
        #[cfg(test)]
        self.fail_at(Fault::Asked(kind));
        if !kind.is_question() {
            return self.accept(asked, kind);
        }
        *queries += 1;
        if *queries > QUERIES_A_ROUND {
            self.refuse(asked, &busy("too many questions at a time"));
        } else {
            self.inform(asked, kind);
        }
    }

    #[cfg(test)]
    pub(super) fn fail_at(&self, fault: Fault) {
        assert_ne!(self.fault, Some(fault), "a fault, injected");
    }

    /// Goes on with what takes long.
    fn work(&mut self) {
        let mut looks = LOOKS_A_ROUND;
        while looks > 0 {
            let Some(job) = self.jobs.pop_front() else { return };
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
    pub(super) fn accept(&mut self, asked: Asked, kind: AdminKind) {
        // Before it waits, and before anything is copied: a client asks with as many records as it likes.
        if let Err(refusal) = self.plan.check_number(kind, asked.len()) {
            self.refuse(asked, &refusal);
            return;
        }
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
            match self.plan.changes(kind, &[]) {
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
                    self.refuse(asked, &busy("this text is not kept any more: read it from its beginning"));
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
            attach_failures: self.node.attach_failures(),
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
