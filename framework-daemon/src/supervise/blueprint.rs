//! A slot before anything of it exists: its classes found, its ports compiled. All that can be wrong with plugins is found
//! here, so that `check` finds it too.

use std::sync::Arc;

use component_sdk::abi::class::{Direction, Pattern, PortDecl};
use component_sdk::object::TypeDescriptor;

use super::catalogue::Catalogue;
use super::events;
use super::pushes;
use super::wiring::at;
use crate::exec::unit::{Limits, Recipe, Source};
use crate::model::limits::{INBOX_DEFAULT, PENDING_DEFAULT, WAIT};
use crate::model::names;
use crate::model::time::nanoseconds;
use crate::plugin::{Class, Plugin};
use crate::port::event_ends::EventEnds;
use crate::port::input::InPort;
use crate::port::output::OutPort;
use crate::port::pattern::objects::Objects;
use crate::port::pattern::provider::Provider;
use crate::port::pattern::requestor::{Requestor, Room};
use crate::port::wait::Waiter;
use crate::profile::plan::{ComponentPlan, OnGone, Preload, Property, SecondaryPlan, ServicePortPlan, SlotPlan};

/// A slot with its classes, before anything of it exists.
pub struct Blueprint<'a> {
    /// What the profiles say of it.
    pub plan: &'a SlotPlan,
    /// Its primary class.
    pub class: Class,
    /// Its secondaries.
    pub standbys: Vec<(Recipe, Preload)>,
    /// Its input ports.
    pub inputs: Vec<InPort>,
    /// Its output ports.
    pub outputs: Vec<OutPort>,
    /// Its clients.
    pub requestors: Vec<Requestor>,
    /// Its servers.
    pub providers: Vec<Provider>,
    /// Its event ports.
    pub events: EventEnds,
    /// It, as one that waits and is waited for.
    pub waiter: Arc<Waiter>,
}

/// Finds the classes of all slots and compiles their ports.
///
/// # Errors
/// All that is wrong, one text each.
pub fn draw<'a>(slots: &'a [SlotPlan], catalogue: &Catalogue) -> Result<Vec<Blueprint<'a>>, Vec<String>> {
    let (mut drawn, mut errors) = (Vec::new(), Vec::new());
    for plan in slots {
        match Blueprint::new(plan, catalogue) {
            Ok(blueprint) => drawn.push(blueprint),
            Err(reason) => errors.push(reason),
        }
    }
    errors.dedup();
    if errors.is_empty() { Ok(drawn) } else { Err(errors) }
}

impl<'a> Blueprint<'a> {
    fn new(plan: &'a SlotPlan, catalogue: &Catalogue) -> Result<Self, String> {
        let class = catalogue.class(&plan.component)?;
        let standbys = plan.rules.secondaries.iter().map(|secondary| standby(secondary, &class, catalogue));
        let standbys = standbys.collect::<Result<_, _>>()?;
        let (inputs, outputs, requestors, providers) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let (events, waiter) = (EventEnds::default(), Waiter::new());
        let mut blueprint = Self { plan, class, standbys, inputs, outputs, requestors, providers, events, waiter };
        blueprint.add_ports()?;
        Ok(blueprint)
    }

    fn add_ports(&mut self) -> Result<(), String> {
        let component = &self.plan.component;
        // One for all of its ports: a slot waits, and is waited for, as a whole.
        let waiter = Arc::clone(&self.waiter);
        for decl in self.class.exported().decl.ports.iter() {
            match (decl.pattern, decl.direction) {
                (Pattern::Push, Direction::Input) => self.inputs.push(pushes::input(decl, component, &waiter)?),
                (Pattern::Push, Direction::Output) => self.outputs.push(pushes::output(decl, component, &waiter)?),
                (Pattern::Query | Pattern::Send, Direction::Input) => {
                    self.providers.push(provider(decl, component, &waiter)?);
                }
                (Pattern::Query | Pattern::Send, Direction::Output) => {
                    self.requestors.push(requestor(decl, component, &waiter)?);
                }
                (Pattern::Event | Pattern::EventPort, _) => events::add(&mut self.events, decl, component, &waiter)?,
            }
        }
        Ok(())
    }

    /// The slot's name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.plan.name
    }

    /// The plugins of its classes, as far as they are loaded.
    #[must_use]
    pub fn plugins(&self) -> Vec<Arc<Plugin>> {
        let standbys = self.standbys.iter().filter_map(|(recipe, _)| match &recipe.source {
            Source::Loaded(class) => Some(class),
            Source::Lazy(_) => None,
        });
        std::iter::once(&self.class).chain(standbys).map(|class| Arc::clone(class.plugin())).collect()
    }

    /// What an output port carries.
    #[must_use]
    pub fn output_object(&self, port: &str) -> Option<&'static TypeDescriptor> {
        self.outputs.iter().find(|candidate| candidate.name == port).map(|port| port.object)
    }

    /// What an input port carries.
    #[must_use]
    pub fn input_object(&self, port: &str) -> Option<&'static TypeDescriptor> {
        self.inputs.iter().find(|candidate| candidate.name == port).map(|port| port.object)
    }
}

fn service<'p>(decl: &PortDecl, component: &'p ComponentPlan) -> Option<&'p ServicePortPlan> {
    component.service_ports.iter().find(|port| port.name == decl.name.as_str())
}

fn objects(decl: &PortDecl) -> Result<Objects, String> {
    let answer = decl.answer.into_option();
    if answer.is_none() && decl.pattern == Pattern::Query {
        return Err(format!("port `{}`: a query without an answer", decl.name));
    }
    Ok(Objects { request: decl.object, answer: answer.filter(|_| decl.pattern == Pattern::Query) })
}

fn requestor(decl: &PortDecl, component: &ComponentPlan, waiter: &Arc<Waiter>) -> Result<Requestor, String> {
    let declared = service(decl, component);
    let room = Room {
        pending: declared.map_or(PENDING_DEFAULT, |port| port.pending),
        timeout_ns: nanoseconds(declared.map_or(WAIT, |port| port.timeout)),
        retry: declared.is_some_and(|port| port.on_gone == OnGone::Retry),
    };
    Ok(Requestor::new(&decl.full_name(), objects(decl)?, room, Arc::clone(waiter)))
}

fn provider(decl: &PortDecl, component: &ComponentPlan, waiter: &Arc<Waiter>) -> Result<Provider, String> {
    let room = service(decl, component).map_or(INBOX_DEFAULT, |port| port.queue_size);
    let provider = Provider::new(&decl.full_name(), objects(decl)?, room, Arc::clone(waiter));
    Ok(if decl.handler { provider } else { provider.without_handler() })
}

/// A secondary: its class is loaded now unless its preload says otherwise, and must have the primary's ports.
fn standby(secondary: &SecondaryPlan, primary: &Class, catalogue: &Catalogue) -> Result<(Recipe, Preload), String> {
    let component = Arc::clone(&secondary.component);
    let properties = texts(&secondary.properties);
    let limits = Limits::new(&component.execution);
    let class_name = names::intern(&component.name);
    let source = if secondary.preload == Preload::None {
        catalogue.foresee(&component).map_err(|reason| at(&secondary.location, &reason))?;
        let (catalogue, primary) = (catalogue.clone(), primary.clone());
        Source::Lazy(Arc::new(move || {
            let class = catalogue.class(&component)?;
            same_ports(&primary, &class).map(|()| class)
        }))
    } else {
        let class = catalogue.class(&component)?;
        same_ports(primary, &class).map_err(|reason| at(&secondary.location, &reason))?;
        Source::Loaded(class)
    };
    Ok((Recipe { number: 0, class_name, source, properties, limits }, secondary.preload))
}

fn same_ports(primary: &Class, secondary: &Class) -> Result<(), String> {
    for port in secondary.exported().decl.ports.iter() {
        let twin = primary.exported().decl.ports.iter().find(|twin| twin.full_name() == port.full_name());
        let layouts =
            |port: &PortDecl| (port.object.layout_hash, port.answer.into_option().map(|answer| answer.layout_hash));
        let fits = twin.is_some_and(|twin| {
            (twin.pattern, twin.direction) == (port.pattern, port.direction) && layouts(twin) == layouts(port)
        });
        if !fits {
            let (own, name) = (secondary.name(), port.full_name());
            return Err(format!(
                "secondary {own}: its port `{name}` is not one of {} with the same object",
                primary.name()
            ));
        }
    }
    Ok(())
}

/// Names and texts, as recipes hold them.
pub(super) fn texts(properties: &[Property]) -> Vec<(String, String)> {
    properties.iter().map(|property| (property.name.clone(), property.value.clone())).collect()
}
