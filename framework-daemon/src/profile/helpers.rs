//! Helpers that the framework inserts: models that slots are compared with, voters.
//!
//! Both are resolved here, while the assembly's names are known: a voter is a name that connections may begin at, a model is
//! connected with what feeds it. Nothing to the right knows that a profile did not say so itself.

use std::time::Duration;

use serde::Serialize;

use super::application::{Assembly, End, LEAST, ReferenceModel, Voting};
use super::assemble::{Assembler, Placed, Scope};
use super::plan::{ConnectionPlan, Location, Measure, PortKind, PortRef, SlotPlan, Trigger, VotingMethod};
use super::quantity::format_duration;
use super::source::{Spot, Word};
use super::suggest;
use super::wire::{Port, ports_of};
use crate::model::symptom::Severity;

/// A slot compared with a model of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReferenceModelPlan {
    /// What the model says: an output of the slot that is the model.
    pub model: PortRef,
    /// What it is compared with: an output of the slot that is to blame.
    pub target: PortRef,
    /// Field that is compared; empty: the object is a single number.
    pub field: String,
    /// What of it is compared.
    pub measure: Measure,
    /// Sliding window.
    pub window: Duration,
    /// Largest difference of the two, each filtered over the window.
    pub threshold: f64,
    /// Where it was declared.
    pub location: Location,
}

/// Redundant outputs that are voted over.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct VotingPlan {
    /// The slot that hands the winner's objects on; `None`: nothing is handed on, they are only watched.
    pub name: Option<String>,
    /// Its port: the first input's name and type.
    pub port: String,
    /// Type name of all, as written.
    pub data_type: String,
    /// The outputs.
    pub inputs: Vec<PortRef>,
    /// How.
    pub method: VotingMethod,
    /// Largest difference that still counts as equal.
    pub tolerance: f64,
    /// Field that is compared; empty: the object is a single number.
    pub field: String,
    /// An input that is silent for longer is left out, and stale; `None`: left out after
    /// [`VOTER_AGE`](crate::model::limits::VOTER_AGE), and not stale.
    pub max_age: Option<Duration>,
    /// How many must agree, or nothing is handed on.
    pub require: usize,
    /// What to do where too few do: [`Severity::Reset`] is none of it. Nothing is inherited.
    pub severity: Severity,
    /// Where it was declared.
    pub location: Location,
}

impl Assembler {
    /// Places the voters of an assembly among its names, before anything is connected.
    pub(super) fn votings(&mut self, assembly: &Assembly, prefix: &str, scope: &mut Scope) {
        for voting in &assembly.votings {
            let placed = self.voting(voting, prefix, scope);
            let name = &voting.name;
            if name.text.is_empty() {
                continue;
            }
            if scope.contains_key(&name.text) {
                let message = format!("\"{}\" is already the name of a subcomponent or voter", name.text);
                self.error(&name.spot, message, "give the voter a name of its own");
                if matches!(placed, Placed::Voter(_)) {
                    self.placed_votings.pop();
                }
                continue;
            }
            if !self.is_declared(&format!("{prefix}{}", name.text), &name.spot) {
                scope.insert(name.text.clone(), placed);
            }
        }
    }

    fn voting(&mut self, voting: &Voting, prefix: &str, scope: &Scope) -> Placed {
        // Too few are told already: whatever they are, they are to be changed.
        if voting.inputs.len() < LEAST {
            return Placed::Broken;
        }
        let mut inputs: Vec<Port> = Vec::new();
        for (at, word) in voting.inputs.iter().enumerate() {
            // The same name twice in a list is told where lists are read.
            if voting.inputs.iter().take(at).any(|other| other.text == word.text) {
                continue;
            }
            let Some(input) = self.voter(word, scope) else { continue };
            if inputs.iter().any(|other| other.end == input.end) {
                let message = format!("\"{}\" votes twice", word.text);
                self.error(&word.spot, message, "each input of a vote is another component's");
            }
            inputs.push(input);
        }
        let Some(first) = inputs.first().cloned().filter(|_| inputs.len() == voting.inputs.len()) else {
            return Placed::Broken;
        };
        let name = (!voting.name.text.is_empty()).then(|| format!("{prefix}{}", voting.name.text));
        let plan = VotingPlan {
            name: name.clone(),
            port: first.name.clone(),
            data_type: first.type_name.clone(),
            inputs: inputs.into_iter().map(|input| input.end).collect(),
            method: voting.method,
            tolerance: voting.tolerance,
            field: voting.field.clone(),
            max_age: voting.max_age,
            require: voting.require.unwrap_or(voting.inputs.len() / 2 + 1),
            severity: voting.severity,
            location: voting.spot.location(),
        };
        self.placed_votings.push((plan, voting.spot.clone()));
        let end = PortRef { slot: name.unwrap_or_default(), port: first.name.clone() };
        Placed::Voter(Box::new(Port { end, ..first }))
    }

    /// What an input of a vote means: a port, or the only output of a slot.
    fn voter(&mut self, word: &Word, scope: &Scope) -> Option<Port> {
        if !scope.contains_key(&word.text) && word.text.contains('.') {
            return self.dotted_port(word, scope).and_then(|port| self.output(port, word));
        }
        let part = |text: &str| Word { text: text.to_owned(), spot: word.spot.clone() };
        let (ports, incomplete) = self.data_ports(&part(&word.text), scope)?;
        let mut outputs: Vec<Port> = ports.into_iter().filter(|port| port.is_source).collect();
        if outputs.len() == 1 {
            return outputs.pop();
        }
        if incomplete {
            return None;
        }
        let names: Vec<&str> = outputs.iter().map(|port| port.name.as_str()).collect();
        let message = format!("{} has {} data outputs", word.text, outputs.len());
        let hint = match names.first() {
            Some(first) => format!("name one of them: {}.{first}", word.text),
            None => "a vote is about the outputs of slots".to_owned(),
        };
        self.error(&word.spot, message, &hint);
        None
    }

    fn output(&mut self, port: Port, word: &Word) -> Option<Port> {
        if !port.is_source {
            self.error(&word.spot, format!("\"{}\" is an input", word.text), "name an output: slot.port");
        }
        port.is_source.then_some(port)
    }

    /// Places the models of an assembly and connects each with what feeds it, where the profile does not do so itself.
    pub(super) fn reference_models(&mut self, assembly: &Assembly, scope: &Scope) {
        for model in &assembly.reference_models {
            self.reference_model(model, scope);
        }
    }

    fn reference_model(&mut self, model: &ReferenceModel, scope: &Scope) {
        let slots = self.slots_called(&model.component, scope);
        let input = self.dotted_port(&model.input, scope);
        let target = self.dotted_port(&model.target, scope).and_then(|port| self.output(port, &model.target));
        let slot = slots.first().and_then(|name| self.slots.iter().find(|slot| slot.name == *name)).cloned();
        let (Some(slot), Some(input), Some(target)) = (slot, input, target) else { return };
        if slots.len() > 1 {
            let message = format!("{} is a composite of {} slots", model.component.text, slots.len());
            return self.error(&model.component.spot, message, "name the slot inside it that is the model");
        }
        if slot.name == target.end.slot {
            let message = format!("{} is compared with itself: that finds nothing", model.component.text);
            let hint = "the model is another slot, with a component that computes what the target should say";
            return self.error(&model.component.spot, message, hint);
        }
        let ports: Vec<Port> = data_ports_of(&slot);
        self.feed_model(model, &slot, &ports, &input);
        let Some(output) = self.model_output(model, &slot.name, &ports, &target) else { return };
        self.warn_of_short_window(model, [&slot.name, &target.end.slot]);
        let plan = ReferenceModelPlan {
            model: output.end,
            target: target.end,
            field: model.field.clone(),
            measure: model.measure,
            window: model.window.unwrap_or_default(),
            threshold: model.threshold,
            location: model.spot.location(),
        };
        if let Some(first) = self.placed_models.iter().find(|other| is_same_comparison(other, &plan)) {
            let message = format!("these two are already compared over that window in line {}", first.location.line);
            return self.error(&model.spot, message, "remove one of them: the smaller threshold would always be first");
        }
        self.placed_models.push(plan);
    }

    /// The port of the model that is compared.
    fn model_output(&mut self, model: &ReferenceModel, slot: &str, ports: &[Port], target: &Port) -> Option<Port> {
        let outputs: Vec<&Port> = ports.iter().filter(|port| port.is_source).collect();
        let named = &model.output;
        let names: Vec<&str> = outputs.iter().map(|port| port.name.as_str()).collect();
        if !named.text.is_empty() {
            let found = outputs.iter().find(|port| port.name == named.text);
            if found.is_none() && !self.incomplete.contains(slot) {
                let hint = suggest::hint(&named.text, &names, str::to_owned)
                    .unwrap_or_else(|| format!("{} has no data outputs", model.component.text));
                let message = format!("{} has no data output \"{}\"", model.component.text, named.text);
                self.error(&named.spot, message, &hint);
            }
            return found.map(|port| (*port).clone());
        }
        let fitting = only(outputs.iter().filter(|port| port.type_name == target.type_name));
        let found = fitting.or_else(|| only(outputs.iter())).map(|port| (*port).clone());
        if found.is_none() && !self.incomplete.contains(slot) {
            let message = format!("{} has {} data outputs", model.component.text, outputs.len());
            let hint = match names.first() {
                Some(first) => format!("say which is compared: output=\"{first}\""),
                None => "a model writes what it computes: name a slot that has an output".to_owned(),
            };
            self.error(&model.component.spot, message, &hint);
        }
        found
    }

    /// Connects the model with what feeds it. Where the profile connects an input of the model to that, it is that one.
    fn feed_model(&mut self, model: &ReferenceModel, slot: &SlotPlan, ports: &[Port], input: &Port) {
        let sources: Vec<PortRef> = if input.is_source {
            vec![input.end.clone()]
        } else {
            let same = self.connections.iter().filter(|one| one.kind == PortKind::Data && one.target == input.end);
            same.map(|connection| connection.source.clone()).collect()
        };
        if sources.is_empty() {
            let message = format!("\"{}\" is an input that nothing is connected to", model.input.text);
            return self.error(&model.input.spot, message, "name the output that feeds the model");
        }
        let is_fed = |one: &ConnectionPlan| sources.contains(&one.source) && one.target.slot == slot.name;
        if self.connections.iter().any(is_fed) {
            return;
        }
        let inputs = ports.iter().filter(|port| !port.is_source);
        let fitting = only(inputs.clone().filter(|port| port.type_name == input.type_name)).or_else(|| only(inputs));
        let Some(port) = fitting else {
            if self.incomplete.contains(&slot.name) {
                return;
            }
            let message = format!("no one input of {} fits {}", model.component.text, model.input.text);
            return self.error(&model.component.spot, message, "connect it by a <port_connection>");
        };
        if port.type_name != input.type_name {
            let message = format!(
                "{} is of type {}, the model's only input, {}.{}, of type {}",
                model.input.text, input.type_name, model.component.text, port.name, port.type_name
            );
            let hint = "a model hears what its target hears: names may differ; the layouts are compared when the plugins are loaded";
            self.warning(&model.input.spot, message, hint);
        }
        for source in sources {
            self.connect_helper(source, port.end.clone(), &model.spot);
        }
    }

    fn connect_helper(&mut self, source: PortRef, target: PortRef, spot: &Spot) {
        let location = spot.location();
        self.linked.insert((PortKind::Data, source.clone(), target.clone()), location.line);
        let (kind, validity, on_gone) = (PortKind::Data, Vec::new(), None);
        self.connections.push(ConnectionPlan { kind, source, target, validity, on_gone, location });
    }

    /// Between two values that lie further apart than the window nothing is compared.
    fn warn_of_short_window(&mut self, model: &ReferenceModel, slots: [&String; 2]) {
        let Some(window) = model.window else { return };
        let period = |name: &&String| {
            let slot = self.slots.iter().find(|slot| slot.name == **name)?;
            match slot.component.execution.trigger {
                Trigger::Periodic(period) if period > window => Some(((*name).clone(), period)),
                _ => None,
            }
        };
        let Some((slot, period)) = slots.iter().find_map(period) else { return };
        let (window, period) = (format_duration(window), format_duration(period));
        let message =
            format!("{slot} writes every {period}, a window of {window} is never filled: nothing is compared");
        self.warning(&model.spot, message, "make the window several periods long");
    }

    /// The slots that a name of the assembly stands for: one, or all of a composite.
    pub(super) fn slots_called(&mut self, word: &Word, scope: &Scope) -> Vec<String> {
        let indices = match scope.get(&word.text) {
            Some(Placed::Slot(index)) => vec![*index],
            Some(Placed::Composite(inside)) => inside.slots.clone(),
            Some(Placed::Voter(voter)) => {
                let message = format!("\"{}\" is a voter, no slot", word.text);
                let hint = format!("name the slots that vote: {}", self.members_of(&voter.end.slot));
                self.error(&word.spot, message, &hint);
                Vec::new()
            }
            Some(Placed::Broken) => Vec::new(),
            None if word.text.is_empty() => Vec::new(),
            None => {
                self.unknown_slot(word, scope);
                Vec::new()
            }
        };
        indices.iter().filter_map(|index| self.slots.get(*index)).map(|slot| slot.name.clone()).collect()
    }

    /// The slots whose outputs a voter votes over, as a list.
    pub(super) fn members_of(&self, voter: &str) -> String {
        let voting =
            self.placed_votings.iter().map(|(voting, _)| voting).find(|voting| voting.name.as_deref() == Some(voter));
        let mut names: Vec<&str> = Vec::new();
        for input in voting.iter().flat_map(|voting| &voting.inputs) {
            if !names.contains(&input.slot.as_str()) {
                names.push(&input.slot);
            }
        }
        suggest::listed(names)
    }

    /// As [`slots_called`](Self::slots_called), of what somebody needs: that may be a voter, too, of this assembly or, `inner.name`, of
    /// a composite in it. `prefix`: that of the assembly's slots.
    pub(super) fn needed_called(&mut self, word: &Word, scope: &Scope, prefix: &str) -> Vec<String> {
        let name = format!("{prefix}{}", word.text);
        let is_voter = self.placed_votings.iter().any(|(voting, _)| voting.name.as_ref() == Some(&name));
        let inside = word.text.split_once('.').filter(|_| scope.get(&word.text).is_none());
        match inside.and_then(|(head, rest)| Some((head, rest, scope.get(head)?))) {
            _ if is_voter => vec![name],
            Some((head, rest, Placed::Composite(inside))) => {
                if !inside.incomplete {
                    self.no_voter_inside(word, (head, rest), prefix);
                }
                Vec::new()
            }
            Some((_, _, Placed::Broken)) => Vec::new(),
            _ => self.slots_called(word, scope),
        }
    }

    /// Of what is inside a composite only a voter can be needed by its own name.
    fn no_voter_inside(&mut self, word: &Word, (head, rest): (&str, &str), prefix: &str) {
        let before = format!("{prefix}{head}.");
        let voters = self.placed_votings.iter().filter_map(|(voting, _)| voting.name.as_deref()?.strip_prefix(&before));
        let voters: Vec<&str> = voters.collect();
        let hint = suggest::hint(rest, &voters, |voter| format!("{head}.{voter}"));
        let hint = hint.unwrap_or_else(|| format!("name the composite: {head}"));
        self.error(&word.spot, format!("no voter \"{rest}\" is in the composite \"{head}\""), &hint);
    }

    /// `slot.port`: the port is behind the last dot, since slots in composites have dots in their names.
    fn dotted_port(&mut self, word: &Word, scope: &Scope) -> Option<Port> {
        let Some((component, port)) = word.text.rsplit_once('.') else {
            if !word.text.is_empty() {
                let hint = match word.text.rsplit_once(['/', ':']) {
                    Some((slot, port)) => format!("write it as {slot}.{port}"),
                    None => "write it as slot.port".to_owned(),
                };
                self.error(&word.spot, format!("\"{}\" names no port", word.text), &hint);
            }
            return None;
        };
        let part = |text: &str| Word { text: text.to_owned(), spot: word.spot.clone() };
        self.data_port(&End { component: part(component), port: part(port) }, scope)
    }

    /// The data port that an end names.
    pub(super) fn data_port(&mut self, end: &End, scope: &Scope) -> Option<Port> {
        let (data, incomplete) = self.data_ports(&end.component, scope)?;
        if let Some(found) = data.iter().find(|port| port.name == end.port.text) {
            return Some(found.clone());
        }
        if incomplete {
            return None;
        }
        let names: Vec<&str> = data.iter().map(|port| port.name.as_str()).collect();
        let hint = suggest::hint(&end.port.text, &names, str::to_owned)
            .unwrap_or_else(|| format!("{} has no data ports", end.component.text));
        let message = format!("{} has no data port \"{}\"", end.component.text, end.port.text);
        self.error(&end.port.spot, message, &hint);
        None
    }

    /// The data ports of whatever has that name, and whether one of them may be missing because of an error; `None`: reported,
    /// here or where it is declared.
    fn data_ports(&mut self, component: &Word, scope: &Scope) -> Option<(Vec<Port>, bool)> {
        let (ports, incomplete) = match scope.get(&component.text) {
            Some(Placed::Slot(index)) => {
                let slot = self.slots.get(*index)?;
                (data_ports_of(slot), self.incomplete.contains(&slot.name))
            }
            Some(Placed::Composite(inside)) => (inside.ports.clone(), inside.incomplete),
            Some(Placed::Voter(port)) => (vec![(**port).clone()], false),
            Some(Placed::Broken) => return None,
            None => {
                self.unknown_slot(component, scope);
                return None;
            }
        };
        Some((ports.into_iter().filter(|port| port.kind == PortKind::Data).collect(), incomplete))
    }
}

/// True where both find the same at the same time, but for the threshold. Of one pair a short and a long window find different things.
fn is_same_comparison(one: &ReferenceModelPlan, other: &ReferenceModelPlan) -> bool {
    let key = |plan: &ReferenceModelPlan| {
        (plan.model.clone(), plan.target.clone(), plan.field.clone(), plan.measure, plan.window)
    };
    key(one) == key(other)
}

fn data_ports_of(slot: &SlotPlan) -> Vec<Port> {
    ports_of(&slot.name, &slot.component).into_iter().filter(|port| port.kind == PortKind::Data).collect()
}

/// The one there is; `None`: there is none, or several.
fn only<T>(mut all: impl Iterator<Item = T>) -> Option<T> {
    all.next().filter(|_| all.next().is_none())
}
