//! What the verbs that ask a running daemon have in common: options, the call, and how refusals are told.

use std::io::{self, Write};
use std::ops::ControlFlow;
use std::os::fd::AsFd;
use std::path::PathBuf;

use clap::Args;
use serde_json::{Map, Value, json};

use super::Format;
use super::exit_code::Exit;
use crate::control::client::{CallError, Client};
use crate::control::views::{cell, table};
use crate::sys::streams;

/// Options of every verb that asks a running daemon.
#[derive(Debug, Args)]
pub struct Remote {
    /// Control socket of the daemon
    /// [default: $XDG_RUNTIME_DIR/framework-daemon/control.sock, else /run/framework-daemon/control.sock].
    #[arg(long, value_name = "PATH")]
    pub socket: Option<PathBuf>,
    /// How answers are printed; json: one object a line.
    #[arg(long, value_enum, default_value_t)]
    pub format: Format,
}

impl Remote {
    /// Calls a method and prints its answer: as it is, or as `text` has it.
    ///
    /// # Errors
    /// Only those of writing.
    pub fn ask(
        &self,
        method: &str,
        parameters: Map<String, Value>,
        out: &mut impl Write,
        text: impl FnOnce(&Value) -> Vec<String>,
    ) -> io::Result<Exit> {
        let answer = self.connect().and_then(|mut client| client.call(method, parameters));
        self.finish(answer, out, |answer| self.lines(std::slice::from_ref(answer), |_| text(answer)))
    }

    /// As [`Self::ask`], for a method that takes its time.
    ///
    /// # Errors
    /// Only those of writing.
    pub fn ask_patiently(
        &self,
        method: &str,
        parameters: Map<String, Value>,
        out: &mut impl Write,
        text: impl FnOnce(&Value) -> Vec<String>,
    ) -> io::Result<Exit> {
        let answer = self.connect().and_then(|mut client| client.call_patiently(method, parameters));
        self.finish(answer, out, |answer| self.lines(std::slice::from_ref(answer), |_| text(answer)))
    }

    /// Calls a method whose answer is a list in `field`, and prints it: an object a line, or as `text` has them.
    ///
    /// # Errors
    /// Only those of writing.
    pub fn list(
        &self,
        method: &str,
        parameters: Map<String, Value>,
        field: &str,
        out: &mut impl Write,
        text: impl FnOnce(&[Value]) -> Vec<String>,
    ) -> io::Result<Exit> {
        let answer = self.connect().and_then(|mut client| client.call(method, parameters));
        self.finish(answer, out, |answer| {
            self.lines(answer[field].as_array().map(Vec::as_slice).unwrap_or_default(), text)
        })
    }

    /// Calls a method that answers again and again, and prints a line for each answer, at most `count`, as long as anybody reads
    /// standard output.
    ///
    /// # Errors
    /// Only those of writing; standard output was closed before the process began.
    pub fn follow(
        &self,
        method: &str,
        parameters: Map<String, Value>,
        count: Option<u64>,
        out: &mut impl Write,
        text: impl Fn(&Value) -> String,
    ) -> io::Result<Exit> {
        if streams::output_was_closed() {
            return Err(io::Error::other("standard output is closed"));
        }
        let (mut left, mut written) = (count.unwrap_or(u64::MAX), Ok(()));
        let each = |answer: &Value| {
            let line = if self.format == Format::Json { answer.to_string() } else { text(answer) };
            written = writeln!(out, "{line}").and_then(|()| out.flush());
            left = left.saturating_sub(1);
            if left == 0 || written.is_err() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let called =
            self.connect().and_then(|mut client| client.stream(method, parameters, io::stdout().as_fd(), each));
        written?;
        self.finish(called, out, |()| Vec::new())
    }

    /// Calls a method whose answer is a list in `field`, and prints what `pick` makes of it, as it is or as `text` has it; why it
    /// makes nothing of it, on stderr.
    ///
    /// # Errors
    /// Only those of writing.
    pub fn pick(
        &self,
        method: &str,
        parameters: Map<String, Value>,
        field: &str,
        out: &mut impl Write,
        pick: impl FnOnce(&[Value]) -> Result<Value, String>,
        text: impl FnOnce(&Value) -> Vec<String>,
    ) -> io::Result<Exit> {
        let answer = self.connect().and_then(|mut client| client.call(method, parameters));
        let picked = answer.and_then(|answer| {
            let picked = pick(answer[field].as_array().map(Vec::as_slice).unwrap_or_default());
            let refused = |reason| CallError::Refused { name: String::new(), parameters: json!({"reason": reason}) };
            picked.map_err(refused)
        });
        self.finish(picked, out, |picked| self.lines(std::slice::from_ref(picked), |_| text(picked)))
    }

    fn connect(&self) -> Result<Client, CallError> {
        Client::connect(self.socket.as_deref())
    }

    /// One line an object for programs, or what people read.
    fn lines(&self, objects: &[Value], text: impl FnOnce(&[Value]) -> Vec<String>) -> Vec<String> {
        match self.format {
            Format::Json => objects.iter().map(Value::to_string).collect(),
            Format::Text => text(objects),
        }
    }

    /// Prints an answer, or tells on stderr why there is none.
    fn finish<A>(
        &self,
        answer: Result<A, CallError>,
        out: &mut impl Write,
        lines: impl FnOnce(&A) -> Vec<String>,
    ) -> io::Result<Exit> {
        let mut err = io::stderr();
        match answer {
            Ok(answer) => lines(&answer).iter().try_for_each(|line| writeln!(out, "{line}")).map(|()| Exit::Done),
            Err(CallError::Unreachable(reason)) => {
                writeln!(err, "framework-daemon: {reason}").map(|()| Exit::Unreachable)
            }
            Err(CallError::Refused { name, parameters }) => {
                let lines = refusal(&name, &parameters);
                let exit = if name.ends_with(".EmergencyLatched") { Exit::Emergency } else { Exit::Refused };
                lines.iter().try_for_each(|line| writeln!(err, "{line}")).map(|()| exit)
            }
        }
    }
}

/// A refusal in words: all that is wrong, then what follows.
fn refusal(name: &str, parameters: &Value) -> Vec<String> {
    let reasons = parameters["reasons"].as_array().into_iter().flatten().map(cell);
    let short = name.rsplit('.').next().unwrap_or(name);
    let reason = match (short, parameters["reason"].as_str()) {
        (_, Some(reason)) => reason.to_owned(),
        ("MethodNotFound" | "InterfaceNotFound", _) => {
            format!("the daemon is of another version: it does not know this ({short})")
        }
        ("InvalidParameter", _) => format!("`{}` is not as it must be", cell(&parameters["parameter"])),
        _ => format!("{name} {parameters}"),
    };
    reasons.chain([format!("refused by the daemon: {reason}")]).collect()
}

/// Parameters by name; those that are not there are left out.
#[must_use]
pub(super) fn parameters<const N: usize>(fields: [(&str, Option<Value>); N]) -> Map<String, Value> {
    fields.into_iter().filter_map(|(name, value)| Some((name.to_owned(), value?))).collect()
}

/// Named fields of an object, a line each.
#[must_use]
pub(super) fn fields(object: &Value, names: &[&str]) -> Vec<String> {
    let width = names.iter().map(|name| name.len()).max().unwrap_or_default();
    names.iter().map(|name| format!("{name:<width$}  {}", cell(&object[*name]))).collect()
}

/// A table below a heading, indented; nothing where there are no rows.
#[must_use]
pub(super) fn section(heading: &str, columns: &[&str], rows: &[Value]) -> Vec<String> {
    if rows.is_empty() {
        return Vec::new();
    }
    let lines = table(columns, rows).into_iter().map(|line| format!("  {line}"));
    std::iter::once(heading.to_owned()).chain(lines).collect()
}

/// `slot.port`; a slot's name may have dots itself.
///
/// # Errors
/// When it is not written so.
pub(super) fn port_name(text: &str) -> Result<(String, String), String> {
    match text.rsplit_once('.') {
        Some((slot, port)) if !slot.is_empty() && !port.is_empty() => Ok((slot.to_owned(), port.to_owned())),
        _ => Err("write it as SLOT.PORT, as in motors.command".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_port_is_the_part_behind_the_last_dot() {
        assert_eq!(port_name("head.inner.scan"), Ok(("head.inner".into(), "scan".into())));
        assert!(["scan", ".scan", "head.", ""].iter().all(|text| port_name(text).is_err()));
    }

    #[test]
    fn every_refusal_has_words() {
        let told = |name: &str, parameters| refusal(name, &parameters).join("|");
        assert_eq!(told("a.NoSuchPort", json!({"reason": "why"})), "refused by the daemon: why");
        assert_eq!(
            told("a.ReloadRefused", json!({"reasons": ["x:1:2: error: y"], "reason": "all as it was"})),
            "x:1:2: error: y|refused by the daemon: all as it was"
        );
        assert!(told("org.varlink.service.MethodNotFound", json!({"method": "m"})).contains("another version"));
        assert!(
            told("org.varlink.service.InvalidParameter", json!({"parameter": "window_ms"})).contains("`window_ms`")
        );
        assert!(told("a.Strange", json!({"x": 1})).contains("a.Strange {\"x\":1}"));
    }
}
