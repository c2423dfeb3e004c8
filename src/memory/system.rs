//! What the machine and this process have of memory.

use serde::Serialize;

/// Bytes of the process.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Resident {
    /// In memory at that moment.
    pub resident: u64,
    /// At most up to that moment.
    pub peak: u64,
}

/// Bytes that the system would give without swapping: what Linux calls available, or less where the process is in a
/// control group with a limit. `None` where the system does not tell.
pub(crate) fn available_memory() -> Option<u64> {
    let read = |path: &str| std::fs::read_to_string(path).ok();
    let system = read("/proc/meminfo").and_then(|text| kilobytes(&text, "MemAvailable:"))?;
    let number = |path: &str| read(path)?.trim().parse::<u64>().ok();
    let group = number("/sys/fs/cgroup/memory.max")
        .zip(number("/sys/fs/cgroup/memory.current"))
        .map(|(limit, used)| limit.saturating_sub(used));
    Some(group.map_or(system, |group| group.min(system)))
}

/// Bytes of this process in memory: now, and at most so far. `None` where the system does not tell.
pub(crate) fn resident_memory() -> Option<Resident> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    Some(Resident { resident: kilobytes(&text, "VmRSS:")?, peak: kilobytes(&text, "VmHWM:")? })
}

/// The number of bytes on the line of `/proc/meminfo` that begins with `key`.
fn kilobytes(text: &str, key: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(key))?;
    line.split_whitespace().next()?.parse::<u64>().ok()?.checked_mul(1024)
}

/// Bytes that may be taken: as somebody set it, or what the machine has free. `None` where the system does not tell.
pub fn allowed_memory(limit: Option<u64>) -> Option<u64> {
    limit.or_else(free_memory)
}

/// What the machine has free, and what this process has of it already: estimates count from nothing.
pub(super) fn free_memory() -> Option<u64> {
    let own = resident_memory().map_or(0, |memory| memory.resident);
    available_memory().map(|free| free.saturating_add(own))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn this_process_is_in_memory() {
        // Not optimised away.
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
