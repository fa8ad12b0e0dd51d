//! State: slave, master, changes, and what becomes of them when the slave fails.

use tests::profiles::{Profiles, application, connection_of, plugin_dir, slot};

use crate::rig::{RESET, Suite, Transport, conformance, declare_executors};

fn profiles(transport: Transport) -> Profiles {
    let slots = [
        slot("master", "Master", &format!("{}{RESET}", transport.place("left"))),
        slot("slave", "Slave", &format!("{}{RESET}", transport.place("right"))),
    ];
    let links = [
        connection_of("service", "master.mine -> master.own", ""),
        connection_of("service", "master.second -> master.own", ""),
        connection_of("service", "master.slave -> slave.state", ""),
        connection_of("service", "master.ask -> slave.asked", ""),
        connection_of("service", "slave.deaf -> master.silent", ""),
    ];
    let profiles = Profiles::new(&application(&slots, &links.each_ref().map(String::as_str)));
    profiles.describe(&plugin_dir().join("libstates.so"));
    declare_executors(&profiles);
    profiles
}

static SUITE: Suite = Suite::new(profiles);

states::state_cases!(conformance SUITE;);
