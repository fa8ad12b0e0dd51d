//! Devices that are lost and found again: the symptom `device`.
//!
//! ```
//! use component_sdk::prelude::*;
//! use std::fs::File;
//! use std::io::{self, Read};
//!
//! /// Reads a distance each period.
//! #[derive(Component)]
//! #[component(name = "Sonar", periodic = "50ms")]
//! pub struct Sonar {
//!     #[property(default = "/dev/sonar0")]
//!     device: String,
//!     file: Option<File>,
//! }
//!
//! impl Sonar {
//!     fn measure(&mut self) -> io::Result<u8> {
//!         let file = match &mut self.file {
//!             Some(file) => file,
//!             none => none.insert(File::open(&self.device)?),
//!         };
//!         let mut echo = [0];
//!         file.read_exact(&mut echo)?;
//!         Ok(echo[0])
//!     }
//! }
//!
//! impl Callbacks for Sonar {
//!     fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
//!         match self.measure() {
//!             Ok(_) => cx.device_found("left sonar"),
//!             Err(error) => {
//!                 self.file = None;
//!                 cx.device_lost("left sonar", &error);
//!             }
//!         }
//!         Ok(())
//!     }
//! }
//! ```
//!
//! Two functions that may be called each time, and not a guard that keeps the device and its state: the slot keeps
//! account, so that the first loss is a fault and the next ones are the same one, that it is found ends it, and an instance
//! which succeeds another after a reset or a replacement ends what that one began. What a guard knew would have gone with its
//! instance.
//!
//! What follows a loss is the integrator's: `<severity symptom="device">`. Where nothing is said, it is written down, and the
//! component goes on trying. A loss that lasts beyond a reset or a replacement is a fault again: it did not help.
//!
//! From `start` on: an instance that stands ready has no device yet. Names are the author's, one for each device of a
//! component, at most eight of which can be lost at a time.

use std::error::Error;
use std::fmt::Write as _;
use std::io;

use abi_stable::std_types::RStr;

use crate::abi::host;
use crate::context::{Context, Line};

/// A device does not work, for that reason: on a thread that the component started itself. Else [`Context::device_lost`].
pub fn lost(device: &str, error: &(dyn Error + 'static)) {
    let mut message = Line::new();
    // A `Line` never fails: it cuts.
    let _ = write!(message, "{error}");
    (host::get().devices.lost)(RStr::from_str(device), RStr::from_str(message.as_str()), os_error(error));
}

/// A device works: on a thread that the component started itself. Else [`Context::device_found`].
pub fn found(device: &str) {
    (host::get().devices.found)(RStr::from_str(device));
}

impl Context<'_> {
    /// A device does not work, for that reason (symptom `device`): each time that it is tried. The first one is a fault, which
    /// the integrator's rules answer; the others are none, until it was found.
    ///
    /// The system's own error number goes along, where the reason is a [`std::io::Error`] or comes of one; for one that the
    /// system knows nothing of, `io::Error::other("no echo for a second")`.
    pub fn device_lost(&self, device: &str, error: &(dyn Error + 'static)) {
        lost(device, error);
    }

    /// A device works: each time that it does, because it costs next to nothing while none is lost.
    pub fn device_found(&self, device: &str) {
        found(device);
    }
}

/// The system's number of an error, or of what it comes of; 0: there is none.
fn os_error(error: &(dyn Error + 'static)) -> i32 {
    let mut next = Some(error);
    while let Some(error) = next {
        if let Some(code) = error.downcast_ref::<io::Error>().and_then(io::Error::raw_os_error) {
            return code;
        }
        next = error.source();
    }
    0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_systems_number_is_found_beneath_other_errors() {
        #[derive(Debug)]
        struct Ours(io::Error);
        impl std::fmt::Display for Ours {
            fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                formatter.write_str("the sonar does not answer")
            }
        }
        impl Error for Ours {
            fn source(&self) -> Option<&(dyn Error + 'static)> {
                Some(&self.0)
            }
        }
        assert_eq!(os_error(&io::Error::from_raw_os_error(5)), 5);
        assert_eq!(os_error(&Ours(io::Error::from_raw_os_error(19))), 19);
        assert_eq!(os_error(&io::Error::other("no echo")), 0);
    }
}
