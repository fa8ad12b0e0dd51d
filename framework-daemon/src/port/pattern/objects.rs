//! What goes over a connection of a service: a request and its answer, or a message, which has none.

use component_sdk::object::{CommObject, TypeDescriptor};

/// The objects of one end.
#[derive(Clone, Copy)]
pub struct Objects {
    /// The request, or the message.
    pub request: &'static TypeDescriptor,
    /// The answer; `None`: it is a message.
    pub answer: Option<&'static TypeDescriptor>,
}

impl Objects {
    /// True of messages.
    #[must_use]
    pub const fn is_one_way(&self) -> bool {
        self.answer.is_none()
    }

    /// The answer; nothing where there is none.
    #[must_use]
    pub fn answer(&self) -> &'static TypeDescriptor {
        self.answer.unwrap_or(<()>::DESCRIPTOR)
    }

    /// What a client with these objects does.
    #[must_use]
    pub fn asked(&self) -> String {
        match self.answer {
            Some(answer) => format!("asks {} for {}", self.request.name, answer.name),
            None => format!("sends {}", self.request.name),
        }
    }

    /// What a server with these objects does.
    #[must_use]
    pub fn served(&self) -> String {
        match self.answer {
            Some(answer) => format!("answers {} with {}", self.request.name, answer.name),
            None => format!("takes {}", self.request.name),
        }
    }

    /// Where these, a client's, differ from those of a server, in words.
    #[must_use]
    pub fn difference(&self, server: &Self) -> Option<String> {
        match (self.is_one_way(), server.is_one_way()) {
            (true, false) => {
                return Some("the client waits for no answer (send), the server gives one (query)".to_owned());
            }
            (false, true) => {
                return Some("the client waits for an answer (query), the server gives none (send)".to_owned());
            }
            _ => {}
        }
        let what = if self.is_one_way() { "message" } else { "request" };
        let parts = [(what, self.request, server.request), ("answer", self.answer(), server.answer())];
        parts.into_iter().find_map(|(part, asked, served)| {
            let difference = asked.difference(served)?;
            Some(format!(
                "the {part} is {} at the client and {} at the server, and their layouts differ: {difference}",
                asked.name, served.name
            ))
        })
    }
}
