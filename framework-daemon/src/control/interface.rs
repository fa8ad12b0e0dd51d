//! What may be asked: the interfaces in varlink's own language, each method with its parameters, and how it is refused.

use std::time::Duration;

use serde_json::{Map, Value, json};

use super::wire::Call;
use crate::fault::order::{Refused, Verb};
use crate::model::limits::{FEED_LINES, RATE_WINDOW_MAX, RATE_WINDOW_MIN};

/// The daemon's own interface.
pub const OWN: &str = "io.frameworkdaemon";

/// The interface of every varlink service.
pub const SERVICE: &str = "org.varlink.service";

/// Interfaces with their descriptions.
pub const INTERFACES: [(&str, &str); 2] =
    [(SERVICE, include_str!("org.varlink.service.varlink")), (OWN, include_str!("io.frameworkdaemon.varlink"))];

/// Lines that [`Method::ListFaults`] gives where it is not told how many.
const FAULTS_DEFAULT: usize = 100;

/// Time over which a rate is measured where nothing else is asked.
const WINDOW_DEFAULT: Duration = Duration::from_secs(1);

/// A slot and one of its ports.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PortName {
    /// The slot.
    pub slot: String,
    /// The port.
    pub port: String,
}

/// What is asked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Method {
    /// Who this is.
    GetInfo,
    /// An interface in words.
    GetInterfaceDescription(String),
    /// How everything is.
    Status,
    /// All slots.
    ListComponents,
    /// All of one slot.
    DescribeComponent(String),
    /// Ports, of one slot or of all.
    ListPorts(Option<String>),
    /// All of one port.
    DescribePort(PortName),
    /// The rate of a port.
    Hz(PortName, Duration),
    /// The values that pass a port.
    Echo(PortName),
    /// Faults that are kept: of one slot or of all, and how many.
    ListFaults(Option<String>, usize),
    /// Faults as they come: of one slot or of all, and how many of those before.
    Follow(Option<String>, usize),
    /// Read the profiles again.
    Reload,
    /// Do that to a slot, or take the emergency stop back.
    Order(Verb, String),
    /// Connect two ports.
    Connect(PortName, PortName),
    /// Cut the connections of a port.
    Disconnect(PortName),
}

/// Why a call is refused.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// There is no such interface.
    InterfaceNotFound(String),
    /// There is no such method.
    MethodNotFound(String),
    /// A parameter is missing, has the wrong type or is unknown.
    InvalidParameter(String),
    /// The method answers only whoever takes more than one reply.
    ExpectedMore,
    /// There is no such slot.
    NoSuchComponent(String, String),
    /// There is no such port.
    NoSuchPort(PortName, String),
    /// The port has no rate that could be measured.
    NotMeasurable(PortName, String),
    /// Ports are not connected, or not disconnected: the status, and why.
    WiringRefused(PortName, u32, String),
    /// The new profiles are not taken.
    ReloadRefused(Vec<String>),
    /// What was ordered is not done.
    OrderRefused(String),
    /// The emergency stop is latched.
    EmergencyLatched(String),
    /// It is no call.
    BadRequest(String),
    /// Too many clients are there.
    TooManyClients(String),
    /// The caller is a stranger.
    NotPermitted(String),
}

impl Refusal {
    /// Of an order.
    #[must_use]
    pub fn of_order(refused: Refused) -> Self {
        match refused {
            Refused::NoSuchSlot(slot) => {
                let reason = format!("there is no slot `{slot}`; `component list` shows all");
                Self::NoSuchComponent(slot, reason)
            }
            Refused::Latched(reason) => Self::EmergencyLatched(reason),
            Refused::Busy(reason) | Refused::Other(reason) => Self::OrderRefused(reason),
        }
    }

    /// Its name on the wire.
    #[must_use]
    pub fn name(&self) -> String {
        let (interface, name) = match self {
            Self::InterfaceNotFound(_) => (SERVICE, "InterfaceNotFound"),
            Self::MethodNotFound(_) => (SERVICE, "MethodNotFound"),
            Self::InvalidParameter(_) => (SERVICE, "InvalidParameter"),
            Self::ExpectedMore => (SERVICE, "ExpectedMore"),
            Self::NoSuchComponent(..) => (OWN, "NoSuchComponent"),
            Self::NoSuchPort(..) => (OWN, "NoSuchPort"),
            Self::NotMeasurable(..) => (OWN, "NotMeasurable"),
            Self::WiringRefused(..) => (OWN, "WiringRefused"),
            Self::ReloadRefused(_) => (OWN, "ReloadRefused"),
            Self::OrderRefused(_) => (OWN, "OrderRefused"),
            Self::EmergencyLatched(_) => (OWN, "EmergencyLatched"),
            Self::BadRequest(_) => (OWN, "BadRequest"),
            Self::TooManyClients(_) => (OWN, "TooManyClients"),
            Self::NotPermitted(_) => (OWN, "NotPermitted"),
        };
        format!("{interface}.{name}")
    }

    /// Its parameters on the wire.
    #[must_use]
    pub fn parameters(&self) -> Value {
        match self {
            Self::InterfaceNotFound(interface) => json!({"interface": interface}),
            Self::MethodNotFound(method) => json!({"method": method}),
            Self::InvalidParameter(parameter) => json!({"parameter": parameter}),
            Self::ExpectedMore => json!({}),
            Self::NoSuchComponent(slot, reason) => json!({"slot": slot, "reason": reason}),
            Self::NoSuchPort(PortName { slot, port }, reason)
            | Self::NotMeasurable(PortName { slot, port }, reason) => {
                json!({"slot": slot, "port": port, "reason": reason})
            }
            Self::WiringRefused(PortName { slot, port }, status, reason) => {
                json!({"slot": slot, "port": port, "status": status, "reason": reason})
            }
            Self::ReloadRefused(reasons) => {
                json!({"reasons": reasons, "reason": "not reloaded: everything runs on as it was"})
            }
            Self::OrderRefused(reason)
            | Self::EmergencyLatched(reason)
            | Self::BadRequest(reason)
            | Self::TooManyClients(reason)
            | Self::NotPermitted(reason) => {
                json!({"reason": reason})
            }
        }
    }
}

impl Method {
    /// What a call asks.
    ///
    /// # Errors
    /// When it is not offered, or its parameters are not as described.
    pub fn of(call: &Call) -> Result<Self, Refusal> {
        let unknown = || Refusal::MethodNotFound(call.method.clone());
        let (interface, name) = call.method.rsplit_once('.').ok_or_else(unknown)?;
        if INTERFACES.iter().all(|(known, _)| *known != interface) {
            return Err(Refusal::InterfaceNotFound(interface.to_owned()));
        }
        let mut fields = Fields(call.parameters.clone());
        let method = match (interface, name) {
            (SERVICE, "GetInfo") => Self::GetInfo,
            (SERVICE, "GetInterfaceDescription") => Self::GetInterfaceDescription(fields.text("interface")?),
            (OWN, "Status") => Self::Status,
            (OWN, "ListComponents") => Self::ListComponents,
            (OWN, "DescribeComponent") => Self::DescribeComponent(fields.text("slot")?),
            (OWN, "ListPorts") => Self::ListPorts(fields.text_if_any("slot")?),
            (OWN, "DescribePort") => Self::DescribePort(fields.port()?),
            (OWN, "Hz") => Self::Hz(fields.port()?, fields.window()?),
            (OWN, "Echo") => Self::Echo(fields.port()?),
            (OWN, "ListFaults") => Self::ListFaults(fields.text_if_any("slot")?, fields.last(FAULTS_DEFAULT)?),
            (OWN, "Follow") => Self::Follow(fields.text_if_any("slot")?, fields.last(0)?),
            (OWN, "Reload") => Self::Reload,
            (OWN, "StartComponent") => Self::Order(Verb::Start, fields.text("slot")?),
            (OWN, "StopComponent") => Self::Order(Verb::Stop, fields.text("slot")?),
            (OWN, "ResetComponent") => Self::Order(Verb::Reset, fields.text("slot")?),
            (OWN, "ClearEmergency") => Self::Order(Verb::Clear, String::new()),
            (OWN, "Connect") => {
                let to =
                    |fields: &mut Fields| Ok(PortName { slot: fields.text("to_slot")?, port: fields.text("to_port")? });
                Self::Connect(fields.port()?, to(&mut fields)?)
            }
            (OWN, "Disconnect") => Self::Disconnect(fields.port()?),
            _ => return Err(unknown()),
        };
        match fields.0.into_iter().next() {
            Some((stranger, _)) => Err(Refusal::InvalidParameter(stranger)),
            None if matches!(method, Self::Follow(..) | Self::Echo(_)) && !call.more => Err(Refusal::ExpectedMore),
            None => Ok(method),
        }
    }
}

/// Parameters that are taken out one by one, so that those nobody knows are left.
struct Fields(Map<String, Value>);

impl Fields {
    fn take(&mut self, name: &str) -> Option<Value> {
        self.0.remove(name).filter(|value| !value.is_null())
    }

    fn text_if_any(&mut self, name: &str) -> Result<Option<String>, Refusal> {
        match self.take(name) {
            None => Ok(None),
            Some(Value::String(text)) => Ok(Some(text)),
            Some(_) => Err(Refusal::InvalidParameter(name.to_owned())),
        }
    }

    fn text(&mut self, name: &str) -> Result<String, Refusal> {
        self.text_if_any(name)?.ok_or_else(|| Refusal::InvalidParameter(name.to_owned()))
    }

    fn port(&mut self) -> Result<PortName, Refusal> {
        Ok(PortName { slot: self.text("slot")?, port: self.text("port")? })
    }

    fn number(&mut self, name: &str) -> Result<Option<u64>, Refusal> {
        let Some(value) = self.take(name) else { return Ok(None) };
        value.as_u64().map(Some).ok_or_else(|| Refusal::InvalidParameter(name.to_owned()))
    }

    fn last(&mut self, default: usize) -> Result<usize, Refusal> {
        let last = self.number("last")?.map_or(default, |last| usize::try_from(last).unwrap_or(FEED_LINES));
        Ok(last.min(FEED_LINES))
    }

    fn window(&mut self) -> Result<Duration, Refusal> {
        let window = self.number("window_ms")?.map_or(WINDOW_DEFAULT, Duration::from_millis);
        let is_sound = (RATE_WINDOW_MIN..=RATE_WINDOW_MAX).contains(&window);
        is_sound.then_some(window).ok_or_else(|| Refusal::InvalidParameter("window_ms".to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn call(method: &str, parameters: &Value) -> Call {
        let parameters = parameters.as_object().cloned().unwrap_or_default();
        Call { method: method.to_owned(), parameters, more: true, oneway: false }
    }

    /// Words that follow `keyword` in a description.
    fn words<'a>(description: &'a str, keyword: &str) -> Vec<&'a str> {
        let lines = description.lines().filter_map(|line| line.strip_prefix(keyword));
        lines.filter_map(|line| line.split(['(', ' ']).find(|word| !word.is_empty())).collect()
    }

    #[test]
    fn every_described_method_is_offered() {
        let given = json!({"slot": "a", "port": "b", "to_slot": "c", "to_port": "d", "interface": OWN, "window_ms": 100, "last": 3});
        for (interface, description) in INTERFACES {
            assert!(description.contains(&format!("interface {interface}\n")));
            for line in description.lines().filter_map(|line| line.strip_prefix("method ")) {
                let (name, rest) = line.split_once('(').unwrap();
                let (taken, _) = rest.split_once(')').unwrap();
                let taken =
                    taken.split(", ").filter_map(|field| field.split(':').next()).filter(|name| !name.is_empty());
                let parameters = Map::from_iter(taken.map(|name| (name.to_owned(), given[name].clone())));
                let asked = call(&format!("{interface}.{name}"), &Value::Object(parameters));
                assert!(Method::of(&asked).is_ok(), "{asked:?}: {:?}", Method::of(&asked));
            }
        }
    }

    #[test]
    fn every_refusal_is_described_with_its_parameters() {
        let name = PortName { slot: "s".into(), port: "p".into() };
        let text = || "t".to_owned();
        let refusals = [
            Refusal::InterfaceNotFound(text()),
            Refusal::MethodNotFound(text()),
            Refusal::InvalidParameter(text()),
            Refusal::ExpectedMore,
            Refusal::NoSuchComponent(text(), text()),
            Refusal::NoSuchPort(name.clone(), text()),
            Refusal::NotMeasurable(name, text()),
            Refusal::WiringRefused(PortName { slot: text(), port: text() }, 14, text()),
            Refusal::ReloadRefused(vec![text()]),
            Refusal::OrderRefused(text()),
            Refusal::EmergencyLatched(text()),
            Refusal::BadRequest(text()),
            Refusal::TooManyClients(text()),
            Refusal::NotPermitted(text()),
        ];
        for refusal in refusals {
            let (full, parameters) = (refusal.name(), refusal.parameters());
            let (interface, error) = full.rsplit_once('.').unwrap();
            let description = INTERFACES.iter().find(|(known, _)| *known == interface).unwrap().1;
            assert!(words(description, "error ").contains(&error), "{full}");
            let line = description.lines().find(|line| line.starts_with(&format!("error {error} "))).unwrap();
            for field in parameters.as_object().unwrap().keys() {
                assert!(line.contains(&format!("{field}: ")), "{full}: {field}");
            }
        }
    }

    #[test]
    fn what_is_missing_wrong_or_unknown_is_named() {
        let refused = |method: &str, parameters: Value| Method::of(&call(method, &parameters)).unwrap_err();
        let invalid = |name: &str| Refusal::InvalidParameter(name.to_owned());
        assert_eq!(refused("io.frameworkdaemon.DescribeComponent", json!({})), invalid("slot"));
        assert_eq!(refused("io.frameworkdaemon.DescribePort", json!({"slot": "a", "port": 1})), invalid("port"));
        assert_eq!(refused("io.frameworkdaemon.Status", json!({"verbose": true})), invalid("verbose"));
        assert_eq!(refused("io.frameworkdaemon.ListFaults", json!({"last": -1})), invalid("last"));
        let hz = json!({"slot": "a", "port": "b", "window_ms": 1});
        assert_eq!(refused("io.frameworkdaemon.Hz", hz), invalid("window_ms"));
        assert_eq!(refused("io.other.Status", json!({})), Refusal::InterfaceNotFound("io.other".into()));
        assert_eq!(refused("Status", json!({})), Refusal::MethodNotFound("Status".into()));
        assert_eq!(refused("io.frameworkdaemon.status", json!({})).name(), "org.varlink.service.MethodNotFound");
        let follow = Call { more: false, ..call("io.frameworkdaemon.Follow", &json!({})) };
        assert_eq!(Method::of(&follow), Err(Refusal::ExpectedMore));
    }

    proptest! {
        /// Whatever is asked with whatever parameters, the answer is a method or a refusal with a name and parameters.
        #[test]
        fn no_call_is_too_wild(
            name in prop_oneof![
                "[A-Za-z.]{0,20}",
                prop::sample::select(vec!["Status", "Hz", "Echo", "Follow", "ListPorts", "DescribePort", "ListFaults", "Reload"])
                    .prop_map(|name| format!("{OWN}.{name}")),
            ],
            fields in prop::collection::btree_map(
                prop_oneof![Just("slot"), Just("port"), Just("last"), Just("window_ms"), Just("other")],
                prop_oneof![Just(json!(null)), any::<i64>().prop_map(Value::from), ".*".prop_map(Value::from), Just(json!([[]])), any::<f64>().prop_map(Value::from)],
                0..5,
            ),
            more: bool,
        ) {
            match Method::of(&Call { more, ..call(&name, &json!(fields)) }) {
                Ok(Method::Follow(_, last) | Method::ListFaults(_, last)) => prop_assert!(last <= FEED_LINES),
                Ok(Method::Hz(_, window)) => prop_assert!((RATE_WINDOW_MIN..=RATE_WINDOW_MAX).contains(&window)),
                Ok(_) => {}
                Err(refusal) => prop_assert!(refusal.name().contains('.') && refusal.parameters().is_object()),
            }
        }
    }
}
