//! Push ports on the bench: the test is the server of every client, and the clients of every server. Nothing waits: a wait
//! for the next value is answered by what the test put since the last look, or times out.

use super::calls::code;
use super::{Bench, BenchPort, clock, port};
use crate::abi::calls::{Incoming, ServeArgs, ServeKind, Wait, Whose};
use crate::abi::class::Direction;
use crate::abi::payload::{PortHandle, ReadMode};
use crate::abi::push::{PushApi, PushDecl, PushEnd, PushInfo, Update};
use crate::component::{Callbacks, Outcome};
use crate::object::CommObject;
use crate::status::Status;

/// What a port on the bench knows of its subscription or its cycle.
pub(super) struct Push {
    decl: PushDecl,
    /// 0: not subscribed.
    prescale: u32,
    left: u32,
    running: bool,
    last_ns: Option<u64>,
    /// By whose gate it is.
    refuses_waits: [bool; 2],
}

impl Push {
    pub(super) const fn new(decl: PushDecl) -> Self {
        Self { decl, prescale: 0, left: 0, running: decl.started, last_ns: None, refuses_waits: [false; 2] }
    }

    /// Whether a value that the test puts reaches the client.
    pub(super) const fn wants(&mut self, direction: Direction) -> bool {
        let is_client = matches!(direction, Direction::Input) && matches!(self.decl.end, PushEnd::Push);
        if !is_client {
            return true;
        }
        if self.prescale == 0 {
            return false;
        }
        let is_next = self.left == 0;
        self.left = if is_next { self.prescale - 1 } else { self.left - 1 };
        is_next
    }

    /// The code with which a server's value is not sent, if it is not.
    pub(super) fn refusal(&mut self, now_ns: u64) -> Option<u32> {
        if self.decl.end == PushEnd::Timed && !self.running {
            return Some(crate::port::Sent::NotActivated as u32);
        }
        let too_early = self.last_ns.is_some_and(|last_ns| now_ns - last_ns < self.decl.min_cycle_ns);
        if too_early {
            return Some(crate::port::Sent::TooEarly as u32);
        }
        self.last_ns = Some(now_ns);
        None
    }
}

impl<C: Callbacks> Bench<C> {
    /// Begins a cycle of a timed server: enters its handler, if it runs.
    ///
    /// # Errors
    /// The handler's own.
    ///
    /// # Panics
    /// When the class has no such server.
    pub fn tick<T: CommObject>(&mut self, port: &str) -> Outcome {
        let port = self.port::<T>(port, Direction::Output);
        let (decl, running) = (port.borrow().push.decl, port.borrow().push.running);
        assert_eq!(decl.end, PushEnd::Timed, "the port is no PushTimedServer");
        let handle = PortHandle(std::ptr::from_ref(port).cast());
        let args = ServeArgs { port: handle, what: ServeKind::Tick, ..ServeArgs::NONE };
        if running { self.enter(|component, cx| component.serve(cx, &Incoming::new(&args))) } else { Ok(()) }
    }

    /// Puts `object` to a client, and enters its handler with it, if it has one. The handler's own prescale is left out.
    ///
    /// # Errors
    /// The handler's own; `Unsubscribed` where the client is not subscribed.
    ///
    /// # Panics
    /// When the class has no such client, or it carries another type.
    pub fn push<T: CommObject>(&mut self, port: &str, object: T) -> Outcome {
        let before = self.port::<T>(port, Direction::Input).borrow().queue.len();
        self.put(port, object);
        let port = self.port::<T>(port, Direction::Input);
        let handle = PortHandle(std::ptr::from_ref(port).cast());
        let newest = port.borrow().queue.back().copied();
        let Some((value, _)) = newest.filter(|_| port.borrow().queue.len() > before) else {
            return Err(Status::Unsubscribed.into());
        };
        let args = ServeArgs { port: handle, what: ServeKind::Value, id: 0, value };
        self.enter(|component, cx| component.serve(cx, &Incoming::new(&args)))
    }
}

impl BenchPort {
    fn update(&mut self, wait: Wait) -> Update {
        if self.push.prescale == 0 {
            return Update::refused(Status::Unsubscribed);
        }
        if wait != Wait::NONE && self.push.refuses_waits.contains(&true) {
            return Update::refused(Status::Cancelled);
        }
        let (mode, missing) =
            if wait == Wait::NONE { (ReadMode::Newest, Status::NoData) } else { (ReadMode::Fresh, Status::Timeout) };
        let read = self.read(mode);
        if read.value.is_null() {
            return Update::refused(missing);
        }
        Update { value: read.value, stamp_ns: read.stamp_ns, status: 0 }
    }
}

pub(super) const API: PushApi = PushApi { subscribe, unsubscribe, update, info, blocking, start, stop };

fn in_push(handle: PortHandle, act: impl FnOnce(&mut Push) -> Result<(), Status>) -> u32 {
    code(port(handle).map_or(Err(Status::Closed), |port| act(&mut port.borrow_mut().push)))
}

extern "C" fn subscribe(handle: PortHandle, prescale: u32) -> u32 {
    in_push(handle, |push| {
        if prescale == 0 {
            return Err(Status::Error);
        }
        if push.prescale == 0 {
            (push.prescale, push.left) = (prescale, 0);
        }
        Ok(())
    })
}

extern "C" fn unsubscribe(handle: PortHandle) -> u32 {
    let Some(port) = port(handle) else { return Status::Closed.code() };
    let mut port = port.borrow_mut();
    port.push.prescale = 0;
    port.queue.clear();
    port.current = None;
    0
}

extern "C" fn update(handle: PortHandle, wait: Wait) -> Update {
    port(handle).map_or(Update::refused(Status::Closed), |port| port.borrow_mut().update(wait))
}

extern "C" fn info(handle: PortHandle) -> PushInfo {
    let running = PushInfo { period_ns: 0, running: true, status: 0 };
    port(handle).map_or(PushInfo::refused(Status::Closed), |_| running)
}

extern "C" fn blocking(handle: PortHandle, whose: Whose, on: bool) -> u32 {
    in_push(handle, |push| {
        push.refuses_waits[whose as usize] = !on;
        Ok(())
    })
}

extern "C" fn start(handle: PortHandle) -> u32 {
    in_push(handle, |push| {
        push.running = true;
        Ok(())
    })
}

extern "C" fn stop(handle: PortHandle) -> u32 {
    in_push(handle, |push| {
        push.running = false;
        Ok(())
    })
}

/// As `publish` of any output.
pub(super) fn publish(port: &mut BenchPort, value: *mut u8) -> u32 {
    let now_ns = clock();
    if let Some(code) = port.push.refusal(now_ns) {
        return code;
    }
    port.queue.push_back((value, now_ns));
    0
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::port::ServerInfo;
    use crate::prelude::*;

    /// Counts, and hears another one count.
    #[derive(Component)]
    #[component(name = "Counter", passive)]
    struct Counter {
        #[port(timed = "100ms", handler = on_tick)]
        count: PushTimedServer<f64>,
        #[port(min_cycle = "10ms")]
        thin: PushServer<f64>,
        #[port(handler = on_value, prescale = 2)]
        other: PushClient<f64>,
        ticks: f64,
        seen: Vec<f64>,
    }

    impl Callbacks for Counter {
        fn start(&mut self, _: &mut Context<'_>) -> Outcome {
            self.other.subscribe(2)?;
            self.other.subscribe(3)?;
            self.count.start()?;
            Ok(())
        }
    }

    impl Counter {
        fn on_tick(&mut self, _: &mut Context<'_>) -> Outcome {
            self.ticks += 1.0;
            self.count.put(self.ticks)?;
            Ok(())
        }

        fn on_value(&mut self, _: &mut Context<'_>, value: &f64) -> Outcome {
            self.seen.push(*value);
            Ok(())
        }
    }

    #[test]
    fn a_timed_server_ticks_while_it_runs() {
        let mut bench = Bench::<Counter>::new().unwrap();
        assert_eq!(bench.component().count.put(1.0), Err(Status::NotActivated));
        bench.tick::<f64>("count").unwrap();
        assert_eq!(bench.take::<f64>("count"), None);
        bench.start().unwrap();
        bench.tick::<f64>("count").unwrap();
        bench.tick::<f64>("count").unwrap();
        assert_eq!(bench.take::<f64>("count"), Some(2.0));
        bench.component().count.stop().unwrap();
        assert_eq!(bench.component().count.put(1.0), Err(Status::NotActivated));
    }

    #[test]
    fn a_value_that_comes_too_early_is_not_sent() {
        let mut bench = Bench::<Counter>::new().unwrap();
        bench.update().unwrap();
        assert_eq!(bench.component().thin.put(1.0), Ok(Delivered::All));
        assert_eq!(bench.component().thin.put(2.0), Ok(Delivered::TooEarly));
        bench.advance(Duration::from_millis(10));
        bench.update().unwrap();
        assert_eq!(bench.component().thin.put(3.0), Ok(Delivered::All));
        assert_eq!(bench.take::<f64>("thin"), Some(3.0));
    }

    #[test]
    fn a_client_hears_what_it_is_subscribed_to() {
        let mut bench = Bench::<Counter>::new().unwrap();
        bench.put("other", 1.0);
        assert_eq!(bench.component().other.update().copied(), Err(Status::Unsubscribed));
        assert!(bench.push("other", 1.0).is_err());
        bench.start().unwrap();
        assert_eq!(bench.component().other.update().copied(), Err(Status::NoData));
        for value in [2.0, 3.0, 4.0] {
            let _ = bench.push("other", value);
        }
        assert_eq!(bench.component().seen, [2.0, 4.0], "the first prescale holds");
        assert_eq!(bench.component().other.update().copied(), Ok(4.0));
        assert_eq!(bench.component().other.update().copied(), Ok(4.0));
        assert_eq!(bench.component().other.update_wait().copied(), Err(Status::Timeout));
        bench.component().other.blocking(false).unwrap();
        assert_eq!(bench.component().other.update_wait().copied(), Err(Status::Cancelled));
        let info = bench.component().other.server_info();
        assert_eq!(info, Ok(ServerInfo { cycle: Duration::ZERO, running: true }));
        bench.component().other.unsubscribe().unwrap();
        bench.component().other.subscribe(1).unwrap();
        assert_eq!(bench.component().other.update().copied(), Err(Status::NoData));
    }

    #[test]
    fn the_declaration_says_cycle_and_prescale() {
        let ports = <Counter as crate::component::Component>::DECL.ports;
        let (timed, thin, client) = (&ports[0], &ports[1], &ports[2]);
        assert_eq!((timed.push.end, timed.push.period_ns, timed.handler), (PushEnd::Timed, 100_000_000, true));
        assert_eq!((thin.push.end, thin.push.min_cycle_ns, thin.handler), (PushEnd::Push, 10_000_000, false));
        assert_eq!((client.direction, client.push.prescale, client.fifo), (Direction::Input, 2, 0));
    }
}
