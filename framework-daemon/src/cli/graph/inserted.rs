//! What the framework inserts, as slots and connections to be drawn: voters, and comparisons with models.

use std::sync::Arc;

use crate::model::schedule::Schedule;
use crate::model::symptom::Severity;
use crate::profile::plan::{
    ComponentPlan, ConnectionPlan, DataPortPlan, Execution, FaultRules, Location, Plan, PortKind, PortRef, Queue,
    SlotPlan, Trigger, Usage,
};
use crate::profile::quantity::format_duration;

/// The plan with a box for each voter and each comparison. For drawing only: nothing of it would run.
#[must_use]
pub fn with_helpers(mut plan: Plan) -> Plan {
    for voting in plan.votings.clone() {
        let name = voting.name.clone().unwrap_or_else(|| format!("voting {}", plan.slots.len()));
        let method = format!("{:?}", voting.method).to_lowercase();
        let answer = match voting.severity {
            Severity::Ignore => String::new(),
            severity => format!(", too few: {}", severity.name()),
        };
        let mut helper =
            Helper::new(&plan, &name, format!("voter by {method}{answer}"), &voting.inputs, &voting.location);
        helper.hear(&voting.inputs, &voting.data_type);
        if voting.name.is_some() {
            helper.port(&voting.port, Usage::Output, &voting.data_type);
        }
        helper.add_to(&mut plan);
    }
    for model in plan.reference_models.clone() {
        let PortRef { slot, port } = &model.target;
        let field = if model.field.is_empty() { String::new() } else { format!(" {}", model.field) };
        let name = free_name(&plan, format!("model of {slot}.{port}{field}"));
        let class = format!("comparison over {}", format_duration(model.window));
        let heard = [model.target.clone(), model.model.clone()];
        let mut helper = Helper::new(&plan, &name, class, &heard, &model.location);
        helper.hear(&heard, "");
        helper.add_to(&mut plan);
    }
    plan
}

/// The name, with a number where a box has it already: one pair may be compared over several windows.
fn free_name(plan: &Plan, name: String) -> String {
    let is_free = |name: &String| !plan.slots.iter().any(|slot| slot.name == *name);
    let numbered = (2..).map(|number| format!("{name} ({number})"));
    std::iter::once(name.clone()).chain(numbered).find(is_free).unwrap_or(name)
}

/// A box and its connections.
struct Helper {
    name: String,
    class: String,
    application: String,
    ports: Vec<DataPortPlan>,
    connections: Vec<ConnectionPlan>,
    location: Location,
}

impl Helper {
    /// In the application of what it hears.
    fn new(plan: &Plan, name: &str, class: String, heard: &[PortRef], location: &Location) -> Self {
        let of = |end: &PortRef| plan.slots.iter().find(|slot| slot.name == end.slot);
        let application = heard.iter().find_map(of).map(|slot| slot.application.clone()).unwrap_or_default();
        let (ports, connections) = (Vec::new(), Vec::new());
        Self { name: name.to_owned(), class, application, ports, connections, location: location.clone() }
    }

    fn port(&mut self, name: &str, usage: Usage, data_type: &str) {
        self.ports.push(DataPortPlan {
            name: name.to_owned(),
            usage,
            data_type: data_type.to_owned(),
            queue: Queue::Last,
            validity: Vec::new(),
            max_age: None,
            push: Default::default(),
            location: self.location.clone(),
        });
    }

    fn hear(&mut self, ends: &[PortRef], data_type: &str) {
        for end in ends {
            let port = format!("{}.{}", end.slot, end.port);
            self.port(&port, Usage::Input, data_type);
            self.connections.push(ConnectionPlan {
                kind: PortKind::Data,
                source: end.clone(),
                target: PortRef { slot: self.name.clone(), port },
                validity: Vec::new(),
                on_gone: None,
                location: self.location.clone(),
            });
        }
    }

    fn add_to(self, plan: &mut Plan) {
        let execution = Execution {
            trigger: Trigger::Nonperiodic,
            schedule: Schedule::default(),
            deadline: None,
            stack: None,
            autostart: true,
            singleton: false,
        };
        let component = ComponentPlan {
            name: self.class,
            version: String::new(),
            library: String::new(),
            execution,
            properties: Vec::new(),
            data_ports: self.ports,
            event_ports: Vec::new(),
            service_ports: Vec::new(),
            location: self.location.clone(),
        };
        plan.slots.push(SlotPlan {
            name: self.name,
            application: self.application,
            component: Arc::new(component),
            properties: Vec::new(),
            executor: None,
            node: None,
            rules: FaultRules::default(),
            location: self.location,
        });
        plan.connections.extend(self.connections);
    }
}
