//! The cases of service types.

use std::time::Duration;

use cases::{same, table, text};
use component_sdk::component::Component as _;
use component_sdk::prelude::*;

use crate::Sender;

crate::service_cases!(table Sender;);

const BOARD: (&str, &str) = ("sender", "board");
const SERVER: (&str, &str) = ("board", "board");

/// Connects, or says why not.
fn connect(cx: &Context<'_>, one: (&str, &str), other: (&str, &str)) -> Result<(), (Status, String)> {
    cx.wiring().connect(one, other).map_err(|refusal| (refusal.status, refusal.reason))
}

fn back_to_normal(cx: &Context<'_>) -> Result<(), String> {
    connect(cx, BOARD, SERVER).map_err(|(_, reason)| reason)
}

fn has(reason: &str, part: &str) -> Result<(), String> {
    if reason.contains(part) { Ok(()) } else { Err(format!("`{part}` is not in: {reason}")) }
}

fn blocking_method_is_a_query(sender: &mut Sender, _: &mut Context<'_>) -> Result<(), String> {
    let before = *text(sender.board.turn(0.0))?;
    same(text(sender.board.turn(1.5)).map(|turned| *turned), Ok(before + 1.5))
}

fn nonblocking_method_is_a_send(sender: &mut Sender, _: &mut Context<'_>) -> Result<(), String> {
    let before = *text(sender.board.beeps())?;
    for tone in 0..5 {
        text(sender.board.beep(tone))?;
    }
    same(text(sender.board.beeps()).map(|beeps| *beeps), Ok(before + 5))
}

fn method_without_parameters_or_result(sender: &mut Sender, _: &mut Context<'_>) -> Result<(), String> {
    text(sender.board.beep(1))?;
    text(sender.board.clear().map(drop))?;
    same(text(sender.board.beeps()).map(|beeps| *beeps), Ok(0))
}

fn method_may_be_asked_for_later(sender: &mut Sender, _: &mut Context<'_>) -> Result<(), String> {
    text(sender.board.clear().map(drop))?;
    let (one, two) = (text(sender.board.turn_request(1.0))?, text(sender.board.turn_request(2.0))?);
    let two = text(sender.board.turn.receive_wait(two)).map(|turned| *turned);
    let one = text(sender.board.turn.receive_wait(one)).map(|turned| *turned);
    same((one, two), (Ok(1.0), Ok(3.0)))
}

fn method_may_refuse(sender: &mut Sender, _: &mut Context<'_>) -> Result<(), String> {
    same(sender.board.release("brake".into()).map(|what| *what), Ok(7))?;
    same(sender.board.release("motor".into()).map(|what| *what), Err(Status::NotAllowed))
}

fn method_may_wait(sender: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    let began = cx.clock();
    text(sender.board.go(&Pose2D::default(), 20).map(drop))?;
    same(cx.clock().since(began) >= Duration::from_millis(20), true)
}

fn parameters_go_by_value_or_reference(sender: &mut Sender, _: &mut Context<'_>) -> Result<(), String> {
    let to = Pose2D { x: 1.0, y: 2.0, ..Pose2D::default() };
    let there = text(sender.board.go(&to, 0))?.take();
    same((there.x, there.y, to.x), (2.0, 2.0, 1.0))
}

fn unconnected_call_is_disconnected(sender: &mut Sender, _: &mut Context<'_>) -> Result<(), String> {
    same(sender.nobody.turn(1.0).map(|turned| *turned), Err(Status::Disconnected))?;
    same(sender.nobody.beep(1), Err(Status::Disconnected))?;
    same(sender.nobody.turn_request(1.0), Err(Status::Disconnected))
}

fn server_may_have_more(sender: &mut Sender, _: &mut Context<'_>) -> Result<(), String> {
    text(sender.board.clear().map(drop))?;
    text(sender.few.beep(1))?;
    same(text(sender.few.turn(2.0)).map(|turned| *turned), Ok(2.0))?;
    same(text(sender.board.beeps()).map(|beeps| *beeps), Ok(1))
}

fn blocking_reaches_every_method(sender: &mut Sender, _: &mut Context<'_>) -> Result<(), String> {
    text(sender.board.blocking(false))?;
    // Where there is an answer already, it wins.
    let ends = (sender.board.go(&Pose2D::default(), 50).err(), sender.board.beep(1));
    text(sender.board.blocking(true))?;
    same(ends, (Some(Status::Cancelled), Ok(())))
}

fn component_blocking_reaches_every_method(sender: &mut Sender, _: &mut Context<'_>) -> Result<(), String> {
    sender.blocking(false);
    let end = sender.board.go(&Pose2D::default(), 50).err();
    sender.blocking(true);
    same(end, Some(Status::Cancelled))
}

fn missing_method_is_incompatible(sender: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    let refused = connect(cx, BOARD, ("miser", "board"));
    let ends = (sender.board.turn(1.0).err(), sender.board.beep(1));
    back_to_normal(cx)?;
    let (status, reason) = refused.err().ok_or("it was connected")?;
    same(status, Status::IncompatibleService)?;
    has(&reason, "sender.board calls beep, beeps, clear, go, release, turn, miser.board has beep, turn")?;
    has(&reason, "method `beeps` is missing at the server")?;
    same(ends, (Some(Status::Disconnected), Err(Status::Disconnected)))
}

fn other_layout_is_incompatible(sender: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    let refused = connect(cx, ("sender", "few"), ("other", "board"));
    connect(cx, ("sender", "few"), SERVER).map_err(|(_, reason)| reason)?;
    let (status, reason) = refused.err().ok_or("it was connected")?;
    same(status, Status::IncompatibleService)?;
    has(&reason, "sender.few asks FewMethodsTurn for double, other.board answers OtherMethodsTurn with double")?;
    has(&reason, "method `turn`: the request is")?;
    same(sender.few.turn(0.0).is_ok(), true)
}

fn one_method_may_be_wired_by_itself(sender: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    connect(cx, ("sender", "nobody/beep"), ("miser", "board/beep")).map_err(|(_, reason)| reason)?;
    let ends = (sender.nobody.beep(1), sender.nobody.turn(1.0).err());
    text(cx.wiring().disconnect(("sender", "nobody/beep")).map_err(|refusal| refusal.status))?;
    same(ends, (Ok(()), Some(Status::Disconnected)))
}

fn failed_connect_leaves_disconnected(sender: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    let refused = connect(cx, BOARD, ("board", "none"));
    same(refused.err().map(|(status, _)| status), Some(Status::ServiceUnavailable))?;
    let refused = connect(cx, BOARD, ("taker", "orders"));
    let end = sender.board.beep(1);
    back_to_normal(cx)?;
    let (status, reason) = refused.err().ok_or("it was connected")?;
    same(status, Status::IncompatibleService)?;
    has(&reason, "one must call the methods of a service, the other have them")?;
    same(end, Err(Status::Disconnected))
}

fn disconnect_by_the_services_name(sender: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    text(cx.wiring().disconnect(BOARD).map_err(|refusal| refusal.status))?;
    let ends = (sender.board.turn(1.0).err(), sender.board.beep(1));
    same(cx.wiring().disconnect(BOARD).map_err(|refusal| refusal.status), Ok(()))?;
    let provided = cx.wiring().disconnect(SERVER).map_err(|refusal| refusal.status);
    back_to_normal(cx)?;
    same(ends, (Some(Status::Disconnected), Err(Status::Disconnected)))?;
    same(provided, Err(Status::IncompatibleService))?;
    same(sender.board.turn(0.0).is_ok(), true)
}

fn names_of_a_service_lead_to_it(sender: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    // Either may be named first.
    connect(cx, SERVER, BOARD).map_err(|(_, reason)| reason)?;
    same(sender.board.turn(0.0).is_ok(), true)?;
    same(connect(cx, ("sender", "boar"), SERVER).err().map(|(status, _)| status), Some(Status::UnknownPort))?;
    same(connect(cx, ("nobody", "board"), SERVER).err().map(|(status, _)| status), Some(Status::UnknownComponent))?;
    let both = connect(cx, BOARD, ("sender", "few")).err().map(|(status, _)| status);
    back_to_normal(cx)?;
    same(both, Some(Status::IncompatibleService))
}

fn methods_are_served_in_the_order_of_the_calls(sender: &mut Sender, _: &mut Context<'_>) -> Result<(), String> {
    text(sender.board.clear().map(drop))?;
    for beeps in 1..=200 {
        // `turn` stands before `beep` in the interface, and `beeps` behind it.
        text(sender.board.beep(1))?;
        text(sender.board.turn(0.0).map(drop))?;
        same(text(sender.board.beeps()).map(|beeps| *beeps), Ok(beeps))?;
    }
    // The other way round.
    text(sender.board.beep(1))?;
    let cleared = text(sender.board.clear_request())?;
    text(sender.board.beep(1))?;
    let turned = text(sender.board.turn_request(1.0))?;
    let beeps = text(sender.board.beeps_request())?;
    text(sender.board.beep(1))?;
    text(sender.board.clear.receive_wait(cleared).map(drop))?;
    text(sender.board.turn.receive_wait(turned).map(drop))?;
    same(text(sender.board.beeps.receive_wait(beeps)).map(|beeps| *beeps), Ok(1))
}
