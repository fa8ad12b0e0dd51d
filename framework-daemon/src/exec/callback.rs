//! The one place where plugin code is entered: on a fiber, with the slot's name set for logs, and with an outcome that
//! is either "done" or a [`Fault`](crate::model::fault::Fault).

use component_sdk::abi::calls::ServeArgs;
use component_sdk::abi::class::{CallArgs, CallStatus, FaultArgs, Hook};

use super::strand::{Frame, Last, Pause, Strand};
use super::unit::{Limits, Parts, Unit};
use crate::detect::{crash, taint};
use crate::model::fault::{Evidence, Fault, Memory, ShortText, Stage};
use crate::model::symptom::Symptom;
use crate::plugin::host;
use crate::port::check;
use crate::sys::clock;
use crate::sys::fiber::{Ended, Errand, Fiber};
use crate::sys::fiber_pool::{FiberPool, Progress};
use crate::sys::foreign::Event;
use crate::sys::seat::{self, Owner};
use crate::sys::trap::{Site, Trap};

/// Fibers for callbacks.
pub type Fibers = FiberPool<Frame>;

/// What a callback is entered with.
#[derive(Clone, Copy)]
pub struct Call<'a> {
    /// As it crosses the border, but for the time.
    args: CallArgs<'a>,
    /// The time, where it was looked up just now; 0: not known. To ask takes as long as the way into a callback.
    pub now_ns: u64,
    /// By how much that may lie in the past, in nanoseconds.
    slack_ns: u64,
}

impl<'a> Call<'a> {
    /// A plain call.
    #[must_use]
    pub const fn plain(hook: Hook) -> Self {
        Self::at(hook, 0)
    }

    /// A plain call at that time, which is now.
    #[must_use]
    pub const fn at(hook: Hook, now_ns: u64) -> Self {
        let args = CallArgs { hook, inject: 0, now_ns: 0, fault: FaultArgs::NONE, serve: ServeArgs::NONE };
        Self { args, now_ns, slack_ns: 0 }
    }

    /// Its time may lie in the past by that much, in nanoseconds.
    #[must_use]
    pub const fn within(mut self, slack_ns: u64) -> Self {
        self.slack_ns = slack_ns;
        self
    }

    /// With that fault to be provoked; 0: none.
    #[must_use]
    pub const fn provoking(mut self, inject: u8) -> Self {
        self.args.inject = inject;
        self
    }

    /// With the fault that led here.
    #[must_use]
    pub const fn telling(mut self, fault: FaultArgs<'a>) -> Self {
        self.args.fault = fault;
        self
    }

    /// With what is to be served.
    #[must_use]
    pub const fn serving(mut self, serve: ServeArgs) -> Self {
        self.args.serve = serve;
        self
    }

    /// As it crosses the border. Where the time is not known exactly, the component asks for it if it wants to know.
    pub(super) const fn args(&self) -> CallArgs<'a> {
        CallArgs { now_ns: self.told_ns(), ..self.args }
    }

    const fn told_ns(&self) -> u64 {
        if self.slack_ns == 0 { self.now_ns } else { 0 }
    }

    /// The same, where the callback before was entered with `args`. What a callback does not look at stays as it was: each
    /// line counts on the way into every one.
    #[inline(always)]
    pub(super) const fn fill(&self, args: &mut CallArgs<'a>) {
        args.hook = self.args.hook;
        args.inject = self.args.inject;
        args.now_ns = self.told_ns();
        match self.args.hook {
            Hook::Execute => {}
            Hook::Serve => args.serve = self.args.serve,
            _ => args.fault = self.args.fault,
        }
    }

    /// When it must have returned.
    fn deadline_ns(&self, limits: &Limits) -> u64 {
        (self.now_ns + self.slack_ns).saturating_add(limits.of(self.args.hook))
    }

    /// With the time, if it had none.
    pub(super) fn timed(mut self) -> Self {
        self.look_at_the_clock();
        self
    }

    /// Looks at the clock, if nobody has. In its place: to copy a call takes as long as to enter the callback.
    #[inline(always)]
    fn look_at_the_clock(&mut self) {
        if self.now_ns == 0 {
            self.now_ns = clock::now_ns();
        }
    }
}

/// Enters a callback of `unit`.
///
/// # Errors
/// The fault that ended it.
pub fn enter(fibers: &mut Fibers, unit: &mut Unit, mut call: Call<'_>) -> Result<(), Fault> {
    call.look_at_the_clock();
    call.args.now_ns = call.told_ns();
    let (args, deadline_ns) = (&call.args, call.deadline_ns(&unit.limits));
    let Unit { instance, owner, limits, .. } = unit;
    let mut status = CallStatus::Done;
    // One place from the innermost call to the outermost: a fault is large.
    let mut result = guarded(fibers, owner, limits.stack_bytes, deadline_ns, &mut || status = instance.enter(args));
    if result.is_err() {
        unit.spent = true;
    } else if let Some(symptom) = crash::of_status(status) {
        result = Err(told(symptom, ""));
    }
    result
}

/// Enters a callback of `unit` that may wait, at the time that `call` says: it knows one. Never inlined: the thread may be another
/// one afterwards.
///
/// # Errors
/// The fault that ended it.
#[inline(never)]
pub fn begin(fibers: &mut Fibers, unit: &mut Unit, strand: &mut Strand, call: &Call<'static>) -> Result<Pause, Fault> {
    take_seat(&unit.owner);
    let limits = &unit.limits;
    let fiber = match fibers.ready(limits.stack_bytes) {
        Ok(fiber) => fiber,
        Err(error) => return Err(no_stack(&error)),
    };
    fiber.furnish(|place| Frame::enter(place, unit.instance.entry(), strand.job, call, limits));
    // What may wait is entered in operation: no other limit is asked for.
    let deadline_ns = (call.now_ns + call.slack_ns).saturating_add(limits.hang_ns);
    match fiber.begin(deadline_ns, strand.may_wait()) {
        Some(frame) if frame.is_plainly_done() => Ok(Pause::Done),
        _ => sort_out(fibers, unit, strand),
    }
}

#[inline(never)]
fn sort_out(fibers: &mut Fibers, unit: &mut Unit, strand: &mut Strand) -> Result<Pause, Fault> {
    let progress = fibers.sort_out(unit.limits.stack_bytes);
    progress.map_or(Ok(Pause::Done), |progress| settle(fibers, unit, strand, progress))
}

/// Goes on with a callback of `unit` that waits; where it may not wait any more, it comes to its end.
///
/// # Errors
/// The fault that ended it.
pub fn go_on(
    fibers: &mut Fibers,
    unit: &mut Unit,
    strand: &mut Strand,
    begins_ns: u64,
    may_wait: bool,
) -> Result<Pause, Fault> {
    let Some(ticket) = strand.take_ticket() else { return Ok(Pause::Done) };
    take_seat(&unit.owner);
    let deadline_ns = begins_ns.saturating_add(unit.limits.hang_ns);
    match fibers.go_on(ticket, deadline_ns, may_wait) {
        Some(progress) => settle(fibers, unit, strand, progress),
        None => Ok(Pause::Done),
    }
}

/// Goes on from where a handler of `unit` got to on a fiber that was lent.
///
/// # Errors
/// The fault that ended it.
pub fn take_up(
    fibers: &mut Fibers,
    unit: &mut Unit,
    strand: &mut Strand,
    fiber: Box<Fiber<Frame>>,
) -> Result<Pause, Fault> {
    let _ = seat::enter(&unit.owner);
    match fibers.take_back(fiber) {
        Some(progress) => settle(fibers, unit, strand, progress),
        None => Ok(Pause::Done),
    }
}

#[inline(always)]
fn settle(fibers: &Fibers, unit: &mut Unit, strand: &mut Strand, progress: Progress<Last>) -> Result<Pause, Fault> {
    match progress {
        Progress::Done(last) => {
            strand.note(last);
            crash::of_status(last.status).map_or(Ok(Pause::Done), |symptom| Err(told(symptom, "")))
        }
        Progress::Trapped(last) => {
            strand.note(last);
            unit.spent = true;
            match fibers.trap() {
                Some(trap) => Err(trapped(trap)),
                None => Err(unseen()),
            }
        }
        Progress::Waits(ticket, until_ns) => {
            strand.wait(ticket, until_ns);
            Ok(Pause::Waits)
        }
    }
}

/// Runs the constructor of a class.
///
/// # Errors
/// The fault that ended it; for a property that does not fit, with its text.
pub fn create(fibers: &mut Fibers, parts: Parts) -> Result<Box<Unit>, Fault> {
    let mut built = None;
    let limits = parts.limits();
    let owner = parts.owner();
    let deadline_ns = clock::now_ns() + limits.of(Hook::Initialize);
    // Nothing that is made on the fiber may need to be dropped: a trap would leak it.
    let texts = parts.texts();
    let ended = guarded(fibers, &owner, limits.stack_bytes, deadline_ns, &mut || built = Some(parts.build(&texts)));
    drop(texts);
    match (ended, built) {
        (Ok(()), Some(Ok(instance))) => Ok(parts.finish(instance)),
        (Ok(()), Some(Err((status, text)))) => Err(told(crash::of_status(status).unwrap_or(Symptom::Error), &text)),
        (Err(fault), _) => Err(fault),
        (Ok(()), None) => Err(told(Symptom::Error, "the constructor did not run")),
    }
}

/// Runs a closure that touches memory of `unit`, guarded as its callbacks are.
///
/// # Errors
/// The fault that ended it: the memory is not there.
pub fn touch(fibers: &mut Fibers, unit: &mut Unit, closure: &mut dyn FnMut()) -> Result<(), Fault> {
    let (owner, limits) = (unit.owner, unit.limits);
    let deadline_ns = clock::now_ns().saturating_add(limits.hang_ns);
    let result = guarded(fibers, &owner, limits.stack_bytes, deadline_ns, closure);
    unit.spent |= result.is_err();
    result
}

/// What became of a unit that is not needed any more.
#[derive(Debug)]
pub struct Disposal {
    /// It was dropped, not quarantined.
    pub dropped: bool,
    /// The fault of its drop.
    pub fault: Option<Fault>,
}

/// Gets rid of a unit: dropped where it is sound, quarantined where it trapped or traps in its drop.
pub fn dispose(fibers: &mut Fibers, mut unit: Box<Unit>) -> Disposal {
    unit.close();
    let fault = if unit.spent { None } else { drop_object(fibers, &mut unit) };
    let dropped = !unit.spent;
    if unit.spent {
        unit.quarantine();
    }
    Disposal { dropped, fault }
}

fn drop_object(fibers: &mut Fibers, unit: &mut Unit) -> Option<Fault> {
    let (owner, limits) = (unit.owner, unit.limits);
    let deadline_ns = clock::now_ns() + limits.of(Hook::Destroy);
    let (instance, mut status) = (&mut unit.instance, CallStatus::Done);
    let ended = guarded(fibers, &owner, limits.stack_bytes, deadline_ns, &mut || status = instance.destroy());
    unit.spent = ended.is_err();
    // A panic in a drop is over when the shim returns; the object is gone.
    let fault = ended.err().or_else(|| crash::of_status(status).map(|symptom| told(symptom, "")));
    let _ = forget_notes();
    fault
}

/// What a callback that went well reported on the side: a bad value that it wrote, a fault that it raised.
#[must_use]
pub fn side_report() -> Option<Fault> {
    if !seat::has_notes() {
        return None;
    }
    let raised = host::take_raised().map(|message| (Symptom::Raised, Evidence::Text { message }));
    let (symptom, evidence) =
        raised.or_else(|| check::take_report().map(|report| (report.symptom, report.evidence)))?;
    let now = clock::now_ns();
    Some(Fault { injected: seat::is_left(seat::Note::Injected), ..Fault::told(symptom, now, evidence) })
}

#[inline(always)]
fn guarded(
    fibers: &mut Fibers,
    owner: &Owner,
    stack_bytes: usize,
    deadline_ns: u64,
    closure: &mut dyn FnMut(),
) -> Result<(), Fault> {
    take_seat(owner);
    match fibers.run(stack_bytes, deadline_ns, closure) {
        Ok(Ended::Returned) => Ok(()),
        Ok(Ended::Trapped) => Err(last_trap(fibers)),
        Err(error) => Err(no_stack(&error)),
    }
}

/// Says whose code runs from now on.
#[inline(always)]
fn take_seat(owner: &Owner) {
    if seat::enter(owner) {
        sweep();
    }
}

/// What an earlier callback left, and nobody asked about, is nobody's any more.
#[cold]
#[inline(never)]
fn sweep() {
    let _ = forget_notes();
    host::forget_regions();
}

pub(super) fn no_stack(error: &std::io::Error) -> Fault {
    told(Symptom::Error, &format!("no stack for its fiber: {error}"))
}

/// The fault of the fiber that trapped just now. Built where it is to lie: a fault is large.
#[inline(always)]
pub(super) fn last_trap<E: Errand>(fibers: &FiberPool<E>) -> Fault {
    match fibers.trap() {
        Some(trap) => trapped(trap),
        None => unseen(),
    }
}

/// Of a trap that nobody saw.
#[cold]
#[inline(never)]
fn unseen() -> Fault {
    told(Symptom::CrashSegv, "")
}

#[inline(always)]
fn trapped(trap: &Trap) -> Fault {
    // Whatever the callback had told before it trapped is not the reason.
    let (injected, symptom) = (forget_notes(), crash::of_trap(trap));
    Fault {
        symptom,
        at_ns: injected.unwrap_or(trap.at_ns),
        detected_ns: trap.seen_ns,
        injected: injected.is_some(),
        thread_lost: trap.thread_lost,
        memory: taint::of_trap(symptom, trap),
        stage: Stage::Confirmed,
        evidence: Evidence::Trap(trap.evidence),
    }
}

/// The fault of a thread that a component started; `None`: it only ended.
pub(super) fn astray(event: &Event, at_ns: u64) -> Option<Fault> {
    let (symptom, evidence, memory, thread_lost) = match event {
        // Elsewhere a lock may be held, and stays so.
        Event::Trapped(trap) => {
            let symptom = crash::of_trap(trap);
            (symptom, Evidence::Trap(trap.evidence), taint::of_trap(symptom, trap), trap.site == Site::Elsewhere)
        }
        Event::Panicked(evidence) => (Symptom::CrashPanic, *evidence, Memory::Sound, false),
        Event::Ended => return None,
    };
    Some(Fault { at_ns, memory, thread_lost, ..Fault::told(symptom, clock::now_ns(), evidence) })
}

/// A fault that was told by a text: what the component noted, or `text` where it noted nothing.
pub(super) fn told(symptom: Symptom, text: &str) -> Fault {
    let detected_ns = clock::now_ns();
    let evidence = match host::take_panic() {
        Some(note) if symptom == Symptom::CrashPanic => {
            Evidence::Panic { message: note.message, file: note.file, line: note.line }
        }
        _ => Evidence::Text { message: host::take_error().unwrap_or_else(|| ShortText::new(text)) },
    };
    let injected = forget_notes();
    Fault {
        at_ns: injected.unwrap_or(detected_ns),
        injected: injected.is_some(),
        ..Fault::told(symptom, detected_ns, evidence)
    }
}

fn forget_notes() -> Option<u64> {
    if !seat::has_notes() {
        return None;
    }
    let _ = check::take_report();
    host::forget()
}
