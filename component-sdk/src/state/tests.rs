//! Histories of the states, some written out and some at random.
#![cfg(test)]

use proptest::prelude::*;

use super::*;

fn machine() -> Machine {
    let mut machine = Machine::default();
    for (main, sub) in [("Moving", "drives"), ("Moving", "looks"), ("Looking", "looks"), ("Looking", "turns")] {
        machine.define(main, sub).unwrap();
    }
    machine
}

fn alive() -> Machine {
    let mut machine = machine();
    machine.step(0, Life::Alive).unwrap();
    go(&mut machine);
    machine
}

fn go(machine: &mut Machine) -> Vec<String> {
    let mut told = Vec::new();
    while let Some(turn) = machine.turn() {
        told.extend(turn.edges.iter().map(|edge| match edge {
            Edge::Quit(name) => format!("-{name}"),
            Edge::Enter(name) => format!("+{name}"),
        }));
        machine.arrive();
    }
    told
}

#[test]
fn the_life_is_the_table() {
    for (from, row) in Life::ALL.iter().zip([
        [false, true, true, true],
        [false, false, true, true],
        [false, false, false, true],
        [false; 4],
    ]) {
        for (to, may) in Life::ALL.iter().zip(row) {
            assert_eq!(from.may_become(*to), may, "{from:?} {to:?}");
            let mut machine = machine();
            let path: &[Life] = match from {
                Life::Init => &[],
                Life::Alive => &[Life::Alive],
                Life::FatalError => &[Life::Alive, Life::FatalError],
                Life::Shutdown => &[Life::Shutdown],
            };
            for step in path {
                machine.step(0, *step).unwrap();
                go(&mut machine);
            }
            assert_eq!(machine.step(0, *to), if may { Ok(()) } else { Err(Status::NotAllowed) });
        }
    }
}

#[test]
fn states_are_defined_before_they_are_used() {
    let mut machine = machine();
    for (main, sub) in
        [("Neutral", "x"), ("Deactivated", "x"), ("Shutdown", "x"), ("Own", "nonneutral"), ("Own", "init")]
    {
        assert_eq!(machine.define(main, sub), Err(Status::NotAllowed), "{main} {sub}");
    }
    assert_eq!(machine.set_initial("Sleeping"), Err(Status::Error));
    assert_eq!((machine.hold("drives"), machine.hold("flies")), (Err(Status::NotActivated), Err(Status::UnknownState)));
    assert_eq!(
        (machine.request(1, "Moving"), machine.current()),
        (Err(Status::NotActivated), Err(Status::NotActivated))
    );
    machine.set_initial("Moving").unwrap();
    machine.step(0, Life::Alive).unwrap();
    assert_eq!(go(&mut machine), ["-init", "+nonneutral", "+drives", "+looks"]);
    assert_eq!(
        (machine.define("Own", "x"), machine.set_initial("Moving")),
        (Err(Status::Activated), Err(Status::Activated))
    );
    assert_eq!(machine.current(), Ok("Moving"));
    assert_eq!(machine.mains().unwrap(), ["Neutral", "Moving", "Looking"]);
    assert_eq!(machine.subs("Looking").unwrap(), ["nonneutral", "looks", "turns"]);
    assert_eq!(machine.subs("Flying"), Err(Status::UnknownState));
}

#[test]
fn tables_have_an_end() {
    let mut machine = Machine::default();
    let mains = (0..).take_while(|number| machine.define(&format!("Main{number}"), "sub").is_ok()).count();
    let subs = (0..).take_while(|number| machine.define("Main0", &format!("sub{number}")).is_ok()).count();
    assert_eq!((mains, subs), (MAIN_STATES, SUBSTATES - RESERVED.len() - 1));
    machine.step(0, Life::Alive).unwrap();
    go(&mut machine);
    let asked = (1..).take_while(|asker| machine.request(*asker, "Main0").is_ok()).count();
    assert_eq!((asked, machine.request(99, "Main0")), (REQUESTS, Err(Status::Overload)));
}

#[test]
fn a_change_waits_for_those_that_hold_what_it_leaves_and_for_no_others() {
    let mut machine = alive();
    machine.request(1, "Moving").unwrap();
    assert_eq!(go(&mut machine), ["-neutral", "+nonneutral", "+drives", "+looks"]);
    assert_eq!(machine.answers(), [(0, Ok(())), (1, Ok(()))]);
    assert_eq!((machine.hold("drives"), machine.hold("looks")), (Ok(Hold::Held), Ok(Hold::Held)));
    machine.request(2, "Looking").unwrap();
    machine.request(3, "Neutral").unwrap();
    assert_eq!((machine.turn(), machine.answers()), (None, vec![]));
    assert_eq!((machine.hold("drives"), machine.hold("turns")), (Ok(Hold::Wait), Ok(Hold::Wait)));
    assert_eq!(machine.hold("looks"), Ok(Hold::Held), "it stays");
    machine.release("drives").unwrap();
    assert_eq!(machine.turn().unwrap().edges, [Edge::Quit("drives".to_owned()), Edge::Enter("turns".to_owned())]);
    assert_eq!((machine.turn(), machine.hold("turns")), (None, Ok(Hold::Wait)), "its handlers are at work");
    machine.arrive();
    assert_eq!((machine.answers(), machine.current()), (vec![(2, Ok(()))], Ok("Looking")));
    (0..5).for_each(|_| machine.release("looks").unwrap());
    assert_eq!(go(&mut machine), ["-looks", "-turns", "-nonneutral", "+neutral"]);
    assert_eq!(machine.answers(), [(3, Ok(()))], "each is answered");
    assert_eq!(machine.release("flies"), Err(Status::UnknownState));
}

#[test]
fn deactivation_rushes_and_shutdown_jumps_the_queue() {
    let mut machine = alive();
    for name in ["Init", "Alive", "FatalError", "Shutdown"] {
        assert_eq!(machine.request(9, name), Err(Status::NotAllowed));
    }
    assert_eq!(machine.request(9, "Flying"), Err(Status::UnknownState));
    machine.request(1, "Moving").unwrap();
    go(&mut machine);
    machine.hold("drives").unwrap();
    machine.request(2, "Looking").unwrap();
    assert!(machine.turn().is_none() && !machine.rushes());
    machine.request(3, "Deactivated").unwrap();
    assert!(machine.turn().is_none() && machine.rushes());
    machine.release("drives").unwrap();
    machine.turn().unwrap();
    machine.arrive();
    assert_eq!((machine.rushes(), machine.current()), (false, Ok("Neutral")));
    machine.turn().unwrap();
    machine.arrive();
    machine.hold("turns").unwrap();
    machine.request(4, "Moving").unwrap();
    assert!(machine.turn().is_none());
    machine.request(5, "Neutral").unwrap();
    machine.answers();
    machine.step(0, Life::Shutdown).unwrap();
    assert_eq!(machine.answers(), [(5, Err(Status::Cancelled)), (4, Err(Status::Cancelled))]);
    assert_eq!(machine.request(6, "Neutral"), Err(Status::Cancelled), "it is on its way");
    assert!(machine.turn().is_none(), "somebody holds");
    machine.release("turns").unwrap();
    assert_eq!(go(&mut machine), ["-looks", "-turns", "-nonneutral", "+shutdown"]);
    assert_eq!(machine.current(), Ok("Shutdown"));
    assert_eq!(machine.hold("looks"), Err(Status::NotActivated));
    assert_eq!(machine.request(7, "Moving"), Err(Status::Cancelled));
}

#[derive(Clone, Debug)]
enum Act {
    Request(usize),
    Step(usize),
    Hold(usize),
    Release(usize),
    Turn,
    Arrive,
}

fn acts() -> impl Strategy<Value = Vec<Act>> {
    let act = prop_oneof![
        4 => (0..5usize).prop_map(Act::Request),
        1 => (0..4usize).prop_map(Act::Step),
        4 => (0..8usize).prop_map(Act::Hold),
        4 => (0..8usize).prop_map(Act::Release),
        4 => Just(Act::Turn),
        4 => Just(Act::Arrive),
    ];
    proptest::collection::vec(act, 0..200)
}

const MAINS: [&str; 5] = ["Neutral", "Moving", "Looking", "Deactivated", "Flying"];
const SUBS: [&str; 8] = ["neutral", "nonneutral", "drives", "looks", "turns", "init", "fatalError", "shutdown"];

proptest! {
    #[test]
    fn whatever_happens_everybody_is_answered_once_and_nothing_is_left_while_it_is_held(acts in acts()) {
        let mut machine = alive();
        machine.answers();
        let (mut next, mut open) = (1, Vec::new());
        for act in acts {
            let before = machine.active;
            match act {
                Act::Request(main) => {
                    if machine.request(next, MAINS[main]).is_ok() {
                        open.push(next);
                    }
                    next += 1;
                }
                Act::Step(life) => _ = machine.step(0, Life::ALL[life]),
                Act::Hold(sub) => _ = machine.hold(SUBS[sub]),
                Act::Release(sub) => _ = machine.release(SUBS[sub]),
                Act::Turn => _ = machine.turn(),
                Act::Arrive if machine.is_changing() => machine.arrive(),
                Act::Arrive => {}
            }
            for left in machine.among(before & !machine.active) {
                prop_assert_eq!(machine.substates[left].held, 0);
            }
            for (asker, _) in machine.answers() {
                let known = open.iter().position(|open| *open == asker);
                prop_assert!(asker == 0 || known.is_some(), "answered twice, or never asked");
                known.into_iter().for_each(|index| _ = open.swap_remove(index));
            }
        }
        // Everybody lets go: all changes come to their end.
        machine.substates.iter_mut().for_each(|substate| substate.held = 0);
        if machine.is_changing() {
            machine.arrive();
        }
        go(&mut machine);
        for (asker, _) in machine.answers() {
            open.retain(|open| *open != asker);
        }
        prop_assert!(open.is_empty(), "never answered: {:?}", open);
    }
}
