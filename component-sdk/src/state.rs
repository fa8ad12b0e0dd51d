//! The states of a component as a table and a few pure functions: no thread, no clock, no lock. [`crate::port::StateSlave`] feeds it.
//!
//! | life cycle, from \ to | Alive | FatalError | Shutdown |
//! |---|---|---|---|
//! | Init | yes | yes | yes |
//! | Alive | | yes | yes |
//! | FatalError | | | yes |
//! | Shutdown | | | |
//!
//! A main state is a set of substates; a substate may be held, and is left only when nobody holds it. What is in the old main
//! state and in the new one goes on untouched.

use std::collections::VecDeque;

use crate::status::Status;

/// Most substates, those that are always there included.
pub const SUBSTATES: usize = 32;
/// Most main states of an author's.
pub const MAIN_STATES: usize = 16;
/// Most requests that wait for their turn.
pub const REQUESTS: usize = 8;

/// Main state at rest: only `neutral`.
pub const NEUTRAL: &str = "Neutral";
/// A command: blocking calls of the component end until it is in `Neutral`.
pub const DEACTIVATED: &str = "Deactivated";

/// Substates that are always there.
const INIT: usize = 0;
const NEUTRAL_SUB: usize = 1;
const NONNEUTRAL: usize = 2;
const FATAL: usize = 3;
const SHUT: usize = 4;
const RESERVED: [&str; 5] = ["init", "neutral", "nonneutral", "fatalError", "shutdown"];

/// Where a component is in its life.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Life {
    /// Its states are being defined.
    Init,
    /// It is in a main state.
    Alive,
    /// It cannot go on.
    FatalError,
    /// It is about to end.
    Shutdown,
}

impl Life {
    /// All of them, in the order of the table.
    pub const ALL: [Self; 4] = [Self::Init, Self::Alive, Self::FatalError, Self::Shutdown];

    /// True where this may follow `self`.
    #[must_use]
    pub const fn may_become(self, next: Self) -> bool {
        const TABLE: [[bool; 4]; 4] = [
            [false, true, true, true],
            [false, false, true, true],
            [false, false, false, true],
            [false, false, false, false],
        ];
        TABLE[self as usize][next as usize]
    }

    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        ["Init", "Alive", "FatalError", "Shutdown"][self as usize]
    }
}

/// What a handler is told during a change.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Edge {
    /// That substate is left; nobody holds it.
    Quit(String),
    /// That substate is entered; nobody holds it yet.
    Enter(String),
}

/// Where a change leads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Target {
    /// Main state, by number.
    Main(usize),
    /// `Neutral`, and blocking calls end until then.
    Deactivated,
    Life(Life),
}

/// Who asked for a change: a number of the caller's.
pub type Asker = u64;

struct Substate {
    name: String,
    held: usize,
}

struct Main {
    name: String,
    mask: u32,
}

/// What an attempt to hold a substate came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hold {
    /// It is held.
    Held,
    /// It is not active, or about to be left.
    Wait,
}

/// What is to be done next for a change.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Turn {
    /// What handlers are told, in this order, before [`Machine::arrive`].
    pub edges: Vec<Edge>,
}

/// The states of one component.
pub struct Machine {
    substates: Vec<Substate>,
    mains: Vec<Main>,
    initial: usize,
    life: Life,
    /// The main state, where it is alive; `None` before.
    current: Option<usize>,
    /// The substates that are active.
    active: u32,
    pending: Option<(Asker, Target)>,
    /// Handlers are at work on the pending change.
    changing: bool,
    queue: VecDeque<(Asker, Target)>,
    /// Who asked and is to be told now.
    answers: Vec<(Asker, Result<(), Status>)>,
}

impl Default for Machine {
    fn default() -> Self {
        let substates = RESERVED.iter().map(|name| Substate { name: (*name).to_owned(), held: 0 }).collect();
        let neutral = Main { name: NEUTRAL.to_owned(), mask: 1 << NEUTRAL_SUB };
        Self {
            substates,
            mains: vec![neutral],
            initial: 0,
            life: Life::Init,
            current: None,
            active: 1 << INIT,
            pending: None,
            changing: false,
            queue: VecDeque::new(),
            answers: Vec::new(),
        }
    }
}

impl Machine {
    fn main(&self, name: &str) -> Option<usize> {
        self.mains.iter().position(|main| main.name == name)
    }

    fn substate(&self, name: &str) -> Result<usize, Status> {
        self.substates.iter().position(|substate| substate.name == name).ok_or(Status::UnknownState)
    }

    const fn is_activated(&self) -> bool {
        !matches!(self.life, Life::Init)
    }

    /// Puts a substate into a main state; makes both where they are new.
    ///
    /// # Errors
    /// `Activated`; `NotAllowed`: a reserved name; `Overload`: too many.
    pub fn define(&mut self, main: &str, sub: &str) -> Result<(), Status> {
        if self.is_activated() {
            return Err(Status::Activated);
        }
        let life = |name: &str| Life::ALL.iter().any(|life| life.name() == name);
        if main == NEUTRAL || main == DEACTIVATED || life(main) || RESERVED.contains(&sub) {
            return Err(Status::NotAllowed);
        }
        let known = self.substates.iter().position(|substate| substate.name == sub);
        if known.is_none() && self.substates.len() == SUBSTATES
            || self.main(main).is_none() && self.mains.len() > MAIN_STATES
        {
            return Err(Status::Overload);
        }
        let sub = known.unwrap_or_else(|| {
            self.substates.push(Substate { name: sub.to_owned(), held: 0 });
            self.substates.len() - 1
        });
        let main = self.main(main).unwrap_or_else(|| {
            self.mains.push(Main { name: main.to_owned(), mask: 1 << NONNEUTRAL });
            self.mains.len() - 1
        });
        self.mains[main].mask |= 1 << sub;
        Ok(())
    }

    /// The main state that it begins with; `Neutral` else.
    ///
    /// # Errors
    /// `Error`: no such state; `Activated`.
    pub fn set_initial(&mut self, main: &str) -> Result<(), Status> {
        if self.is_activated() {
            return Err(Status::Activated);
        }
        self.initial = self.main(main).ok_or(Status::Error)?;
        Ok(())
    }

    /// Asks for a step in its life; the component itself does.
    ///
    /// # Errors
    /// `NotAllowed`: not from here.
    pub fn step(&mut self, asker: Asker, next: Life) -> Result<(), Status> {
        let from = match (&self.pending, self.queue.front()) {
            // What is on its way already counts.
            (Some((_, Target::Life(life))), _) | (_, Some((_, Target::Life(life)))) => *life,
            _ => self.life,
        };
        if !from.may_become(next) {
            return Err(Status::NotAllowed);
        }
        if next != Life::Alive {
            self.jump_the_queue();
        }
        self.queue.push_front((asker, Target::Life(next)));
        Ok(())
    }

    /// Whoever waits for another state waits no longer.
    fn jump_the_queue(&mut self) {
        let waiting = std::mem::take(&mut self.queue);
        self.answers.extend(waiting.into_iter().map(|(asker, _)| (asker, Err(Status::Cancelled))));
        if let Some((asker, _)) = self.pending.take_if(|_| !self.changing) {
            self.answers.push((asker, Err(Status::Cancelled)));
        }
    }

    /// A master asks for a main state.
    ///
    /// # Errors
    /// `NotActivated`; `Cancelled`: it fails or ends; `NotAllowed`: a step of its life, which is its own; `UnknownState`;
    /// `Overload`: too many ask.
    pub fn request(&mut self, asker: Asker, main: &str) -> Result<(), Status> {
        let target = match self.life {
            Life::Init => return Err(Status::NotActivated),
            Life::FatalError | Life::Shutdown => return Err(Status::Cancelled),
            Life::Alive if Life::ALL.iter().any(|life| life.name() == main) => return Err(Status::NotAllowed),
            Life::Alive if main == DEACTIVATED => Target::Deactivated,
            Life::Alive => Target::Main(self.main(main).ok_or(Status::UnknownState)?),
        };
        let ends = |(_, target): &(Asker, Target)| matches!(target, Target::Life(_));
        if self.pending.as_ref().is_some_and(ends) || self.queue.iter().any(ends) {
            return Err(Status::Cancelled);
        }
        if self.queue.len() == REQUESTS {
            return Err(Status::Overload);
        }
        if target == Target::Deactivated {
            // Before one that waits for holders: that may be what they wait for.
            let waiting = self.pending.take_if(|_| !self.changing);
            waiting.into_iter().for_each(|waiting| self.queue.push_front(waiting));
            self.queue.push_front((asker, target));
        } else {
            self.queue.push_back((asker, target));
        }
        Ok(())
    }

    /// The substates of a target.
    fn mask(&self, target: Target) -> u32 {
        match target {
            Target::Main(main) => self.mains[main].mask,
            Target::Deactivated => self.mains[0].mask,
            Target::Life(Life::Init) => 1 << INIT,
            Target::Life(Life::Alive) => self.mains[self.initial].mask,
            Target::Life(Life::FatalError) => 1 << FATAL,
            Target::Life(Life::Shutdown) => 1 << SHUT,
        }
    }

    /// True while blocking calls are to end.
    #[must_use]
    pub fn rushes(&self) -> bool {
        matches!(self.pending, Some((_, Target::Deactivated)))
    }

    /// The next change that can be carried out: its edges, after which [`Self::arrive`] is to be called. `None`: there is
    /// none, or somebody holds what is to be left.
    pub fn turn(&mut self) -> Option<Turn> {
        if self.changing {
            return None;
        }
        if self.pending.is_none() {
            self.pending = self.queue.pop_front();
        }
        let (_, target) = self.pending?;
        let leaving = self.active & !self.mask(target);
        if self.among(leaving).any(|substate| self.substates[substate].held > 0) {
            return None;
        }
        self.changing = true;
        let entering = self.mask(target) & !self.active;
        // The common substate is left last and entered first.
        let (common, apart) = (1u32 << NONNEUTRAL, !(1u32 << NONNEUTRAL));
        let name = |substate: usize| self.substates[substate].name.clone();
        let quits = self.among(leaving & apart).chain(self.among(leaving & common)).map(|each| Edge::Quit(name(each)));
        let enters =
            self.among(entering & common).chain(self.among(entering & apart)).map(|each| Edge::Enter(name(each)));
        Some(Turn { edges: quits.chain(enters).collect() })
    }

    fn among(&self, mask: u32) -> impl Iterator<Item = usize> + use<> {
        (0..self.substates.len()).filter(move |substate| mask & 1 << substate != 0)
    }

    /// Handlers are at work, or were.
    #[must_use]
    pub const fn is_changing(&self) -> bool {
        self.changing
    }

    /// The handlers are done: the change is.
    pub fn arrive(&mut self) {
        let Some((asker, target)) = self.pending.take() else { return };
        self.changing = false;
        self.active = self.mask(target);
        match target {
            Target::Main(main) => self.current = Some(main),
            Target::Deactivated => self.current = Some(0),
            Target::Life(life) => {
                self.life = life;
                self.current = (life == Life::Alive).then_some(self.initial);
            }
        }
        self.answers.push((asker, Ok(())));
    }

    /// Who is to be told, and what.
    pub fn answers(&mut self) -> Vec<(Asker, Result<(), Status>)> {
        std::mem::take(&mut self.answers)
    }

    /// The substates that a change, begun or waiting, takes away or brings.
    fn touched(&self) -> u32 {
        self.pending.map_or(0, |(_, target)| self.mask(target) ^ self.active)
    }

    /// Tries to hold a substate.
    ///
    /// # Errors
    /// `UnknownState`; `NotActivated`: before it is activated, and in `Shutdown`.
    pub fn hold(&mut self, name: &str) -> Result<Hold, Status> {
        let substate = self.substate(name)?;
        if !self.is_activated() || self.life == Life::Shutdown {
            return Err(Status::NotActivated);
        }
        if self.active & !self.touched() & 1 << substate == 0 {
            return Ok(Hold::Wait);
        }
        self.substates[substate].held += 1;
        Ok(Hold::Held)
    }

    /// Lets a substate go; once too often is no mistake.
    ///
    /// # Errors
    /// `UnknownState`.
    pub fn release(&mut self, name: &str) -> Result<(), Status> {
        let substate = self.substate(name)?;
        self.substates[substate].held = self.substates[substate].held.saturating_sub(1);
        Ok(())
    }

    /// The main state, or the step of its life where it is in none.
    ///
    /// # Errors
    /// `NotActivated`.
    pub fn current(&self) -> Result<&str, Status> {
        if !self.is_activated() {
            return Err(Status::NotActivated);
        }
        Ok(self.current.map_or(self.life.name(), |main| &self.mains[main].name))
    }

    /// All main states.
    ///
    /// # Errors
    /// `NotActivated`.
    pub fn mains(&self) -> Result<Vec<&str>, Status> {
        if !self.is_activated() {
            return Err(Status::NotActivated);
        }
        Ok(self.mains.iter().map(|main| main.name.as_str()).collect())
    }

    /// The substates of a main state.
    ///
    /// # Errors
    /// `NotActivated`, `UnknownState`.
    pub fn subs(&self, main: &str) -> Result<Vec<&str>, Status> {
        if !self.is_activated() {
            return Err(Status::NotActivated);
        }
        let mask = self.mains[self.main(main).ok_or(Status::UnknownState)?].mask;
        Ok(self.among(mask).map(|substate| self.substates[substate].name.as_str()).collect())
    }
}

mod tests;
