//! Calls on the bench: the test plays the other side. Nothing waits, for there is nobody to wait for: a query is
//! answered by what the test prepared, or times out.
#![allow(unsafe_code, reason = "address of unsafe: plays the daemon's side of a call")]

use std::collections::VecDeque;

use super::{Bench, port};
use crate::abi::calls::{CallApi, Incoming, Lent, ServeArgs, ServeKind, Wait, Whose};
use crate::abi::class::{Direction, Pattern, PortDecl};
use crate::abi::payload::PortHandle;
use crate::component::{Callbacks, Outcome};
use crate::object::{CommObject, TypeDescriptor};
use crate::status::Status;

/// Answers the requests of a client port: from the request's address to the answer's, a leaked box.
type Answerer = Box<dyn FnMut(*const u8) -> Result<*mut u8, Status>>;

/// What a port on the bench knows of its calls.
pub(super) struct Calls {
    open: Vec<Call>,
    /// They are messages.
    one_way: bool,
    /// The component has a handler.
    has_handler: bool,
    /// What came in and was not taken.
    waiting: VecDeque<u64>,
    /// What was sent and not looked at.
    pub(super) sent: VecDeque<u64>,
    /// What is said to who sends.
    pub(super) refusal: Option<Status>,
    answerer: Option<Answerer>,
    /// By whose gate it is.
    refuses_waits: [bool; 2],
}

/// A call; its number is its place, from 1.
struct Call {
    request: *mut u8,
    answer: *mut u8,
    state: State,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum State {
    Loan,
    Open,
    Answered,
    Refused(Status),
    Over,
}

/// A query that the test asked of the component.
#[derive(Debug)]
pub struct Asked<A> {
    port: usize,
    id: u64,
    answer: std::marker::PhantomData<A>,
}

impl<C: Callbacks> Bench<C> {
    /// Says how queries of a client port are answered from now on. Without it, or where it returns `Err(Status::NoData)`,
    /// they stay open.
    ///
    /// # Panics
    /// When the class has no such client, or it carries other objects.
    pub fn answer<R: CommObject, A: CommObject>(
        &mut self,
        port: &str,
        mut answer: impl FnMut(&R) -> Result<A, Status> + 'static,
    ) {
        let index = self.query_port::<R, A>(port, Direction::Output);
        let answerer = move |request: *const u8| {
            // SAFETY: `query_port` compared the layouts; the component has filled the request.
            let request = unsafe { &*request.cast::<R>() };
            answer(request).map(|answer| Box::into_raw(Box::new(answer)).cast())
        };
        self.ports[index].borrow_mut().calls.answerer = Some(Box::new(answerer));
    }

    /// Asks the component: enters the handler of a server port; where it has none, the query waits to be taken.
    ///
    /// # Errors
    /// The handler's own.
    ///
    /// # Panics
    /// When the class has no such server, or it carries other objects.
    pub fn ask<R: CommObject, A: CommObject>(
        &mut self,
        port: &str,
        request: R,
    ) -> Result<Asked<A>, crate::component::ComponentError> {
        let index = self.query_port::<R, A>(port, Direction::Input);
        self.bring(index, Box::into_raw(Box::new(request)).cast(), ServeKind::Request).map(|id| Asked {
            port: index,
            id,
            answer: std::marker::PhantomData,
        })
    }

    /// Something comes in.
    pub(super) fn bring(
        &mut self,
        index: usize,
        request: *mut u8,
        what: ServeKind,
    ) -> Result<u64, crate::component::ComponentError> {
        let mut port = self.ports[index].borrow_mut();
        let id = port.calls.open(request, State::Open);
        if !port.calls.has_handler {
            port.calls.waiting.push_back(id);
            return Ok(id);
        }
        drop(port);
        let handle = PortHandle(std::ptr::from_ref(&self.ports[index]).cast());
        self.serve(&ServeArgs { port: handle, what, id, value: request }).map(|()| id)
    }

    pub(super) fn serve(&mut self, args: &ServeArgs) -> Outcome {
        self.enter(|component, cx| component.serve(cx, &Incoming::new(args)))
    }

    /// What became of a query: its answer, once.
    ///
    /// # Errors
    /// `NoData` while the component keeps it, `WrongId` when it was fetched already, or the status with which the
    /// component let it go.
    pub fn answered<A: CommObject>(&mut self, asked: &Asked<A>) -> Result<A, Status> {
        let mut port = self.ports[asked.port].borrow_mut();
        let lent = port.calls.receive(asked.id, Wait::NONE);
        Status::check(lent.status)?;
        // SAFETY: the component wrote an `A` into memory of its layout that `answer_loan` leaked; its number is used up,
        // so that it is taken once.
        Ok(*unsafe { Box::from_raw(lent.value.cast::<A>()) })
    }

    fn query_port<R: CommObject, A: CommObject>(&self, name: &str, direction: Direction) -> usize {
        let is_it = |port: &crate::abi::class::PortDecl| {
            port.full_name() == name && port.direction == direction && port.pattern == Pattern::Query
        };
        let side = if direction == Direction::Input { "QueryServer" } else { "QueryClient" };
        let index = self.decl.ports.iter().position(is_it);
        let index = index.unwrap_or_else(|| panic!("the class has no {side} `{name}`"));
        let decl = &self.decl.ports[index];
        let fits = |object: &TypeDescriptor, wanted: &TypeDescriptor| object.layout_hash == wanted.layout_hash;
        let answer = decl.answer.into_option();
        assert!(
            fits(decl.object, R::DESCRIPTOR) && answer.is_some_and(|answer| fits(answer, A::DESCRIPTOR)),
            "port `{name}` carries other objects: {} and {}",
            decl.object.name,
            answer.map_or("nothing", |answer| answer.name.as_str())
        );
        index
    }
}

impl Calls {
    pub(super) fn new(decl: &PortDecl) -> Self {
        Self {
            open: Vec::new(),
            one_way: decl.pattern == Pattern::Send,
            has_handler: decl.handler,
            waiting: VecDeque::new(),
            sent: VecDeque::new(),
            refusal: None,
            answerer: None,
            refuses_waits: [false; 2],
        }
    }

    /// What a client sent first of all that was not looked at.
    pub(super) fn take_sent(&mut self) -> Option<*mut u8> {
        let id = self.sent.pop_front()?;
        self.call(id).map(|call| call.request)
    }

    fn next(&mut self, wait: Wait) -> Lent {
        if self.has_handler {
            return Lent::refused(Status::NotAllowed);
        }
        let Some(id) = self.waiting.pop_front() else {
            return Lent::refused(if wait == Wait::NONE { Status::NoData } else { Status::Timeout });
        };
        self.opened(id)
    }

    fn opened(&mut self, id: u64) -> Lent {
        self.in_state(id, State::Open).map_or(Lent::refused(Status::WrongId), |call| Lent {
            value: call.request,
            id,
            status: 0,
            initialised: true,
        })
    }

    fn send_one_way(&mut self, id: u64) -> Result<(), Status> {
        let refusal = self.refusal;
        self.in_state(id, State::Loan).ok_or(Status::WrongId)?.state = State::Over;
        if let Some(status) = refusal {
            return Err(status);
        }
        self.sent.push_back(id);
        Ok(())
    }

    fn open(&mut self, request: *mut u8, state: State) -> u64 {
        self.open.push(Call { request, answer: std::ptr::null_mut(), state });
        self.open.len() as u64
    }

    fn call(&mut self, id: u64) -> Option<&mut Call> {
        self.open.get_mut(usize::try_from(id).ok()?.checked_sub(1)?)
    }

    fn in_state(&mut self, id: u64, wanted: State) -> Option<&mut Call> {
        self.call(id).filter(|call| call.state == wanted)
    }

    fn send(&mut self, id: u64) -> Result<(), Status> {
        if self.one_way {
            return self.send_one_way(id);
        }
        let request = self.in_state(id, State::Loan).ok_or(Status::WrongId)?.request;
        let answer = self.answerer.as_mut().map_or(Err(Status::NoData), |answerer| answerer(request));
        let call = self.in_state(id, State::Loan).ok_or(Status::WrongId)?;
        call.state = match answer {
            Ok(answer) => {
                call.answer = answer;
                State::Answered
            }
            Err(Status::NoData) => State::Open,
            // What a connection without its server says, it says at once.
            Err(status @ (Status::Disconnected | Status::Overload)) => {
                call.state = State::Over;
                return Err(status);
            }
            Err(status) => State::Refused(status),
        };
        Ok(())
    }

    fn receive(&mut self, id: u64, wait: Wait) -> Lent {
        let refuses_waits = self.refuses_waits.contains(&true);
        let Some(call) = self.call(id) else { return Lent::refused(Status::WrongId) };
        match call.state {
            State::Answered => {
                call.state = State::Over;
                Lent { value: call.answer, id, status: 0, initialised: true }
            }
            State::Refused(status) => {
                call.state = State::Over;
                Lent::refused(status)
            }
            State::Open if wait == Wait::NONE => Lent::refused(Status::NoData),
            State::Open if refuses_waits => Lent::refused(Status::Cancelled),
            State::Open => Lent::refused(Status::Timeout),
            State::Loan | State::Over => Lent::refused(Status::WrongId),
        }
    }

    fn end(&mut self, id: u64, state: State) -> Result<(), Status> {
        self.in_state(id, State::Open).map(|call| call.state = state).ok_or(Status::WrongId)
    }
}

pub(super) const API: CallApi =
    CallApi { loan, send, ask, receive, release, discard, blocking, wake, next, opened, answer_loan, answer, refuse };

pub(super) fn allocate(object: &TypeDescriptor) -> *mut u8 {
    let layout =
        std::alloc::Layout::from_size_align(object.size.max(1), object.align).expect("a compiler's own layout");
    // SAFETY: the size is not zero.
    unsafe { std::alloc::alloc(layout) }
}

pub(super) fn code(result: Result<(), Status>) -> u32 {
    result.map_or_else(Status::code, |()| 0)
}

/// Of a port that was taken.
const CLOSED: Lent = Lent::refused(Status::Closed);

fn in_port(handle: PortHandle, act: impl FnOnce(&mut Calls) -> Result<(), Status>) -> Result<(), Status> {
    port(handle).map_or(Err(Status::Closed), |port| act(&mut port.borrow_mut().calls))
}

extern "C" fn loan(handle: PortHandle) -> Lent {
    let Some(port) = port(handle) else { return CLOSED };
    let mut port = port.borrow_mut();
    let request = allocate(port.object);
    let id = port.calls.open(request, State::Loan);
    Lent { value: request, id, status: 0, initialised: false }
}

extern "C" fn send(handle: PortHandle, id: u64) -> u32 {
    code(in_port(handle, |calls| calls.send(id)))
}

extern "C" fn ask(handle: PortHandle, id: u64, wait: Wait) -> Lent {
    let Some(port) = port(handle) else { return CLOSED };
    let calls = &mut port.borrow_mut().calls;
    if let Err(status) = calls.send(id) {
        return Lent::refused(status);
    }
    let lent = calls.receive(id, wait);
    if lent.status != 0 {
        let _ = calls.end(id, State::Over);
    }
    lent
}

extern "C" fn receive(handle: PortHandle, id: u64, wait: Wait) -> Lent {
    port(handle).map_or(CLOSED, |port| port.borrow_mut().calls.receive(id, wait))
}

extern "C" fn release(_: PortHandle, _: u64) {}

extern "C" fn discard(handle: PortHandle, id: u64) -> u32 {
    code(in_port(handle, |calls| {
        let call = calls.call(id).filter(|call| call.state != State::Over).ok_or(Status::WrongId)?;
        call.state = State::Over;
        Ok(())
    }))
}

extern "C" fn blocking(handle: PortHandle, whose: Whose, on: bool) -> u32 {
    code(in_port(handle, |calls| {
        calls.refuses_waits[whose as usize] = !on;
        Ok(())
    }))
}

/// Nobody waits on the bench.
extern "C" fn wake(handle: PortHandle) -> u32 {
    code(in_port(handle, |_| Ok(())))
}

extern "C" fn opened(handle: PortHandle, id: u64) -> Lent {
    port(handle).map_or(CLOSED, |port| port.borrow_mut().calls.opened(id))
}

extern "C" fn next(handle: PortHandle, wait: Wait) -> Lent {
    port(handle).map_or(CLOSED, |port| port.borrow_mut().calls.next(wait))
}

extern "C" fn answer_loan(handle: PortHandle, id: u64) -> Lent {
    let Some(port) = port(handle) else { return CLOSED };
    let mut port = port.borrow_mut();
    let Some(object) = port.answer else { return Lent::refused(Status::NotAllowed) };
    let Some(call) = port.calls.in_state(id, State::Open) else { return Lent::refused(Status::WrongId) };
    call.answer = allocate(object);
    Lent { value: call.answer, id, status: 0, initialised: false }
}

extern "C" fn answer(handle: PortHandle, id: u64) -> u32 {
    code(in_port(handle, |calls| {
        let is_lent = calls.call(id).is_some_and(|call| !call.answer.is_null());
        if is_lent { calls.end(id, State::Answered) } else { Err(Status::WrongId) }
    }))
}

extern "C" fn refuse(handle: PortHandle, id: u64, status: u32) -> u32 {
    code(in_port(handle, |calls| calls.end(id, State::Refused(Status::from_code(status)))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prelude::*;

    /// Asks twice and answers at once, later, or never.
    #[derive(Component)]
    #[component(name = "Asker", passive)]
    struct Asker {
        #[port]
        square: QueryClient<f64, f64>,
        #[port(handler = on_half)]
        halves: QueryServer<f64, f64>,
        kept: Vec<Pending<f64, f64>>,
        seen: Vec<Result<f64, Status>>,
    }

    impl Callbacks for Asker {
        fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
            let first = self.square.request(3.0)?;
            let mut second = self.square.loan()?;
            *second = 4.0;
            let second = second.request()?;
            self.seen.push(self.square.receive_wait(second).map(|answer| *answer));
            self.seen.push(self.square.receive(first).map(super::super::super::port::Reply::take));
            self.seen.push(self.square.receive(first).map(|answer| *answer));
            Ok(())
        }

        fn update(&mut self, cx: &mut Context<'_>) -> Outcome {
            for pending in self.kept.drain(..) {
                let half = pending.request()? / 2.0;
                let mut answer = pending.loan(cx)?;
                *answer = half;
                answer.send()?;
            }
            Ok(())
        }
    }

    impl Asker {
        fn on_half(&mut self, _: &mut Context<'_>, query: Query<'_, f64, f64>) -> Outcome {
            let number = *query;
            if number < 0.0 {
                query.refuse(Status::NotAllowed)?;
            } else if number > 100.0 {
                self.kept.push(query.keep());
            } else if number != 0.0 {
                query.answer(number / 2.0)?;
            }
            Ok(())
        }
    }

    #[test]
    fn a_client_gets_what_the_test_prepared_in_any_order() {
        let mut bench = Bench::<Asker>::new().unwrap();
        bench.answer("square", |number: &f64| Ok(number * number));
        bench.execute().unwrap();
        assert_eq!(bench.component().seen, [Ok(16.0), Ok(9.0), Err(Status::WrongId)]);
    }

    #[test]
    fn a_client_without_an_answer_times_out_or_is_cancelled_and_keeps_its_id() {
        let mut bench = Bench::<Asker>::new().unwrap();
        bench.execute().unwrap();
        assert_eq!(bench.component().seen, [Err(Status::Timeout), Err(Status::NoData), Err(Status::NoData)]);
        let port = &mut bench.component().square;
        assert_eq!(port.query(1.0).unwrap_err(), Status::Timeout);
        port.blocking(false).unwrap();
        let id = port.request(1.0).unwrap();
        assert_eq!(port.receive_wait(id).unwrap_err(), Status::Cancelled);
        assert_eq!(port.discard(id), Ok(()));
        assert_eq!(port.discard(id), Err(Status::WrongId));
    }

    #[test]
    fn a_handler_answers_refuses_forgets_and_keeps() {
        let mut bench = Bench::<Asker>::new().unwrap();
        let ask = |bench: &mut Bench<Asker>, number: f64| bench.ask::<f64, f64>("halves", number).unwrap();
        let (answered, refused) = (ask(&mut bench, 8.0), ask(&mut bench, -1.0));
        let (forgotten, kept) = (ask(&mut bench, 0.0), ask(&mut bench, 200.0));
        assert_eq!(bench.answered(&answered), Ok(4.0));
        assert_eq!(bench.answered(&answered), Err(Status::WrongId), "an answer is fetched once");
        assert_eq!(bench.answered(&refused), Err(Status::NotAllowed));
        assert_eq!(bench.answered(&forgotten), Err(Status::Error));
        assert_eq!(bench.answered(&kept), Err(Status::NoData));
        bench.update().unwrap();
        assert_eq!(bench.answered(&kept), Ok(100.0));
    }

    #[test]
    fn the_declaration_says_pattern_objects_and_handler() {
        let ports = <Asker as crate::component::Component>::DECL.ports;
        let (client, server) = (&ports[0], &ports[1]);
        assert!(client.pattern == Pattern::Query && client.direction == Direction::Output && !client.handler);
        assert!(server.pattern == Pattern::Query && server.direction == Direction::Input && server.handler);
        assert_eq!(server.answer.into_option().map(|answer| answer.layout_hash), Some(f64::DESCRIPTOR.layout_hash));
    }
}
