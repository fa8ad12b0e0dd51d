//! Components with threads of their own: the conformance tests of tasks.
//!
//! The tasker runs one case in each callback and logs how it went; the victim does to itself what it is asked to, on a task.

mod more;
mod told;
mod victim;

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use component_sdk::prelude::*;

pub use victim::Victim;

/// All cases, each named after the line of the tables that it stands for; those that cost the victim its life come last.
#[macro_export]
macro_rules! task_cases {
    ($then:ident $($arguments:tt)*) => {
        $then! {
            $($arguments)*
            task_runs_stops_joins, task_cancelled_flag, task_sleep, task_schedule_by_executor_rules,
            task_periodic_entry_execute_exit, trigger_timed,
            trigger_query_queue, trigger_input_prescale, send_queued_by_a_task_is_fifo, queued_timed_handler,
            handlers_of_a_slot_run_one_at_a_time, wait_on_own_std_thread_is_refused,
            wait_while_panicking_is_cancelled, no_method_panics_or_throws,
            trigger_wait_cancelled_timeout_not_activated, answer_later_from_a_task, active_handler_is_one_worker_fifo, a_port_that_was_taken_is_closed, more_tasks_than_allowed_are_refused,
            a_task_starts_no_task, a_task_that_could_answer_is_no_cycle, two_strands_wait_at_once,
            data_is_written_and_read_in_a_task, task_error_is_its_slots_fault, task_panic_is_its_slots_fault,
            task_raises_a_fault, task_trap_is_its_slots_fault, task_trap_in_the_allocator_is_its_slots_fault,
            task_hang_is_its_slots_fault, tasks_of_a_failed_callback_end_with_it,
        }
    };
}

/// What the victim may be asked to do.
pub mod todo {
    /// Tell which of its instances answers.
    pub const NUMBER: u64 = 0;
    /// Return an error, in a task.
    pub const ERROR: u64 = 1;
    /// Panic, in a task.
    pub const PANIC: u64 = 2;
    /// Raise a fault, in a task.
    pub const RAISE: u64 = 3;
    /// Trap, in a task.
    pub const TRAP: u64 = 4;
    /// Trap inside the allocator, in a task.
    pub const TRAP_IN_ALLOCATOR: u64 = 5;
    /// Loop for ever, in a task.
    pub const HANG: u64 = 6;
    /// Trap, in the handler.
    pub const TRAP_IN_HANDLER: u64 = 7;
    /// Tell how often it was reset.
    pub const RESETS: u64 = 8;
    /// Tell how often its periodic task has run.
    pub const TICKS: u64 = 9;
    /// Tell how often a task that failed was entered.
    pub const TRIES: u64 = 10;
    /// Ask back, and tell what came of it.
    pub const BACK: u64 = 11;
    /// Answer after 20 ms.
    pub const SLOW: u64 = 12;
    /// Tell how many handlers of slow questions were entered at once, at most.
    pub const MOST_INSIDE: u64 = 13;
    /// Leave the answer, 8, to a task.
    pub const BY_TASK: u64 = 14;
}

/// Runs the cases, one in each period.
#[derive(Component)]
#[component(name = "Tasker", version = "1.0", periodic = "2ms")]
pub struct Tasker {
    /// To the victim.
    #[port]
    ask: QueryClient<u64, u64>,
    /// To the victim, for a task.
    #[port]
    beside: QueryClient<u64, u64>,
    /// To its own service that a task serves.
    #[port]
    own: QueryClient<u64, u64>,
    /// To the victim, lent to whoever may not wait.
    #[port]
    third: QueryClient<u64, u64>,
    /// Served by a task.
    #[port]
    worked: QueryServer<u64, u64>,
    /// To its own task.
    #[port]
    orders: SendClient<u64>,
    /// Served by a task.
    #[port]
    queued: SendServer<u64>,
    /// To its own task.
    #[port]
    feed: PushServer<u64>,
    /// To a task.
    #[port]
    fed: PushClient<u64>,
    /// Of the victim's task.
    #[port]
    clock: PushClient<u64>,
    /// From a task.
    #[port]
    sent: DataOut<u64>,
    /// To a task.
    #[port(fifo = 8)]
    heard: DataIn<u64>,
    /// `all` cases; `stay` with tasks that come to an end; `lend` a port to one; `hang` with one that does not.
    #[property(default = "all")]
    run: String,
    next: usize,
}

impl Callbacks for Tasker {
    fn start(&mut self, cx: &mut Context<'_>) -> Outcome {
        match self.run.as_str() {
            "stay" => stay(cx)?,
            "lend" => lend(cx, std::mem::take(&mut self.ask))?,
            "hang" => cx.spawn(Task::new("hangs"), |_: &mut Context<'_>| -> Outcome {
                victim::hang();
                Ok(())
            })?,
            _ => {}
        }
        Ok(())
    }

    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        if self.run == "all" {
            self.next = cases::run(told::ALL, self.next, self, cx);
        }
        Ok(())
    }
}

/// Tells when it ends.
struct Told(u64);

impl Job for Told {
    fn enter(&mut self, cx: &mut Context<'_>) -> Outcome {
        info!(cx, "task entered");
        Ok(())
    }

    fn execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        self.0 += 1;
        if self.0 == 3 {
            info!(cx, "task ran thrice");
        }
        Ok(())
    }

    fn exit(&mut self, cx: &mut Context<'_>) -> Outcome {
        info!(cx, "task left, cancelled: {}", cx.cancelled());
        Ok(())
    }
}

impl Drop for Told {
    fn drop(&mut self) {
        DROPPED.fetch_add(1, Ordering::SeqCst);
    }
}

static DROPPED: AtomicU64 = AtomicU64::new(0);

/// A task that asks the victim by a port that was moved into it.
fn lend(cx: &Context<'_>, mut ask: QueryClient<u64, u64>) -> Outcome {
    cx.spawn(Task::new("asks"), move |cx: &mut Context<'_>| -> Outcome {
        ask.query(todo::RESETS)?;
        info!(cx, "task was answered");
        let slept = cx.sleep(Duration::from_secs(3600));
        info!(cx, "task that asks slept: {slept}");
        Ok(())
    })?;
    Ok(())
}

fn stay(cx: &Context<'_>) -> Outcome {
    cx.spawn_job(Task::new("ticks").period(Duration::from_millis(5)), Told(0))?;
    cx.spawn(Task::new("sleeps"), |cx: &mut Context<'_>| -> Outcome {
        info!(cx, "task sleeps");
        let slept = cx.sleep(Duration::from_secs(3600));
        info!(cx, "task slept: {slept}, cancelled: {}", cx.cancelled());
        Ok(())
    })?;
    cx.spawn(Task::new("works").budget(Duration::from_secs(3600)), |cx: &mut Context<'_>| -> Outcome {
        info!(cx, "task works");
        while !cx.cancelled() {
            std::hint::spin_loop();
        }
        info!(cx, "task worked");
        Ok(())
    })?;
    Ok(())
}

export_components!(Tasker, Victim);
