//! Drivers of devices: files, which are there or not.

use std::fs::File;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use component_sdk::device;
use component_sdk::prelude::*;

/// Looks after files as if they were devices: those that are not there are lost. In its callbacks, in a task, or on a thread
/// that it starts itself.
#[derive(Component)]
#[component(name = "Driver", version = "1.0", periodic = "5ms")]
pub struct Driver {
    /// Their paths, with spaces between them.
    #[property(default = "")]
    devices: String,
    /// `callback`, `task` or `thread`.
    #[property(default = "callback")]
    by: String,
    over: Arc<AtomicBool>,
}

/// A file that cannot be opened does not work.
fn look_after(devices: &str, lost: impl Fn(&str, &std::io::Error), found: impl Fn(&str)) {
    for device in devices.split_whitespace() {
        match File::open(device) {
            Ok(_) => found(device),
            Err(error) => lost(device, &error),
        }
    }
}

fn look_after_here(devices: &str, cx: &Context<'_>) {
    look_after(devices, |device, error| cx.device_lost(device, error), |device| cx.device_found(device));
}

impl Callbacks for Driver {
    fn start(&mut self, cx: &mut Context<'_>) -> Outcome {
        let devices = self.devices.clone();
        match self.by.as_str() {
            "task" => {
                let task = Task::new("devices").period(Duration::from_millis(5));
                cx.spawn(task, move |cx: &mut Context<'_>| -> Outcome {
                    look_after_here(&devices, cx);
                    Ok(())
                })?;
            }
            "thread" => {
                let over = Arc::new(AtomicBool::new(false));
                self.over = Arc::clone(&over);
                std::thread::spawn(move || {
                    while !over.load(Ordering::SeqCst) {
                        look_after(&devices, |device, error| device::lost(device, error), device::found);
                        std::thread::sleep(Duration::from_millis(5));
                    }
                });
            }
            _ => {}
        }
        Ok(())
    }

    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        if self.by == "callback" {
            look_after_here(&self.devices, cx);
        }
        Ok(())
    }

    fn on_error(&mut self, cx: &mut Context<'_>, fault: &FaultInfo<'_>) -> Outcome {
        info!(cx, "told of {}: {}", fault.symptom, fault.message);
        Ok(())
    }

    fn stop(&mut self, _: &mut Context<'_>) -> Outcome {
        self.over.store(true, Ordering::SeqCst);
        Ok(())
    }
}

impl Drop for Driver {
    fn drop(&mut self) {
        self.over.store(true, Ordering::SeqCst);
    }
}

/// Needs no device.
#[derive(Component)]
#[component(name = "Dummy", version = "1.0", periodic = "5ms")]
pub struct Dummy {
    #[property(default = "")]
    devices: String,
    #[property(default = "")]
    by: String,
}

impl Callbacks for Dummy {
    fn start(&mut self, cx: &mut Context<'_>) -> Outcome {
        info!(cx, "needs none of {}, {}", self.devices, self.by);
        Ok(())
    }
}
