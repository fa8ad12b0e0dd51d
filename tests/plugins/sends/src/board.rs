//! Services: an interface, one with fewer of its methods, and one with another parameter.

use std::time::Duration;

use component_sdk::prelude::*;

/// What a board does for others.
#[service]
pub trait BoardMethods {
    /// Turns, and tells how far in all.
    fn turn(&mut self, by: f64) -> f64;
    /// Goes somewhere; where it is then.
    fn go(&mut self, cx: &mut Context<'_>, to: &Pose2D, after_ms: u32) -> Pose2D;
    /// Nobody waits for it.
    #[nonblocking]
    fn beep(&mut self, tone: u32);
    /// How often it has beeped.
    fn beeps(&mut self) -> u64;
    /// May be refused.
    fn release(&mut self, what: Text) -> Result<u32, Status>;
    /// Says only that it is done.
    fn clear(&mut self);
}

/// Some of it.
#[service]
pub trait FewMethods {
    /// Turns, and tells how far in all.
    fn turn(&mut self, by: f64) -> f64;
    /// Nobody waits for it.
    #[nonblocking]
    fn beep(&mut self, tone: u32);
}

/// The same names, other types.
#[service]
pub trait OtherMethods {
    /// In other units.
    fn turn(&mut self, by: f32) -> f64;
    /// Nobody waits for it.
    #[nonblocking]
    fn beep(&mut self, tone: u32);
}

/// Implements all of it.
#[derive(Component)]
#[component(name = "Board", version = "1.0", passive)]
pub struct Board {
    #[port]
    board: Provided<dyn BoardMethods>,
    turned: f64,
    tones: u64,
}

impl Callbacks for Board {}

impl BoardMethods for Board {
    fn turn(&mut self, by: f64) -> f64 {
        self.turned += by;
        self.turned
    }

    fn go(&mut self, cx: &mut Context<'_>, to: &Pose2D, after_ms: u32) -> Pose2D {
        let _ = cx.sleep(Duration::from_millis(u64::from(after_ms)));
        Pose2D { x: to.x + 1.0, ..*to }
    }

    fn beep(&mut self, _: u32) {
        self.tones += 1;
    }

    fn beeps(&mut self) -> u64 {
        self.tones
    }

    fn release(&mut self, what: Text) -> Result<u32, Status> {
        if what.as_str() == "brake" { Ok(7) } else { Err(Status::NotAllowed) }
    }

    fn clear(&mut self) {
        (self.turned, self.tones) = (0.0, 0);
    }
}

/// Implements some of it.
#[derive(Component)]
#[component(name = "Miser", version = "1.0", passive)]
pub struct Miser {
    #[port]
    board: Provided<dyn FewMethods>,
}

impl Callbacks for Miser {}

impl FewMethods for Miser {
    fn turn(&mut self, _: f64) -> f64 {
        -1.0
    }

    fn beep(&mut self, _: u32) {}
}

/// Implements something else.
#[derive(Component)]
#[component(name = "OtherBoard", version = "1.0", passive)]
pub struct OtherBoard {
    #[port]
    board: Provided<dyn OtherMethods>,
}

impl Callbacks for OtherBoard {}

impl OtherMethods for OtherBoard {
    fn turn(&mut self, by: f32) -> f64 {
        f64::from(by)
    }

    fn beep(&mut self, _: u32) {}
}
