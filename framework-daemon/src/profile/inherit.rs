//! What a composite's subcomponent says, handed to the slots inside: its executor and its fault rules where they state none of
//! their own, its properties by `inner.name`, over what they say themselves.

use super::application::{Assembly, PropertyOverride, Subcomponent};
use super::assemble::Assembler;
use super::suggest;

impl Assembler {
    /// The composite as this subcomponent wants it.
    pub(super) fn inherit(&mut self, outer: &Subcomponent, composite: &Assembly) -> Assembly {
        let mut assembly = composite.clone();
        for inner in &mut assembly.subcomponents {
            let given = outer.properties.iter().filter_map(|property| meant_for(&inner.name.text, property));
            let given: Vec<PropertyOverride> = given.collect();
            // The first one of a name holds.
            inner.properties.splice(0..0, given);
            inner.executor = inner.executor.take().or_else(|| outer.executor.clone());
            inner.fault_tolerance = inner.fault_tolerance.take().or_else(|| outer.fault_tolerance.clone());
        }
        for property in &outer.properties {
            if !composite.subcomponents.iter().any(|inner| meant_for(&inner.name.text, property).is_some()) {
                self.meant_for_nobody(property, composite);
            }
        }
        assembly
    }

    fn meant_for_nobody(&mut self, given: &PropertyOverride, composite: &Assembly) {
        let name = &given.property.name;
        let names: Vec<&str> = composite.subcomponents.iter().map(|inner| inner.name.text.as_str()).collect();
        let (slot, rest) = name.split_once('.').unwrap_or(("", name));
        let hint = suggest::hint(slot, &names, |inner| format!("{inner}.{rest}"));
        let hint =
            hint.unwrap_or_else(|| format!("name the slot inside it: {}.{rest}", names.first().unwrap_or(&"slot")));
        let message = format!("composite \"{}\" has no property \"{name}\"", composite.name.text);
        self.error(&given.spot, message, &hint);
    }
}

/// `head.sonar.range`, in the composite that holds `head`, is `sonar.range` of `head`.
fn meant_for(inner: &str, given: &PropertyOverride) -> Option<PropertyOverride> {
    let rest = given.property.name.strip_prefix(inner)?.strip_prefix('.')?;
    let mut property = given.clone();
    property.property.name = rest.to_owned();
    Some(property)
}
