//! The system that the cases of requestors and of wiring are run in.

use tests::profiles::{Profiles, application, plugin_dir, slot};

use crate::rig::{RESET, Transport, declare_executors};

/// Everything that can be wired, and nothing connected.
pub(crate) fn profiles(transport: Transport, run: &str) -> Profiles {
    let property = |name: &str, kind: &str, value: &str| {
        format!("<properties><property name=\"{name}\" type=\"{kind}\">{value}</property></properties>")
    };
    let (left, right) = (transport.place("left"), transport.place("right"));
    // The lister has its name when the wirer begins.
    let slots = [
        slot("lister", "Lister", &format!("{right}{RESET}")),
        slot("wirer", "Wirer", &format!("{}{left}{RESET}", property("run", "string", run))),
        slot("one", "Adder", &right),
        slot("two", "Adder", &format!("{}{right}", property("summand", "ulong", "10"))),
        slot("other", "OtherAdder", &right),
        slot("speaker", "Speaker", &right),
        slot("kept", "Kept", &right),
        slot("crowd", "Crowd", &right),
    ];
    let profiles = Profiles::new(&application(&slots, &[]));
    profiles.describe(&plugin_dir().join("liblinks.so"));
    declare_executors(&profiles);
    profiles
}
