//! Messages on the bench: the test plays the other side.
#![allow(unsafe_code, reason = "address of unsafe: plays the daemon's side of a message")]

use super::Bench;
use crate::abi::calls::ServeKind;
use crate::abi::class::{Direction, Pattern};
use crate::component::{Callbacks, Outcome};
use crate::object::CommObject;
use crate::status::Status;

impl<C: Callbacks> Bench<C> {
    /// Sends something to the component: enters the handler of a server port; where it has none, it waits to be taken.
    ///
    /// # Errors
    /// The handler's own.
    ///
    /// # Panics
    /// When the class has no such server, or it takes another object.
    pub fn send<T: CommObject>(&mut self, port: &str, object: T) -> Outcome {
        let index = self.send_port::<T>(port, Direction::Input);
        self.bring(index, Box::into_raw(Box::new(object)).cast(), ServeKind::Message).map(drop)
    }

    /// What the component sent first over a client port, of all that was not taken yet.
    ///
    /// # Panics
    /// When the class has no such client, or it sends another object.
    pub fn sent<T: CommObject>(&mut self, port: &str) -> Option<T> {
        let index = self.send_port::<T>(port, Direction::Output);
        let sent = self.ports[index].borrow_mut().calls.take_sent();
        // SAFETY: the component wrote a `T` into memory of its layout that `loan` leaked; `send_port` compared the layouts;
        // it left the queue, so that it is taken once.
        sent.map(|value| *unsafe { Box::from_raw(value.cast::<T>()) })
    }

    /// What the component is told from now on when it sends over that port; `None`: it is taken.
    ///
    /// # Panics
    /// When the class has no such client, or it sends another object.
    pub fn refuse<T: CommObject>(&mut self, port: &str, status: Option<Status>) {
        let index = self.send_port::<T>(port, Direction::Output);
        self.ports[index].borrow_mut().calls.refusal = status;
    }

    fn send_port<T: CommObject>(&self, name: &str, direction: Direction) -> usize {
        let is_it = |port: &crate::abi::class::PortDecl| {
            port.full_name() == name && port.direction == direction && port.pattern == Pattern::Send
        };
        let side = if direction == Direction::Input { "SendServer" } else { "SendClient" };
        let index = self.decl.ports.iter().position(is_it);
        let index = index.unwrap_or_else(|| panic!("the class has no {side} `{name}`"));
        let object = self.decl.ports[index].object;
        assert_eq!(object.layout_hash, T::DESCRIPTOR.layout_hash, "port `{name}` carries {}", object.name);
        index
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prelude::*;

    /// Passes on what comes in, twice as much.
    #[derive(Component)]
    #[component(name = "Doubler", passive)]
    struct Doubler {
        #[port(handler = on_number)]
        numbers: SendServer<f64>,
        #[port]
        waiting: SendServer<f64>,
        #[port]
        asked: QueryServer<f64, f64>,
        #[port]
        doubled: SendClient<f64>,
    }

    impl Callbacks for Doubler {
        fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
            while let Ok(number) = self.waiting.try_next(cx) {
                self.doubled.send(*number * 2.0)?;
            }
            if let Ok(query) = self.asked.next(cx) {
                let number = *query;
                query.answer(number * 2.0)?;
            }
            Ok(())
        }
    }

    impl Doubler {
        fn on_number(&mut self, cx: &mut Context<'_>, number: &f64) -> Outcome {
            if *number == 0.0 {
                // A port with a handler is the handler's.
                return Err(self.numbers.next(cx).unwrap_err().into());
            }
            let mut doubled = self.doubled.loan()?;
            *doubled = number * 2.0;
            doubled.send()?;
            Ok(())
        }
    }

    #[test]
    fn what_is_sent_arrives_in_order_and_what_is_dropped_is_not_sent() {
        let mut bench = Bench::<Doubler>::new().unwrap();
        for number in 1..=3 {
            bench.send("numbers", f64::from(number)).unwrap();
        }
        drop(bench.component().doubled.loan().unwrap());
        let sent: Vec<f64> = std::iter::from_fn(|| bench.sent("doubled")).collect();
        assert_eq!(sent, [2.0, 4.0, 6.0]);
        bench.refuse::<f64>("doubled", Some(Status::Overload));
        let refused = bench.send("numbers", 1.0).unwrap_err();
        assert_eq!(refused.to_string(), Status::Overload.to_string());
        assert_eq!(bench.sent::<f64>("doubled"), None);
        assert_eq!(bench.send("numbers", 0.0).unwrap_err().to_string(), Status::NotAllowed.to_string());
    }

    #[test]
    fn a_server_without_a_handler_takes_what_waits() {
        let mut bench = Bench::<Doubler>::new().unwrap();
        bench.execute().unwrap();
        for number in 1..=2 {
            bench.send("waiting", f64::from(number)).unwrap();
        }
        let asked = bench.ask::<f64, f64>("asked", 8.0).unwrap();
        assert_eq!(bench.answered(&asked), Err(Status::NoData));
        bench.execute().unwrap();
        assert_eq!(bench.answered(&asked), Ok(16.0));
        assert_eq!((bench.sent("doubled"), bench.sent("doubled")), (Some(2.0), Some(4.0)));
    }

    #[test]
    fn the_declaration_says_pattern_and_handler() {
        let ports = <Doubler as crate::component::Component>::DECL.ports;
        assert!(ports.iter().all(|port| port.answer.into_option().is_some() == (port.pattern == Pattern::Query)));
        assert!(ports[0].handler && !ports[1].handler && !ports[2].handler);
    }
}
