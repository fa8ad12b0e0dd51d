//! Every bound in one place, units in the names, relations between them checked at compile time.
//!
//! A limit exists so that a wrong or hostile input costs a message, not the robot. Each is far beyond what a real
//! system needs: the largest public profile has some 60 KiB, 6 levels and 2,500 elements.

use std::time::Duration;

/// Largest profile file.
pub const PROFILE_FILE_BYTES: u64 = 4 << 20;
/// Deepest nesting of elements in a profile.
pub const PROFILE_DEPTH: usize = 32;
/// Most elements in a profile file.
pub const PROFILE_ELEMENTS: usize = 100_000;
/// Most attributes of one element.
pub const PROFILE_ATTRIBUTES_PER_ELEMENT: usize = 64;
/// Most bytes of one attribute value or of the text of one element.
pub const PROFILE_TEXT_BYTES: usize = 1 << 20;
/// Most profile files that one directory may hold or reach by references.
pub const PROFILE_FILES: usize = 4_096;
/// Deepest nesting of composites.
pub const COMPOSITE_DEPTH: usize = 16;
/// Most diagnostics kept of one run; beyond it their number is told.
pub const DIAGNOSTICS: usize = 1_000;
/// Longest name of a component, slot, port, executor, in characters.
pub const NAME_CHARS: usize = 128;
/// Longest part of a source line that a diagnostic shows, in characters.
pub const EXCERPT_CHARS: usize = 160;

/// Most slots of a plan, composites flattened.
pub const SLOTS: usize = 10_000;
/// Most composites of a plan, each counted as often as it is used.
pub const COMPOSITES: usize = 10_000;
/// Most ports of one component.
pub const PORTS: usize = 1_024;
/// Most properties of all slots together.
pub const PROPERTIES: usize = 1_000_000;
/// Port handles of all instances together: chunks of the table, which grows by one at a time.
pub const HANDLE_CHUNKS: usize = 4_096;
/// Handles in a chunk.
pub const HANDLES_PER_CHUNK: usize = 1_024;
/// Stack that a host function which takes a lock finds below it, or the overflow happens before the lock.
pub const HEADROOM_BYTES: usize = 16 << 10;
/// Stack of a prepared fiber that is in memory already.
pub const TOUCHED_STACK_BYTES: usize = 32 << 10;
/// Most connections of a plan, fan-out counted.
pub const CONNECTIONS: usize = 100_000;
/// Most declared executors.
pub const EXECUTORS: usize = 256;
/// Highest processor number that an executor may name.
pub const CPU_MAX: usize = 1_023;
/// Real-time priorities of Linux.
pub const PRIORITY_MIN: i32 = 1;
/// Real-time priorities of Linux.
pub const PRIORITY_MAX: i32 = 99;

/// Shortest period of a periodic callback.
pub const PERIOD_MIN: Duration = Duration::from_micros(50);
/// Longest time of any kind in a profile.
pub const DURATION_MAX: Duration = Duration::from_secs(7 * 24 * 3600);
/// Smallest stack of a fiber, in bytes.
pub const STACK_MIN_BYTES: usize = 64 << 10;
/// Largest stack of a fiber, in bytes.
pub const STACK_MAX_BYTES: usize = 1 << 30;
/// Largest queue of a FIFO port.
pub const FIFO_SIZE_MAX: usize = 65_536;
/// Size of a FIFO that states none: OPRoS's own default.
pub const FIFO_SIZE_DEFAULT: usize = 15;

/// Activations that a client of events may have at once, where its profile says nothing.
pub const ACTIVATIONS_DEFAULT: usize = 16;
/// Most of them.
pub const ACTIVATIONS_MAX: usize = 1_024;
/// Calls that a client port may have open at once, where its profile says nothing.
pub const PENDING_DEFAULT: usize = 8;
/// Most of them.
pub const PENDING_MAX: usize = 1_024;
/// Calls that may wait for a server port, where its profile says nothing.
pub const INBOX_DEFAULT: usize = 64;
/// Most of them.
pub const INBOX_MAX: usize = 4_096;
/// Values that may wait for the handler of a push client, where its author does not say.
pub const HANDLER_QUEUE_DEFAULT: usize = 8;
/// Longest time that a call, or the next value, is waited for, where neither its author nor its profile says.
pub const WAIT: Duration = Duration::from_secs(1);
/// Slots that may wait for each other, with those of a reload beside them.
pub const WAITERS: usize = 2 * SLOTS + 1;

/// Most tasks of one instance.
pub const TASKS: usize = 16;
/// Longest time until a task that is cancelled by a stop must have come to its end.
pub const TASK_END_AT_STOP: Duration = Duration::from_millis(200);
/// As above, where another instance waits to take the slot over.
pub const TASK_END: Duration = Duration::from_millis(20);
/// How long a task that is ended by force is waited for.
pub const TASK_END_BY_FORCE: Duration = Duration::from_millis(50);

/// Most resets that a restart intensity may allow within its window.
pub const RESETS_MAX: u32 = 1_000;
/// Restart intensity of a slot whose rules state none: that many resets
pub const RESETS_DEFAULT: u32 = 10;
/// within that time.
pub const RESETS_WINDOW: Duration = Duration::from_secs(10);
/// Most secondaries of one slot.
pub const SECONDARIES: usize = 16;
/// Most spares of one slot.
pub const SPARES_MAX: u32 = 64;
/// Instances of one slot that may wait to be ended in the background.
pub const CLEARED_UNITS: usize = SPARES_MAX as usize;
/// Most bytes of a spare that its executor fetches in advance.
pub const NEAR_BYTES: usize = 4_096;
/// Pause after a spare that could not be prepared; doubled after each further one.
pub const SPARE_PAUSE_MIN: Duration = Duration::from_millis(100);
/// Longest such pause.
pub const SPARE_PAUSE_MAX: Duration = Duration::from_secs(10);
/// Most members of one vote.
pub const VOTERS: usize = 16;
/// How long a member of a vote may say nothing before it is left out, where its profile does not say.
pub const VOTER_AGE: Duration = Duration::from_secs(1);

/// Largest plugin file.
pub const PLUGIN_FILE_BYTES: u64 = 1 << 30;
/// Ranges of machine code that are told apart: one for each loaded plugin and library.
pub const TEXTS: usize = 1_024;
/// Largest file whose symbols are read for the evidence of a fault.
pub const SYMBOL_FILE_BYTES: u64 = 256 << 20;
/// Address space of a fiber's stack where the profile says nothing; only touched pages take memory.
pub const STACK_BYTES: usize = 1 << 20;
/// Alternate signal stack of each guarded thread; AVX-512 frames are large.
pub const SIGNAL_STACK_BYTES: usize = 64 << 10;
/// How far from the end of a plugin's thread's stack a bad access counts as its overflow: its guard, or a frame beyond it.
pub const STACK_OVERFLOW_REACH_BYTES: usize = 64 << 10;
/// Faults on threads of plugins waiting to be passed on.
pub const FOREIGN_REPORTS: usize = 256;
/// Words on top of a trap's stack in which return addresses are looked for: those of the functions between the trap and the
/// plugin.
pub const STACK_WORDS: usize = 64;
/// Return addresses into plugins that are kept of a trap: the nearest may be the standard library's.
pub const CALLERS: usize = 4;
/// Addresses below are those of nothing, plus the offset of a field.
pub const NULL_PAGE_BYTES: u64 = 64 << 10;
/// Longest panic message, error text or log record kept, in bytes.
pub const TEXT_BYTES: usize = 400;
/// Longest name of a port, a field or a source file kept with a fault, in bytes.
pub const LABEL_BYTES: usize = 118;
/// Safe outputs of a process.
pub const SAFE_OUTPUTS: usize = 64;
/// Longest safe output.
pub const SAFE_OUTPUT_BYTES: usize = 64;
/// Longest time that a dying process waits until a device takes its safe output.
pub const SAFE_OUTPUT_WAIT: Duration = Duration::from_millis(50);
/// Most slots that get the emergency stop.
pub const ACTUATORS: usize = 64;
/// A fault within this time after one of the same chain is its consequence.
pub const CONSEQUENCE_WINDOW: Duration = Duration::from_millis(500);
/// Longest chain that a consequence is looked for along, in connections and dependencies.
pub const CHAIN_STEPS: usize = 16;
/// Slots of such a chain that can be the root of a fault of its last one: the nearest.
pub const CHAIN_SLOTS: usize = 256;
/// Consequences of a slot that wait until their root is answered; more are answered at once.
pub const CONSEQUENCES: usize = 4;
/// Consequences that wait to be written down until their root is.
pub const CONSEQUENCE_LINES: usize = 64;
/// Faults of late among which the root of a consequence is looked for.
pub const RECENT_FAULTS: usize = 64;
/// Longest time that the fault manager waits for an executor that is to stop or start slots.
pub const HANDLING_STEP: Duration = Duration::from_secs(2);
/// Longest time that who clears the emergency stop waits for the fault that it was raised for to be written down.
pub const EMERGENCY_KNOWN: Duration = Duration::from_millis(200);
/// Notices of the emergency stop that wait to be written down.
pub const EMERGENCY_NOTICES: usize = 256;
/// Log records of components waiting to be written.
pub const LOG_RECORDS: usize = 1_024;
/// Lines of the daemon's own log waiting to be written.
pub const LOG_LINES: usize = 4_096;
/// Soonest recovery that a profile may count on, without privileges and with all processors busy: some times what one of a
/// thousand recoveries by a spare that is ready takes there, which is up to 36 us.
pub const RECOVERY_LEAST: Duration = Duration::from_micros(200);
/// As above, where a library is loaded or an instance made first.
pub const RECOVERY_LEAST_UNPREPARED: Duration = Duration::from_millis(10);
/// Charges by others that wait for one slot.
pub const CHARGES: usize = 8;
/// Devices of one slot that can be lost at a time; the longest lost of more is forgotten.
pub const DEVICES_LOST: usize = 8;
/// Elements of a sequence whose rate of change is checked: the first ones.
pub const RATE_ELEMENTS: usize = 1_024;
/// Fault events waiting for the fault manager.
pub const FAULT_EVENTS: usize = 4_096;
/// Idle fibers that an executor makes room for, for each size of stack.
pub const IDLE_FIBERS: usize = 4;
/// Questions that one callback may have answered at once, one after the other, before others have their turn.
pub const TURNS_AT_ONCE: u32 = 64;
/// Time that they may take all together before others have their turn, in nanoseconds; known to a tick of the kernel.
pub const TIME_AT_ONCE_NS: u64 = 1_000_000;
/// Longest time that a callback may wait at once.
pub const WAIT_MAX: Duration = Duration::from_secs(7 * 24 * 3600);
/// Fibers that wait which an executor makes room for; more are possible.
pub const WAITING_FIBERS: usize = 64;
/// From so many stacks of ended fibers on their pages are given back, all at once; as many again may wait for that.
pub const GRAVES: usize = 32;
/// The same by what their stacks could hold, in bytes.
pub const GRAVE_BYTES: usize = 16 << 20;
/// Blocks of an output port beyond those that its readers can hold.
pub const SPARE_BLOCKS: usize = 2;
/// Connections of an output that are made at run time before its table grows.
pub const SPARE_LINKS: usize = 16;
/// Longest time that `stop` or `destroy` of one component may take.
pub const SHUTDOWN_STEP: Duration = Duration::from_millis(500);
/// Longest time that a constructor with `initialize`, or `start`, may take before a boot or reload is given up.
pub const BOOT_STEP: Duration = Duration::from_secs(10);
/// Stack of an executor's own loop, which allocates no buffers on it.
pub const SCHEDULE_STACK_BYTES: usize = 256 << 10;
/// Threads that may be given up before the daemon asks to be restarted; each leaves its stack and its heap behind.
pub const LOST_THREADS_MAX: u64 = 512;
/// Instances that may be given up before the daemon asks to be restarted; none of them is ever freed.
pub const QUARANTINED_MAX: u64 = 1_000_000;
/// Arenas of the C library's heap: more than there are threads.
pub const ARENAS: i32 = 65_536;
/// Threads that wait to take an executor over, for each schedule in use.
pub const RESERVE_THREADS: usize = 2;
/// How long an executor looks out for a ring at least before it sleeps, where its waits were that short lately: about what it
/// takes two threads to fall asleep and to be woken on a machine of their own.
pub const LOOK_OUT_LEAST: Duration = Duration::from_micros(10);
/// The same at most, where it takes longer to be woken.
pub const LOOK_OUT_MOST: Duration = Duration::from_micros(50);
/// Longest time of a callback without a `<deadline>`: beyond it a hang.
pub const HANG: Duration = Duration::from_secs(1);
/// How many deadlines a callback may take before it hangs, where the profile does not say.
pub const HANG_FACTOR: u32 = 2;
/// Longest time of a constructor, `initialize` or `start`: they may open devices.
pub const HANG_AT_START: Duration = Duration::from_secs(9);
/// Longest time of `stop`, `destroy` or a drop.
pub const HANG_AT_STOP: Duration = Duration::from_millis(400);
/// How long after a signal the watchdog asks again.
pub const WATCHDOG_RETRY: Duration = Duration::from_micros(50);
/// How often a callback that is late is found in the C library before its thread is given up.
pub const HANG_ATTEMPTS: u32 = 8;
/// As above, in a function of the daemon, where a moment later is nearly always better.
pub const HANG_ATTEMPTS_IN_DAEMON: u32 = 1_000;
/// Recoveries tried for one fault before the slot is stopped.
pub const RECOVERY_STEPS_MAX: usize = 2 * SECONDARIES;
/// Largest checkpoint of one slot, in bytes.
pub const CHECKPOINT_BYTES: usize = 16 << 20;
/// Reports of components that wait for the fault manager; the oldest ones give way.
pub const FAULT_REPORTS: usize = 256;
/// Longest file of checkpoints, in bytes.
pub const CHECKPOINT_FILE_BYTES: u64 = 1 << 30;
/// Runs that may go on from one checkpoint without any of them making another: it may be what ends them.
pub const CHECKPOINT_TRIES: u32 = 3;
/// Regions that a component may register in one callback.
pub const REGIONS_PER_CALLBACK: usize = 16;
/// Failed tries of one recovery after which the next one follows at once.
pub const BREATHLESS_FAILURES: usize = 1;
/// Pause after the failed tries beyond them; doubled each time.
pub const BREATH_MIN: Duration = Duration::from_millis(50);
/// Longest such pause.
pub const BREATH_MAX: Duration = Duration::from_secs(2);

/// Clients of the control socket at once.
pub const CONTROL_CLIENTS: usize = 32;
/// Longest request on the control socket.
pub const CONTROL_REQUEST_BYTES: usize = 1 << 20;
/// Longest reply that a client of the control socket takes: the status of all slots that a plan may have, with room to spare.
pub const CONTROL_REPLY_BYTES: usize = 64 << 20;
/// After this much of a stream a client of the control socket must have read before there is more.
pub const CONTROL_STREAM_BYTES: usize = 256 << 10;
/// A client that took nothing of what it asked for in this time makes room for others when there are too many.
pub const CONTROL_PATIENCE: Duration = Duration::from_secs(5);
/// A client that asks nothing for this long makes room for others when there are too many.
pub const CONTROL_IDLE: Duration = Duration::from_secs(1);
/// Longest time until the daemon answers what it knows by itself.
pub const CONTROL_ANSWER: Duration = Duration::from_secs(15);
/// Values that wait for somebody who looks at a port.
pub const ECHO_QUEUE: usize = 8;
/// Time between two looks at a port.
pub const ECHO_PAUSE: Duration = Duration::from_millis(10);
/// Most parts of a value that are shown.
pub const ECHO_PARTS: usize = 4_096;
/// Deepest part of a value that is shown.
pub const ECHO_DEPTH: usize = 32;
/// Most bytes of a text in a value that are shown.
pub const ECHO_TEXT_BYTES: usize = 4_096;
/// Shortest time over which the rate of a port is measured.
pub const RATE_WINDOW_MIN: Duration = Duration::from_millis(10);
/// Longest such time.
pub const RATE_WINDOW_MAX: Duration = Duration::from_secs(3_600);
/// Lines of the fault manager that are kept for whoever asks later.
pub const FEED_LINES: usize = 1_024;

const _: () = assert!(VOTERS <= 64, "a set of members is one word");
const _: () = assert!(COMPOSITE_DEPTH < PROFILE_FILES);
const _: () =
    assert!(CONTROL_PATIENCE.as_nanos() < CONTROL_ANSWER.as_nanos(), "a client that waits for a place gets it");
const _: () = assert!(PROFILE_ELEMENTS > SLOTS, "a file must be able to hold every slot");
const _: () = assert!(PROFILE_TEXT_BYTES as u64 <= PROFILE_FILE_BYTES);
const _: () = assert!(PROFILE_FILE_BYTES < u32::MAX as u64, "spans are 32 bits wide");
const _: () = assert!(FIFO_SIZE_DEFAULT <= FIFO_SIZE_MAX);
const _: () = assert!(STACK_MIN_BYTES < STACK_MAX_BYTES && STACK_MIN_BYTES.is_multiple_of(4096));
const _: () = assert!(HANDLE_CHUNKS * HANDLES_PER_CHUNK < u32::MAX as usize, "a handle has 32 bits for its place");
const _: () = assert!(HEADROOM_BYTES < TOUCHED_STACK_BYTES && TOUCHED_STACK_BYTES < STACK_MIN_BYTES);
const _: () = assert!(PRIORITY_MIN < PRIORITY_MAX);
const _: () = assert!(PERIOD_MIN.as_nanos() < DURATION_MAX.as_nanos());
const _: () = assert!(STACK_MIN_BYTES <= STACK_BYTES && STACK_BYTES <= STACK_MAX_BYTES);
const _: () = assert!(HANG_AT_START.as_nanos() < BOOT_STEP.as_nanos(), "a hang is told before the boot is given up");
const _: () = assert!(HANG_AT_STOP.as_nanos() < SHUTDOWN_STEP.as_nanos());
const _: () = assert!(
    TASK_END_AT_STOP.as_nanos() + TASK_END_BY_FORCE.as_nanos() < SHUTDOWN_STEP.as_nanos(),
    "a task that hangs does not hold up the end"
);
const _: () = assert!(SAFE_OUTPUT_BYTES == component_sdk::context::SAFE_OUTPUT_LIMIT);
const _: () = assert!(SAFE_OUTPUT_BYTES.is_multiple_of(8), "kept in words");
const _: () = assert!(TEXT_BYTES >= component_sdk::context::TEXT_LIMIT && TEXT_BYTES <= u16::MAX as usize);
