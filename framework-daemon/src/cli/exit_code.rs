//! What the exit code says. Scripts hold on to these numbers.

/// How a verb ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Exit {
    /// Done.
    Done = 0,
    /// Failed.
    Failed = 1,
    /// Wrong usage; clap uses the same number.
    Usage = 2,
    /// A profile is invalid.
    ProfileInvalid = 3,
    /// A plugin is refused.
    PluginRefused = 4,
    /// The daemon cannot be reached.
    Unreachable = 5,
    /// The daemon refused.
    Refused = 6,
    /// The emergency stop is latched.
    Emergency = 7,
}
