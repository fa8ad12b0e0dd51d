//! A reload that builds a slot anew: the new instance goes on from the checkpoint of the old one, as a successor does. A
//! fresh copy is made while the old one still works, so that a long period costs nothing; where it failed, there is nothing
//! to go on from that could be trusted.

use super::checkpoint::Left;
use super::kept::Kept;
use super::member::{Crew, Member};
use crate::model::lifecycle::State;

impl Member {
    /// What whoever takes the slot over is to go on from.
    pub(super) fn hand_over(&mut self, crew: &mut Crew) -> Option<Kept> {
        if self.state() == State::Active && !self.strand.waits() {
            self.back_up_now(crew);
        }
        let is_sound = matches!(self.state(), State::Active | State::Inactive);
        let unit = self.unit.as_ref().filter(|unit| is_sound && !unit.spent)?;
        self.checkpoint.as_ref()?.to_keep(&unit.regions)
    }

    /// The slot's first instance is to go on from that, when it starts.
    ///
    /// # Errors
    /// Why it cannot.
    pub(super) fn inherit(&mut self, kept: &Kept) -> Result<(), String> {
        let checkpoint = self.checkpoint.as_mut().ok_or_else(|| "it keeps none any more".to_owned())?;
        checkpoint.inherit(kept, Left::ByReload)
    }
}
