//! Instances come and go here: constructor and `initialize` before, `stop`, `destroy` and the drop after. Executors and the
//! workshop share it, each with its own crew.

use component_sdk::abi::class::Hook;

use super::callback::{self, Call};
use super::checkpoint::{Checkpoint, Region};
use super::member::Crew;
use super::recover;
use super::slot::{Slot, Status};
use super::strand::{Frame, Pause, Strand};
use super::task_faults::start_tasks;
use super::unit::{Recipe, Unit};
use crate::model::fault::{Fault, FaultEvent, Outcome, Times};
use crate::model::ladder::Answer;
use crate::model::names;
use crate::model::symptom::{Severity, Symptom};
use crate::plugin::host;
use crate::sys::fiber::Fiber;
use crate::sys::seat;

impl Crew {
    /// An initialised instance after a recipe.
    ///
    /// # Errors
    /// The fault of its constructor or of `initialize`.
    pub fn make(&mut self, slot: &Slot, recipe: &Recipe) -> Result<Box<Unit>, Fault> {
        let parts = recipe.gather(slot).map_err(|text| callback::told(Symptom::Error, &text))?;
        let unit = callback::create(&mut self.fibers, parts)?;
        self.first(slot, unit, Hook::Initialize)
    }

    /// An initialised instance that is to stand ready: it runs a dry callback, so that its code, its memory and the way
    /// to it are warm.
    ///
    /// # Errors
    /// The fault of its constructor, of `initialize` or of `rehearse`.
    pub fn prepare(&mut self, slot: &Slot, recipe: &Recipe) -> Result<Box<Unit>, Fault> {
        let unit = self.make(slot, recipe)?;
        self.first(slot, unit, Hook::Rehearse)
    }

    /// Enters one of the first callbacks of a unit that is not in use yet.
    fn first(&mut self, slot: &Slot, mut unit: Box<Unit>, hook: Hook) -> Result<Box<Unit>, Fault> {
        match self.enter(&mut unit, Call::plain(hook)) {
            Ok(()) => Ok(unit),
            Err(fault) => {
                self.dispose(slot, unit);
                Err(fault)
            }
        }
    }

    /// Enters a callback of a unit of that slot.
    ///
    /// # Errors
    /// The fault that ended it.
    pub fn enter(&mut self, unit: &mut Unit, call: Call<'_>) -> Result<(), Fault> {
        let result = callback::enter(&mut self.fibers, unit, call);
        self.ended_ns = 0;
        self.look_after(unit);
        result
    }

    /// Enters a callback of a unit that may wait.
    ///
    /// # Errors
    /// The fault that ended it.
    pub fn begin(&mut self, unit: &mut Unit, strand: &mut Strand, call: &Call<'static>) -> Result<Pause, Fault> {
        let result = callback::begin(&mut self.fibers, unit, strand, call);
        self.look_after_own(unit);
        result
    }

    /// Goes on with a callback that waits; where it may not wait any more, it comes to its end.
    ///
    /// # Errors
    /// The fault that ended it.
    pub fn go_on(
        &mut self,
        unit: &mut Unit,
        strand: &mut Strand,
        begins_ns: u64,
        may_wait: bool,
    ) -> Result<Pause, Fault> {
        let result = callback::go_on(&mut self.fibers, unit, strand, begins_ns, may_wait);
        self.look_after_own(unit);
        result
    }

    /// Goes on from where a handler of a unit got to in its lane.
    ///
    /// # Errors
    /// The fault that ended it.
    pub(super) fn take_up(
        &mut self,
        unit: &mut Unit,
        strand: &mut Strand,
        fiber: Box<Fiber<Frame>>,
    ) -> Result<Pause, Fault> {
        let result = callback::take_up(&mut self.fibers, unit, strand, fiber);
        self.look_after(unit);
        result
    }

    /// As [`Self::look_after`]; what there is may be of others, who ran on the unit's time.
    fn look_after_own(&mut self, unit: &mut Unit) {
        if !self.aside.has_news() {
            self.look_after(unit);
        }
    }

    /// What follows every callback of a unit, however it ended.
    fn look_after(&mut self, unit: &mut Unit) {
        if seat::has_notes() {
            start_tasks(unit);
            while let Some(note) = host::take_region() {
                let name = names::intern(note.name.as_str());
                unit.register(Region { name, address: note.address, len: note.len });
            }
        }
    }

    /// Copies an instance's critical regions.
    ///
    /// # Errors
    /// The fault that the copy met.
    pub fn back_up(&mut self, unit: &mut Unit, checkpoint: &mut Checkpoint) -> Result<(), Fault> {
        self.ended_ns = 0;
        let regions = std::mem::take(&mut unit.regions);
        let has_room = checkpoint.make_room(&regions, unit.origin());
        let copied =
            if has_room { callback::touch(&mut self.fibers, unit, &mut || checkpoint.copy(&regions)) } else { Ok(()) };
        unit.regions = regions;
        if has_room && copied.is_ok() {
            checkpoint.seal();
        }
        copied
    }

    /// Puts the last checkpoint into a successor; returns its age in nanoseconds, or nothing where there is none that fits.
    ///
    /// # Errors
    /// The fault that the copy met.
    pub fn restore(&mut self, unit: &mut Unit, checkpoint: &Checkpoint) -> Result<Option<u64>, Fault> {
        let Some(whole) = checkpoint.whole_for(&unit.regions) else { return Ok(None) };
        let regions = std::mem::take(&mut unit.regions);
        let restored = callback::touch(&mut self.fibers, unit, &mut || checkpoint.restore(whole, &regions));
        unit.regions = regions;
        restored.map(|()| Some(whole.age_ns))
    }

    /// Ends a unit that was ready, or left on the shelf: in order where it is sound. What it does about that changes nothing
    /// any more, and is written down.
    pub fn end(&mut self, slot: &Slot, mut unit: Box<Unit>) {
        if unit.spent {
            // Counted by its executor, at once.
            return unit.quarantine();
        }
        for hook in [Hook::Stop, Hook::Destroy] {
            if !unit.spent
                && (hook == Hook::Destroy || unit.started)
                && let Err(fault) = self.enter(&mut unit, Call::plain(hook))
            {
                self.note(slot, unit.class, fault);
            }
        }
        self.dispose(slot, unit);
    }

    /// Gets rid of a unit: dropped where it is sound, quarantined and counted where it is not.
    pub fn dispose(&mut self, slot: &Slot, unit: Box<Unit>) {
        let class = unit.class;
        let disposal = callback::dispose(&mut self.fibers, unit);
        if let Some(fault) = disposal.fault {
            self.note(slot, class, fault);
        }
        if !disposal.dropped {
            Status::count(&slot.status.quarantined);
        }
    }

    /// Writes down a fault on the way out: there is nothing left to answer.
    fn note(&self, slot: &Slot, class: &'static str, fault: Fault) {
        Status::count(&slot.status.faults);
        slot.status.count_taint(fault.memory);
        let event = FaultEvent {
            slot: slot.name,
            class,
            severity: Severity::Ignore,
            answer: Answer::Ignore,
            successor: Some(slot.status.class()),
            outcome: Outcome::Ignored,
            checkpoint_ns: None,
            cause: None,
            times: Times { detected_ns: fault.detected_ns.saturating_sub(fault.at_ns), ..Times::default() },
            fault,
        };
        recover::send(&self.faults, event);
    }
}
