//! A `.so` file to a handle that the rest can use safely: `discover -> probe -> image -> library -> compat -> instance`.

/// Header checks before any call: both values, and what to do.
pub mod compat;

/// Which file serves which `library_name`.
pub mod discover;

/// What a component's callbacks tell the daemon besides data: logs, panics, errors.
pub mod host;

/// What the file says before it is loaded.
pub mod image;

/// The interfaces of service ports.
pub mod interface;

/// One method for each shim; the only caller of plugin code.
pub mod instance;

/// A file that was never loaded is loaded by another process first.
pub mod probe;

/// Private copy, `dlopen`, root module; never `dlclose`.
pub mod library;

/// Which function an address lies in.
pub mod symbols;

/// Tasks that a callback starts.
pub mod task;

pub use library::{Class, Plugin};
