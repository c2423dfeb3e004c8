//! Memory of the machine and of this process.

use serde::Serialize;

/// Memory of the process, in bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Resident {
    /// Resident at that moment.
    pub resident: u64,
    /// Peak up to that moment.
    pub peak: u64,
}

/// Bytes that the system can give without swapping: what Linux calls available, or less where the process is in a control group
/// with a limit. `None` where the system does not report it.
pub(crate) fn available_memory() -> Option<u64> {
    let read = |path: &str| std::fs::read_to_string(path).ok();
    let system = read("/proc/meminfo").and_then(|text| kilobytes(&text, "MemAvailable:"))?;
    let number = |path: &str| read(path)?.trim().parse::<u64>().ok();
    let group = number("/sys/fs/cgroup/memory.max")
        .zip(number("/sys/fs/cgroup/memory.current"))
        .map(|(limit, used)| limit.saturating_sub(used));
    Some(group.map_or(system, |group| group.min(system)))
}

/// Resident memory of this process: now and at its peak. `None` where the system does not report it.
pub(crate) fn resident_memory() -> Option<Resident> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    Some(Resident { resident: kilobytes(&text, "VmRSS:")?, peak: kilobytes(&text, "VmHWM:")? })
}

/// The number of bytes on the line of `/proc/meminfo` that begins with `key`.
fn kilobytes(text: &str, key: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(key))?;
    line.split_whitespace().next()?.parse::<u64>().ok()?.checked_mul(1024)
}

/// Bytes that may be used: the limit of the user, or the free memory of the machine. `None` where the system does not report it.
pub fn allowed_memory(limit: Option<u64>) -> Option<u64> {
    limit.or_else(free_memory)
}

/// Free memory of the machine plus the memory that this process already has, because estimates count from zero.
pub(super) fn free_memory() -> Option<u64> {
    let own = resident_memory().map_or(0, |memory| memory.resident);
    available_memory().map(|free| free.saturating_add(own))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn this_process_is_in_memory() {
        // Must not be optimised away.
        let held = std::hint::black_box(vec![1u8; 50_000_000]);
        let Some(found) = resident_memory() else {
            println!("skipped: the system does not tell");
            return;
        };
        assert!(found.resident > held.len() as u64 && found.peak >= found.resident, "{found:?}");
    }

    #[test]
    fn meminfo_is_read() {
        let text = "MemTotal:       8000000 kB\nMemAvailable:    4000 kB\n";
        assert_eq!(kilobytes(text, "MemAvailable:"), Some(4_096_000));
        assert_eq!(kilobytes(text, "Swap:"), None);
        assert_eq!(kilobytes("MemAvailable: what\n", "MemAvailable:"), None);
    }
}
