//! A question that is answered at once: where client and server share an executor and the server is at rest, its handler is
//! entered from where the client asks, and the answer is there before the client has to wait for it.
//!
//! Only how soon is different, and what it costs: inbox, ring and both ways through the executor are left out. Whatever does
//! not come to its end that way (a handler that waits, answers later, fails, or leaves something to be asked about) goes on
//! as if the call had been taken from the inbox.
//!
//! The words here belong to the executor's thread: a server with tasks, which might answer from theirs, has no lane that is
//! open. To give each call a ticket all the same was the alternative: its locks and counts take half as long as the question.
#![allow(
    unsafe_code,
    reason = "address of unsafe: the client that waits further down on this very stack, by its address"
)]

use std::sync::{Arc, OnceLock};

use component_sdk::abi::calls::ServeArgs;
use component_sdk::status::Status;

use super::call::{Call, Client};
use crate::sys::shared::{AtomicBool, AtomicPtr, AtomicU64, Ordering};

/// The way into a server's handlers from where a client asks. Executors give it to the servers of their members.
pub trait Lane: Send + Sync {
    /// True where a handler can be entered now, by whoever calls this.
    fn is_open(&self) -> bool;

    /// Enters a handler.
    fn serve(&self, args: ServeArgs) -> Served;
}

/// How far a handler got that was entered at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Served {
    /// It was not entered.
    Not,
    /// It returned.
    Done,
    /// It waits or failed, or left something to be asked about: the executor sees to that before the client goes on.
    Aside,
}

/// The call that a server has in hand at once.
#[derive(Default)]
pub(super) struct Direct {
    lane: OnceLock<Arc<dyn Lane>>,
    /// The server's number of it; 0: there is none.
    id: AtomicU64,
    /// The block for its answer is on loan.
    is_lent: AtomicBool,
    call: AtomicPtr<Call>,
    client: AtomicPtr<Client>,
}

impl Direct {
    /// Says how its handlers are entered at once; once.
    pub(super) fn use_lane(&self, lane: Arc<dyn Lane>) {
        let _ = self.lane.set(lane);
    }

    pub(super) fn lane(&self) -> Option<&dyn Lane> {
        self.lane.get().map(Arc::as_ref)
    }

    /// Runs `serve` while that call is in hand; returns what it returned, and whether the call is still open.
    pub(super) fn hold<T>(&self, id: u64, client: &Client, call: &Call, serve: impl FnOnce() -> T) -> (T, bool) {
        self.call.store(std::ptr::from_ref(call).cast_mut(), Ordering::Relaxed);
        self.client.store(std::ptr::from_ref(client).cast_mut(), Ordering::Relaxed);
        self.is_lent.store(false, Ordering::Relaxed);
        self.id.store(id, Ordering::Relaxed);
        let served = serve();
        let is_open = self.id.load(Ordering::Relaxed) == id;
        self.id.store(0, Ordering::Relaxed);
        (served, is_open)
    }

    /// The call of that number, if it is the one in hand.
    #[inline]
    fn call(&self, id: u64) -> Option<&Call> {
        let is_here = id != 0 && self.id.load(Ordering::Relaxed) == id;
        // SAFETY: `hold` has the number stored as long as it borrows the call, and this runs further up on the same stack, or
        // on that of a fiber which it entered.
        if is_here { unsafe { self.call.load(Ordering::Relaxed).as_ref() } } else { None }
    }

    /// Where the request of that call lies.
    #[inline]
    pub(super) fn opened(&self, id: u64) -> Option<*mut u8> {
        self.call(id).map(|call| call.request.value())
    }

    /// Lends the block for its answer; with it, whether there is a value in it.
    #[inline]
    pub(super) fn answer_loan(&self, id: u64) -> Option<(*mut u8, bool)> {
        let block = &self.call(id)?.answer;
        // A block on loan counts as empty: what a trap leaves in it is half an object.
        let is_filled = self.is_lent() || block.is_filled();
        self.is_lent.store(true, Ordering::Relaxed);
        block.forget_contents();
        Some((block.value(), is_filled))
    }

    /// The block for the answer is on loan.
    pub(super) fn is_lent(&self) -> bool {
        self.is_lent.load(Ordering::Relaxed)
    }

    /// Ends that call: with the answer on loan, or with a status; `None`: it is not the one in hand.
    #[inline]
    pub(super) fn finish(&self, id: u64, code: u32) -> Option<Result<(), Status>> {
        let call = self.call(id)?;
        if self.is_lent() {
            call.answer.fill(0);
        } else if code == 0 {
            return Some(Err(Status::NotAllowed));
        }
        // SAFETY: as of the call.
        let client = unsafe { self.client.load(Ordering::Relaxed).as_ref() };
        let is_left = client.is_none_or(|client| call.epoch() != client.epoch());
        call.finish(if is_left { Status::Disconnected.code() } else { code });
        self.id.store(0, Ordering::Relaxed);
        Some(if is_left { Err(Status::Disconnected) } else { Ok(()) })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use component_sdk::abi::calls::{Lent, Wait, Whose};
    use component_sdk::object::CommObject;

    use super::super::objects::Objects;
    use super::super::provider::{Openness, Provider};
    use super::super::requestor::{Requestor, Room};
    use super::*;
    use crate::port::wait::{NotHere, Waiter};

    const OBJECTS: Objects = Objects { request: u64::DESCRIPTOR, answer: Some(u64::DESCRIPTOR) };
    const ROOM: Room = Room { pending: 2, timeout_ns: 1_000, retry: false };

    /// What the handler does with the number of its call, and how far that gets.
    type Handler = Box<dyn Fn(&Provider, u64) -> Served + Send + Sync>;

    struct Played {
        handler: Handler,
        server: OnceLock<Arc<Provider>>,
        is_open: AtomicBool,
        entered: Mutex<Vec<u64>>,
    }

    impl Lane for Played {
        fn is_open(&self) -> bool {
            self.is_open.load(Ordering::Relaxed)
        }

        fn serve(&self, args: ServeArgs) -> Served {
            self.entered.lock().unwrap().push(args.id);
            (self.handler)(self.server.get().unwrap(), args.id)
        }
    }

    /// A connected pair whose handler is that.
    fn pair(
        handler: impl Fn(&Provider, u64) -> Served + Send + Sync + 'static,
    ) -> (Requestor, Arc<Provider>, Arc<Played>) {
        let server = Arc::new(Provider::new("scans", OBJECTS, 2, Waiter::new()));
        let client = Requestor::new("scan", OBJECTS, ROOM, Waiter::new());
        let (handler, is_open) = (Box::new(handler) as Handler, AtomicBool::new(true));
        let lane = Arc::new(Played { handler, server: OnceLock::new(), is_open, entered: Mutex::default() });
        let _ = lane.server.set(Arc::clone(&server));
        server.use_lane(Arc::clone(&lane) as _);
        server.set_open(Openness::Serving);
        client.connect(&server, None).unwrap();
        (client, server, lane)
    }

    fn ask(client: &Requestor, park: &impl Fn(u64) -> Result<(), NotHere>) -> Result<u64, Status> {
        let lent = client.loan();
        // SAFETY: lent for a `u64`.
        unsafe { lent.value.cast::<u64>().write(5) };
        read(client, client.ask(lent.id, Wait(1_000_000_000), park))
    }

    fn read(client: &Requestor, lent: Lent) -> Result<u64, Status> {
        if lent.status != 0 {
            return Err(Status::from_code(lent.status));
        }
        // SAFETY: an answer, lent until it is released.
        let answer = unsafe { *lent.value.cast::<u64>() };
        client.release(lent.id);
        Ok(answer)
    }

    fn answer(server: &Provider, id: u64) -> Result<(), Status> {
        let (opened, lent) = (server.opened(id), server.answer_loan(id));
        if lent.status == 0 {
            // SAFETY: both are lent for a `u64`.
            unsafe { lent.value.cast::<u64>().write(*opened.value.cast::<u64>() + 1) };
        }
        server.answer(id)
    }

    fn nobody_waits(_: u64) -> Result<(), NotHere> {
        panic!("nobody is to wait here")
    }

    #[test]
    fn who_asks_a_server_at_rest_has_the_answer_without_a_wait() {
        let (client, server, lane) = pair(|server, id| {
            assert_eq!(server.answer(id), Err(Status::NotAllowed), "nothing is on loan");
            assert_eq!(answer(server, id), Ok(()));
            assert_eq!(answer(server, id), Err(Status::WrongId), "once");
            Served::Done
        });
        for _ in 0..5 {
            assert_eq!(ask(&client, &nobody_waits), Ok(6));
        }
        assert_eq!((server.counts(), client.counts()), ((0, 0, 0), (5, 0)));
        let mut numbers = lane.entered.lock().unwrap().clone();
        numbers.dedup();
        assert_eq!(numbers.len(), 5, "each has a number of its own");
        assert_eq!(server.answer(numbers[0]), Err(Status::WrongId), "afterwards nobody has it");
    }

    #[test]
    fn what_is_not_answered_then_is_in_hand_and_the_client_waits() {
        let (client, server, lane) = pair(|_, _| Served::Done);
        let later = |_: u64| {
            assert_eq!(server.counts().1, 1);
            let id = lane.entered.lock().unwrap()[0];
            answer(&server, id).unwrap();
            Ok(())
        };
        assert_eq!(ask(&client, &later), Ok(6));
        assert_eq!(server.counts().1, 0);
    }

    #[test]
    fn an_answer_that_was_begun_is_sent_later() {
        let (client, server, lane) = pair(|server, id| {
            // SAFETY: lent for a `u64`.
            unsafe { server.answer_loan(id).value.cast::<u64>().write(40) };
            Served::Done
        });
        let later = |_: u64| server.answer(lane.entered.lock().unwrap()[0]).map_err(|_| NotHere);
        assert_eq!(ask(&client, &later), Ok(40));
    }

    #[test]
    fn the_executor_is_let_in_before_the_client_goes_on_where_it_has_to_be() {
        let (client, _server, _) = pair(|server, id| {
            answer(server, id).unwrap();
            Served::Aside
        });
        let times = AtomicU64::new(0);
        let park = |_: u64| {
            times.fetch_add(1, Ordering::Relaxed);
            Ok(())
        };
        assert_eq!((ask(&client, &park), times.load(Ordering::Relaxed)), (Ok(6), 1));
    }

    #[test]
    fn a_handler_that_failed_ends_the_wait() {
        let (client, server, _) = pair(|_, _| Served::Aside);
        let park = |_: u64| {
            server.fail();
            Ok(())
        };
        assert_eq!(ask(&client, &park), Err(Status::ProviderGone));
    }

    #[test]
    fn a_client_that_was_disconnected_by_the_handler_is_told_so() {
        let client: Arc<OnceLock<Requestor>> = Arc::default();
        let (cut, seen) = (Arc::clone(&client), Arc::new(Mutex::new(Ok(()))));
        let told = Arc::clone(&seen);
        let (own, _server, _) = pair(move |server, id| {
            cut.get().unwrap().disconnect();
            *told.lock().unwrap() = answer(server, id);
            Served::Done
        });
        assert_eq!(ask(client.get_or_init(|| own), &nobody_waits), Err(Status::Disconnected));
        assert_eq!(*seen.lock().unwrap(), Err(Status::Disconnected));
    }

    #[test]
    fn a_gate_that_was_closed_for_a_moment_while_the_handler_ran_ends_the_wait() {
        let client: Arc<OnceLock<Requestor>> = Arc::default();
        let (gate, is_answered) = (Arc::clone(&client), Arc::new(AtomicBool::new(false)));
        let answers = Arc::clone(&is_answered);
        let (own, _server, _) = pair(move |server, id| {
            [false, true].into_iter().for_each(|on| gate.get().unwrap().blocking(Whose::Port, on));
            if answers.load(Ordering::Relaxed) {
                answer(server, id).unwrap();
            }
            Served::Done
        });
        let client = client.get_or_init(|| own);
        assert_eq!(ask(client, &nobody_waits), Err(Status::Cancelled));
        is_answered.store(true, Ordering::Relaxed);
        assert_eq!(ask(client, &nobody_waits), Ok(6), "what is there is given out");
    }

    #[test]
    fn nobody_jumps_the_queue_and_a_closed_lane_is_not_entered() {
        let (client, server, lane) = pair(|server, id| {
            answer(server, id).unwrap();
            Served::Done
        });
        let served = |_: u64| {
            while let Some(call) = server.next() {
                answer(&server, call.id).unwrap();
            }
            Ok(())
        };
        let first = client.loan();
        // SAFETY: lent for a `u64`.
        unsafe { first.value.cast::<u64>().write(1) };
        client.send(first.id).unwrap();
        assert_eq!(ask(&client, &served), Ok(6), "behind the one that waits");
        assert_eq!(read(&client, client.receive(first.id, Wait::NONE, &nobody_waits)), Ok(2));
        lane.is_open.store(false, Ordering::Relaxed);
        assert_eq!(ask(&client, &served), Ok(6));
        assert!(lane.entered.lock().unwrap().is_empty());
    }

    #[test]
    fn a_handler_that_could_not_be_entered_is_asked_as_usual() {
        let (client, server, _) = pair(|_, _| Served::Not);
        let served = |_: u64| server.next().map_or(Err(NotHere), |call| answer(&server, call.id).map_err(|_| NotHere));
        assert_eq!((ask(&client, &served), client.counts()), (Ok(6), (1, 0)));
    }
}
