//! The wiring pattern: a component wires ports by their names, its own and others'.

use std::time::Duration;

use cases::{same, table, text};
use component_sdk::prelude::*;

use crate::{Ask, Wirer, number_of, status, todo};

crate::wiring_cases!(table Wirer;);

const OWN: (&str, &str) = ("wirer", "ask");
const ONE: (&str, &str) = ("one", "told");
const TWO: (&str, &str) = ("two", "told");
const SPEAKER: (&str, &str) = ("speaker", "said");

type Case = Result<(), String>;

fn connect(cx: &Context<'_>, one: (&str, &str), other: (&str, &str)) -> Result<(), Status> {
    status(cx.wiring().connect(one, other))
}

fn disconnect(cx: &Context<'_>, port: (&str, &str)) -> Result<(), Status> {
    status(cx.wiring().disconnect(port))
}

fn names_are_slot_and_port(wirer: &mut Wirer, cx: &mut Context<'_>) -> Case {
    text(connect(cx, OWN, ONE))?;
    same(wirer.sum(1), Ok(2))?;
    // Whichever is named first.
    text(connect(cx, TWO, OWN))?;
    same(wirer.sum(1), Ok(11))
}

fn every_slot_is_a_slave(_: &mut Wirer, cx: &mut Context<'_>) -> Case {
    // One that has no code for it.
    text(connect(cx, ("kept", "heard"), SPEAKER))?;
    text(connect(cx, ("lister", "shown"), ONE))?;
    text(disconnect(cx, ("lister", "shown")))
}

fn connect_by_master(wirer: &mut Wirer, cx: &mut Context<'_>) -> Case {
    text(connect(cx, OWN, ONE))?;
    same(wirer.sum(1), Ok(2))
}

fn connect_cancelled(wirer: &mut Wirer, cx: &mut Context<'_>) -> Case {
    text(wirer.ask.blocking(false))?;
    let ends = (connect(cx, OWN, ONE), disconnect(cx, OWN));
    text(wirer.ask.blocking(true))?;
    same(ends, (Ok(()), Ok(())))
}

fn connect_unknown_component(_: &mut Wirer, cx: &mut Context<'_>) -> Case {
    same(connect(cx, ("nobody", "ask"), ONE), Err(Status::UnknownComponent))
}

fn connect_unknown_port(_: &mut Wirer, cx: &mut Context<'_>) -> Case {
    same(connect(cx, ("wirer", "asks"), ONE), Err(Status::UnknownPort))
}

fn connect_service_unavailable(_: &mut Wirer, cx: &mut Context<'_>) -> Case {
    same(connect(cx, OWN, ("nobody", "told")), Err(Status::ServiceUnavailable))?;
    same(connect(cx, OWN, ("one", "tolt")), Err(Status::ServiceUnavailable))
}

fn connect_incompatible(_: &mut Wirer, cx: &mut Context<'_>) -> Case {
    same(connect(cx, OWN, ("other", "other")), Err(Status::IncompatibleService))?;
    same(connect(cx, ("other", "other"), OWN), Err(Status::IncompatibleService))
}

fn disconnect_by_master_ok(wirer: &mut Wirer, cx: &mut Context<'_>) -> Case {
    text(connect(cx, OWN, ONE))?;
    text(disconnect(cx, OWN))?;
    same(wirer.sum(1), Err(Status::Disconnected))
}

fn disconnect_unconnected_ok(_: &mut Wirer, cx: &mut Context<'_>) -> Case {
    text(disconnect(cx, OWN))?;
    text(disconnect(cx, ("wirer", "heard")))
}

fn disconnect_unknown_component(_: &mut Wirer, cx: &mut Context<'_>) -> Case {
    same(disconnect(cx, ("nobody", "ask")), Err(Status::UnknownComponent))
}

fn disconnect_unknown_port(_: &mut Wirer, cx: &mut Context<'_>) -> Case {
    same(disconnect(cx, ("wirer", "asks")), Err(Status::UnknownPort))
}

fn failed_connect_leaves_disconnected(wirer: &mut Wirer, cx: &mut Context<'_>) -> Case {
    for to in [("nobody", "told"), ("one", "tolt"), ("other", "other"), SPEAKER, ("wirer", "again")] {
        text(connect(cx, OWN, ONE))?;
        same(wirer.sum(1), Ok(2))?;
        same(connect(cx, OWN, to).is_err(), true)?;
        same(wirer.sum(1), Err(Status::Disconnected))?;
    }
    // The server named first.
    text(connect(cx, OWN, ONE))?;
    same(connect(cx, ("other", "other"), OWN), Err(Status::IncompatibleService))?;
    same(wirer.sum(1), Err(Status::Disconnected))
}

fn compatibility_by_layout(wirer: &mut Wirer, cx: &mut Context<'_>) -> Case {
    // `Sum` is laid out as `Told` is.
    text(connect(cx, OWN, ("other", "same")))?;
    same(wirer.sum(1), Ok(101))
}

fn wrong_type_incompatible(_: &mut Wirer, cx: &mut Context<'_>) -> Case {
    same(connect(cx, OWN, ("other", "other")), Err(Status::IncompatibleService))
}

fn wrong_pattern_incompatible(_: &mut Wirer, cx: &mut Context<'_>) -> Case {
    same(connect(cx, OWN, SPEAKER), Err(Status::IncompatibleService))?;
    same(connect(cx, ("wirer", "heard"), ONE), Err(Status::IncompatibleService))?;
    same(connect(cx, OWN, ("wirer", "again")), Err(Status::IncompatibleService))
}

fn refusal_names_both_sides(_: &mut Wirer, cx: &mut Context<'_>) -> Case {
    for to in [("other", "other"), SPEAKER, ("nobody", "told"), ("one", "tolt")] {
        let refusal = cx.wiring().connect(OWN, to).expect_err("they do not fit");
        let names = ["wirer.ask".to_owned(), format!("{}.{}", to.0, to.1)];
        if !names.iter().all(|name| refusal.reason.contains(name)) {
            return Err(refusal.reason);
        }
    }
    Ok(())
}

fn removed_port_keeps_connection_unknown_to_masters(wirer: &mut Wirer, cx: &mut Context<'_>) -> Case {
    text(connect(cx, OWN, ONE))?;
    text(status(wirer.ask.remove()))?;
    let ends = (connect(cx, OWN, TWO), disconnect(cx, OWN), wirer.sum(1));
    text(status(wirer.ask.add("ask")))?;
    same(ends, (Err(Status::UnknownPort), Err(Status::UnknownPort), Ok(2)))
}

fn duplicate_port_name(wirer: &mut Wirer, _: &mut Context<'_>) -> Case {
    same(status(wirer.hidden.add("again")), Err(Status::PortAlreadyUsed))
}

fn masters_at_once_are_serialised_per_port(wirer: &mut Wirer, cx: &mut Context<'_>) -> Case {
    text(status(wirer.ask.connect("crowd", "told")))?;
    let tell = |number| Ask { todo: 0, number };
    let before = text(number_of(wirer.ask.query(tell(1))))?;
    for _ in 0..50 {
        for _ in 0..3 {
            text(connect(cx, ("wirer", "again"), TWO))?;
            // Whoever was last: it leads to one of the two, or nowhere.
            let sum = number_of(wirer.again.query(Ask { todo: todo::ANSWER, number: 1 }));
            same([Ok(2), Ok(11), Err(Status::Disconnected)].contains(&sum), true)?;
        }
        let _ = cx.sleep(Duration::from_millis(1));
    }
    let after = text(number_of(wirer.ask.query(tell(0))))?;
    same(after, before)
}

fn rewire_under_traffic_loses_nothing_elsewhere(wirer: &mut Wirer, cx: &mut Context<'_>) -> Case {
    text(connect(cx, ("kept", "heard"), SPEAKER))?;
    let mut last = 0;
    for _ in 0..100 {
        text(connect(cx, ("wirer", "heard"), SPEAKER))?;
        same(cx.sleep(Duration::from_millis(2)), true)?;
        if let Some(number) = wirer.heard.fresh().copied() {
            same(number > last, true)?;
            last = number;
        }
        text(disconnect(cx, ("wirer", "heard")))?;
    }
    same(last > 0, true)?;
    text(connect(cx, OWN, ("kept", "count")))?;
    same(wirer.sum(0), Ok(0))
}
