//! One question and its answer, or one message, which has none. The memory is the client's port's, made once and used again.
//!
//! | word | written by | states |
//! |---|---|---|
//! | client | the client's callbacks | `Free -> Loan -> Sent -> (Lent ->) Free`; of a message `Free -> Loan -> Free` |
//! | server | who holds the call: the client until it is sent, then whoever takes it from the provider's queue | `None -> Queued -> Taken -> Over(code)` |
//!
//! A message is the server's from the moment in which it is queued: the client does not look at it again, and whether it
//! is still connected, or there, does not matter any more.
//!
//! A call is used anew when the client's word is `Free` and the server's `None` or `Over`: nobody else touches it then.
//! Both words carry the generation, so that a number of an earlier use fits neither.

use std::sync::{Arc, OnceLock};

use component_sdk::object::TypeDescriptor;
use component_sdk::status::Status;

use super::objects::Objects;
use crate::port::block::Block;
use crate::sys::bell::{Ring, Signal};
use crate::sys::shared::{AtomicBool, AtomicU32, AtomicU64, Ordering};

/// How far the client is with it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
pub(super) enum ClientState {
    /// Nobody uses it.
    Free,
    /// Its request is being filled.
    Loan,
    /// Its answer is awaited.
    Sent,
    /// Its answer is being read.
    Lent,
}

/// How far the server is with it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
enum ServerState {
    None,
    Queued,
    Taken,
    Over,
}

/// Generation, state and code in one word.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Word(u64);

impl Word {
    const fn new(generation: u32, state: u16, code: u16) -> Self {
        Self((generation as u64) << 32 | (state as u64) << 16 | code as u64)
    }

    const fn generation(self) -> u32 {
        (self.0 >> 32) as u32
    }

    const fn state(self) -> u16 {
        (self.0 >> 16) as u16
    }

    const fn code(self) -> u16 {
        self.0 as u16
    }
}

/// What the client finds when it looks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Look {
    /// Nothing yet.
    Open,
    /// The answer.
    Answered,
    /// It will never come.
    Ended(Status),
}

/// One call of a client port.
pub(super) struct Call {
    client: AtomicU64,
    server: AtomicU64,
    epoch: AtomicU32,
    /// Asked again of the provider's successor.
    retry: AtomicBool,
    pub(super) request: Block,
    pub(super) answer: Block,
}

impl Call {
    fn new(request: &'static TypeDescriptor, answer: &'static TypeDescriptor) -> Self {
        Self {
            client: AtomicU64::new(0),
            server: AtomicU64::new(0),
            epoch: AtomicU32::new(0),
            retry: AtomicBool::new(false),
            request: Block::new(request),
            answer: Block::new(answer),
        }
    }

    fn client(&self) -> Word {
        Word(self.client.load(Ordering::Acquire))
    }

    fn server(&self) -> Word {
        Word(self.server.load(Ordering::Acquire))
    }

    fn set_server(&self, generation: u32, state: ServerState, code: u32) {
        // Every status fits: the largest has eleven bits.
        self.server.store(Word::new(generation, state as u16, code as u16).0, Ordering::Release);
    }

    /// Client: begins a new use; `None`: somebody still has it.
    pub(super) fn begin(&self) -> Option<u32> {
        let (client, server) = (self.client(), self.server());
        let is_over = server.state() == ServerState::None as u16 || server.state() == ServerState::Over as u16;
        if client.state() != ClientState::Free as u16 || !is_over {
            return None;
        }
        // Never 0: no number of a call is.
        let generation = client.generation().wrapping_add(1).max(1);
        self.set_server(generation, ServerState::None, 0);
        self.set_client(generation, ClientState::Loan);
        Some(generation)
    }

    /// Client: goes on to that state.
    pub(super) fn set_client(&self, generation: u32, state: ClientState) {
        self.client.store(Word::new(generation, state as u16, 0).0, Ordering::Release);
    }

    /// True when the client is that far with that use.
    pub(super) fn is_client(&self, generation: u32, state: ClientState) -> bool {
        self.client() == Word::new(generation, state as u16, 0)
    }

    /// Client: about to be queued.
    pub(super) fn send(&self, generation: u32, epoch: u32, retry: bool) {
        self.epoch.store(epoch, Ordering::Relaxed);
        self.retry.store(retry, Ordering::Relaxed);
        self.set_server(generation, ServerState::Queued, 0);
        self.set_client(generation, ClientState::Sent);
    }

    /// Client: it could not be queued; nobody else has it.
    pub(super) fn unsend(&self, generation: u32) {
        self.set_server(generation, ServerState::None, 0);
    }

    /// Client: it was not sent after all; nobody else has it.
    pub(super) fn take_back(&self, generation: u32) {
        self.unsend(generation);
        self.set_client(generation, ClientState::Loan);
    }

    /// Client: how far the server is with that use.
    pub(super) fn look(&self, generation: u32) -> Look {
        let server = self.server();
        if server.generation() != generation || server.state() != ServerState::Over as u16 {
            return Look::Open;
        }
        if server.code() == 0 { Look::Answered } else { Look::Ended(Status::from_code(u32::from(server.code()))) }
    }

    /// Gives up what is in the use of an instance that is gone: what it had on loan may be half an object.
    fn abandon(&self) {
        let client = self.client();
        if client.state() == ClientState::Lent as u16 {
            self.answer.forget_contents();
        }
        // A request on loan counts as empty until it is sent.
        self.set_client(client.generation(), ClientState::Free);
    }

    pub(super) fn epoch(&self) -> u32 {
        self.epoch.load(Ordering::Relaxed)
    }

    /// Server: out of the queue, in hand.
    pub(super) fn take(&self, generation: u32) {
        self.set_server(generation, ServerState::Taken, 0);
    }

    /// Server: done with the use that the client is at.
    pub(super) fn finish(&self, code: u32) {
        self.end(self.client().generation(), code);
    }

    /// Server: done with it; afterwards it is not to be touched.
    fn end(&self, generation: u32, code: u32) {
        self.set_server(generation, ServerState::Over, code);
    }
}

/// The calls of a client port, and how its slot is rung. Held by the port and by every server that has one of the calls.
pub(super) struct Client {
    calls: Box<[Call]>,
    /// Counts connections and instances: an answer to an earlier one has nobody left to go to.
    epoch: AtomicU32,
    signal: OnceLock<Arc<Signal>>,
    /// Its calls are messages.
    one_way: bool,
}

impl Client {
    pub(super) fn new(objects: Objects, calls: usize) -> Arc<Self> {
        let calls = (0..calls).map(|_| Call::new(objects.request, objects.answer())).collect();
        let one_way = objects.is_one_way();
        Arc::new(Self { calls, epoch: AtomicU32::new(0), signal: OnceLock::new(), one_way })
    }

    pub(super) const fn is_one_way(&self) -> bool {
        self.one_way
    }

    pub(super) fn listen(&self, signal: Arc<Signal>) {
        let _ = self.signal.set(signal);
    }

    pub(super) fn ring(&self) {
        if let Some(signal) = self.signal.get() {
            signal.ring(Ring::Wait);
        }
    }

    pub(super) fn calls(&self) -> &[Call] {
        &self.calls
    }

    pub(super) fn epoch(&self) -> u32 {
        self.epoch.load(Ordering::SeqCst)
    }

    /// Whatever is open is over.
    pub(super) fn next_epoch(&self) {
        self.epoch.fetch_add(1, Ordering::SeqCst);
    }

    /// Gives all calls up, whatever they are at.
    pub(super) fn abandon(&self) {
        self.next_epoch();
        self.calls.iter().for_each(Call::abandon);
    }
}

/// A call on its way to a server or in its hand. Whoever has the one ticket of a use is the writer of its server's word.
pub(super) struct Ticket {
    client: Arc<Client>,
    index: u32,
    generation: u32,
}

impl Ticket {
    pub(super) fn new(client: &Arc<Client>, index: u32, generation: u32) -> Self {
        Self { client: Arc::clone(client), index, generation }
    }

    /// A ticket is made with the index of a call that is there.
    pub(super) fn call(&self) -> &Call {
        &self.client.calls[self.index as usize]
    }

    /// The client has left: its connection or its instance is another one.
    pub(super) fn is_left(&self) -> bool {
        !self.client.one_way && self.call().epoch() != self.client.epoch()
    }

    /// The client still wants the answer; a message was handed over.
    pub(super) fn is_wanted(&self) -> bool {
        self.client.one_way || (!self.is_left() && self.call().is_client(self.generation, ClientState::Sent))
    }

    /// A server takes it in hand.
    pub(super) fn take(&self) {
        self.call().take(self.generation);
    }

    /// It is to be asked again when this server fails.
    pub(super) fn is_asked_again(&self) -> bool {
        self.call().retry.load(Ordering::Relaxed) && self.is_wanted()
    }

    /// Ends the call: with the answer that lies in its block, or with a status.
    pub(super) fn end(self, code: u32) {
        self.call().end(self.generation, code);
        if !self.client.one_way {
            self.client.ring();
        }
    }
}
