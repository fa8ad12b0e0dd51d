//! The spare that an executor has at hand. The workshop makes spares on another processor; taken from the shelf in the
//! moment of a fault, each of its lines would have to come over first.

use super::member::Member;
use super::unit::Unit;

impl Member {
    /// Takes a spare from the shelf in advance, where there is one.
    #[inline]
    pub(super) fn reach_for_spare(&mut self) {
        if self.spare.is_none() && !self.shelf.is_bare() {
            self.pick_up_spare();
        }
    }

    #[cold]
    fn pick_up_spare(&mut self) {
        // First, so that the workshop does not make another one meanwhile.
        self.shelf.set_at_hand(true);
        self.spare = self.shelf.take();
        self.shelf.set_at_hand(self.spare.is_some());
        self.spare.iter().for_each(|unit| unit.bring_near());
        // While it changed hands the workshop may have counted it twice.
        self.shelf.order();
    }

    /// A spare of the class in use: the one at hand, or one from the shelf.
    pub(super) fn take_spare(&mut self) -> Option<Box<Unit>> {
        self.put_spare_down().or_else(|| self.shelf.take())
    }

    /// The one at hand is at hand no more.
    pub(super) fn put_spare_down(&mut self) -> Option<Box<Unit>> {
        let spare = self.spare.take()?;
        self.shelf.set_at_hand(false);
        Some(spare)
    }

    /// The spare that is the instance of that number.
    pub(super) fn find_spare(&mut self, number: u64) -> Option<Box<Unit>> {
        match &self.spare {
            Some(spare) if spare.owner.instance == number => self.put_spare_down(),
            _ => self.shelf.take_instance(number),
        }
    }
}
