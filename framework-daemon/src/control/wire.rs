//! Varlink's wire form: a JSON object and a NUL byte, either way. Pure: bytes in, messages out.
//!
//! The `varlink` crate was looked at first: it brings threads of its own and generated code, for what is a search for a
//! zero byte.

use serde_json::{Map, Value, json};

/// Bytes that came, until they are messages.
#[derive(Debug)]
pub struct Inbox {
    bytes: Vec<u8>,
    /// No NUL byte lies before.
    searched: usize,
    limit: usize,
}

/// A message is longer than it may be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooLong {
    /// What it may have, in bytes.
    pub limit: usize,
}

impl Inbox {
    /// Takes messages of at most `limit` bytes.
    #[must_use]
    pub const fn new(limit: usize) -> Self {
        Self { bytes: Vec::new(), searched: 0, limit }
    }

    /// Takes bytes in.
    pub fn put(&mut self, bytes: &[u8]) {
        self.bytes.extend_from_slice(bytes);
    }

    /// The next message, without its NUL byte; `None`: it is not complete.
    ///
    /// # Errors
    /// When it is too long. Nothing that follows can be told apart then.
    pub fn take(&mut self) -> Result<Option<Vec<u8>>, TooLong> {
        let end = self.bytes.iter().skip(self.searched).position(|byte| *byte == 0).map(|at| self.searched + at);
        self.searched = end.unwrap_or(self.bytes.len());
        if self.searched > self.limit {
            return Err(TooLong { limit: self.limit });
        }
        let Some(end) = end else { return Ok(None) };
        let rest = self.bytes.split_off(end + 1);
        let mut message = std::mem::replace(&mut self.bytes, rest);
        message.pop();
        self.searched = 0;
        Ok(Some(message))
    }

    /// A message waits, or what is too long for one.
    #[must_use]
    pub fn has_message(&self) -> bool {
        self.bytes.len() > self.limit || self.bytes.iter().skip(self.searched).any(|byte| *byte == 0)
    }
}

/// A method call.
#[derive(Clone, Debug, PartialEq)]
pub struct Call {
    /// Full name of the method, with its interface.
    pub method: String,
    /// Its parameters.
    pub parameters: Map<String, Value>,
    /// The caller takes more than one reply.
    pub more: bool,
    /// The caller takes no reply.
    pub oneway: bool,
}

impl Call {
    /// Reads a message.
    ///
    /// # Errors
    /// In words, when it is no method call.
    pub fn parse(message: &[u8]) -> Result<Self, String> {
        let value = serde_json::from_slice(message).map_err(|error| format!("no JSON: {error}"))?;
        let Value::Object(mut fields) = value else { return Err("no JSON object".to_owned()) };
        let Some(Value::String(method)) = fields.remove("method") else {
            return Err("`method` must be there and be a text".to_owned());
        };
        let parameters = match fields.remove("parameters") {
            None | Some(Value::Null) => Map::new(),
            Some(Value::Object(parameters)) => parameters,
            Some(_) => return Err("`parameters` must be an object".to_owned()),
        };
        let mut flag = |name: &str| match fields.remove(name) {
            None | Some(Value::Null) => Ok(false),
            Some(Value::Bool(flag)) => Ok(flag),
            Some(_) => Err(format!("`{name}` must be true or false")),
        };
        let (more, oneway, upgrade) = (flag("more")?, flag("oneway")?, flag("upgrade")?);
        if upgrade {
            return Err("`upgrade` is not offered".to_owned());
        }
        Ok(Self { method, parameters, more, oneway })
    }

    /// The call as it is sent.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut fields = json!({"method": self.method, "parameters": self.parameters});
        for (name, _) in [("more", self.more), ("oneway", self.oneway)].into_iter().filter(|(_, is_set)| *is_set) {
            fields[name] = true.into();
        }
        framed(&fields)
    }
}

/// A reply as it is sent.
#[must_use]
pub fn reply(parameters: &Value, continues: bool) -> Vec<u8> {
    framed(&if continues {
        json!({"parameters": parameters, "continues": true})
    } else {
        json!({"parameters": parameters})
    })
}

/// An error as it is sent.
#[must_use]
pub fn error(name: &str, parameters: &Value) -> Vec<u8> {
    framed(&json!({"error": name, "parameters": parameters}))
}

/// JSON text holds no NUL byte: inside strings it is written as an escape.
fn framed(value: &Value) -> Vec<u8> {
    let mut bytes = value.to_string().into_bytes();
    bytes.push(0);
    bytes
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const LIMIT: usize = 40;

    /// What a reader that has everything at once would find.
    fn model(bytes: &[u8]) -> (Vec<Vec<u8>>, bool) {
        let mut messages = Vec::new();
        let mut parts = bytes.split(|byte| *byte == 0).peekable();
        while let Some(part) = parts.next() {
            if part.len() > LIMIT {
                return (messages, true);
            }
            if parts.peek().is_some() {
                messages.push(part.to_vec());
            }
        }
        (messages, false)
    }

    fn read(inbox: &mut Inbox, messages: &mut Vec<Vec<u8>>) -> bool {
        loop {
            match inbox.take() {
                Ok(Some(message)) => messages.push(message),
                Ok(None) => return false,
                Err(TooLong { limit }) => {
                    assert_eq!(limit, LIMIT);
                    return true;
                }
            }
        }
    }

    proptest! {
        /// Bytes that come in any pieces are the same messages, and the first that is too long ends it.
        #[test]
        fn pieces_do_not_matter(
            bytes in prop::collection::vec(prop_oneof![1 => Just(0u8), 12 => any::<u8>()], 0..400),
            cuts in prop::collection::vec(1..50usize, 1..40),
        ) {
            let (mut inbox, mut messages, mut too_long) = (Inbox::new(LIMIT), Vec::new(), false);
            let (mut rest, mut cuts) = (bytes.as_slice(), cuts.iter().cycle());
            while !rest.is_empty() && !too_long {
                let (piece, after) = rest.split_at(rest.len().min(*cuts.next().unwrap()));
                inbox.put(piece);
                too_long = read(&mut inbox, &mut messages);
                rest = after;
            }
            prop_assert_eq!((messages, too_long), model(&bytes));
        }

        /// A call is read back as it was sent, whatever is in it, NUL bytes too.
        #[test]
        fn a_call_is_read_back(method in ".*", key in ".*", text in "[\\x00-\\x7f]*", more: bool, oneway: bool) {
            let parameters = Map::from_iter([(key, Value::from(text))]);
            let call = Call { method, parameters, more, oneway };
            let mut inbox = Inbox::new(1 << 20);
            inbox.put(&call.to_bytes());
            let message = inbox.take().unwrap().unwrap();
            prop_assert!(!inbox.has_message());
            prop_assert_eq!(Call::parse(&message), Ok(call));
        }

        /// No bytes are too wild for the parser; what it takes is a call again.
        #[test]
        fn no_message_is_too_wild(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            if let Ok(call) = Call::parse(&bytes) {
                prop_assert!(!call.to_bytes().is_empty());
            }
        }

        /// Nor is any JSON with the right names and the wrong types.
        #[test]
        fn no_call_is_too_wild(fields in prop::collection::btree_map(
            prop_oneof![Just("method"), Just("parameters"), Just("more"), Just("oneway"), Just("upgrade"), Just("else")],
            prop_oneof![Just(json!(null)), Just(json!(true)), Just(json!(7)), Just(json!("a.b.C")), Just(json!([])), Just(json!({"slot": 1}))],
            0..6,
        )) {
            let right = |name: &str, test: fn(&Value) -> bool| fields.get(name).is_none_or(|value| value.is_null() || test(value));
            let is_call = fields.get("method").is_some_and(Value::is_string)
                && right("parameters", Value::is_object)
                && ["more", "oneway"].iter().all(|name| right(name, Value::is_boolean))
                && right("upgrade", |_| false);
            prop_assert_eq!(Call::parse(json!(fields).to_string().as_bytes()).is_ok(), is_call);
        }
    }

    #[test]
    fn a_message_of_exactly_the_limit_is_taken_and_one_byte_more_is_not() {
        for (length, fits) in [(LIMIT, true), (LIMIT + 1, false)] {
            let mut inbox = Inbox::new(LIMIT);
            inbox.put(&vec![b'x'; length]);
            inbox.put(&[0]);
            assert_eq!(inbox.take().is_ok(), fits);
        }
    }

    #[test]
    fn deep_nesting_is_refused_and_not_followed() {
        let deep = format!("{{\"method\":\"a\",\"parameters\":{}{}}}", "[".repeat(100_000), "]".repeat(100_000));
        assert!(Call::parse(deep.as_bytes()).unwrap_err().contains("recursion"));
    }

    #[test]
    fn replies_and_errors_are_one_message_each() {
        let replies = [reply(&json!({"a": "\u{0}"}), true), reply(&json!({}), false), error("a.B", &json!({}))];
        for bytes in replies {
            assert_eq!(bytes.iter().position(|byte| *byte == 0), Some(bytes.len() - 1));
        }
        assert_eq!(reply(&json!({"a": 1}), false), b"{\"parameters\":{\"a\":1}}\0");
    }
}
