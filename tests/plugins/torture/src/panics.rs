//! Panics.

use std::hint::black_box;

torture! {
    /// Panics.
    Panic => || panic!("torture");

    /// Panics in the drop of a local value, while nothing else is wrong.
    PanicInDrop => || drop(black_box(Bomb));

    /// Panics in a drop while a panic unwinds, which ends in an abort.
    DoublePanic => || {
        let _bomb = black_box(Bomb);
        panic!("torture, the first");
    };
}

struct Bomb;

impl Drop for Bomb {
    fn drop(&mut self) {
        panic!("torture in a drop");
    }
}
