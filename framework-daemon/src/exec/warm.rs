//! Warm restart: a slot of a daemon that was started again goes on from the checkpoint that the run before left; one that a
//! reload built anew, from that of before the reload.
//!
//! Its first instance gets it after `initialize` and is told by `recover`, as a successor is, with the symptom `restart`; then
//! comes `start`. Where one of them fails the checkpoint is forgotten and the fault is answered as any other.

use component_sdk::abi::class::{FaultArgs, Hook};

use super::callback::Call;
use super::checkpoint::{Checkpoint, Left};
use super::member::{Crew, Member};
use super::unit::Source;
use crate::model::fault::Fault;

/// What `recover` is told as the symptom.
const SYMPTOM: &str = "restart";

impl Member {
    /// Finds memory for the checkpoint, as far as it is known by now how large it may become. May take its time.
    pub(super) fn furnish_checkpoint(&mut self) {
        let (Some(checkpoint), Some(unit)) = (&mut self.checkpoint, &self.unit) else { return };
        let declared = self.shelf.recipes().iter().filter_map(|recipe| match &recipe.source {
            Source::Loaded(class) => Some(class.exported().decl.criticals.iter().map(|field| field.size).collect()),
            Source::Lazy(_) => None,
        });
        let standbys = self.standbys.iter().filter_map(|standby| standby.unit.as_ref());
        let registered = standbys.map(|unit| unit.regions.iter().map(|region| region.len).collect());
        let all: Vec<Vec<usize>> = declared.chain(registered).collect();
        checkpoint.furnish(&unit.regions, &all, unit.origin());
    }

    /// `start`; where a checkpoint was left, the first instance goes on from that.
    ///
    /// # Errors
    /// The fault of the copy, of `recover`, or of `start`.
    pub(super) fn start_instance(&mut self, crew: &mut Crew) -> Result<(), Fault> {
        let Some(left) = self.checkpoint.as_mut().and_then(Checkpoint::left) else { return self.enter_start(crew) };
        let result = self.go_on_from_before(left, crew).and_then(|age_ns| {
            self.keep_side_report();
            self.enter_start(crew).map(|()| age_ns)
        });
        let Some(checkpoint) = &mut self.checkpoint else { return Ok(()) };
        match result {
            Ok(age_ns) => age_ns.into_iter().for_each(|age_ns| checkpoint.tell_taken_up(left, age_ns)),
            Err(fault) => {
                checkpoint.forget();
                return Err(fault);
            }
        }
        Ok(())
    }

    /// The instance gets the checkpoint and is told; the age of that in nanoseconds.
    fn go_on_from_before(&mut self, left: Left, crew: &mut Crew) -> Result<Option<u64>, Fault> {
        let (Some(checkpoint), Some(unit)) = (&self.checkpoint, &mut self.unit) else { return Ok(None) };
        let Some(age_ns) = crew.restore(unit, checkpoint)? else { return Ok(None) };
        let what = match left {
            Left::ByRun => "the daemon was started again",
            Left::ByReload => "the slot was built anew",
        };
        let message = format!("{what}; the checkpoint is {:.1} ms old", age_ns as f64 / 1e6);
        let fault =
            FaultArgs { symptom: SYMPTOM.into(), slot: self.slot.name.into(), message: message.as_str().into() };
        crew.enter(unit, Call::plain(Hook::Recover).telling(fault))?;
        Ok(Some(age_ns))
    }
}
