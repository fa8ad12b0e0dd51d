//! Tasks on the bench: nothing runs by itself. What the component started runs when the test says so.

use super::{Bench, RECORD};
use crate::abi::class::CallStatus;
use crate::abi::task::{Phase, TaskApi, TaskDecl};
use crate::component::{Callbacks, ComponentError, Outcome};
use crate::status::Status;

/// Most tasks of a component.
const TASKS: usize = 16;

/// A task that the component started.
pub(super) struct Started {
    name: String,
    once: bool,
    entered: bool,
    decl: TaskDecl<'static>,
}

pub(super) const API: TaskApi = TaskApi { spawn, cancelled, wait };

extern "C" fn spawn(task: TaskDecl<'_>) -> u32 {
    let name = task.name.to_string();
    let decl = TaskDecl { name: "".into(), ..task };
    RECORD.with_borrow_mut(|record| {
        if record.tasks.len() == TASKS {
            return Status::Overload.code();
        }
        record.tasks.push(Started { name, once: task.period_ns == 0, entered: false, decl });
        0
    })
}

extern "C" fn cancelled() -> bool {
    RECORD.with_borrow(|record| record.cancelled)
}

/// There is nobody to wait for.
extern "C" fn wait(_: u64) -> bool {
    false
}

fn enter(decl: &TaskDecl<'_>, phase: Phase, now_ns: u64) -> Outcome {
    match (decl.call)(decl.job, phase, now_ns) {
        CallStatus::Done => Ok(()),
        CallStatus::Panic => Err(crate::fault!("the task panicked")),
        CallStatus::Error => {
            Err(ComponentError::new(RECORD.with_borrow_mut(|record| std::mem::take(&mut record.error))))
        }
    }
}

impl Started {
    /// One run; false: it was the last.
    fn run(&mut self, now_ns: u64) -> Result<bool, ComponentError> {
        if !std::mem::replace(&mut self.entered, true) {
            enter(&self.decl, Phase::Enter, now_ns)?;
        }
        enter(&self.decl, Phase::Execute, now_ns)?;
        if self.once {
            enter(&self.decl, Phase::Exit, now_ns)?;
        }
        Ok(!self.once)
    }
}

impl Drop for Started {
    fn drop(&mut self) {
        (self.decl.drop)(self.decl.job);
    }
}

impl<C: Callbacks> Bench<C> {
    /// Runs each task that the component has started: one period of those that have one, the others to their end.
    ///
    /// # Errors
    /// The first that a task ends with; it runs again the next time.
    pub fn run_tasks(&mut self) -> Outcome {
        // Apart meanwhile: a task may look at the record.
        let tasks = RECORD.with_borrow_mut(|record| {
            record.now_ns = self.now_ns;
            std::mem::take(&mut record.tasks)
        });
        let (mut kept, mut first) = (Vec::new(), Ok(()));
        for mut task in tasks {
            let goes_on = task.run(self.now_ns).unwrap_or_else(|error| {
                first = std::mem::replace(&mut first, Ok(())).and(Err(error));
                true
            });
            if goes_on {
                kept.push(task);
            }
        }
        RECORD.with_borrow_mut(|record| drop(record.tasks.splice(0..0, kept)));
        first
    }

    /// Names of the tasks that the component has started and that have not come to their end, on this thread.
    #[must_use]
    pub fn tasks() -> Vec<String> {
        RECORD.with_borrow(|record| record.tasks.iter().map(|task| task.name.clone()).collect())
    }

    /// Cancels all tasks: each runs its end and is dropped.
    ///
    /// # Errors
    /// The first that a task ends with.
    pub fn cancel_tasks(&mut self) -> Outcome {
        let tasks = RECORD.with_borrow_mut(|record| {
            record.cancelled = true;
            std::mem::take(&mut record.tasks)
        });
        let end = |task: Started| if task.entered { enter(&task.decl, Phase::Exit, self.now_ns) } else { Ok(()) };
        let ends: Vec<Outcome> = tasks.into_iter().map(end).collect();
        RECORD.with_borrow_mut(|record| record.cancelled = false);
        ends.into_iter().collect()
    }
}

/// The text of the error that is about to be returned.
pub(super) extern "C" fn note_error(text: abi_stable::std_types::RStr<'_>) {
    RECORD.with_borrow_mut(|record| record.error = text.to_string());
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::prelude::*;

    /// Squares on a task, and counts what it is told.
    #[derive(Component)]
    #[component(name = "Worker", passive)]
    struct Worker {
        #[port]
        square: QueryClient<f64, f64>,
        #[port]
        squares: DataOut<f64>,
        seen: std::sync::Arc<std::sync::Mutex<Vec<&'static str>>>,
    }

    struct Told(std::sync::Arc<std::sync::Mutex<Vec<&'static str>>>, u32);

    impl Job for Told {
        fn enter(&mut self, _: &mut Context<'_>) -> Outcome {
            self.0.lock().unwrap().push("enter");
            Ok(())
        }
        fn execute(&mut self, cx: &mut Context<'_>) -> Outcome {
            self.0.lock().unwrap().push(if cx.cancelled() { "cancelled" } else { "execute" });
            self.1 += 1;
            if self.1 == 2 { Err(fault!("twice")) } else { Ok(()) }
        }
        fn exit(&mut self, cx: &mut Context<'_>) -> Outcome {
            self.0.lock().unwrap().push(if cx.cancelled() { "exit, cancelled" } else { "exit" });
            Ok(())
        }
    }

    impl Callbacks for Worker {
        fn start(&mut self, cx: &mut Context<'_>) -> Outcome {
            let (mut square, mut squares) = (std::mem::take(&mut self.square), std::mem::take(&mut self.squares));
            cx.spawn(Task::new("once"), move |_: &mut Context<'_>| -> Outcome {
                squares.write(*square.query(3.0)?);
                Ok(())
            })?;
            cx.spawn_job(Task::new("often").period(Duration::from_millis(5)), Told(self.seen.clone(), 0))?;
            Ok(())
        }

        fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
            self.square.query(1.0)?;
            Ok(())
        }
    }

    #[test]
    fn tasks_run_when_the_test_says_so_with_the_ports_that_they_were_given() {
        let mut bench = Bench::<Worker>::new().unwrap();
        bench.answer("square", |number: &f64| Ok(number * number));
        bench.start().unwrap();
        assert_eq!(Bench::<Worker>::tasks(), ["once", "often"]);
        assert_eq!(bench.execute().unwrap_err().to_string(), Status::Closed.to_string(), "its port was taken");
        bench.run_tasks().unwrap();
        assert_eq!(bench.take::<f64>("squares"), Some(9.0));
        assert_eq!(Bench::<Worker>::tasks(), ["often"]);
        assert_eq!(bench.run_tasks().unwrap_err().to_string(), "twice");
        bench.run_tasks().unwrap();
        bench.cancel_tasks().unwrap();
        assert!(Bench::<Worker>::tasks().is_empty());
        let seen = bench.component().seen.lock().unwrap().clone();
        assert_eq!(seen, ["enter", "execute", "execute", "execute", "exit, cancelled"]);
    }

    #[test]
    fn there_is_a_bound() {
        let mut bench = Bench::<Worker>::new().unwrap();
        let cx = Context::new(0, &super::super::BENCH);
        let spawn = || cx.spawn(Task::new("one"), |_: &mut Context<'_>| -> Outcome { Ok(()) });
        let ends: Vec<_> = (0..17).map(|_| spawn()).collect();
        assert!(ends[..16].iter().all(Result::is_ok));
        assert_eq!(ends[16], Err(Status::Overload));
        bench.run_tasks().unwrap();
    }
}
