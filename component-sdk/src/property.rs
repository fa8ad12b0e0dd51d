//! Typed properties with defaults, units and ranges, read from the profile's text.

use abi_stable::StableAbi;
use abi_stable::std_types::RStr;

use crate::abi::class::{CreateArgs, PropertyDecl};
use crate::component::ComponentError;
use crate::object::CommObject;
use crate::port::{
    DataIn, DataOut, EventClient, EventIn, EventOut, EventServer, Provided, PushClient, PushServer, PushTimedServer,
    QueryClient, QueryServer, Required, SendClient, SendServer, Service, StateMaster, StateSlave,
};

/// What a property's text must be.
#[repr(u8)]
#[derive(StableAbi, Clone, Copy, Debug, PartialEq, Eq)]
pub enum PropertyKind {
    /// `true`, `false`, `1`, `0`.
    Bool,
    /// A whole number.
    Integer,
    /// A number.
    Number,
    /// Any text.
    Text,
}

impl PropertyKind {
    /// Its name in an OPRoS profile.
    #[must_use]
    pub const fn opros_name(self) -> &'static str {
        match self {
            Self::Bool => "bool",
            Self::Integer => "int",
            Self::Number => "double",
            Self::Text => "string",
        }
    }
}

/// A type that a property may have.
pub trait PropertyValue: Sized {
    /// What its text must be.
    const KIND: PropertyKind;

    /// Reads the text; `None` where it does not fit.
    fn parse(text: &str) -> Option<Self>;

    /// The value as a number, to be held against the range.
    fn number(&self) -> Option<f64> {
        None
    }
}

macro_rules! numbers {
    ($($kind:ident: $($number:ty),+;)+) => { $($(
        impl PropertyValue for $number {
            const KIND: PropertyKind = PropertyKind::$kind;
            fn parse(text: &str) -> Option<Self> {
                text.parse().ok()
            }
            fn number(&self) -> Option<f64> {
                // Ranges are written by hand; beyond 2^53 nobody writes one.
                Some(*self as f64)
            }
        }
    )+)+ };
}

numbers! {
    Number: f32, f64;
    Integer: i8, i16, i32, i64, u8, u16, u32, u64, usize;
}

impl PropertyValue for bool {
    const KIND: PropertyKind = PropertyKind::Bool;
    fn parse(text: &str) -> Option<Self> {
        match text.to_ascii_lowercase().as_str() {
            "true" | "1" => Some(true),
            "false" | "0" => Some(false),
            _ => None,
        }
    }
}

impl PropertyValue for String {
    const KIND: PropertyKind = PropertyKind::Text;
    fn parse(text: &str) -> Option<Self> {
        Some(text.to_owned())
    }
}

/// Hands the fields of a new instance what the daemon gave: ports and property texts, in the class's order.
pub struct Builder<'a> {
    args: &'a CreateArgs<'a>,
    properties: &'static [PropertyDecl],
}

impl<'a> Builder<'a> {
    pub(crate) fn new(args: &'a CreateArgs<'a>, properties: &'static [PropertyDecl]) -> Self {
        Self { args, properties }
    }

    /// The input port at `index`.
    #[must_use]
    pub fn data_in<T: CommObject>(&self, index: usize) -> DataIn<T> {
        DataIn::new(self.args.ports[index])
    }

    /// The output port at `index`.
    #[must_use]
    pub fn data_out<T: CommObject>(&self, index: usize) -> DataOut<T> {
        DataOut::new(self.args.ports[index])
    }

    /// The push client at `index`.
    #[must_use]
    pub fn push_client<T: CommObject>(&self, index: usize) -> PushClient<T> {
        PushClient::new(self.args.ports[index])
    }

    /// The push server at `index`.
    #[must_use]
    pub fn push_server<T: CommObject>(&self, index: usize) -> PushServer<T> {
        PushServer::new(self.args.ports[index])
    }

    /// The timed push server at `index`.
    #[must_use]
    pub fn push_timed_server<T: CommObject>(&self, index: usize) -> PushTimedServer<T> {
        PushTimedServer::new(self.args.ports[index])
    }

    /// The client port at `index`.
    #[must_use]
    pub fn query_client<R: CommObject, A: CommObject>(&self, index: usize) -> QueryClient<R, A> {
        QueryClient::new(self.args.ports[index])
    }

    /// The server port at `index`.
    #[must_use]
    pub fn query_server<R: CommObject, A: CommObject>(&self, index: usize) -> QueryServer<R, A> {
        QueryServer::new(self.args.ports[index])
    }

    /// The sending port at `index`.
    #[must_use]
    pub fn send_client<C: CommObject>(&self, index: usize) -> SendClient<C> {
        SendClient::new(self.args.ports[index])
    }

    /// The taking port at `index`.
    #[must_use]
    pub fn send_server<C: CommObject>(&self, index: usize) -> SendServer<C> {
        SendServer::new(self.args.ports[index])
    }

    /// The client of events at `index`.
    #[must_use]
    pub fn event_client<P: CommObject, E: CommObject>(&self, index: usize) -> EventClient<P, E> {
        EventClient::new(self.args.ports[index])
    }

    /// The server of events at `index`.
    #[must_use]
    pub fn event_server<P: CommObject, E: CommObject, S: ?Sized>(&self, index: usize) -> EventServer<P, E, S> {
        EventServer::new(self.args.ports[index])
    }

    /// The event input at `index`.
    #[must_use]
    pub fn event_in<E: CommObject>(&self, index: usize) -> EventIn<E> {
        EventIn::new(self.args.ports[index])
    }

    /// The event output at `index`.
    #[must_use]
    pub fn event_out<E: CommObject>(&self, index: usize) -> EventOut<E> {
        EventOut::new(self.args.ports[index])
    }

    /// The required service whose first port is at `index`.
    #[must_use]
    pub fn required<S: Service + ?Sized>(&self, index: usize) -> Required<S> {
        Required::new(S::client(self, index))
    }

    /// The provided service whose first port is at `index`.
    #[must_use]
    pub fn provided<S: Service + ?Sized>(&self, index: usize) -> Provided<S> {
        Provided::new(S::server(self, index))
    }

    /// The states at `index`.
    #[must_use]
    pub fn state_slave(&self, index: usize) -> StateSlave {
        StateSlave::new(self.args.ports[index], self.args.ports.to_vec())
    }

    /// The master of states at `index`.
    #[must_use]
    pub fn state_master(&self, index: usize) -> StateMaster {
        StateMaster::new(self.args.ports[index])
    }

    /// The property at `index`.
    ///
    /// # Errors
    /// When its text does not fit its type or range.
    pub fn property<T: PropertyValue>(&self, index: usize) -> Result<T, ComponentError> {
        let decl = &self.properties[index];
        let text = self.args.properties.get(index).copied().unwrap_or(RStr::empty());
        read_property(decl, text.as_str().trim())
    }
}

fn read_property<T: PropertyValue>(decl: &PropertyDecl, text: &str) -> Result<T, ComponentError> {
    let name = decl.name;
    let value =
        T::parse(text).ok_or_else(|| crate::fault!("property `{name}`: `{text}` is no {}", T::KIND.opros_name()))?;
    match value.number() {
        Some(number) if !(decl.min..=decl.max).contains(&number) => Err(crate::fault!(
            "property `{name}`: {text} is outside {}..={}{}{}",
            decl.min,
            decl.max,
            if decl.unit.is_empty() { "" } else { " " },
            decl.unit
        )),
        _ => Ok(value),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decl(min: f64, max: f64) -> PropertyDecl {
        PropertyDecl {
            name: RStr::from_str("clearance"),
            kind: PropertyKind::Number,
            default: RStr::from_str("1"),
            unit: RStr::from_str("m"),
            min,
            max,
            description: RStr::from_str(""),
        }
    }

    #[test]
    fn a_value_outside_its_range_names_range_and_unit() {
        let error = read_property::<f64>(&decl(0.0, 2.0), "3.5").unwrap_err();
        assert_eq!(error.to_string(), "property `clearance`: 3.5 is outside 0..=2 m");
    }

    #[test]
    fn not_a_number_is_in_no_range() {
        assert!(read_property::<f64>(&decl(f64::NEG_INFINITY, f64::INFINITY), "NaN").is_err());
    }

    #[test]
    fn texts_are_read_by_type() {
        assert!(read_property::<bool>(&decl(0.0, 0.0), "True").unwrap());
        assert!(read_property::<i64>(&decl(0.0, 9.0), "5.0").is_err());
        assert_eq!(read_property::<String>(&decl(0.0, 0.0), "/dev/ttyUSB0").unwrap(), "/dev/ttyUSB0");
    }
}
