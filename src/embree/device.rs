//! Embree devices: start, version, instruction set, errors and memory.

use embree4_sys as sys;
use std::ffi::{CStr, CString, c_char, c_void};
use std::fmt;
use std::sync::Mutex;
use std::sync::atomic::{AtomicI64, Ordering};

/// An error from Embree or from this wrapper.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EmbreeError {
    /// The library at run time is older than 4.3 or than the headers this program was built with.
    #[error(
        "the Embree library is version {found}, but {needed} or later is needed; install a newer libembree4 or set \
         EMBREE_DIR and rebuild"
    )]
    Version {
        /// Version of the library that was loaded.
        found: LibraryVersion,
        /// Oldest supported version.
        needed: LibraryVersion,
    },
    /// No device could be created.
    #[error("Embree could not start: {0}")]
    NoDevice(String),
    /// A call failed.
    #[error("Embree failed to {action}: {message}")]
    Call {
        /// The attempted action.
        action: &'static str,
        /// Embree's message.
        message: String,
    },
    /// The environment variable names an instruction set that does not exist or that this machine lacks.
    #[error("CARDIOID_ISA is {0:?}; it must be one of {names} that this machine has, or not be set", names = Isa::names())]
    InstructionSet(String),
    /// There are more primitives than a 32-bit index can address.
    #[error("{0} primitives in one geometry; Embree counts to 4294967294")]
    TooManyPrimitives(usize),
}

/// A version of the Embree library.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct LibraryVersion {
    /// Major, minor and patch.
    pub parts: (u32, u32, u32),
}

impl LibraryVersion {
    /// The version from Embree's number `10000 major + 100 minor + patch`.
    fn from_number(number: u32) -> Self {
        Self { parts: (number / 10_000, number / 100 % 100, number % 100) }
    }
}

impl fmt::Display for LibraryVersion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (major, minor, patch) = self.parts;
        write!(f, "{major}.{minor}.{patch}")
    }
}

/// Instruction set of Embree's kernels. Kernels of different sets round distances and barycentric coordinates differently.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Isa {
    /// Embree's own choice: the widest set that the machine has.
    Best,
    /// SSE 4.2.
    Sse42,
    /// AVX2.
    Avx2,
    /// AVX-512 (F, DQ, CD, BW and VL).
    Avx512,
}

impl Isa {
    /// Environment variable that restricts Embree to one [`Self::name`], in programs and tests alike.
    pub const VARIABLE: &str = "CARDIOID_ISA";

    /// Embree's name of the set; empty for Embree's own choice.
    pub fn name(self) -> &'static str {
        match self {
            Self::Best => "",
            Self::Sse42 => "sse4.2",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
        }
    }

    /// Names of the instruction sets that this machine has.
    pub fn available_names() -> String {
        let sets = [Self::Sse42, Self::Avx2, Self::Avx512].into_iter().filter(|isa| isa.is_available());
        let names: Vec<&str> = sets.map(Self::name).collect();
        if names.is_empty() { "none to choose from".to_owned() } else { names.join(", ") }
    }

    fn names() -> String {
        [Self::Sse42, Self::Avx2, Self::Avx512].map(Self::name).join(", ")
    }

    #[cfg(target_arch = "x86_64")]
    fn is_available(self) -> bool {
        match self {
            Self::Best => true,
            Self::Sse42 => std::is_x86_feature_detected!("sse4.2"),
            Self::Avx2 => std::is_x86_feature_detected!("avx2") && std::is_x86_feature_detected!("fma"),
            Self::Avx512 => {
                std::is_x86_feature_detected!("avx512f")
                    && std::is_x86_feature_detected!("avx512dq")
                    && std::is_x86_feature_detected!("avx512cd")
                    && std::is_x86_feature_detected!("avx512bw")
                    && std::is_x86_feature_detected!("avx512vl")
            }
        }
    }

    #[cfg(not(target_arch = "x86_64"))]
    fn is_available(self) -> bool {
        self == Self::Best
    }

    /// The instruction set with this name, if this machine has it. Without the check, Embree would execute an illegal instruction.
    ///
    /// # Errors
    /// [`EmbreeError::InstructionSet`] for an unknown name or a set that the machine lacks.
    pub fn from_name(name: &str) -> Result<Self, EmbreeError> {
        [Self::Best, Self::Sse42, Self::Avx2, Self::Avx512]
            .into_iter()
            .find(|isa| isa.name() == name && isa.is_available())
            .ok_or_else(|| EmbreeError::InstructionSet(name.to_owned()))
    }

    /// The widest set that this machine has.
    pub fn detected() -> Self {
        [Self::Avx512, Self::Avx2, Self::Sse42]
            .into_iter()
            .find(|isa| isa.is_available())
            .unwrap_or(Self::Best)
    }

    /// The instruction set that [`Self::VARIABLE`] names; [`Self::Best`] where it is empty or not set.
    ///
    /// # Errors
    /// As for [`Self::from_name`].
    pub fn from_environment() -> Result<Self, EmbreeError> {
        let value = std::env::var_os(Self::VARIABLE).unwrap_or_default();
        Self::from_name(&value.to_string_lossy())
    }
}

/// Oldest supported version: since 4.3 the hit structure has the layout of the bindings.
const OLDEST: u32 = 40_300;

/// An instance of Embree with its own thread pool.
pub struct Device {
    handle: sys::RTCDevice,
    /// First error since the last check, written by the callback. Boxed, as Embree keeps its address.
    error: Box<Mutex<Option<String>>>,
    /// Bytes that the library holds, where counting is enabled. Boxed, as Embree keeps its address.
    bytes: Option<Box<AtomicI64>>,
    version: LibraryVersion,
    isa: Isa,
}

// SAFETY: Embree's device functions may be called from any thread; the error slot is behind a mutex.
unsafe impl Send for Device {}
// SAFETY: as above; no method takes `&mut self`.
unsafe impl Sync for Device {}

impl fmt::Debug for Device {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Device").field("version", &self.version).finish_non_exhaustive()
    }
}

/// Called by Embree for each error, on the thread that caused it.
extern "C" fn record_error(slot: *mut c_void, _code: sys::RTCError, message: *const c_char) {
    if slot.is_null() || message.is_null() {
        return;
    }
    // SAFETY: `slot` is the boxed mutex of a living device (the callback is removed before it is dropped) and
    // `message` a C string that lives for the call.
    let (slot, message) = unsafe { (&*slot.cast::<Mutex<Option<String>>>(), CStr::from_ptr(message)) };
    // A poisoned lock would mean a panic in a one-line critical section; keep what is there.
    let mut first = slot.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    first.get_or_insert_with(|| message.to_string_lossy().into_owned());
}

/// Called by Embree before it allocates memory and after it frees memory, from any thread.
extern "C" fn count_bytes(slot: *mut c_void, bytes: isize, _post: bool) -> bool {
    if !slot.is_null() {
        // SAFETY: the boxed counter of a living device, which outlives the library's use of it.
        unsafe { &*slot.cast::<AtomicI64>() }.fetch_add(bytes as i64, Ordering::Relaxed);
    }
    true
}

impl Device {
    /// A device as from [`Self::new`] that counts the memory of the library ([`Self::memory_bytes`]), for measurements.
    ///
    /// # Errors
    /// As for [`Self::new`].
    pub fn counting_memory(threads: usize) -> Result<Self, EmbreeError> {
        Self::counting_memory_with(threads, None)
    }

    /// The same with this instruction set, where there is one, in place of that of the environment.
    ///
    /// # Errors
    /// As for [`Self::new`].
    pub fn counting_memory_with(threads: usize, isa: Option<Isa>) -> Result<Self, EmbreeError> {
        let mut device = Self::with_isa(threads, isa.map_or_else(Isa::from_environment, Ok)?)?;
        let bytes = Box::new(AtomicI64::new(0));
        let slot = std::ptr::from_ref::<AtomicI64>(&bytes).cast_mut().cast::<c_void>();
        // SAFETY: `slot` stays valid as long as the device.
        unsafe { sys::rtcSetDeviceMemoryMonitorFunction(device.handle, Some(count_bytes), slot) };
        device.bytes = Some(bytes);
        Ok(device)
    }

    /// The instruction set of its kernels.
    pub fn isa(&self) -> Isa {
        self.isa
    }

    /// Bytes that the library holds for the scenes of a device from [`Self::counting_memory`]; `None` for other devices. Buffers that it
    /// reads in place are not included.
    pub fn memory_bytes(&self) -> Option<u64> {
        self.bytes.as_ref().map(|bytes| bytes.load(Ordering::Relaxed).max(0) as u64)
    }

    /// A device that builds with at most `threads` threads; 0 means one per core. Its kernels use the instruction set of
    /// [`Isa::from_environment`].
    ///
    /// # Errors
    /// If Embree cannot start, if its version is too old for the layouts of the bindings, or if the instruction set is not available.
    pub fn new(threads: usize) -> Result<Self, EmbreeError> {
        Self::with_isa(threads, Isa::from_environment()?)
    }

    fn with_isa(threads: usize, isa: Isa) -> Result<Self, EmbreeError> {
        let choice = if isa == Isa::Best { String::new() } else { format!(",isa={}", isa.name()) };
        let config = CString::new(format!("threads={threads}{choice}")).unwrap_or_default();
        // SAFETY: a NUL-terminated configuration string that lives for the call.
        let handle = unsafe { sys::rtcNewDevice(config.as_ptr()) };
        if handle.is_null() {
            return Err(EmbreeError::NoDevice("rtcNewDevice returned nothing".into()));
        }
        // SAFETY: a valid device; version is a read-only property.
        let number = unsafe { sys::rtcGetDeviceProperty(handle, sys::RTC_DEVICE_PROPERTY_VERSION) };
        let number = u32::try_from(number).unwrap_or(0);
        let needed = OLDEST.max(sys::RTC_VERSION);
        let version = LibraryVersion::from_number(number);
        if number < needed {
            // SAFETY: the only reference to the device.
            unsafe { sys::rtcReleaseDevice(handle) };
            return Err(EmbreeError::Version { found: version, needed: LibraryVersion::from_number(needed) });
        }
        let error = Box::new(Mutex::new(None));
        let slot = std::ptr::from_ref::<Mutex<Option<String>>>(&error).cast_mut().cast::<c_void>();
        // SAFETY: `slot` stays valid until `drop`, which removes the callback first.
        unsafe { sys::rtcSetDeviceErrorFunction(handle, Some(record_error), slot) };
        let isa = if isa == Isa::Best { Isa::detected() } else { isa };
        Ok(Self { handle, error, bytes: None, version, isa })
    }

    /// Version of the library in use.
    pub fn version(&self) -> LibraryVersion {
        self.version
    }

    /// Whether the library was built with filter functions.
    pub(super) fn has_filters(&self) -> bool {
        // SAFETY: a valid device; a read-only property.
        let supported = unsafe {
            sys::rtcGetDeviceProperty(self.handle, sys::RTC_DEVICE_PROPERTY_FILTER_FUNCTION_SUPPORTED)
        };
        supported != 0
    }

    pub(super) fn handle(&self) -> sys::RTCDevice {
        self.handle
    }

    /// Returns an error that Embree recorded since the last call, as [`EmbreeError::Call`].
    pub(super) fn check(&self, action: &'static str) -> Result<(), EmbreeError> {
        let recorded = self.error.lock().unwrap_or_else(std::sync::PoisonError::into_inner).take();
        match recorded {
            None => Ok(()),
            Some(message) => Err(EmbreeError::Call { action, message }),
        }
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        // SAFETY: the callback is removed before its slot is freed; scenes hold an `Arc` of the device, so none is
        // left.
        unsafe {
            sys::rtcSetDeviceErrorFunction(self.handle, None, std::ptr::null_mut());
            // The memory counter stays set: its box is dropped after the device.
            sys::rtcReleaseDevice(self.handle);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instruction_sets_are_asked_for_by_name() {
        assert_eq!(Isa::from_name("").unwrap(), Isa::Best);
        for name in ["sse4", "AVX2", "avx1024", "isa=avx2"] {
            let error = Isa::from_name(name).unwrap_err();
            assert_eq!(error, EmbreeError::InstructionSet(name.to_owned()));
            assert!(error.to_string().contains("sse4.2, avx2, avx512"), "{error}");
        }
    }

    #[test]
    fn version_is_at_least_4_3() {
        let device = Device::new(1).unwrap();
        assert!(device.version().parts >= (4, 3, 0));
    }
}
