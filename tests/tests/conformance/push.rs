//! Push: newest, timed, merged; subscriptions, waits, gates, handlers, data ports at the other end.

use tests::profiles::{Profiles, application, connection, connection_of, plugin_dir, slot};
use tests::running::Running;

use crate::rig::{
    RESET, Suite, Transport, conformance, declare_executors, is_built_anew_while_parked, is_stopped_while_parked,
    parked,
};

/// By connection: `sender.first` to several, and so on.
const LINKS: [(&str, &[&str]); 8] = [
    (
        "sender.first",
        &[
            "listener.newest",
            "listener.second",
            "listener.handled",
            "listener.halved",
            "listener.data",
            "listener.thirds",
            "listener.fourths",
            "waiter.newest",
        ],
    ),
    ("sender.timed", &["listener.timed", "listener.again"]),
    ("sender.auto", &["listener.auto"]),
    ("sender.thin", &["listener.thin"]),
    ("sender.narrow", &["listener.narrow", "listener.beside"]),
    ("sender.plain", &["listener.written"]),
    ("listener.feed", &["listener.own"]),
    ("listener.feed", &["sender.back"]),
];

/// Hearer, sender, somebody else who waits, and another sender.
fn profiles(transport: Transport, run: &str) -> Profiles {
    let cases = format!("<properties><property name=\"run\" type=\"string\">{run}</property></properties>");
    let right = transport.place("right");
    let slots = [
        slot("listener", "Hearer", &format!("{cases}{}", transport.place("left"))),
        slot("sender", "Sender", &format!("{right}{RESET}")),
        slot("waiter", "Waiter", &right),
        slot("others", "OtherSender", &right),
    ];
    let calls = [("listener.order", "sender.orders"), ("listener.other", "waiter.orders")];
    let calls = calls.map(|(client, server)| connection_of("service", &format!("{client} -> {server}"), ""));
    let data = LINKS.iter().flat_map(|(server, clients)| {
        clients.iter().map(move |client| connection(&format!("{server} -> {client}"), ""))
    });
    let links: Vec<String> = data.chain(calls).collect();
    let links: Vec<&str> = links.iter().map(String::as_str).collect();
    let profiles = Profiles::new(&application(&slots, &links));
    profiles.describe(&plugin_dir().join("libpushes.so"));
    declare_executors(&profiles);
    profiles.replace("Sender.xml", "<period>1s</period>", "<period>20ms</period>");
    set(&profiles, "thirds", "<prescale>3</prescale>");
    set(&profiles, "fourths", "<prescale>4</prescale>");
    set(&profiles, "narrow", "<overflow>drop_newest</overflow>");
    profiles
}

/// Adds to a port of the listener.
fn set(profiles: &Profiles, port: &str, element: &str) {
    let (name, end) = (format!("<name>{port}</name>"), "</data_port>");
    profiles.replace_after("Hearer.xml", &name, end, &format!("{element}{end}"));
}

pub(crate) static SUITE: Suite = Suite::new(|transport| profiles(transport, "all"));

pushes::push_cases!(conformance SUITE;);

#[test]
fn vector_push_scalability() {
    const CLIENTS: u64 = 60;
    for transport in [Transport::Near, Transport::Far] {
        let prescale = |number: u64| 1 + number % 4;
        // The clients first: each hears the first value.
        let clients = (0..CLIENTS).map(|number| {
            let one_of = format!("<property name=\"prescale\" type=\"int\">{}</property>", prescale(number));
            let inside = format!("{}<properties>{one_of}</properties>", transport.place("right"));
            slot(&format!("counter{number}"), "Counter", &inside)
        });
        let slots: Vec<_> = clients.chain([slot("feeder", "Feeder", &transport.place("left"))]).collect();
        let links: Vec<_> = (0..CLIENTS).map(|number| format!("feeder.numbers -> counter{number}.numbers")).collect();
        let profiles = Profiles::new(&application(&slots, &links.iter().map(String::as_str).collect::<Vec<_>>()));
        profiles.describe(&plugin_dir().join("libpushes.so"));
        declare_executors(&profiles);
        let mut daemon = Running::start(profiles.path(), &[]);
        daemon.wait_for_lines("counted ", CLIENTS as usize);
        daemon.stop();
        for number in 0..CLIENTS {
            let every = prescale(number);
            let arrived = (pushes::LAST - 1) / every + 1;
            let line = format!("counter{number}: counted {arrived} of every {every}, 0 wrong");
            assert!(daemon.log().contains(&line), "`{line}` in {:?}", daemon.lines("counted "));
        }
    }
}

#[test]
fn stop_while_parked() {
    for transport in [Transport::Near, Transport::Far] {
        let (_profiles, mut daemon) = parked(profiles(transport, "stay"));
        is_stopped_while_parked(&mut daemon);
        // In `initialize` it is not connected, and in `stop` nobody may wait.
        daemon.wait_for("in initialize: Err(Disconnected) Err(Disconnected)");
        let stop = daemon.lines("in stop: ");
        assert!(!stop.is_empty() && stop.iter().all(|line| line.contains("Err(")), "{stop:?}");
    }
}

#[test]
fn server_ends_in_order() {
    for transport in [Transport::Near, Transport::Far] {
        let (profiles, mut daemon) = parked(profiles(transport, "stay"));
        // The sender is built anew.
        profiles.replace("Sender.xml", "<version>1.0</version>", "<version>1.1</version>");
        daemon.signal("HUP");
        daemon.wait_for("waited: Err(ProviderReplaced)");
        // In between it is not connected; then it is subscribed to the new one and waits.
        daemon.wait_for("reloaded: ");
        let told = || daemon.lines("waited: ").len();
        let mut before = usize::MAX;
        while told() != before {
            before = told();
            std::thread::sleep(std::time::Duration::from_millis(300));
        }
        assert!(daemon.lines(": waits").len() > before);
        daemon.stop();
    }
}

#[test]
fn reload_while_parked() {
    for transport in [Transport::Near, Transport::Far] {
        is_built_anew_while_parked(profiles(transport, "stay"), "Hearer");
    }
}

#[test]
fn what_does_not_fit_the_class_is_refused_at_load() {
    let wrong = [
        ("Sender", "<name>first</name>", "<period>1s</period>", "<period> belongs to a PushTimedServer"),
        ("Hearer", "<name>data</name>", "<timeout>1s</timeout>", "<timeout> belongs to a PushClient"),
        ("Hearer", "<name>newest</name>", "<period>1s</period>", "<period> belongs to an output"),
        ("Sender", "<name>first</name>", "<prescale>2</prescale>", "<prescale> belongs to an input"),
    ];
    for (class, name, element, told) in wrong {
        let profiles = profiles(Transport::Near, "all");
        let file = format!("{class}.xml");
        let text = std::fs::read_to_string(profiles.path().join(&file)).unwrap();
        let (before, after) = text.split_once(name).expect("the port is described");
        let after = after.replacen("</data_port>", &format!("{element}</data_port>"), 1);
        profiles.write(&file, &format!("{before}{name}{after}"));
        let (is_good, said) = super::check::check(&profiles);
        assert!(!is_good && said.contains(told), "{told} in {said}");
    }
}
