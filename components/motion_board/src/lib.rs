//! Driver of the motion board: wheel commands out, encoders and echoes in, over a serial line.

use std::io::{self, ErrorKind};
use std::time::Duration;

use board_protocol::{StatusFlags, Telemetry};
use component_sdk::prelude::*;
use robot_objects::retry::Retry;
use robot_objects::{EncoderCounts, UltrasonicRing, WheelCommand};
use serialport::TTYPort;

pub mod link;
pub mod telemetry;

use link::{BoardClock, Link};

/// A wheel command older than this counts as "neutral"; the board's own watchdog (200 ms) is the second guard.
const COMMAND_LASTS: Duration = Duration::from_millis(150);

/// A board that says nothing for so long is lost, though its line may be open: it speaks 70 times a second.
const SPEAKS_WITHIN: Duration = Duration::from_secs(1);

/// Speaks with the motion board.
#[derive(Component)]
#[component(name = "MotionBoard", version = "1.0", periodic = "10ms")]
pub struct MotionBoard {
    /// How fast the wheels are to turn.
    #[port]
    wheels: DataIn<WheelCommand>,
    /// Readings of the wheel encoders, 50 a second.
    #[port]
    encoders: DataOut<EncoderCounts>,
    /// Raw rounds of the ultrasonic ring, 20 a second.
    #[port]
    echoes: DataOut<UltrasonicRing>,
    /// Path of the serial device.
    #[property(default = "/dev/ttyUSB0")]
    device: String,
    /// Speed of the line.
    #[property(default = 115_200, unit = "baud", range = 1200..=4_000_000)]
    baud: u32,
    link: Option<Link<TTYPort>>,
    clock: BoardClock,
    status: StatusFlags,
    retry: Retry,
    heard: Instant,
}

impl Callbacks for MotionBoard {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        if self.link.is_none() && !self.retry.is_due(cx.now().as_nanos()) {
            return Ok(());
        }
        match self.open(cx).and_then(|()| self.exchange(cx)) {
            Ok(()) => {}
            Err(loss) => self.lose(cx, &loss),
        }
        Ok(())
    }

    fn stop(&mut self, cx: &mut Context<'_>) -> Outcome {
        // A line that is lost cannot be told; the board stops by itself then.
        let Some(mut link) = self.close(cx) else { return Ok(()) };
        if link.damaged() > 0 {
            warn!(cx, "{} frames were damaged on the line; check cable and `baud`", link.damaged());
        }
        Ok(link.drive(0.0, 0.0)?)
    }

    fn reset(&mut self, cx: &mut Context<'_>) -> Outcome {
        self.close(cx);
        Ok(())
    }
}

impl MotionBoard {
    fn open(&mut self, cx: &Context<'_>) -> io::Result<()> {
        if self.link.is_none() {
            let link = self.link.insert(Link::new(open_line(&self.device, self.baud)?));
            // If the daemon itself dies, this stops the wheels sooner than the board's watchdog.
            cx.safe_output(link.line(), &link::neutral());
            self.clock = BoardClock::default();
            self.heard = cx.now();
            info!(cx, "motion board opened at {}", self.device);
        }
        Ok(())
    }

    /// The link, which is ours no more.
    fn close(&mut self, cx: &Context<'_>) -> Option<Link<TTYPort>> {
        self.link.take().inspect(|link| cx.safe_output(link.line(), &[]))
    }

    /// Sends the newest command and passes on all telemetry that has come.
    fn exchange(&mut self, cx: &Context<'_>) -> io::Result<()> {
        let Some(link) = &mut self.link else { return Ok(()) };
        let in_time = self.wheels.age(cx).is_some_and(|age| age <= COMMAND_LASTS);
        let WheelCommand { left, right } = self.wheels.newest().filter(|_| in_time).copied().unwrap_or_default();
        link.drive(left, right)?;
        let mut speaks = false;
        link.listen(|message| {
            speaks = true;
            match message {
                Telemetry::Encoders(reading) => _ = self.encoders.write(telemetry::counts(&reading, &mut self.clock)),
                Telemetry::Ultrasonic(round) => _ = self.echoes.write(telemetry::ring(&round, &mut self.clock)),
                Telemetry::Status(status) => telemetry::tell_changes(cx, &mut self.status, status.flags),
            }
        })?;
        self.tell_whether_it(speaks, cx);
        Ok(())
    }

    /// One that is silent is told to stop all the same, as it may hear: its line stays open.
    fn tell_whether_it(&mut self, speaks: bool, cx: &Context<'_>) {
        if speaks {
            self.heard = cx.now();
            cx.device_found(&self.device);
        } else if cx.now().since(self.heard) > SPEAKS_WITHIN {
            let silence =
                io::Error::new(ErrorKind::TimedOut, "the board says nothing; has it power, is `baud` its own?");
            cx.device_lost(&self.device, &silence);
        }
    }

    fn lose(&mut self, cx: &Context<'_>, loss: &io::Error) {
        self.close(cx);
        cx.device_lost(&self.device, loss);
    }
}

/// Not exclusive: an instance that crashed is never dropped and keeps its descriptor, and its successor must still get in.
fn open_line(device: &str, baud: u32) -> io::Result<TTYPort> {
    let line = serialport::new(device, baud).timeout(Duration::ZERO).exclusive(false);
    line.open_native().map_err(io::Error::from)
}

export_components!(MotionBoard);
