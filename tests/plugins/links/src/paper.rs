//! What the paper promises beside its patterns' tables.

use std::time::Duration;

use cases::{same, table, text};
use component_sdk::prelude::*;

use crate::{Ask, Wirer, number_of, status, todo};

crate::paper_cases!(table Wirer;);

type Case = Result<(), String>;

fn sum(client: &mut QueryClient<Ask, crate::Told>, number: u64) -> Result<u64, Status> {
    number_of(client.query(Ask { todo: todo::ANSWER, number }))
}

/// The first case: the profile's connection is still there.
fn three_ways_to_be_wired(wirer: &mut Wirer, cx: &mut Context<'_>) -> Case {
    // By the profile, when the system starts.
    same(sum(&mut wirer.again, 1), Ok(2))?;
    // By itself.
    same(sum(&mut wirer.hidden, 1), Err(Status::Disconnected))?;
    text(status(wirer.hidden.connect("two", "told")))?;
    same(sum(&mut wirer.hidden, 1), Ok(11))?;
    // By somebody else, at a port with a name.
    text(status(cx.wiring().connect(("wirer", "ask"), ("one", "told"))))?;
    same(sum(&mut wirer.ask, 1), Ok(2))
}

fn add_remove(wirer: &mut Wirer, cx: &mut Context<'_>) -> Case {
    let wire = |cx: &Context<'_>, slot: &str| status(cx.wiring().connect(("wirer", "shown"), (slot, "told")));
    same(wire(cx, "one"), Err(Status::UnknownPort))?;
    text(status(wirer.hidden.add("shown")))?;
    text(wire(cx, "one"))?;
    text(status(wirer.hidden.remove()))?;
    same(wire(cx, "two"), Err(Status::UnknownPort))?;
    same(sum(&mut wirer.hidden, 1), Ok(2))
}

fn connect_any_time(wirer: &mut Wirer, cx: &mut Context<'_>) -> Case {
    for round in 0..100 {
        // With questions open, with answers there, and with neither.
        let (slot, sum) = if round % 2 == 0 { ("one", 2) } else { ("two", 11) };
        text(status(wirer.ask.connect(slot, "told")))?;
        let id = text(wirer.ask.request(Ask { todo: todo::ANSWER, number: 1 }))?;
        if round % 3 == 0 {
            same(number_of(wirer.ask.receive_wait(id)), Ok(sum))?;
        } else if round % 3 == 1 {
            same(cx.sleep(Duration::from_millis(1)), true)?;
        }
        if round % 3 != 0 {
            text(status(wirer.ask.disconnect()))?;
            let end = number_of(wirer.ask.receive_wait(id));
            same(end == Ok(sum) || end == Err(Status::Disconnected), true)?;
        }
    }
    Ok(())
}

fn by_value(wirer: &mut Wirer, _: &mut Context<'_>) -> Case {
    text(status(wirer.ask.connect("one", "told")))?;
    let mut question = Ask { todo: todo::ANSWER, number: 1 };
    let id = text(wirer.ask.request(question))?;
    question.number = 50;
    let other = text(wirer.ask.request(question))?;
    let mut answer = text(wirer.ask.receive_wait(id))?.take();
    answer.number += 100;
    same(answer.number, 102)?;
    same(number_of(wirer.ask.receive_wait(other)), Ok(51))
}
