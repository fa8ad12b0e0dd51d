//! What a client does that asks or sends, and what must come of it.
#![allow(unsafe_code, reason = "the simulation plays the plugins, which write and read through the pointers")]

use component_sdk::abi::calls::{Lent, Wait as Time, Whose};
use component_sdk::status::Status;

use super::awaited::{Awaited, End};
use super::model::{Call, EVENT_GATE, PORTS, PUSH_GATE, SENDS, old_number, refusal};
use super::script::{Actor, Way};

/// What the answer to a question is.
const fn answer_to(number: u64) -> u64 {
    number * 3 + 1
}

impl Actor<'_> {
    /// A request on loan; `None`: there was none, as it must be.
    fn loan(&self, port: usize) -> Option<Lent> {
        let lent = self.ends.requestors[port].loan();
        let mut model = self.world.model();
        let loans = &mut model.slots[self.slot].instance.loans;
        loans.push((port, lent.id));
        let loans = loans.iter().filter(|(on, _)| *on == port).count();
        let is_full = model.used((self.ends.life, port), loans - 1) >= self.world.pending;
        if is_full || lent.status != 0 {
            model.slots[self.slot].instance.loans.pop();
        }
        drop(model);
        let must = if is_full { Status::Overload.code() } else { 0 };
        self.world.same(|| format!("slot {}, a loan of port {port}", self.slot), lent.status, must);
        (lent.status == 0 && !is_full).then_some(lent)
    }

    fn forget_loan(&self, port: usize, id: u64) {
        self.world.model().slots[self.slot].instance.loans.retain(|loan| *loan != (port, id));
    }

    /// A request on loan is given back, filled or not.
    pub(super) fn loan_and_discard(&self, port: usize) {
        let Some(lent) = self.loan(port) else { return };
        self.give_way();
        // SAFETY: lent for a `u64`, to this borrower.
        unsafe { lent.value.cast::<u64>().write(u64::MAX) };
        self.forget_loan(port, lent.id);
        self.world.same(|| "discarding a loan".to_owned(), self.ends.requestors[port].discard(lent.id), Ok(()));
        self.world.model().slots[self.slot].instance.stale.push((port, lent.id));
    }

    /// What sending must come to now.
    fn sending(&self, port: usize) -> Result<(), Status> {
        let model = self.world.model();
        let link = model.slots[self.slot].links[port].ok_or(Status::Disconnected)?;
        let provider = &model.providers[link.to];
        refusal(provider.open).map_or(Ok(()), Err)?;
        if provider.queue.len() >= provider.room { Err(Status::Overload) } else { Ok(()) }
    }

    /// A request, filled; its number at the client and in the model.
    fn filled(&self, port: usize) -> Option<(u64, u64)> {
        let lent = self.loan(port)?;
        if self.world.dice.once_in(8) {
            self.give_way();
        }
        let number = {
            let mut model = self.world.model();
            model.last += 1;
            model.last
        };
        // SAFETY: as in `loan_and_discard`.
        unsafe { lent.value.cast::<u64>().write(number) };
        Some((lent.id, number))
    }

    /// It is asked: what the model knows of it; where it is asked.
    fn note(&self, port: usize, number: u64) -> Option<usize> {
        let mut model = self.world.model();
        let link = model.slots[self.slot].links[port]?;
        let call = Call {
            from: (self.ends.life, port),
            one_way: port == SENDS,
            retry: link.retry,
            left: false,
            // A message is out of its sender's hands.
            wanted: port != SENDS,
            ticket: true,
            fate: None,
        };
        model.calls.insert(number, call);
        Some(link.to)
    }

    /// It is on its way by the inbox.
    fn enter(&self, port: usize, number: u64) {
        let server = self.note(port, number);
        server.into_iter().for_each(|server| self.world.model().came(server, number));
    }

    /// Sends a question, or a message, and goes on.
    pub(super) fn request(&self, port: usize) {
        let Some((id, number)) = self.filled(port) else { return };
        let must = self.sending(port);
        self.forget_loan(port, id);
        if must.is_ok() {
            self.enter(port, number);
        }
        let sent = self.ends.requestors[port].send(id);
        self.world.tell(|| format!("slot {} port {port}: request {number} -> {sent:?}", self.slot));
        self.world.count(match (port == SENDS, sent.is_ok()) {
            (true, true) => "messages",
            (true, false) => "messages refused",
            (false, true) => "requests",
            (false, false) => "requests refused",
        });
        self.world.same(|| format!("request {number}"), sent, must);
        let mut model = self.world.model();
        let instance = &mut model.slots[self.slot].instance;
        match sent {
            Ok(()) if port != SENDS => instance.open.push((port, id, number)),
            _ => instance.stale.push((port, id)),
        }
    }

    /// Sends a question and waits for the answer.
    pub(super) fn query(&self, port: usize) {
        let Some((id, number)) = self.filled(port) else { return };
        let (must, time) = (self.sending(port), self.time());
        self.forget_loan(port, id);
        self.world.count("queries");
        let here = self.here();
        if let Err(status) = must {
            let lent = self.ends.requestors[port].ask(id, time, &here);
            self.world.same(|| format!("query {number}"), lent.status, status.code());
            self.world.model().slots[self.slot].instance.stale.push((port, id));
            return;
        }
        let at_once = self.world.asks_at_once(self.slot, port);
        self.world.tell(|| format!("slot {} port {port}: query {number}, at once: {at_once}", self.slot));
        let (lent, before) = if at_once {
            let _ = self.note(port, number);
            self.ask_at_once((port, id), number, time, &here)
        } else {
            self.enter(port, number);
            let before = self.before(Awaited::Answer(port, number), time);
            (self.ends.requestors[port].ask(id, time, &here), Some(before))
        };
        let Some(before) = before else {
            return self.world.wrong(format!("query {number} is not answered at once"));
        };
        let end = answer_in(&lent);
        self.after(&before, end, &here);
        self.answered(port, number, &lent);
        if end.is_err() {
            // Whatever it was, the question is over.
            self.world.model().let_go(number);
            self.world.model().slots[self.slot].instance.stale.push((port, id));
            self.world.same(|| "a query that ended".to_owned(), self.look(port, id), Err(Status::WrongId));
        }
    }

    fn look(&self, port: usize, id: u64) -> Result<(), Status> {
        let lent = self.ends.requestors[port].receive(id, Time::NONE, &Self::never);
        if lent.status == 0 { Ok(()) } else { Err(Status::from_code(lent.status)) }
    }

    #[allow(clippy::unnecessary_wraps, reason = "a place in which nobody waits")]
    fn never(_: u64) -> Result<(), framework_daemon::port::wait::NotHere> {
        Err(framework_daemon::port::wait::NotHere)
    }

    /// Looks for an answer, or waits for it.
    pub(super) fn receive(&self, nth: usize, waits: bool) {
        let open = {
            let model = self.world.model();
            let open = &model.slots[self.slot].instance.open;
            open.get(nth % open.len().max(1)).copied()
        };
        let Some((port, id, number)) = open else { return };
        let time = if waits { self.time() } else { Time::NONE };
        self.world.count(if waits { "waits" } else { "looks" });
        self.world.tell(|| format!("slot {} port {port}: receive {number}, {time:?}", self.slot));
        let (here, before) = (self.here(), self.before(Awaited::Answer(port, number), time));
        let lent = self.ends.requestors[port].receive(id, time, &here);
        let end = answer_in(&lent);
        self.after(&before, end, &here);
        self.answered(port, number, &lent);
        let keeps = matches!(end, Err(Status::NoData | Status::Cancelled | Status::Timeout | Status::Cycle));
        if keeps || end.is_ok() {
            return;
        }
        let mut model = self.world.model();
        let instance = &mut model.slots[self.slot].instance;
        instance.open.retain(|open| open.2 != number);
        instance.stale.push((port, id));
        model.let_go(number);
    }

    /// Where an answer came, it is that to the question.
    fn answered(&self, port: usize, number: u64, lent: &Lent) {
        if lent.status == 0 {
            self.world.same(|| format!("the answer to {number}"), value_of(lent), answer_to(number));
            self.read(port, lent, number);
        }
    }

    /// Reads an answer, for some time, and gives it back.
    fn read(&self, port: usize, lent: &Lent, number: u64) {
        self.world.model().slots[self.slot].instance.open.retain(|open| open.2 != number);
        if self.world.dice.once_in(4) {
            self.world.model().slots[self.slot].instance.lent.push((port, lent.id, number));
            self.ramble(2);
            if self.way_is(Way::Trapped) {
                return;
            }
            let again = value_of(lent);
            self.world.same(|| format!("the answer to {number} while it is read"), again, answer_to(number));
            self.world.model().slots[self.slot].instance.lent.retain(|lent| lent.2 != number);
        }
        self.ends.requestors[port].release(lent.id);
        let mut model = self.world.model();
        model.let_go(number);
        model.slots[self.slot].instance.stale.push((port, lent.id));
    }

    /// Gives a question up.
    pub(super) fn discard(&self, nth: usize) {
        let mut model = self.world.model();
        let open = &mut model.slots[self.slot].instance.open;
        if open.is_empty() {
            return;
        }
        let (port, id, number) = open.remove(nth % open.len());
        model.let_go(number);
        model.slots[self.slot].instance.stale.push((port, id));
        drop(model);
        self.world.tell(|| format!("slot {} port {port}: discard {number}", self.slot));
        self.world.count("discards");
        self.world.same(|| format!("discarding {number}"), self.ends.requestors[port].discard(id), Ok(()));
    }

    /// A number that is not good any more stays so.
    pub(super) fn stale(&self, nth: usize) {
        let stale = old_number(&mut self.world.model().slots[self.slot].instance.stale, nth);
        let Some((port, id)) = stale else { return };
        let requestor = &self.ends.requestors[port];
        self.world.same(|| "receiving by an old number".to_owned(), self.look(port, id), Err(Status::WrongId));
        self.world.same(|| "discarding by an old number".to_owned(), requestor.discard(id), Err(Status::WrongId));
        self.world.same(|| "sending by an old number".to_owned(), requestor.send(id), Err(Status::WrongId));
        requestor.release(id);
    }

    /// Blocking on or off, for one port or for all.
    pub(super) fn blocking(&self, port: usize, whose: Whose, on: bool) {
        self.world.tell(|| format!("slot {} port {port}: blocking({on}) of {whose:?}", self.slot));
        let ports = if whose == Whose::Port { port..port + 1 } else { 0..PORTS };
        for port in ports {
            self.set_gate(port, whose, on);
            self.ends.requestors[port].blocking(whose, on);
        }
        if whose == Whose::Component {
            self.blocking_events(whose, on);
            self.blocking_updates(whose, on);
        }
    }

    /// The same for its event client.
    pub(super) fn blocking_events(&self, whose: Whose, on: bool) {
        self.set_gate(EVENT_GATE, whose, on);
        self.ends.events.clients.iter().for_each(|port| port.blocking(whose, on));
    }

    /// The same for its subscriber.
    pub(super) fn blocking_updates(&self, whose: Whose, on: bool) {
        self.set_gate(PUSH_GATE, whose, on);
        self.ends.subscriber().blocking(whose, on);
    }

    fn set_gate(&self, gate: usize, whose: Whose, on: bool) {
        let mut model = self.world.model();
        let gates = &mut model.slots[self.slot].gates[gate];
        *(if whose == Whose::Port { &mut gates.port } else { &mut gates.component }) = on;
        gates.closings += u32::from(!on);
    }
}

fn value_of(lent: &Lent) -> u64 {
    // SAFETY: an answer is valid until it is released.
    unsafe { *lent.value.cast::<u64>() }
}

fn answer_in(lent: &Lent) -> End {
    if lent.status == 0 { Ok(value_of(lent)) } else { Err(Status::from_code(lent.status)) }
}

/// What the server answers.
pub(super) const fn told(number: u64) -> u64 {
    answer_to(number)
}
