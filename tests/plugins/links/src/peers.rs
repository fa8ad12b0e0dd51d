//! What the wirer wires.

use std::hint::black_box;
use std::time::Duration;

use component_sdk::prelude::*;

use crate::{Ask, Told, todo};

/// Adds.
#[derive(Component)]
#[component(name = "Adder", version = "1.0", passive)]
pub struct Adder {
    #[port(handler = on_ask)]
    told: QueryServer<Ask, Told>,
    /// Asks whoever it connects to itself.
    #[port(unlisted)]
    onward: QueryClient<Ask, Told>,
    /// What is added.
    #[property(default = 1)]
    summand: u64,
    kept: Option<Pending<Ask, Told>>,
}

impl Callbacks for Adder {}

impl Adder {
    fn on_ask(&mut self, cx: &mut Context<'_>, query: Query<'_, Ask, Told>) -> Outcome {
        let Ask { todo, number } = *query;
        match todo {
            todo::KEEP => self.kept = Some(query.keep()),
            todo::REPORT => {
                let ended = self.kept.take().map(|kept| kept.answer(Told::default()));
                let code = ended.map_or(u64::MAX, |ended| ended.map_or_else(|status| u64::from(status.code()), |()| 0));
                query.answer(Told { number: code })?;
            }
            todo::CUT => {
                // It waits for this very answer.
                cx.wiring().disconnect(("wirer", "ask"))?;
                self.kept = Some(query.keep());
            }
            todo::ONWARD => {
                self.onward.connect("two", "told")?;
                let number = self.onward.query(Ask { todo: todo::ANSWER, number })?.number;
                self.onward.disconnect()?;
                query.answer(Told { number })?;
            }
            todo::HOLD => {
                let began = cx.clock();
                while cx.clock().since(began) < Duration::from_millis(number) {
                    black_box(number);
                }
                self.kept = Some(query.keep());
            }
            _ => query.answer(Told { number: number + self.summand })?,
        }
        Ok(())
    }
}

/// An answer of the same layout by another name.
#[repr(C)]
#[derive(CommObject, Clone, Copy, Debug, Default, PartialEq)]
pub struct Sum {
    /// The sum.
    pub number: u64,
}

/// Adds a hundred, and says so by another name; and answers something else.
#[derive(Component)]
#[component(name = "OtherAdder", version = "1.0", passive)]
pub struct OtherAdder {
    #[port(handler = on_same)]
    same: QueryServer<Ask, Sum>,
    #[port(handler = on_other)]
    other: QueryServer<Ask, Pose2D>,
}

impl Callbacks for OtherAdder {}

impl OtherAdder {
    fn on_same(&mut self, _: &mut Context<'_>, query: Query<'_, Ask, Sum>) -> Outcome {
        let number = query.number + 100;
        query.answer(Sum { number })?;
        Ok(())
    }

    fn on_other(&mut self, _: &mut Context<'_>, query: Query<'_, Ask, Pose2D>) -> Outcome {
        query.answer(Pose2D::default())?;
        Ok(())
    }
}

/// Counts aloud, from 1.
#[derive(Component)]
#[component(name = "Speaker", version = "1.0", periodic = "1ms")]
pub struct Speaker {
    #[port]
    said: DataOut<u64>,
    number: u64,
}

impl Callbacks for Speaker {
    fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
        self.number += 1;
        self.said.write(self.number);
        Ok(())
    }
}

/// Listens to every number; one that is missing is a fault.
#[derive(Component)]
#[component(name = "Kept", version = "1.0", nonperiodic)]
pub struct Kept {
    #[port(fifo = 1000)]
    heard: DataIn<u64>,
    #[port(handler = on_ask)]
    count: QueryServer<Ask, Told>,
    last: u64,
    gaps: u64,
}

impl Callbacks for Kept {
    fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
        while let Some(number) = self.heard.take().copied() {
            self.gaps += u64::from(self.last != 0 && number != self.last + 1);
            self.last = number;
        }
        Ok(())
    }
}

impl Kept {
    /// How many numbers it has missed, or 1000 where it has heard none.
    fn on_ask(&mut self, _: &mut Context<'_>, query: Query<'_, Ask, Told>) -> Outcome {
        query.answer(Told { number: if self.last == 0 { 1000 } else { self.gaps } })?;
        Ok(())
    }
}

/// Wires the wirer's second port all the time while it is told to.
#[derive(Component)]
#[component(name = "Crowd", version = "1.0", periodic = "1ms")]
pub struct Crowd {
    #[port(handler = on_ask)]
    told: QueryServer<Ask, Told>,
    busy: bool,
    failed: u64,
}

impl Callbacks for Crowd {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        for _ in 0..if self.busy { 3 } else { 0 } {
            let ends =
                [cx.wiring().connect(("wirer", "again"), ("one", "told")), cx.wiring().disconnect(("wirer", "again"))];
            self.failed += ends.iter().filter(|end| end.is_err()).count() as u64;
        }
        Ok(())
    }
}

impl Crowd {
    /// Begins or ends; tells how often it was refused.
    fn on_ask(&mut self, _: &mut Context<'_>, query: Query<'_, Ask, Told>) -> Outcome {
        self.busy = query.number != 0;
        query.answer(Told { number: self.failed })?;
        Ok(())
    }
}

/// Shows its port by another name, from `start` on.
#[derive(Component)]
#[component(name = "Lister", version = "1.0", periodic = "5ms")]
pub struct Lister {
    #[port(unlisted)]
    ask: QueryClient<Ask, Told>,
    /// The name.
    #[property(default = "shown")]
    name: String,
}

impl Callbacks for Lister {
    fn initialize(&mut self, cx: &mut Context<'_>) -> Outcome {
        info!(cx, "in initialize: {:?}", self.ask.add(&self.name).map_err(|refusal| refusal.status));
        Ok(())
    }

    fn start(&mut self, cx: &mut Context<'_>) -> Outcome {
        self.ask.add(&self.name)?;
        info!(cx, "shown as {}", self.name);
        Ok(())
    }
}
