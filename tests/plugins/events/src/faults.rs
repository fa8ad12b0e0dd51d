//! Hears of the faults of others, and reports some.

use std::time::Duration;

use component_sdk::objects::{FaultFilter, FaultNotice, FaultReport};
use component_sdk::prelude::*;

/// Hears of the faults that it asks for, and of all.
#[derive(Component)]
#[component(name = "FaultListener", version = "1.0", nonperiodic)]
pub struct FaultListener {
    /// The slot that it asks for.
    #[property(default = "")]
    slot: String,
    /// The symptom that it asks for.
    #[property(default = "")]
    symptom: String,
    /// The least severity that it asks for.
    #[property(default = "")]
    least: String,
    /// How long it takes over each of all faults.
    #[property(default = 0, unit = "ms", range = 0..=60_000)]
    slow: u32,
    #[port(handler = on_asked)]
    faults: EventClient<FaultFilter, FaultNotice>,
    #[port(handler = on_any)]
    all: EventIn<FaultNotice>,
}

impl Callbacks for FaultListener {
    fn start(&mut self, cx: &mut Context<'_>) -> Outcome {
        let filter = FaultFilter::default().slot(&self.slot).symptom(&self.symptom).least(&self.least);
        match self.faults.activate(Mode::Continuous, filter) {
            Ok(_) => info!(cx, "listens"),
            Err(status) => info!(cx, "does not ask: {status}"),
        }
        Ok(())
    }
}

impl FaultListener {
    fn on_asked(&mut self, cx: &mut Context<'_>, _: EventId<FaultNotice>, fault: &FaultNotice) -> Outcome {
        let (slot, symptom, severity, outcome) = (fault.slot(), fault.symptom(), fault.severity(), fault.outcome());
        info!(cx, "asked for: {} {slot} {symptom} {severity} {outcome}: {}", fault.sequence, fault.message());
        Ok(())
    }

    fn on_any(&mut self, cx: &mut Context<'_>, fault: &FaultNotice) -> Outcome {
        info!(cx, "hears: {} {} {}", fault.sequence, fault.slot(), fault.symptom());
        // Whoever ends the wait is answered at once.
        let _ = cx.sleep(Duration::from_millis(self.slow.into()));
        Ok(())
    }
}

/// Reports a fault of another slot, in its tenth cycle.
#[derive(Component)]
#[component(name = "FaultReporter", version = "1.0", periodic = "20ms")]
pub struct FaultReporter {
    /// The slot that it blames; none: its own.
    #[property(default = "")]
    blames: String,
    #[port]
    report: EventOut<FaultReport>,
    cycles: u32,
}

impl Callbacks for FaultReporter {
    fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
        self.cycles += 1;
        if self.cycles == 10 {
            self.report.send(FaultReport::new(&self.blames, "it looks the wrong way"));
        }
        Ok(())
    }
}
