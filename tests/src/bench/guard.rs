//! What a guarded call costs: a closure on a fiber, and a component's callback as executors enter it, each against the same
//! by a bare indirect call.

use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

use component_sdk::abi::calls::ServeArgs;
use component_sdk::abi::class::{CallArgs, FaultArgs, Hook};
use framework_daemon::exec::callback::{self, Call, Fibers};
use framework_daemon::exec::slot::{Slot, Status};
use framework_daemon::exec::strand::{Job, Strand};
use framework_daemon::exec::task::Tasks;
use framework_daemon::exec::unit::{Limits, Recipe, Source, Unit};
use framework_daemon::model::symptom::SeverityTable;
use framework_daemon::plugin::Plugin;
use framework_daemon::port::border::HOST;
use framework_daemon::port::charge::Charges;
use framework_daemon::port::devices::Devices;
use framework_daemon::port::event_ends::EventEnds;
use framework_daemon::port::wait::Waiter;
use framework_daemon::sys::bell::{Bell, Signal};
use framework_daemon::sys::clock;
use framework_daemon::sys::fiber::{Fiber, NEVER};

use super::stats::Samples;
use crate::profiles::plugin_dir;

/// Calls in one sample: a single one is shorter than the clock's own cost.
const BATCH: u32 = 1000;
const STACK: usize = 64 << 10;

/// Nanoseconds a call, on a fiber and bare.
///
/// # Panics
/// When there is no address space for a stack.
#[must_use]
pub fn fiber(samples: usize) -> (Samples, Samples) {
    let mut fiber = Fiber::<()>::new(STACK).expect("address space for one stack");
    let mut count = 0u64;
    let mut closure = || count = black_box(count + 1);
    let mut bare_count = 0u64;
    let mut bare = || bare_count = black_box(bare_count + 1);
    interleaved(
        samples,
        || _ = black_box(fiber.run(NEVER, black_box(&mut closure))),
        || {
            let call: &mut dyn FnMut() = black_box(&mut bare);
            call();
        },
    )
}

/// Nanoseconds a callback of a component that does nothing: as executors enter those that may not wait, and by its shim
/// alone. Both read the clock once, for the callback is told the time.
///
/// # Panics
/// When the plugin of the basic components is not there.
#[must_use]
pub fn callback(samples: usize) -> (Samples, Samples) {
    let mut fibers = Fibers::default();
    let (mut guarded, mut bare) = (idle_unit(&mut fibers), idle_unit(&mut fibers));
    interleaved(
        samples,
        || _ = black_box(callback::enter(&mut fibers, &mut guarded, Call::plain(Hook::Execute))),
        || enter_bare(&mut bare),
    )
}

/// As [`callback()`], as executors enter `on_execute` and handlers, which may wait.
///
/// # Panics
/// As [`callback()`].
#[must_use]
pub fn waiting(samples: usize) -> (Samples, Samples) {
    let mut fibers = Fibers::default();
    let mut strand = Strand::default();
    let (mut guarded, mut bare) = (idle_unit(&mut fibers), idle_unit(&mut fibers));
    interleaved(
        samples,
        || {
            let call = Call::at(Hook::Execute, clock::now_ns());
            strand.take_up(Job::Execute { queued: 0 });
            _ = black_box(callback::begin(&mut fibers, &mut guarded, &mut strand, &call));
        },
        || enter_bare(&mut bare),
    )
}

fn enter_bare(unit: &mut Unit) {
    let args = CallArgs {
        hook: Hook::Execute,
        inject: 0,
        now_ns: clock::now_ns(),
        fault: FaultArgs::NONE,
        serve: ServeArgs::NONE,
    };
    black_box(unit.instance.enter(black_box(&args)));
}

/// A component whose `on_execute` does next to nothing.
pub(super) fn idle_unit(fibers: &mut Fibers) -> Box<Unit> {
    let plugin = Plugin::load(&plugin_dir().join("libbasic.so"), &HOST).expect("the plugin is built");
    let class = plugin.class("Diary").expect("the plugin has it");
    let limits = Limits { stack_bytes: STACK, budget_ns: None, hang_ns: 1_000_000_000 };
    let source = Source::Loaded(class);
    let recipe = Recipe { number: 0, class_name: "Diary", source, properties: Vec::new(), limits };
    let charges = Arc::new(Charges::new("", Signal::new(Bell::new()), &SeverityTable::default()));
    let slot = Slot {
        name: "bench",
        inputs: Vec::new(),
        outputs: Vec::new(),
        requestors: Vec::new(),
        providers: Vec::new(),
        unlisted: Vec::new(),
        events: EventEnds::default(),
        devices: Arc::new(Devices::new(Arc::clone(&charges))),
        charges,
        tasks: Arc::new(Tasks::new("bench", Signal::new(Bell::new()), Waiter::new())),
        handles_pushes: false,
        status: Status::new(vec!["Diary"]),
    };
    let parts = recipe.gather(&slot).expect("it has no ports");
    callback::create(fibers, parts).expect("it has no constructor of its own")
}

fn interleaved(samples: usize, mut own: impl FnMut(), mut bare: impl FnMut()) -> (Samples, Samples) {
    let (mut guarded, mut limit) = (Samples::default(), Samples::default());
    for _ in 0..samples {
        guarded.add(each(&mut own));
        limit.add(each(&mut bare));
    }
    (guarded, limit)
}

fn each(call: &mut impl FnMut()) -> u64 {
    let began = Instant::now();
    for _ in 0..BATCH {
        call();
    }
    began.elapsed().as_nanos() as u64 / u64::from(BATCH)
}
