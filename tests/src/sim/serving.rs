//! What a slot is entered for when something came in, as `exec::service` has it: cycles, requests, values and events in turn.
#![allow(unsafe_code, reason = "the simulation plays the plugin, which reads what its handlers are shown")]

use component_sdk::abi::calls::{ServeArgs, ServeKind};
use framework_daemon::port::pattern::turns;

use super::awaited::subscriber;
use super::ends::Ends;
use super::executors::Executors;
use super::model::{InHand, Model, SERVERS};
use super::script::Job;

/// What must be handled next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Next {
    /// A server's call, and where a successor finds it.
    Call(usize, u64, Option<u64>),
    Told(u64),
    Fired(u64, u64),
    Tick,
    Value(u64),
}

impl Next {
    /// What its handler is shown: which kind, and the number in it.
    const fn shown(self) -> (u32, Option<u64>) {
        match self {
            Self::Call(server, number, _) => (if server % SERVERS == 0 { REQUEST } else { MESSAGE }, Some(number)),
            Self::Told(_) => (ServeKind::Activation as u32, None),
            Self::Fired(_, event) => (ServeKind::Firing as u32, Some(event)),
            Self::Tick => (ServeKind::Tick as u32, None),
            Self::Value(value) => (ServeKind::Value as u32, Some(value)),
        }
    }
}

const REQUEST: u32 = ServeKind::Request as u32;
const MESSAGE: u32 = ServeKind::Message as u32;

impl Model {
    /// What a slot is to be entered for: activations first, then events and the others in turn.
    fn due(&mut self, life: usize) -> Option<Next> {
        if let Some(told) = self.tellers[life].told.take() {
            self.put_down(told);
        }
        if let Some((_, number)) = self.next_activation(life, (0, 0), false) {
            let one = self.activations.get_mut(&number)?;
            (one.announced, one.held) = (true, true);
            self.tellers[life].told = Some(number);
            return Some(Next::Told(number));
        }
        let others_first = self.turns[life].others_first;
        self.turns[life].others_first = !others_first;
        if others_first {
            self.other(life).or_else(|| self.fired(life))
        } else {
            self.fired(life).or_else(|| self.other(life))
        }
    }

    fn fired(&mut self, life: usize) -> Option<Next> {
        self.next_firing(life).map(|(number, event)| Next::Fired(number, event))
    }

    fn other(&mut self, life: usize) -> Option<Next> {
        if std::mem::take(&mut self.writers[life].ticked) {
            return Some(Next::Tick);
        }
        if let Some((server, number, before)) = self.next_of(life) {
            return Some(Next::Call(server, number, before));
        }
        let handled = self.readers[subscriber(life)].handled.as_mut()?;
        handled.queue.pop_front().map(Next::Value)
    }
}

/// As `exec::service` has it.
fn other(ends: &Ends) -> Option<ServeArgs> {
    let request = || turns::next(&ends.providers);
    ends.output.outlet().next().or_else(request).or_else(|| ends.subscriber().next())
}

impl Executors {
    /// Enters the handler of what came in, if something did.
    pub(super) fn serve(&mut self, slot: usize) {
        let ends = self.world.ends(slot);
        let must = self.world.model().due(ends.life);
        let is = ends.events.next_or(|| other(&ends)).map(|due| due.serve);
        // SAFETY: what a handler is shown stays while it is entered.
        let number = |args: &ServeArgs| unsafe { args.value.cast::<u64>().as_ref() }.copied();
        let shown = is.as_ref().map(|args| (args.what as u32, number(args)));
        self.world.tell(|| format!("slot {slot} is entered for {must:?}"));
        let same = match (shown, must) {
            (Some((kind, number)), Some(must)) => {
                let (wanted, shows) = must.shown();
                kind == wanted && shows.is_none_or(|shows| number == Some(shows)) && parameter_of(must, number)
            }
            (shown, must) => shown.is_none() && must.is_none(),
        };
        if !same {
            return self.world.wrong(format!("slot {slot} is entered for {shown:?} instead of {must:?}"));
        }
        let (Some(args), Some(must)) = (is, must) else { return };
        let job = self.job(&ends, &args, must);
        self.begin(slot, job);
    }

    fn job(&self, ends: &Ends, args: &ServeArgs, must: Next) -> Job {
        let place = args.value.expose_provenance();
        match must {
            Next::Told(number) => Job::Told(number),
            Next::Fired(number, event) => Job::Fired(number, event, place),
            Next::Tick => Job::Tick,
            Next::Value(value) => Job::Value(value, place),
            Next::Call(server, number, before) => {
                if let Some(before) = before {
                    let kept_place = args.id as u32 == before as u32 && args.id != before;
                    self.world.same(|| format!("a number of its own for {number} asked again"), kept_place, true);
                    self.world.count("asked again");
                }
                self.world.model().providers[server].hands.push(InHand { id: args.id, number, again: false });
                self.world.count("served");
                if server == ends.life * SERVERS { Job::Serve(args.id, number) } else { Job::Take(args.id, number) }
            }
        }
    }
}

/// The parameter that a server is told of is that activation's.
fn parameter_of(must: Next, shown: Option<u64>) -> bool {
    match must {
        Next::Told(number) => shown == Some(number << 20),
        _ => true,
    }
}
