//! Service types: an interface of methods, required by one component and provided by another.
//!
//! ```
//! use component_sdk::prelude::*;
//!
//! /// What a motor board does for others.
//! #[service]
//! pub trait Motors {
//!     /// Drives, and tells where that has led so far.
//!     fn drive(&mut self, left: f64, right: f64) -> Pose2D;
//!     /// May be refused.
//!     fn release(&mut self, cx: &mut Context<'_>) -> Result<(), Status>;
//!     /// Nobody waits for it.
//!     #[nonblocking]
//!     fn beep(&mut self, tone: u32);
//! }
//!
//! #[derive(Component)]
//! #[component(name = "Board", passive)]
//! pub struct Board {
//!     #[port]
//!     motors: Provided<dyn Motors>,
//!     pose: Pose2D,
//! }
//!
//! impl Callbacks for Board {}
//!
//! impl Motors for Board {
//!     fn drive(&mut self, left: f64, right: f64) -> Pose2D {
//!         self.pose.x += (left + right) / 2.0;
//!         self.pose.clone()
//!     }
//!
//!     fn release(&mut self, _: &mut Context<'_>) -> Result<(), Status> {
//!         Err(Status::NotAllowed)
//!     }
//!
//!     fn beep(&mut self, _: u32) {}
//! }
//!
//! #[derive(Component)]
//! #[component(name = "Driver", periodic = "20ms")]
//! pub struct Driver {
//!     #[port]
//!     motors: Required<dyn Motors>,
//! }
//!
//! impl Callbacks for Driver {
//!     fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
//!         let x = self.motors.drive(0.2, 0.2)?.x;
//!         if x > 1.0 {
//!             self.motors.beep(440)?;
//!         }
//!         let later = self.motors.drive_request(0.2, 0.2)?;
//!         let _pose = self.motors.drive.receive_wait(later)?;
//!         Ok(())
//!     }
//! }
//! ```
//!
//! A service port is a bundle of ports that are wired at once: a query for each method, a send for each
//! `#[nonblocking]` one. They are named `motors/drive`, `motors/beep`. The other way to do it, one query whose request is
//! an enum of all calls, would have made the client of one small method pay for the largest, a method that nobody waits for
//! wait, and an interface with one method more another type; this way a server may have more methods than its client needs,
//! and a refusal names the method.
//!
//! Parameters are communication objects, by value or, where copying costs something, by reference; so is the result.

use std::ops::{Deref, DerefMut};

use abi_stable::std_types::{ROption, RStr};

use crate::abi::calls::Incoming;
use crate::abi::class::{Direction, Pattern, PortDecl};
use crate::abi::push::PushDecl;
use crate::context::Context;
use crate::object::TypeDescriptor;
use crate::property::Builder;
use crate::status::Status;

/// What `#[service]` implements for its trait's object.
pub trait Service: 'static {
    /// Name of the interface.
    const NAME: &'static str;
    /// Its methods.
    const METHODS: &'static [MethodDecl];
    /// The client's ends.
    type Client: Send;
    /// The server's ends.
    type Server: Send;
    /// A call that came in.
    type Call<'a>;

    /// The client's ends, the first of which has that index.
    fn client(builder: &Builder<'_>, first: usize) -> Self::Client;

    /// The server's ends, the first of which has that index.
    fn server(builder: &Builder<'_>, first: usize) -> Self::Server;

    /// Sets the gates of all methods.
    ///
    /// # Errors
    /// `Closed`.
    fn blocking(client: &mut Self::Client, on: bool) -> Result<(), Status>;

    /// Sets the component's gate at all methods.
    #[doc(hidden)]
    fn component_blocking(client: &mut Self::Client, on: bool);

    /// The call that came in, if it is one of these methods.
    fn find<'a>(server: &Self::Server, incoming: &Incoming<'a>) -> Option<Self::Call<'a>>;

    /// Enters the method.
    fn enter(&mut self, cx: &mut Context<'_>, call: Self::Call<'_>);
}

/// A method of an interface.
pub struct MethodDecl {
    /// Its name.
    pub name: RStr<'static>,
    /// `Query`, or `Send` where nobody waits for it.
    pub pattern: Pattern,
    /// Its parameters, one field each.
    pub parameters: &'static TypeDescriptor,
    /// Its result; of a query only.
    pub result: ROption<&'static TypeDescriptor>,
    /// First paragraph of its documentation.
    pub description: RStr<'static>,
}

/// A service that this component calls: has the methods of the interface, each of which may fail with a [`Status`].
pub struct Required<S: Service + ?Sized>(S::Client);

impl<S: Service + ?Sized> Required<S> {
    pub(crate) fn new(client: S::Client) -> Self {
        Self(client)
    }

    /// Whether its methods may wait; as [`QueryClient::blocking`](crate::port::QueryClient::blocking) of each.
    ///
    /// # Errors
    /// `Closed`.
    pub fn blocking(&mut self, on: bool) -> Result<(), Status> {
        S::blocking(&mut self.0, on)
    }

    /// For the derives: the component's gate.
    #[doc(hidden)]
    pub fn component_blocking(&mut self, on: bool) {
        S::component_blocking(&mut self.0, on);
    }
}

impl<S: Service + ?Sized> Deref for Required<S> {
    type Target = S::Client;
    fn deref(&self) -> &S::Client {
        &self.0
    }
}

impl<S: Service + ?Sized> DerefMut for Required<S> {
    fn deref_mut(&mut self) -> &mut S::Client {
        &mut self.0
    }
}

/// A service that this component implements.
pub struct Provided<S: Service + ?Sized>(S::Server);

impl<S: Service + ?Sized> Provided<S> {
    pub(crate) fn new(server: S::Server) -> Self {
        Self(server)
    }

    /// For the derives: the call that came in, if it is one of these methods.
    #[doc(hidden)]
    pub fn find<'a>(&self, incoming: &Incoming<'a>) -> Option<S::Call<'a>> {
        S::find(&self.0, incoming)
    }
}

/// For the derives: the ports of all methods of an interface.
#[doc(hidden)]
#[must_use]
pub const fn method_ports<S: Service + ?Sized, const N: usize>(
    name: RStr<'static>,
    direction: Direction,
) -> [PortDecl; N] {
    let mut ports = [PortDecl::NONE; N];
    let mut index = 0;
    while index < N {
        let method = &S::METHODS[index];
        ports[index] = PortDecl {
            name,
            service: RStr::from_str(S::NAME),
            method: method.name,
            pattern: method.pattern,
            direction,
            object: method.parameters,
            answer: method.result,
            handler: matches!(direction, Direction::Input),
            listed: true,
            fifo: 0,
            push: PushDecl::DATA,
            description: method.description,
        };
        index += 1;
    }
    ports
}

/// For the derives: how many ports there are.
#[doc(hidden)]
#[must_use]
pub const fn port_count(parts: &[&[PortDecl]]) -> usize {
    let (mut count, mut index) = (0, 0);
    while index < parts.len() {
        count += parts[index].len();
        index += 1;
    }
    count
}

/// For the derives: all ports, one after the other.
#[doc(hidden)]
#[must_use]
pub const fn all_ports<const N: usize>(parts: &[&[PortDecl]]) -> [PortDecl; N] {
    let mut ports = [PortDecl::NONE; N];
    let (mut at, mut part) = (0, 0);
    while part < parts.len() {
        let mut index = 0;
        while index < parts[part].len() {
            ports[at] = parts[part][index];
            at += 1;
            index += 1;
        }
        part += 1;
    }
    ports
}
