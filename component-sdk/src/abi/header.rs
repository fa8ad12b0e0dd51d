//! What the daemon compares before it calls anything in a plugin.
//!
//! Fixed layout for all time: plain integers and borrowed bytes, so that even a plugin of another ABI version can be
//! told what is wrong with it.

use abi_stable::type_layout::TypeLayout;

use super::ABI_VERSION;
use super::class::{ComponentClass, PluginModuleRef};
use super::host::HostApi;
use crate::object::TypeDescriptor;

/// First bytes of every header.
pub const MAGIC: [u8; 8] = *b"CMPPLUG\0";

/// Prefix of the one symbol that a plugin exports; the crate's name follows, so that tests may link several plugins.
pub const SYMBOL_PREFIX: &str = "component_plugin_";

/// Version of the layout checker; its own data differ between versions.
pub const CHECKER: &str = "abi_stable 0.11";

/// `catch_unwind` works.
pub const PANIC_UNWIND: u32 = 1;
/// A panic would end the daemon.
pub const PANIC_ABORT: u32 = 2;

/// Borrowed text of fixed layout.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct HeaderText {
    start: &'static u8,
    len: usize,
}

impl HeaderText {
    /// The text.
    #[must_use]
    pub const fn new(text: &'static str) -> Self {
        assert!(!text.is_empty());
        Self { start: &text.as_bytes()[0], len: text.len() }
    }

    /// Address and length of its bytes.
    #[must_use]
    pub const fn raw(&self) -> (*const u8, usize) {
        (std::ptr::from_ref(self.start), self.len)
    }
}

/// What a plugin says about itself.
#[repr(C)]
pub struct PluginHeader {
    /// [`MAGIC`].
    pub magic: [u8; 8],
    /// [`ABI_VERSION`] of the SDK that it was built with.
    pub abi_version: u32,
    /// Size of this struct.
    pub header_size: u32,
    /// [`PANIC_UNWIND`] or [`PANIC_ABORT`].
    pub panic_strategy: u32,
    /// Size of [`HostApi`].
    pub host_size: u32,
    /// Size of [`ComponentClass`].
    pub class_size: u32,
    /// Size of [`TypeDescriptor`].
    pub descriptor_size: u32,
    /// [`CHECKER`].
    pub checker: HeaderText,
    /// Version of the SDK.
    pub sdk_version: HeaderText,
    /// Package and version of the plugin.
    pub build: HeaderText,
    /// Layout of the root module, for the checker.
    pub layout: extern "C" fn() -> &'static TypeLayout,
    /// The root module.
    pub root: extern "C" fn() -> PluginModuleRef,
}

impl PluginHeader {
    /// The header of a plugin built with this SDK.
    #[must_use]
    pub const fn new(
        build: &'static str,
        panic_strategy: u32,
        layout: extern "C" fn() -> &'static TypeLayout,
        root: extern "C" fn() -> PluginModuleRef,
    ) -> Self {
        Self {
            magic: MAGIC,
            abi_version: ABI_VERSION,
            header_size: size_of::<Self>() as u32,
            panic_strategy,
            host_size: size_of::<HostApi>() as u32,
            class_size: size_of::<ComponentClass>() as u32,
            descriptor_size: size_of::<TypeDescriptor>() as u32,
            checker: HeaderText::new(CHECKER),
            sdk_version: HeaderText::new(env!("CARGO_PKG_VERSION")),
            build: HeaderText::new(build),
            layout,
            root,
        }
    }
}
