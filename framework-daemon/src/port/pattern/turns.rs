//! The order in which the servers of one slot are asked: as their calls came in. What a client sends to one method of a
//! service and then asks of another is served in that order, and no busy port keeps its neighbours waiting.
//!
//! A slot with a single server has its inbox for that, and pays nothing here.

use std::sync::Arc;

use crate::sys::shared::ArrayQueue;
use component_sdk::abi::calls::ServeArgs;

use super::provider::Provider;

/// Whose turn it is: places in the list of a slot's servers.
pub(super) struct Turns(ArrayQueue<usize>);

impl Turns {
    /// A call came in there. What finds no room is served after the others.
    pub(super) fn came(&self, place: usize) {
        let _ = self.0.push(place);
    }
}

/// From now on these are asked in the order in which their calls come in.
pub fn share(providers: &[Arc<Provider>]) {
    if providers.len() < 2 {
        return;
    }
    // Twice: calls that were ended in the queue leave their turn behind.
    let room = 2 * providers.iter().map(|port| port.room()).sum::<usize>();
    let turns = Arc::new(Turns(ArrayQueue::new(room.max(1))));
    for (place, port) in providers.iter().enumerate().filter(|(_, port)| port.has_handler()) {
        port.take_turns(Arc::clone(&turns), place);
    }
}

/// The next call of all of them that is to be served by a handler.
pub fn next(providers: &[Arc<Provider>]) -> Option<ServeArgs> {
    if let Some(turns) = providers.iter().find_map(|port| port.turns()) {
        while let Some(place) = turns.0.pop() {
            if let Some(served) = providers.get(place).and_then(|port| port.next()) {
                return Some(served);
            }
        }
    }
    providers.iter().find_map(|port| port.next())
}
