//! The binary contract between a plugin and the daemon, on one page.
//!
//! - **One symbol** per plugin, `component_plugin_<crate>`: a [`PluginHeader`](crate::abi::header::PluginHeader). It is read before any call and
//!   says magic, ABI version, sizes, layout hashes, panic strategy and build, so that a refusal names both values.
//! - **Then** `abi_stable` compares the layout of [`PluginModule`](crate::abi::class::PluginModule) and of all it mentions, field by field.
//! - **Ownership**: what a plugin exports is `'static`, because libraries are never closed. Objects on ports live in
//!   blocks of the daemon; only plugin code constructs and drops what is in them.
//! - **Threads**: an instance is entered by one thread at a time, always on a fiber.
//! - **Growth**: [`PluginModule`](crate::abi::class::PluginModule) and [`HostApi`](crate::abi::host::HostApi) grow at their end only; anything else is a new ABI version.
//! - **Panics** never cross: each shim catches them inside the plugin, where the copy of `std` that threw can.
//!
//! The root module's own loader of `abi_stable` was tried and left: it opens the library itself and reports less than
//! the header does when versions differ.

/// Calls crossing the border.
pub mod calls;

/// Events crossing the border.
pub mod events;

/// What a plugin exports: classes, their ports and properties, the shims.
pub mod class;

/// The entry symbol and the shims behind it.
pub mod export;

/// Devices lost and found.
pub mod device;

/// Connections made and cut at run time.
pub mod links;

/// What is compared before any call.
pub mod header;

/// What a plugin may call.
pub mod host;

/// Push ports crossing the border.
pub mod push;

/// Provokes faults for tests and drills, in the plugin's own text.
pub mod inject;

/// Objects crossing the border.
pub mod payload;

/// Tasks crossing the border.
pub mod task;

/// Version of the binary contract. Anything but growth at the end of a prefix type raises it.
pub const ABI_VERSION: u32 = 3;
