//! The control socket: what it tells, whom it serves, and that nobody can hold it up.

use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::os::unix::net::UnixListener;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tests::asking::{Answer, Wire, ask, ask_at, finish, start};
use tests::profiles::{Profiles, application, connection_of, plugin_dir, slot};
use tests::running::Running;

const IGNORE: &str = "<fault_tolerance><severity>ignore</severity></fault_tolerance>";

fn pair() -> Profiles {
    let rules = "<fault_tolerance><severity>reset</severity><reset limit=\"3\" within=\"10s\"/></fault_tolerance>";
    Profiles::new(&application(
        &[slot("ticker", "Ticker", rules), slot("listener", "Listener", ""), slot("diary", "Diary", "")],
        &["ticker.out -> listener.heard"],
    ))
}

/// Slots that fail a thousand times a second each, beside one that does not.
fn storm(wrecks: usize) -> Profiles {
    let wrecks = (0..wrecks).map(|number| slot(&format!("wreck{number}"), "Wreck", IGNORE));
    Profiles::new(&application(&wrecks.chain([slot("beat", "Beat", "")]).collect::<Vec<_>>(), &[]))
}

fn done(answer: Answer) -> Answer {
    assert_eq!(answer.code, Some(0), "{answer:?}");
    answer
}

#[test]
fn status_tells_the_same_as_the_log_and_the_journal() {
    let profiles = Profiles::new(&application(&[slot("idle", "Stubborn", ""), slot("deaf", "Listener", "")], &[]));
    let daemon = Running::start(profiles.path(), &[]);
    daemon.signal("USR1");
    let journaled = daemon.journal("status", 1).remove(0);
    let status = done(ask(&daemon, "status --format json")).json().remove(0);
    assert_eq!((&status["slots"], &status["process"]), (&journaled["slots"], &journaled["process"]));
    assert_eq!((status["state"].as_str(), status["pid"].as_u64()), (Some("running"), Some(u64::from(daemon.id()))));
    let text = done(ask(&daemon, "status")).out;
    assert!(text.lines().next().unwrap().contains("running, process"), "{text}");
    daemon.wait_for("threads given up:");
    for line in text.lines().skip(1) {
        assert!(daemon.log().contains(line), "`{line}` is not in the log:\n{}", daemon.log());
    }
}

#[test]
fn components_are_listed_and_described() {
    let profiles = pair();
    let daemon = Running::start(profiles.path(), &[]);
    let listed = done(ask(&daemon, "component list --format json")).json();
    let names: Vec<_> = listed.iter().map(|component| component["slot"].as_str().unwrap()).collect();
    assert_eq!(names, ["ticker", "listener", "diary"]);
    assert_eq!((listed[0]["trigger"].as_str(), listed[1]["trigger"].as_str()), (Some("every 2ms"), Some("data")));
    assert!(listed.iter().all(|component| component["application"] == "test" && component["state"] == "active"));
    let text = done(ask(&daemon, "component list")).out;
    assert!(text.starts_with("slot") && text.lines().count() == 4, "{text}");

    let ticker = done(ask(&daemon, "component info ticker --format json")).json().remove(0)["component"].take();
    assert_eq!(ticker["reset"], json!({"limit": 3, "within_ns": 10_000_000_000_u64}));
    assert_eq!((&ticker["class"], &ticker["primary"]), (&json!("Ticker"), &json!("Ticker")));
    assert_eq!(ticker["spares"], 1, "one is kept where a reset loses the instance");
    assert_eq!(ticker["ports"][0]["connections"], json!(["listener.heard"]));
    let text = done(ask(&daemon, "component info ticker")).out;
    for word in ["every 2ms", "libbasic.so", "properties", "label", "listener.heard", "app.xml:"] {
        assert!(text.contains(word), "no `{word}` in:\n{text}");
    }
    let wrong = ask(&daemon, "component info tiker");
    assert_eq!(wrong.code, Some(6));
    assert!(wrong.err.contains("there is no slot `tiker`; did you mean `ticker`?"), "{wrong:?}");
}

#[test]
fn an_operator_wires_ports_while_they_run() {
    let profiles = pair();
    let daemon = Running::start(profiles.path(), &[]);
    daemon.wait_for("heard 101");
    let connections = || {
        let port = done(ask(&daemon, "port info listener.heard --format json")).json().remove(0)["port"].take();
        (port["connections"].clone(), port["received"].as_u64().unwrap())
    };
    let text = done(ask(&daemon, "disconnect listener.heard")).out;
    assert_eq!(text, "disconnected listener.heard\n");
    let (none, before) = connections();
    std::thread::sleep(Duration::from_millis(50));
    assert_eq!((none, connections().1), (json!([]), before), "nothing comes any more");
    done(ask(&daemon, "connect listener.heard ticker.out --format json"));
    assert_eq!(connections().0, json!(["ticker.out"]));
    daemon.wait_for("heard 201");
    for (words, reason) in [
        ("connect listener.heard tiker.out", "listener.heard cannot be connected to tiker.out: there is no slot tiker"),
        ("connect listener.herd ticker.out", "slot listener has no port herd"),
        ("disconnect nobody.out", "there is no slot nobody"),
    ] {
        let wrong = ask(&daemon, words);
        assert_eq!(wrong.code, Some(6), "{wrong:?}");
        assert!(wrong.err.contains(reason), "{wrong:?}");
    }
}

#[test]
fn ports_are_listed_and_described() {
    let profiles = pair();
    let daemon = Running::start(profiles.path(), &[]);
    daemon.wait_for("heard 101");
    let listed = done(ask(&daemon, "port list --format json")).json();
    let (out, heard) = (&listed[0], &listed[1]);
    assert_eq!((&out["slot"], &out["port"], &out["direction"]), (&json!("ticker"), &json!("out"), &json!("output")));
    assert_eq!((&heard["policy"], &heard["connections"]), (&json!("fifo of 64"), &json!(["ticker.out"])));
    assert!(heard["received"].as_u64() > Some(100) && heard["dropped"] == 0, "{heard}");
    assert_eq!(done(ask(&daemon, "port list diary --format json")).json(), [] as [Value; 0]);
    let text = done(ask(&daemon, "port list listener")).out;
    assert!(text.contains("listener.heard") && !text.contains("ticker.out  "), "{text}");

    let info = done(ask(&daemon, "port info listener.heard --format json")).json().remove(0);
    assert_eq!(info["layout"]["fields"][0]["name"], "number");
    let text = done(ask(&daemon, "port info ticker.out")).out;
    assert!(text.contains("listener.heard") && text.contains("number: uint64_t"), "{text}");
    for (asked, told) in [
        ("port info ticker.outt", "slot `ticker` has no port `outt`; did you mean `ticker.out`?"),
        ("port info nobody.out", "there is no slot `nobody`"),
        ("port list nobody", "there is no slot `nobody`"),
    ] {
        let wrong = ask(&daemon, asked);
        assert!(wrong.code == Some(6) && wrong.err.contains(told), "{asked}: {wrong:?}");
    }
    assert_eq!(ask(&daemon, "port info ticker").code, Some(2));
}

#[test]
fn a_port_is_told_with_the_name_that_its_component_gave_it() {
    let nameless = "<properties><property name=\"name\" type=\"string\">other</property></properties>";
    let profiles = Profiles::new(&application(&[slot("lister", "Lister", nameless)], &[]));
    profiles.describe(&plugin_dir().join("liblinks.so"));
    let daemon = Running::start(profiles.path(), &[]);
    daemon.wait_for("shown as other");
    let listed = done(ask(&daemon, "port list --format json")).json();
    assert_eq!((&listed[0]["port"], &listed[0]["known_as"]), (&json!("ask"), &json!("other")));
    for asked in ["port list", "component info lister"] {
        let text = done(ask(&daemon, asked)).out;
        assert!(text.contains("ask (known as other)"), "{asked}: {text}");
    }
    // By either.
    for port in ["ask", "other"] {
        let info = done(ask(&daemon, &format!("port info lister.{port} --format json"))).json().remove(0);
        assert_eq!((&info["port"]["port"], &info["port"]["known_as"]), (&json!("ask"), &json!("other")));
    }
}

#[test]
fn connections_that_a_component_makes_are_seen_while_they_change() {
    let slots = [
        slot("one", "Ticker", ""),
        slot("two", "Ticker", ""),
        slot("listener", "Listener", ""),
        slot("switch", "Switch", ""),
    ];
    let profiles = Profiles::new(&application(&slots, &[]));
    let daemon = Running::start(profiles.path(), &[]);
    let mut wire = Wire::to(&daemon);
    let mut seen = Vec::new();
    let began = Instant::now();
    while !(seen.contains(&json!(["one.out"])) && seen.contains(&json!(["two.out"]))) {
        assert!(began.elapsed() < Duration::from_secs(60), "{seen:?}");
        let reply = wire.ask("DescribePort", &json!({"slot": "listener", "port": "heard"}));
        let connections = reply["parameters"]["port"]["connections"].clone();
        if !seen.contains(&connections) {
            seen.push(connections);
        }
    }
}

#[test]
fn ports_of_queries_are_listed_with_what_they_count() {
    let profiles = Profiles::new("<application_profile><name>test</name></application_profile>");
    profiles.describe(&plugin_dir().join("libqueries.so"));
    let app = application(&[slot("asker", "Asker", ""), slot("teller", "Teller", ""), slot("echo", "Echo", "")], &[]);
    let link = connection_of("service", "asker.tell -> teller.told", "");
    profiles.write("app.xml", &app.replace("</port_connections>", &format!("{link}</port_connections>")));
    let daemon = Running::start(profiles.path(), &[]);
    let listed = done(ask(&daemon, "port list --format json")).json();
    let find = |slot: &str, port: &str| {
        listed.iter().find(|each| each["slot"] == slot && each["port"] == port).unwrap_or_else(|| panic!("{listed:?}"))
    };
    let (client, server) = (find("asker", "tell"), find("teller", "told"));
    assert_eq!((&client["direction"], &client["connections"]), (&json!("client"), &json!(["teller.told"])));
    assert_eq!((&server["direction"], &server["connections"]), (&json!("server"), &json!(["asker.tell"])));
    assert!(
        client["asked"].is_u64() && server["refused"].is_u64() && client["type"].as_str().unwrap().contains(" -> ")
    );
    let text = done(ask(&daemon, "port info asker.tell")).out;
    assert!(["request", "answer", "asked"].iter().all(|word| text.contains(word)), "{text}");
    let no_rate = ask(&daemon, "port hz asker.tell");
    assert!(no_rate.code == Some(6) && no_rate.err.contains("is no data port"), "{no_rate:?}");
}

#[test]
fn a_rate_is_measured_at_an_input_and_for_an_output_at_its_reader() {
    let profiles = pair();
    let daemon = Running::start(profiles.path(), &[]);
    for port in ["listener.heard", "ticker.out"] {
        let rates = done(ask(&daemon, &format!("port hz {port} --window 0.3 --count 2 --format json"))).json();
        assert_eq!(rates.len(), 2);
        for rate in rates.iter().map(|answer| &answer["rate"]) {
            // A machine that is busy loses periods and never makes more than it was told to.
            assert!((1.0..1000.0).contains(&rate["hz"].as_f64().unwrap()), "{rate}");
            assert!(rate["seconds"].as_f64() >= Some(0.3) && rate["measured_at"] == "listener.heard", "{rate}");
        }
    }
    let text = done(ask(&daemon, "port hz ticker.out --window 0.1 --count 1")).out;
    assert!(text.contains(" Hz (") && text.contains("at listener.heard)"), "{text}");
    // Without `more`: once.
    let mut wire = Wire::to(&daemon);
    let once = wire.ask("Hz", &json!({"slot": "ticker", "port": "out", "window_ms": 50}));
    assert!(once["parameters"]["rate"]["hz"].as_f64() > Some(0.0) && once.get("continues").is_none(), "{once}");
    assert_eq!(wire.ask("Status", &json!({}))["parameters"]["state"], "running");
}

#[test]
fn an_output_that_nobody_reads_has_no_rate_and_a_port_that_goes_ends_the_measurement() {
    let profiles = pair();
    let daemon = Running::start(profiles.path(), &[]);
    let measuring = start(&daemon, "port hz listener.heard --window 0.05");
    std::thread::sleep(Duration::from_millis(100));
    profiles.replace("app.xml", &slot("listener", "Listener", ""), "");
    let app = std::fs::read_to_string(profiles.path().join("app.xml")).unwrap();
    let (before, rest) = app.split_once("<port_connections>").unwrap();
    let (_, after) = rest.split_once("</port_connections>").unwrap();
    profiles.write("app.xml", &format!("{before}<port_connections></port_connections>{after}"));
    let reload = done(ask(&daemon, "reload --format json")).json().remove(0);
    assert_eq!(reload["removed"], json!(["listener"]));
    let ended = finish(measuring);
    assert_eq!(ended.code, Some(6), "{ended:?}");
    assert!(ended.out.contains(" Hz (") && ended.err.contains("listener.heard"), "{ended:?}");
    let unread = ask(&daemon, "port hz ticker.out");
    assert!(unread.code == Some(6) && unread.err.contains("nobody reads ticker.out"), "{unread:?}");
}

#[test]
fn faults_are_listed_with_what_was_done() {
    let profiles = pair();
    let inject =
        ["--inject", "ticker:crash.segv@0.1", "--inject", "ticker:crash.panic@0.3", "--inject", "diary:error@0.5"];
    let daemon = Running::start(profiles.path(), &inject);
    let journaled = daemon.journal("fault", 3);
    let listed = done(ask(&daemon, "fault list --format json")).json();
    let bare = |entry: &Value| {
        let mut entry = entry.clone();
        entry.as_object_mut().unwrap().remove("crc");
        entry
    };
    assert_eq!(listed, journaled.iter().map(bare).collect::<Vec<_>>(), "the journal's own lines");
    let of_ticker = done(ask(&daemon, "fault list --slot ticker --last 1 --format json")).json();
    assert_eq!((of_ticker.len(), &of_ticker[0]["symptom"]), (1, &json!("crash.panic")));
    let text = done(ask(&daemon, "fault list")).out;
    for word in ["ticker", "crash.segv", "reset", "recovered", "injected panic", "stopped"] {
        assert!(text.contains(word), "no `{word}` in:\n{text}");
    }
    assert_eq!(text.lines().count(), 4);
    for verb in ["fault list --slot tiker", "fault follow --slot tiker"] {
        let wrong = ask(&daemon, verb);
        assert!(wrong.code == Some(6) && wrong.err.contains("did you mean `ticker`?"), "{verb}: {wrong:?}");
    }
    // A slot that is gone has left its faults.
    profiles.replace("app.xml", &slot("diary", "Diary", ""), "");
    done(ask(&daemon, "reload"));
    assert_eq!(done(ask(&daemon, "fault list --slot diary --format json")).json().len(), 1);
}

#[test]
fn who_follows_sees_each_fault_in_order() {
    let profiles = storm(1);
    let daemon = Running::start(profiles.path(), &[]);
    let followed = done(finish(start(&daemon, "fault follow --last 10 --count 200 --format json"))).json();
    assert_eq!(followed.len(), 200);
    let (mut seq, mut failures, mut started) = (None, None, false);
    for line in &followed {
        if line["missed"].is_u64() {
            (seq, failures) = (None, None);
            continue;
        }
        let (fault, text) = (&line["fault"], line["fault"]["evidence"]["message"].as_str().unwrap().to_owned());
        let (now, failure) = (fault["seq"].as_u64(), text.rsplit(' ').next().unwrap().parse::<u64>().ok());
        // The line of the start has a number, too, and the first faults may come before it.
        let steps = seq.map_or(1, |before: u64| now.unwrap_or_default() - before);
        assert!(steps == 1 || steps == 2 && !std::mem::replace(&mut started, true), "{seq:?} {now:?}");
        assert!(failures.is_none_or(|before: u64| failure == Some(before + 1)), "{text} after {failures:?}");
        (seq, failures) = (now, failure);
    }
    let text = done(finish(start(&daemon, "fault follow --slot wreck0 --count 3"))).out;
    assert!(text.lines().count() == 3 && text.contains("wreck0") && text.contains("failure "), "{text}");
    let mut nobody = start(&daemon, "fault follow --slot beat");
    std::thread::sleep(Duration::from_millis(100));
    assert!(nobody.try_wait().unwrap().is_none(), "it waits for the faults of a slot that has none");
    nobody.kill().unwrap();
    assert_eq!(finish(nobody).out, "");
}

#[test]
fn a_fault_storm_delays_no_answer_and_a_slow_follower_is_told_what_it_missed() {
    let profiles = storm(8);
    let mut daemon = Running::start_silent(profiles.path());
    let mut slow = Wire::to(&daemon);
    slow.call("Follow", &json!({"last": 0}), true);
    let first = slow.reply().unwrap();
    assert_eq!(first["continues"], true);
    // It reads nothing while far more comes than is kept for it.
    let faults = || {
        let status = done(ask(&daemon, "status --format json")).json().remove(0);
        let slots = status["slots"].as_array().unwrap().clone();
        assert!(slots.iter().all(|slot| slot["state"] == "active"), "{status}");
        slots.iter().filter_map(|slot| slot["faults"].as_u64()).sum::<u64>()
    };
    let began = Instant::now();
    let (mut asked, first_count) = (0, faults());
    while faults() < first_count + 12_000 {
        asked += 1;
        assert!(began.elapsed() < Duration::from_secs(60), "too few faults to call it a storm");
    }
    assert!(asked > 0, "an answer comes in the midst of it");
    let missed = std::iter::from_fn(|| slow.reply()).map(|reply| reply["parameters"]["missed"].as_u64());
    assert!(missed.flatten().next() > Some(0));
    // Then it goes on; it may miss more.
    let slots = std::iter::from_fn(|| slow.reply()).map(|mut reply| reply["parameters"]["fault"]["slot"].take());
    let slot = slots.into_iter().find(Value::is_string).unwrap();
    assert!(slot.as_str().unwrap().starts_with("wreck"), "{slot}");
    drop(slow);
    daemon.stop();
}

#[test]
fn a_reload_is_answered_when_it_is_done_and_a_refused_one_tells_everything_that_is_wrong() {
    let profiles = pair();
    let daemon = Running::start(profiles.path(), &[]);
    assert_eq!(done(ask(&daemon, "reload")).out, "reloaded: added [], changed [], removed [], 3 not touched\n");
    profiles.replace("app.xml", "</subcomponents>", &format!("{}</subcomponents>", slot("second", "Ticker", "")));
    let added = done(ask(&daemon, "reload --format json")).json().remove(0);
    assert_eq!(added, json!({"added": ["second"], "changed": [], "removed": [], "taken_up": [], "kept": 3}));
    let names = done(ask(&daemon, "component list --format json")).json();
    assert_eq!(names[3]["slot"], "second", "the answer comes after the change");

    profiles.replace("app.xml", "Listener.xml", "Lisener.xml");
    let refused = ask(&daemon, "reload");
    assert_eq!((refused.code, refused.out.as_str()), (Some(6), ""), "{refused:?}");
    for word in ["app.xml:", "error: ", "Lisener.xml", "refused by the daemon: not reloaded: everything runs on"] {
        assert!(refused.err.contains(word), "no `{word}` in:\n{}", refused.err);
    }
    assert_eq!(daemon.journal("reload", 3)[2]["accepted"], false);
    assert_eq!(done(ask(&daemon, "component list --format json")).json().len(), 4);
}

#[test]
fn a_reload_that_takes_long_keeps_nobody_else_waiting() {
    let profiles = Profiles::new(&application(&[slot("stubborn", "Stubborn", ""), slot("diary", "Diary", "")], &[]));
    let daemon = Running::start(profiles.path(), &[]);
    // It does not return from `stop` until the watchdog ends it.
    profiles.replace("app.xml", &slot("stubborn", "Stubborn", ""), "");
    let (mut one, mut other) = (Wire::to(&daemon), Wire::to(&daemon));
    one.call("Reload", &json!({}), false);
    let mut seen = Vec::new();
    while !seen.contains(&json!("reloading")) {
        seen.push(other.ask("Status", &json!({}))["parameters"]["state"].take());
    }
    assert_eq!(one.reply().unwrap()["parameters"]["removed"], json!(["stubborn"]));
    assert_eq!(other.ask("Status", &json!({}))["parameters"]["state"], "running");
}

#[test]
fn while_it_starts_it_says_so_and_a_reload_waits_for_it() {
    let profiles = Profiles::new(&application(&[slot("sluggard", "Sluggard", "")], &[]));
    let daemon = Running::spawn(profiles.path(), &[]);
    daemon.wait_for("control socket: ");
    let status = done(ask(&daemon, "status --format json")).json().remove(0);
    assert_eq!((&status["state"], &status["slots"]), (&json!("starting"), &json!([])));
    let early = ["component info sluggard", "component stop sluggard", "fault clear", "disconnect sluggard.out"];
    for early in early.map(|words| ask(&daemon, words)) {
        assert!(early.code == Some(6) && early.err.contains("the daemon is starting: ask again"), "{early:?}");
    }
    assert_eq!(done(ask(&daemon, "reload --format json")).json()[0]["kept"], 1);
    done(ask(&daemon, "component info sluggard"));
}

#[test]
fn it_speaks_varlink() {
    let profiles = pair();
    let daemon = Running::start(profiles.path(), &[]);
    let mut wire = Wire::to(&daemon);
    let mut service = |method: &str, parameters: Value| {
        let call = json!({"method": format!("org.varlink.service.{method}"), "parameters": parameters});
        assert!(wire.send(format!("{call}\0").as_bytes()));
        wire.reply().unwrap()
    };
    let info = service("GetInfo", json!({}));
    assert_eq!(info["parameters"]["interfaces"], json!(["org.varlink.service", "io.frameworkdaemon"]));
    let described = service("GetInterfaceDescription", json!({"interface": "io.frameworkdaemon"}));
    assert!(described["parameters"]["description"].as_str().unwrap().contains("method Status()"));
    let unknown = service("GetInterfaceDescription", json!({"interface": "io.other"}));
    assert_eq!(unknown["error"], "org.varlink.service.InterfaceNotFound");
    assert_eq!(service("Nothing", json!({}))["error"], "org.varlink.service.MethodNotFound");
    let without_more = wire.ask("Follow", &json!({}));
    assert_eq!(without_more["error"], "org.varlink.service.ExpectedMore");
    // Three calls in one piece, the second without a reply: two answers, in order.
    let calls = [("Status", false), ("Status", true), ("ListComponents", false)].map(|(method, oneway)| {
        format!("{}\0", json!({"method": format!("io.frameworkdaemon.{method}"), "oneway": oneway}))
    });
    assert!(wire.send(calls.concat().as_bytes()));
    assert!(wire.reply().unwrap()["parameters"]["slots"].is_array());
    assert!(wire.reply().unwrap()["parameters"]["components"].is_array());
    // Who sends no more is answered all the same.
    wire.call("ListPorts", &json!({}), false);
    wire.0.shutdown(std::net::Shutdown::Write).unwrap();
    assert!(wire.reply().unwrap()["parameters"]["ports"].is_array());
    assert_eq!(wire.reply(), None, "then it hangs up");
}

#[test]
fn garbage_is_refused_with_a_word_and_disturbs_nobody() {
    let profiles = pair();
    let daemon = Running::start(profiles.path(), &[]);
    let too_long = vec![b'x'; (1 << 20) + 70_000];
    let deep = format!("{{\"method\":\"a.b\",\"parameters\":{}\0", "[".repeat(100_000));
    let garbage: [&[u8]; 8] = [
        b"\0",
        b"hello\0",
        b"[]\0",
        b"{\"method\":7}\0",
        b"\xff\xfe\x00",
        b"{\"method\":\"\\ud800\"}\0",
        deep.as_bytes(),
        &too_long,
    ];
    for bytes in garbage {
        let mut wire = Wire::to(&daemon);
        // It may hang up before it has read all.
        let _ = wire.send(bytes);
        let reply = wire.reply().unwrap_or_else(|| panic!("no word about {:?}", &bytes[..bytes.len().min(20)]));
        assert_eq!(reply["error"], "io.frameworkdaemon.BadRequest", "{reply}");
        assert_eq!(wire.reply(), None, "and it hangs up");
    }
    // Half a request, and gone.
    for _ in 0..50 {
        assert!(Wire::to(&daemon).send(b"{\"method\":\"io.frameworkdaemon.Sta"));
    }
    done(ask(&daemon, "status"));
}

#[test]
fn clients_that_never_read_hold_nobody_up() {
    let profiles = pair();
    let mut daemon = Running::start(profiles.path(), &[]);
    let idle: Vec<Wire> = (0..10).map(|_| Wire::to(&daemon)).collect();
    let mut deaf: Vec<Wire> = (0..10).map(|_| Wire::to(&daemon)).collect();
    for wire in &mut deaf {
        wire.0.set_nonblocking(true).unwrap();
        // As many calls as the socket takes; nobody reads the answers.
        let call = format!("{}\0", json!({"method": "io.frameworkdaemon.ListPorts"})).repeat(100);
        while wire.send(call.as_bytes()) {}
    }
    for _ in 0..20 {
        done(ask(&daemon, "status"));
    }
    drop((idle, deaf));
    done(ask(&daemon, "status"));
    daemon.stop();
}

#[test]
fn forty_clients_at_once_are_all_answered() {
    let profiles = pair();
    let daemon = Running::start(profiles.path(), &[]);
    let answers = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..40).map(|_| scope.spawn(|| ask(&daemon, "component list --format json"))).collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).collect::<Vec<_>>()
    });
    for answer in answers {
        assert_eq!(done(answer).json().len(), 3);
    }
    // Forty that stay: who has been idle longest makes room.
    let mut staying: Vec<Wire> = (0..40).map(|_| Wire::to(&daemon)).collect();
    let newest = staying.last_mut().unwrap();
    assert_eq!(newest.ask("Status", &json!({}))["parameters"]["state"], "running");
    done(ask(&daemon, "status"));
}

#[test]
fn who_follows_keeps_its_place_and_the_next_one_is_told_that_all_are_taken() {
    let profiles = pair();
    let daemon = Running::start(profiles.path(), &[]);
    let mut followers: Vec<Wire> = (0..32).map(|_| Wire::to(&daemon)).collect();
    followers.iter_mut().for_each(|wire| wire.call("Follow", &json!({}), true));
    // The calls are read in some round soon: until then a place may still be waited for.
    let refused = ask(&daemon, "status");
    assert_eq!(refused.code, Some(6), "{refused:?}");
    assert!(refused.err.contains("32 clients are there already"), "{refused:?}");
    followers.pop();
    done(ask(&daemon, "status"));
}

#[test]
fn only_owner_and_group_may_use_the_socket_and_it_is_gone_in_the_end() {
    let profiles = pair();
    let mut daemon = Running::start(profiles.path(), &[]);
    let found = std::fs::metadata(daemon.socket()).unwrap();
    assert!(found.file_type().is_socket());
    assert_eq!(found.permissions().mode() & 0o7777, 0o660);
    let follower = start(&daemon, "fault follow");
    std::thread::sleep(Duration::from_millis(100));
    daemon.stop();
    assert!(!daemon.socket().exists());
    let ended = finish(follower);
    assert!(ended.code == Some(5) && ended.err.contains("it hung up"), "{ended:?}");
    for verb in ["status", "component list", "port hz a.b", "fault follow", "reload"] {
        let answer = ask(&daemon, verb);
        assert_eq!(answer.code, Some(5), "{verb}: {answer:?}");
        assert!(answer.err.contains("no such socket") && answer.err.contains("--socket PATH"), "{answer:?}");
    }
}

#[test]
fn a_stale_socket_is_replaced_and_a_living_daemons_is_not() {
    let (profiles, scratch) = (pair(), tempfile::tempdir().unwrap());
    let socket = scratch.path().join("stale.sock");
    drop(UnixListener::bind(&socket).unwrap());
    assert!(ask_at(&socket, "status").err.contains("nobody listens any more"));
    let path = socket.to_str().unwrap();
    let mut first = Running::start(profiles.path(), &["--socket", path]);
    done(ask_at(&socket, "status"));
    let mut second = Running::spawn(profiles.path(), &["--socket", path]);
    assert_eq!(second.wait().code(), Some(1));
    second.wait_for("another daemon has it; choose another one by --socket PATH");
    assert_eq!(second.entries("start")[0]["accepted"], false);
    done(ask_at(&socket, "status"));
    first.signal("KILL");
    first.wait();
    assert!(socket.exists(), "nobody was left to remove it");
    let third = Running::start(profiles.path(), &["--socket", path]);
    let status = done(ask_at(&socket, "status --format json")).json().remove(0);
    assert_eq!(status["pid"].as_u64(), Some(u64::from(third.id())));
}

#[test]
fn without_an_option_the_socket_is_the_users_and_a_daemon_that_cannot_have_it_runs_on() {
    let (profiles, runtime) = (pair(), tempfile::tempdir().unwrap());
    let first = Running::start_at_home(profiles.path(), runtime.path());
    let socket = runtime.path().join("framework-daemon/control.sock");
    done(ask_at(&socket, "status"));
    let mut second = Running::start_at_home(profiles.path(), runtime.path());
    second.wait_for("another daemon has it");
    second.wait_for("it runs without");
    second.stop();
    let status = done(ask_at(&socket, "status --format json")).json().remove(0);
    assert_eq!(status["pid"].as_u64(), Some(u64::from(first.id())), "it did not take the first one's along");
}
