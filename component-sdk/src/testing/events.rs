//! Events on the bench: the test plays the other side. Nothing waits, for there is nobody to wait for: what the test has
//! not fired times out.
#![allow(unsafe_code, reason = "address of unsafe: plays the daemon's side of an event")]

use super::calls::{allocate, code};
use super::{Bench, port};
use crate::abi::calls::{Lent, ServeArgs, ServeKind, Wait, Whose};
use crate::abi::class::{Direction, Pattern};
use crate::abi::events::{EventApi, Mode, Testing, Which};
use crate::abi::payload::PortHandle;
use crate::component::{Callbacks, ComponentError, Outcome};
use crate::object::{CommObject, TypeDescriptor};
use crate::port::EventId;
use crate::status::Status;

/// What a port on the bench knows of its activations.
#[derive(Default)]
pub(super) struct Events {
    all: Vec<Activation>,
    /// Where the event of a test that did not fire lies.
    spare: Option<*mut u8>,
    /// By whose gate it is.
    refuses_waits: [bool; 2],
}

/// An activation; its number is its place, from 1. Objects are leaked boxes, as all on the bench.
struct Activation {
    parameter: *mut u8,
    mode: Mode,
    is_open: bool,
    /// What was not fetched.
    event: Option<*mut u8>,
    has_fired: bool,
}

impl<C: Callbacks> Bench<C> {
    /// The activations of a client of events, in the order in which the component made them.
    ///
    /// # Panics
    /// When the class has no such client, or it carries other objects.
    #[must_use]
    pub fn activations<P: CommObject, E: CommObject>(&self, port: &str) -> Vec<EventId<E>> {
        let index = self.event_port::<P, E>(port, Direction::Input);
        let port = self.ports[index].borrow();
        let open = port.events.all.iter().zip(1..).filter(|(activation, _)| activation.is_open);
        open.map(|(_, id)| EventId::new(id)).collect()
    }

    /// Fires an activation of a client of events: stores the event, and enters the handler if there is one.
    ///
    /// # Errors
    /// The handler's own; that the activation is over.
    ///
    /// # Panics
    /// When the class has no such client, or it carries other objects.
    pub fn fire<P: CommObject, E: CommObject>(&mut self, port: &str, id: EventId<E>, event: E) -> Outcome {
        let index = self.event_port::<P, E>(port, Direction::Input);
        let event = Box::into_raw(Box::new(event)).cast::<u8>();
        self.ports[index].borrow_mut().events.fire(id.number(), event)?;
        self.enter_handler(index, ServeKind::Firing, id.number(), event)
    }

    /// Activates a server of events, and enters its `on_activation` if there is one.
    ///
    /// # Errors
    /// That method's own.
    ///
    /// # Panics
    /// When the class has no such server, or it carries other objects.
    pub fn activate<P: CommObject, E: CommObject>(
        &mut self,
        port: &str,
        mode: Mode,
        parameter: P,
    ) -> Result<EventId<E>, ComponentError> {
        let index = self.event_port::<P, E>(port, Direction::Output);
        let parameter = Box::into_raw(Box::new(parameter)).cast::<u8>();
        let id = self.ports[index].borrow_mut().events.open(parameter, mode);
        self.enter_handler(index, ServeKind::Activation, id, parameter)?;
        Ok(EventId::new(id))
    }

    /// What an activation of a server fired last, since this was asked last.
    ///
    /// # Panics
    /// When the class has no such server, or it carries other objects.
    pub fn fired<P: CommObject, E: CommObject>(&mut self, port: &str, id: EventId<E>) -> Option<E> {
        let index = self.event_port::<P, E>(port, Direction::Output);
        let event = self.ports[index].borrow_mut().events.get(id.number()).ok()?.event.take()?;
        // SAFETY: the component wrote an `E` into memory of its layout that `first` leaked; it was taken out, once.
        Some(*unsafe { Box::from_raw(event.cast::<E>()) })
    }

    /// Sends an event to an event port: enters its handler, or `on_event` where it has none.
    ///
    /// # Errors
    /// The callback's own.
    ///
    /// # Panics
    /// When the class has no such port, or it carries another object.
    pub fn notify<E: CommObject>(&mut self, port: &str, event: E) -> Outcome {
        let found = |port_name: &str| self.decl.ports.iter().position(|decl| decl.name.as_str() == port_name);
        let is_event = |index: &usize| self.decl.ports[*index].pattern == Pattern::EventPort;
        let index = found(port).filter(is_event).unwrap_or_else(|| panic!("the class has no EventIn `{port}`"));
        if !self.ports[index].borrow().handler {
            self.put(port, event);
            return self.enter(C::on_event);
        }
        let object = self.decl.ports[index].object;
        assert_eq!(object.layout_hash, E::DESCRIPTOR.layout_hash, "port `{port}` carries {}", object.name);
        self.enter_handler(index, ServeKind::Event, 0, Box::into_raw(Box::new(event)).cast())
    }

    fn enter_handler(&mut self, index: usize, what: ServeKind, id: u64, value: *const u8) -> Outcome {
        if !self.ports[index].borrow().handler {
            return Ok(());
        }
        let handle = PortHandle(std::ptr::from_ref(&self.ports[index]).cast());
        self.serve(&ServeArgs { port: handle, what, id, value })
    }

    fn event_port<P: CommObject, E: CommObject>(&self, name: &str, direction: Direction) -> usize {
        let side = if direction == Direction::Input { "EventClient" } else { "EventServer" };
        let is_it = |port: &crate::abi::class::PortDecl| {
            port.name.as_str() == name && port.direction == direction && port.pattern == Pattern::Event
        };
        let index = self.decl.ports.iter().position(is_it);
        let index = index.unwrap_or_else(|| panic!("the class has no {side} `{name}`"));
        let decl = &self.decl.ports[index];
        let fits = |object: &TypeDescriptor, wanted: &TypeDescriptor| object.layout_hash == wanted.layout_hash;
        let parameter = decl.answer.into_option();
        assert!(
            fits(decl.object, E::DESCRIPTOR) && parameter.is_some_and(|parameter| fits(parameter, P::DESCRIPTOR)),
            "port `{name}` carries other objects: {} for {}",
            decl.object.name,
            parameter.map_or("nothing", |parameter| parameter.name.as_str())
        );
        index
    }
}

impl Events {
    fn open(&mut self, parameter: *mut u8, mode: Mode) -> u64 {
        self.all.push(Activation { parameter, mode, is_open: true, event: None, has_fired: false });
        self.all.len() as u64
    }

    fn place(&mut self, id: u64) -> Option<&mut Activation> {
        self.all.get_mut(usize::try_from(id).ok()?.checked_sub(1)?)
    }

    fn get(&mut self, id: u64) -> Result<&mut Activation, Status> {
        self.place(id).filter(|activation| activation.is_open).ok_or(Status::WrongId)
    }

    fn fire(&mut self, id: u64, event: *mut u8) -> Result<(), Status> {
        let activation = self.get(id)?;
        if activation.mode == Mode::Continuous || !activation.has_fired {
            activation.event = Some(event);
        }
        activation.has_fired = true;
        Ok(())
    }

    fn fetch(&mut self, id: u64, which: Which, wait: Wait) -> Result<*mut u8, Status> {
        let refuses_waits = self.refuses_waits.contains(&true);
        let activation = self.get(id)?;
        if which == Which::Present
            && let Some(event) = activation.event.take()
        {
            return Ok(event);
        }
        match wait {
            _ if activation.mode == Mode::Single && activation.has_fired => Err(Status::Passive),
            _ if refuses_waits => Err(Status::Cancelled),
            Wait::NONE => Err(Status::NoData),
            _ => Err(Status::Timeout),
        }
    }

    /// The first open activation from that place on.
    fn test_from(&mut self, place: usize, object: &TypeDescriptor) -> Testing {
        let found = self.all.iter().enumerate().skip(place).find(|(_, activation)| activation.is_open);
        let Some((place, activation)) = found else { return Testing::over(Status::NoData) };
        let initialised = self.spare.is_some();
        let event = *self.spare.get_or_insert_with(|| allocate(object));
        Testing { parameter: activation.parameter, event, id: place as u64 + 1, status: 0, initialised }
    }
}

pub(super) const API: EventApi = EventApi { loan, activate, deactivate, state, fetch, blocking, first, next, leave };

/// Of a port that was taken.
fn in_events(handle: PortHandle, act: impl FnOnce(&mut Events) -> Result<(), Status>) -> u32 {
    code(port(handle).map_or(Err(Status::Closed), |port| act(&mut port.borrow_mut().events)))
}

extern "C" fn loan(handle: PortHandle) -> Lent {
    let Some(port) = port(handle) else { return Lent::refused(Status::Closed) };
    let mut port = port.borrow_mut();
    let Some(object) = port.answer else { return Lent::refused(Status::NotAllowed) };
    let parameter = allocate(object);
    let id = port.events.open(parameter, Mode::Single);
    port.events.all.last_mut().into_iter().for_each(|activation| activation.is_open = false);
    Lent { value: parameter, id, status: 0, initialised: false }
}

extern "C" fn activate(handle: PortHandle, id: u64, mode: Mode) -> u32 {
    in_events(handle, |events| {
        let activation = events.place(id).ok_or(Status::WrongId)?;
        (activation.is_open, activation.mode) = (true, mode);
        Ok(())
    })
}

extern "C" fn deactivate(handle: PortHandle, id: u64) -> u32 {
    in_events(handle, |events| events.get(id).map(|activation| activation.is_open = false))
}

extern "C" fn state(handle: PortHandle, id: u64) -> u32 {
    in_events(handle, |events| match events.get(id)? {
        activation if activation.event.is_some() => Ok(()),
        activation if activation.mode == Mode::Single && activation.has_fired => Err(Status::Passive),
        _ => Err(Status::Active),
    })
}

extern "C" fn fetch(handle: PortHandle, id: u64, which: Which, wait: Wait) -> Lent {
    let fetched = port(handle).map_or(Err(Status::Closed), |port| port.borrow_mut().events.fetch(id, which, wait));
    fetched.map_or_else(Lent::refused, |value| Lent { value, id, status: 0, initialised: true })
}

extern "C" fn blocking(handle: PortHandle, whose: Whose, on: bool) -> u32 {
    in_events(handle, |events| {
        events.refuses_waits[whose as usize] = !on;
        Ok(())
    })
}

extern "C" fn first(handle: PortHandle) -> Testing {
    let Some(port) = port(handle) else { return Testing::over(Status::Closed) };
    let mut port = port.borrow_mut();
    let object = port.object;
    port.events.test_from(0, object)
}

extern "C" fn next(handle: PortHandle, id: u64, fires: bool) -> Testing {
    let Some(port) = port(handle) else { return Testing::over(Status::Closed) };
    let mut port = port.borrow_mut();
    let (object, events) = (port.object, &mut port.events);
    let may_fire = events.get(id).is_ok_and(|activation| activation.mode == Mode::Continuous || !activation.has_fired);
    if fires
        && may_fire
        && let Some(event) = events.spare.take()
    {
        // An activation of that number is there.
        let _ = events.fire(id, event);
    }
    events.test_from(usize::try_from(id).unwrap_or(usize::MAX), object)
}

extern "C" fn leave(_: PortHandle, _: u64) {}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prelude::*;

    /// Hears of events in all ways, and tells them.
    #[derive(Component)]
    #[component(name = "Watcher", passive)]
    struct Watcher {
        #[port(handler = on_crossing)]
        level: EventClient<f64, u32>,
        #[port(on_activation = on_activation)]
        crossings: EventServer<f64, u32, f64>,
        #[port(handler = on_alarm)]
        alarms: EventIn<u32>,
        #[port(fifo = 4)]
        notes: EventIn<u32>,
        #[port]
        told: EventOut<u32>,
        seen: Vec<String>,
    }

    impl Callbacks for Watcher {
        fn start(&mut self, _: &mut Context<'_>) -> Outcome {
            self.level.activate(Mode::Continuous, 3.0)?;
            self.level.activate(Mode::Single, 5.0)?;
            Ok(())
        }

        fn on_event(&mut self, _: &mut Context<'_>) -> Outcome {
            let note = self.notes.take().copied();
            self.seen.push(format!("note {note:?}"));
            self.told.send(note.unwrap_or_default());
            Ok(())
        }
    }

    impl Watcher {
        fn on_crossing(&mut self, _: &mut Context<'_>, id: EventId<u32>, event: &u32) -> Outcome {
            let stored = self.level.try_event(id)?;
            self.seen.push(format!("crossing {event} {stored:?}"));
            Ok(())
        }

        fn on_activation(&mut self, _: &mut Context<'_>, parameter: &f64) -> Outcome {
            self.seen.push(format!("activation {parameter}"));
            Ok(())
        }

        fn on_alarm(&mut self, _: &mut Context<'_>, event: &u32) -> Outcome {
            self.seen.push(format!("alarm {event}"));
            Ok(())
        }

        fn measured(&mut self, value: f64) -> Result<(), Status> {
            self.crossings.put(&value, |parameter, event, value| {
                *event += *value as u32;
                value > parameter
            })
        }
    }

    #[test]
    fn a_client_gets_what_the_test_fires_and_its_handler_besides() {
        let mut bench = Bench::<Watcher>::new().unwrap();
        bench.start().unwrap();
        let ids = bench.activations::<f64, u32>("level");
        let [continuous, single] = ids[..] else { panic!("{ids:?}") };
        for event in [7, 8] {
            bench.fire::<f64, u32>("level", continuous, event).unwrap();
            bench.fire::<f64, u32>("level", single, event).unwrap();
        }
        let seen = &bench.component().seen;
        assert_eq!(seen[..2], ["crossing 7 Fired", "crossing 7 Fired"]);
        let level = &mut bench.component().level;
        assert_eq!((level.get_event(continuous).copied(), level.get_event(single).copied()), (Ok(8), Ok(7)));
        assert_eq!(level.get_event(single), Err(Status::Passive));
        assert_eq!(level.get_event(continuous), Err(Status::Timeout));
        level.blocking(false).unwrap();
        assert_eq!(level.get_next_event(continuous), Err(Status::Cancelled));
        assert_eq!((level.deactivate(single), level.deactivate(single)), (Ok(()), Err(Status::WrongId)));
    }

    #[test]
    fn a_server_tests_each_activation_with_a_fresh_event() {
        let mut bench = Bench::<Watcher>::new().unwrap();
        let low = bench.activate::<f64, u32>("crossings", Mode::Continuous, 1.0).unwrap();
        let high = bench.activate::<f64, u32>("crossings", Mode::Single, 5.0).unwrap();
        assert_eq!(bench.component().seen, ["activation 1", "activation 5"]);
        bench.component().measured(3.0).unwrap();
        assert_eq!(bench.fired::<f64, u32>("crossings", low), Some(3));
        assert_eq!(bench.fired::<f64, u32>("crossings", high), None);
        bench.component().measured(9.0).unwrap();
        bench.component().measured(8.0).unwrap();
        assert_eq!(bench.fired::<f64, u32>("crossings", low), Some(8));
        assert_eq!(bench.fired::<f64, u32>("crossings", high), Some(9), "once");
    }

    #[test]
    fn event_ports_enter_their_handler_or_on_event() {
        let mut bench = Bench::<Watcher>::new().unwrap();
        bench.notify("alarms", 4u32).unwrap();
        bench.notify("notes", 5u32).unwrap();
        assert_eq!(bench.component().seen, ["alarm 4", "note Some(5)"]);
        assert_eq!(bench.take::<u32>("told"), Some(5));
    }

    #[test]
    fn the_declaration_says_pattern_objects_and_handler() {
        let ports = <Watcher as crate::component::Component>::DECL.ports;
        let said: Vec<_> = ports.iter().map(|port| (port.pattern, port.direction, port.handler)).collect();
        use {Direction::Input, Direction::Output};
        assert_eq!(
            said[..3],
            [(Pattern::Event, Input, true), (Pattern::Event, Output, true), (Pattern::EventPort, Input, true)]
        );
        assert_eq!(said[3..], [(Pattern::EventPort, Input, false), (Pattern::EventPort, Output, false)]);
        assert_eq!(ports[0].object.layout_hash, u32::DESCRIPTOR.layout_hash);
        assert_eq!(ports[0].answer.into_option().map(|p| p.layout_hash), Some(f64::DESCRIPTOR.layout_hash));
    }
}
