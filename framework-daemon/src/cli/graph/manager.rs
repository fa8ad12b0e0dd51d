//! The fault manager in a picture: where a connection names one of its ports, it is drawn as a slot.

use std::sync::Arc;

use crate::model::limits::{ACTIVATIONS_DEFAULT, WAIT};
use crate::model::names::FAULT_MANAGER;
use crate::model::schedule::Schedule;
use crate::profile::plan::{
    ComponentPlan, EventPortPlan, Execution, FaultRules, Location, Overflow, Plan, SlotPlan, Trigger, Usage,
};
use crate::profile::wire::{Port, ports_of_fault_manager};

/// The plan with what the framework adds to it.
#[must_use]
pub(super) fn shown(mut plan: Plan) -> Plan {
    let ends = plan.connections.iter().flat_map(|connection| [&connection.source, &connection.target]);
    if ends.into_iter().any(|end| end.slot == FAULT_MANAGER) {
        let application = plan.applications.first().cloned().unwrap_or_default();
        plan.slots.push(slot(application));
    }
    plan
}

fn slot(application: String) -> SlotPlan {
    let location = Location::default();
    let execution = Execution {
        trigger: Trigger::Nonperiodic,
        schedule: Schedule::default(),
        deadline: None,
        stack: None,
        autostart: true,
        singleton: true,
    };
    let component = ComponentPlan {
        name: "the framework's own".to_owned(),
        version: String::new(),
        library: String::new(),
        execution,
        properties: Vec::new(),
        data_ports: Vec::new(),
        event_ports: ports_of_fault_manager().into_iter().map(port).collect(),
        service_ports: Vec::new(),
        location: location.clone(),
    };
    SlotPlan {
        name: FAULT_MANAGER.to_owned(),
        application,
        component: Arc::new(component),
        properties: Vec::new(),
        executor: None,
        node: None,
        rules: FaultRules::default(),
        location,
    }
}

fn port(port: Port) -> EventPortPlan {
    EventPortPlan {
        name: port.name,
        usage: if port.is_source { Usage::Output } else { Usage::Input },
        data_type: port.type_name,
        queue_size: None,
        overflow: Overflow::DropOldest,
        activations: ACTIVATIONS_DEFAULT,
        timeout: WAIT,
        location: Location::default(),
    }
}
