//! An actuator, and somebody who says when it starts and stops.

use std::fs::File;
use std::io::Write;

use component_sdk::prelude::*;

/// Drives on in each of its callbacks, on a line that is a file; its safe output is `stop`.
#[derive(Component)]
#[component(name = "Brake", version = "1.0", periodic = "2ms")]
pub struct Brake {
    /// The line.
    #[property(default = "")]
    line: String,
    open: Option<File>,
}

impl Callbacks for Brake {
    fn start(&mut self, cx: &mut Context<'_>) -> Outcome {
        let file = File::options().append(true).create(true).open(&self.line)?;
        cx.safe_output(&file, b"stop\n");
        self.open = Some(file);
        info!(cx, "starts");
        Ok(())
    }

    fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
        self.open.iter_mut().try_for_each(|line| line.write_all(b"drive\n"))?;
        Ok(())
    }

    fn on_emergency(&mut self, cx: &mut Context<'_>) -> Outcome {
        info!(cx, "is told of an emergency");
        self.open.iter_mut().try_for_each(|line| line.write_all(b"ease\n"))?;
        Ok(())
    }

    fn stop(&mut self, cx: &mut Context<'_>) -> Outcome {
        info!(cx, "stops");
        Ok(())
    }
}

/// Says when it starts, stops and is reset.
#[derive(Component)]
#[component(name = "Witness", version = "1.0", periodic = "2ms")]
pub struct Witness {
    cycles: u64,
}

impl Callbacks for Witness {
    fn start(&mut self, cx: &mut Context<'_>) -> Outcome {
        info!(cx, "starts");
        Ok(())
    }

    fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
        self.cycles += 1;
        Ok(())
    }

    fn stop(&mut self, cx: &mut Context<'_>) -> Outcome {
        info!(cx, "stops");
        Ok(())
    }

    fn reset(&mut self, cx: &mut Context<'_>) -> Outcome {
        info!(cx, "is reset");
        Ok(())
    }

    fn recover(&mut self, cx: &mut Context<'_>, fault: &FaultInfo<'_>) -> Outcome {
        info!(cx, "succeeds after {}", fault.message);
        Ok(())
    }
}
