//! What the name of a service port stands for: one port, or one for each method of an interface, which are wired at once.

use std::sync::Arc;

use super::objects::Objects;
use super::provider::Provider;
use super::requestor::Requestor;

/// A port of a service.
pub trait Part {
    /// Its name, `motors/drive` where it is a method.
    fn name(&self) -> &str;

    /// What goes over it.
    fn objects(&self) -> Objects;
}

impl Part for Requestor {
    fn name(&self) -> &str {
        &self.name
    }

    fn objects(&self) -> Objects {
        self.objects
    }
}

impl Part for Provider {
    fn name(&self) -> &str {
        &self.name
    }

    fn objects(&self) -> Objects {
        self.objects
    }
}

impl<P: Part> Part for Arc<P> {
    fn name(&self) -> &str {
        self.as_ref().name()
    }

    fn objects(&self) -> Objects {
        self.as_ref().objects()
    }
}

/// The method of a port of that service; empty: it is the port itself. `None`: it is another port.
fn method<'a>(port: &'a str, service: &str) -> Option<&'a str> {
    match port.strip_prefix(service)? {
        "" => Some(""),
        rest => rest.strip_prefix('/'),
    }
}

/// The ports of one service, each with its method.
pub struct Bundle<'a, P>(Vec<(&'a str, &'a P)>);

impl<'a, P: Part> Bundle<'a, P> {
    /// The ports that this name stands for; `None`: there are none.
    pub fn find(ports: impl IntoIterator<Item = &'a P>, service: &str) -> Option<Self> {
        let parts = ports.into_iter().filter_map(|port| Some((method(port.name(), service)?, port)));
        let parts: Vec<_> = parts.collect();
        if parts.is_empty() { None } else { Some(Self(parts)) }
    }

    /// Its ports.
    pub fn ports(&self) -> impl Iterator<Item = &'a P> {
        self.0.iter().map(|(_, port)| *port)
    }

    fn part(&self, method: &str) -> Option<&'a P> {
        self.0.iter().find(|(known, _)| *known == method).map(|(_, port)| *port)
    }

    fn is_single(&self) -> bool {
        self.0.iter().all(|(method, _)| method.is_empty())
    }

    fn methods(&self) -> String {
        self.0.iter().map(|(method, _)| *method).collect::<Vec<_>>().join(", ")
    }
}

/// Why a client and a server do not fit: what each of them does, and the difference.
#[derive(Debug, PartialEq, Eq)]
pub struct Mismatch {
    /// What the client does.
    pub asked: String,
    /// What the server does.
    pub served: String,
    /// Where they differ.
    pub difference: String,
}

/// Each of the client's ports with its server. A server may have more methods than its client calls.
///
/// # Errors
/// A method is missing, or is another one at the server.
pub fn pair<'a, C: Part, S: Part>(
    client: &Bundle<'a, C>,
    server: &Bundle<'a, S>,
) -> Result<Vec<(&'a C, &'a S)>, Mismatch> {
    let pairs = client.0.iter().map(|(method, port)| {
        let found = server.part(method).ok_or_else(|| missing(method, client, server))?;
        match port.objects().difference(&found.objects()) {
            None => Ok((*port, found)),
            Some(difference) => Err(Mismatch {
                asked: port.objects().asked(),
                served: found.objects().served(),
                difference: if method.is_empty() { difference } else { format!("method `{method}`: {difference}") },
            }),
        }
    });
    pairs.collect()
}

fn missing<C: Part, S: Part>(method: &str, client: &Bundle<'_, C>, server: &Bundle<'_, S>) -> Mismatch {
    let first = |objects: Option<Objects>, say: fn(&Objects) -> String| objects.as_ref().map(say).unwrap_or_default();
    let asked = if client.is_single() {
        first(client.ports().next().map(Part::objects), Objects::asked)
    } else {
        format!("calls {}", client.methods())
    };
    let served = if server.is_single() {
        first(server.ports().next().map(Part::objects), Objects::served)
    } else {
        format!("has {}", server.methods())
    };
    let difference = if client.is_single() || server.is_single() {
        "one is a service of methods, the other a port of its own".to_owned()
    } else {
        format!("method `{method}` is missing at the server")
    };
    Mismatch { asked, served, difference }
}

#[cfg(test)]
mod tests {
    use component_sdk::object::{CommObject, TypeDescriptor};

    use super::*;

    struct Port(&'static str, Objects);

    impl Part for Port {
        fn name(&self) -> &str {
            self.0
        }

        fn objects(&self) -> Objects {
            self.1
        }
    }

    fn query(name: &'static str, answer: &'static TypeDescriptor) -> Port {
        Port(name, Objects { request: f64::DESCRIPTOR, answer: Some(answer) })
    }

    fn send(name: &'static str) -> Port {
        Port(name, Objects { request: f64::DESCRIPTOR, answer: None })
    }

    fn paired(client: &[Port], server: &[Port]) -> Result<Vec<&'static str>, String> {
        let (client, server) = (Bundle::find(client, "motors").unwrap(), Bundle::find(server, "motors").unwrap());
        let pairs = pair(&client, &server)
            .map_err(|Mismatch { asked, served, difference }| format!("{asked}, {served}: {difference}"))?;
        Ok(pairs.into_iter().map(|(client, _)| client.0).collect())
    }

    #[test]
    fn a_name_stands_for_one_port_or_for_its_methods() {
        let ports = [send("motors/beep"), send("motorsport"), send("motor"), send("motors/drive"), send("brake")];
        let methods = |name: &str| Bundle::find(&ports, name).map(|found| found.methods());
        assert_eq!(methods("motors").as_deref(), Some("beep, drive"));
        assert_eq!(methods("brake").as_deref(), Some(""));
        assert_eq!(methods("motors/drive").as_deref(), Some(""), "one method may be wired by itself");
        assert_eq!(methods("wheel"), None);
    }

    #[test]
    fn a_server_may_have_more_and_must_have_the_same() {
        let server = [query("motors/drive", u64::DESCRIPTOR), send("motors/beep"), send("motors/more")];
        assert_eq!(paired(&[send("motors/beep"), query("motors/drive", u64::DESCRIPTOR)], &server).unwrap().len(), 2);
        let refused = |client: &[Port]| paired(client, &server).unwrap_err();
        let text = refused(&[send("motors/stop")]);
        assert_eq!(text, "calls stop, has drive, beep, more: method `stop` is missing at the server");
        let text = refused(&[query("motors/drive", f32::DESCRIPTOR)]);
        assert!(
            text.contains("asks double for float, answers double with uint64_t: method `drive`: the answer"),
            "{text}"
        );
        assert!(
            refused(&[query("motors/beep", u64::DESCRIPTOR)]).contains("method `beep`: the client waits for an answer")
        );
        assert!(
            refused(&[send("motors")]).contains("sends double, has drive, beep, more: one is a service of methods")
        );
    }
}
