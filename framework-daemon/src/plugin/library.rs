//! Private copy, `dlopen`, header, root module; never `dlclose`.
//!
//! The copy is in memory: a file that is overwritten while it is mapped would take its readers down with SIGBUS, and a
//! rebuilt plugin must be loaded anew although `dlopen` knows its name. A Rust library is never closed: its thread-local
//! destructors would be called after they are gone.
#![allow(unsafe_code, reason = "address of unsafe: dlopen and the plugin's header")]

use std::io::Write;
use std::mem::ManuallyDrop;
use std::os::fd::{AsRawFd, OwnedFd};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use abi_stable::StableAbi;
use component_sdk::abi::class::{ComponentClass, PluginModuleRef};
use component_sdk::abi::header::{HeaderText, PluginHeader};
use component_sdk::abi::host::HostApi;
use libloading::os::unix::{Library, RTLD_LOCAL, RTLD_NOW};

use super::compat::{self, HeaderView};
use super::image::{self, Image};
use crate::model::limits::PLUGIN_FILE_BYTES;
use crate::sys::copy::Sum;
use crate::sys::{fence, memory, shield, text};

/// A loaded plugin.
pub struct Plugin {
    /// The file it came from.
    pub file: PathBuf,
    /// Its file when it was read: another length or time means another plugin.
    pub stamp: Stamp,
    /// Stands for what its file held.
    pub build: u64,
    /// What its file said.
    pub image: Image,
    /// What its header said.
    pub header: HeaderView,
    classes: &'static [ComponentClass],
}

/// Length and time of change of a file.
pub type Stamp = (u64, Option<std::time::SystemTime>);

/// Length and time of change of `file` now.
///
/// # Errors
/// When there is no such file.
pub fn stamp(file: &Path) -> std::io::Result<Stamp> {
    let metadata = std::fs::metadata(file)?;
    Ok((metadata.len(), metadata.modified().ok()))
}

/// A class of a loaded plugin.
#[derive(Clone)]
pub struct Class {
    exported: &'static ComponentClass,
    plugin: Arc<Plugin>,
}

/// Why a file is no plugin for this daemon.
#[derive(Clone, Debug, thiserror::Error)]
#[error("plugin {} is refused: {reason}", file.display())]
pub struct Refusal {
    /// The file.
    pub file: PathBuf,
    /// Why, and the way out.
    pub reason: String,
}

impl Plugin {
    /// Loads a plugin and hands it its host.
    ///
    /// # Errors
    /// When the file cannot be read, is no plugin, or does not fit this daemon.
    pub fn load(file: &Path, host: &'static HostApi) -> Result<Arc<Self>, Refusal> {
        Self::try_load(file, host).map_err(|reason| Refusal { file: file.to_owned(), reason })
    }

    fn try_load(file: &Path, host: &'static HostApi) -> Result<Arc<Self>, String> {
        let stamp = stamp(file).map_err(|error| format!("it cannot be read: {error}"))?;
        if stamp.0 > PLUGIN_FILE_BYTES || !file.is_file() {
            return Err(format!("it is no regular file of at most {} MiB", PLUGIN_FILE_BYTES >> 20));
        }
        let bytes = std::fs::read(file).map_err(|error| format!("it cannot be read: {error}"))?;
        let image = image::read(&bytes)?;
        let identity = if image.build_id.is_empty() { bytes.as_slice() } else { image.build_id.as_bytes() };
        let build = Sum::of(identity).finish(0);
        // Not within `load`: the copy is the daemon's own descriptor.
        let copy = copy_in_memory(file, &bytes).map_err(|error| format!("no memory for its private copy: {error}"))?;
        let (header, classes) = shield::load(|| -> Result<_, String> {
            let library = open_copy(file, copy)?;
            let (header, raw) = read_header(&library, &image.symbol)?;
            memory::read_in(std::ptr::from_ref(raw).expose_provenance());
            let module = root_module(raw)?;
            (module.install())(host);
            Ok((header, (module.classes())().as_slice()))
        })?;
        Ok(Arc::new(Self { file: file.to_owned(), stamp, build, image, header, classes }))
    }

    /// True when its file holds another plugin by now. One that is gone is still the same.
    #[must_use]
    pub fn is_outdated(&self) -> bool {
        stamp(&self.file).is_ok_and(|now| now != self.stamp)
    }

    /// The classes that it exports.
    #[must_use]
    pub fn classes(self: &Arc<Self>) -> Vec<Class> {
        self.classes.iter().map(|exported| Class { exported, plugin: Arc::clone(self) }).collect()
    }

    /// The class of that name.
    #[must_use]
    pub fn class(self: &Arc<Self>, name: &str) -> Option<Class> {
        self.classes().into_iter().find(|class| class.name() == name)
    }
}

impl Class {
    /// Its name.
    #[must_use]
    pub fn name(&self) -> &'static str {
        self.exported.decl.name.as_str()
    }

    /// Description and shims.
    #[must_use]
    pub const fn exported(&self) -> &'static ComponentClass {
        self.exported
    }

    /// Names of the ports that others do not find until the component says so.
    #[must_use]
    pub fn unlisted(&self) -> Vec<&'static str> {
        let ports = self.exported.decl.ports.as_slice().iter();
        ports.filter(|port| !port.listed).map(|port| port.name.as_str()).collect()
    }

    /// Where it came from.
    #[must_use]
    pub const fn plugin(&self) -> &Arc<Plugin> {
        &self.plugin
    }
}

/// Opens that copy of the file's contents. Library and descriptor stay for the life of the process: `dlopen` compares
/// names, and the name of a copy is its descriptor's number.
fn open_copy(file: &Path, descriptor: OwnedFd) -> Result<ManuallyDrop<Library>, String> {
    let path = format!("{}{}", text::COPIES, descriptor.as_raw_fd());
    text::install();
    // SAFETY: loading runs the library's constructors: they are trusted as far as its image was checked here and another
    // process survived them (`probe`).
    let library = unsafe { Library::open(Some(&path), RTLD_NOW | RTLD_LOCAL) };
    let library = library.map_err(|error| {
        let cause = std::error::Error::source(&error).map(|source| format!(": {source}")).unwrap_or_default();
        format!("it cannot be loaded: {error}{cause}")
    })?;
    #[allow(clippy::mem_forget, reason = "the descriptor's number is the name of a library that is never closed")]
    std::mem::forget(descriptor);
    fence::enclose(&text::learn(&path, file));
    Ok(ManuallyDrop::new(library))
}

fn copy_in_memory(file: &Path, bytes: &[u8]) -> std::io::Result<OwnedFd> {
    let name = file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let descriptor = nix::sys::memfd::memfd_create(name.as_str(), nix::sys::memfd::MFdFlags::MFD_CLOEXEC)?;
    let mut copy = std::fs::File::from(descriptor);
    copy.write_all(bytes)?;
    Ok(copy.into())
}

fn read_header(library: &Library, symbol: &str) -> Result<(HeaderView, &'static PluginHeader), String> {
    // SAFETY: the symbol is only taken as an address here.
    let found = unsafe { library.get::<*const PluginHeader>(symbol) }.map_err(|error| error.to_string())?;
    let raw: *const PluginHeader = *found;
    // SAFETY: `image` found the symbol defined with the reserved prefix; its first fields are plain integers of fixed
    // place in every version; the library is never closed. The rest is read only after those agree.
    let mut view = unsafe {
        HeaderView {
            magic: (&raw const (*raw).magic).read_unaligned(),
            abi_version: (&raw const (*raw).abi_version).read_unaligned(),
            header_size: (&raw const (*raw).header_size).read_unaligned(),
            panic_strategy: 0,
            host_size: 0,
            class_size: 0,
            descriptor_size: 0,
            checker: String::new(),
            sdk_version: String::new(),
            build: String::new(),
        }
    };
    compat::check_fixed(&view)?;
    // SAFETY: magic, version and size of the header agree, so it is one of ours, in a library that is never closed.
    let header: &'static PluginHeader = unsafe { &*raw };
    view.panic_strategy = header.panic_strategy;
    view.host_size = header.host_size;
    view.class_size = header.class_size;
    view.descriptor_size = header.descriptor_size;
    view.checker = text(&header.checker);
    view.sdk_version = text(&header.sdk_version);
    view.build = text(&header.build);
    compat::check_rest(&view)?;
    Ok((view, header))
}

fn text(text: &HeaderText) -> String {
    let (start, len) = text.raw();
    // SAFETY: a header's text borrows static bytes of the plugin, which is never closed.
    String::from_utf8_lossy(unsafe { std::slice::from_raw_parts(start, len) }).into_owned()
}

/// The root module, after the field-by-field comparison of its layout with ours.
fn root_module(header: &'static PluginHeader) -> Result<PluginModuleRef, String> {
    let (ours, theirs) = (<PluginModuleRef as StableAbi>::LAYOUT, (header.layout)());
    abi_stable::abi_stability::abi_checking::check_layout_compatibility(ours, theirs).map_err(|errors| {
        let version = env!("CARGO_PKG_VERSION");
        let difference = compat::difference(&errors.to_string());
        format!("its binary layout differs from the daemon's ({difference}): build it against component-sdk {version}")
    })?;
    Ok((header.root)())
}
