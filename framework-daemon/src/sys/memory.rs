//! Pages that a recovery needs are in memory before it needs them: everything is locked where that is permitted, the
//! code of plugins is read in when they are loaded. An idle standby whose pages were reclaimed costs milliseconds.
#![allow(unsafe_code, reason = "address of unsafe: system calls that say which pages stay")]

use std::ops::Range;

/// Number of `CAP_IPC_LOCK`.
const IPC_LOCK: u32 = 14;

/// Keeps every page of the process in memory from its first use on, also those of later mappings.
///
/// # Errors
/// In words, when that is not permitted. Then nothing is locked: under a limit, later mappings would fail.
pub fn lock_all() -> Result<(), String> {
    let refused = |reason: &str| {
        format!(
            "memory is not locked ({reason}): under memory pressure a standby may have to be read in again, which takes \
             milliseconds; grant CAP_IPC_LOCK or raise `ulimit -l` to unlimited (systemd: LimitMEMLOCK=infinity)"
        )
    };
    if !is_permitted(&std::fs::read_to_string("/proc/self/status").unwrap_or_default(), limit()) {
        return Err(refused("not permitted"));
    }
    // SAFETY: no memory is passed.
    let result = unsafe { libc::mlockall(libc::MCL_CURRENT | libc::MCL_FUTURE | libc::MCL_ONFAULT) };
    if result == 0 { Ok(()) } else { Err(refused(&std::io::Error::last_os_error().to_string())) }
}

/// The limit on locked memory; `None`: there is none.
fn limit() -> Option<u64> {
    let mut limit = libc::rlimit { rlim_cur: 0, rlim_max: 0 };
    // SAFETY: `limit` is a valid place for the result.
    let result = unsafe { libc::getrlimit(libc::RLIMIT_MEMLOCK, &raw mut limit) };
    (result != 0 || limit.rlim_cur != libc::RLIM_INFINITY).then_some(limit.rlim_cur)
}

fn is_permitted(status: &str, limit: Option<u64>) -> bool {
    let effective = status.lines().find_map(|line| line.strip_prefix("CapEff:"));
    let effective = effective.and_then(|hex| u64::from_str_radix(hex.trim(), 16).ok()).unwrap_or(0);
    limit.is_none() || effective & (1 << IPC_LOCK) != 0
}

/// Reads in all mappings of the file that is mapped at `address`, and keeps them as far as the limit on locked memory
/// goes. What the system refuses is read in when it is used.
pub fn read_in(address: usize) {
    for range in mappings(&std::fs::read_to_string("/proc/self/maps").unwrap_or_default(), address) {
        let (start, len) = (std::ptr::with_exposed_provenance_mut::<libc::c_void>(range.start), range.len());
        // SAFETY: neither call changes what the pages hold; a range that is not there any more is refused.
        unsafe {
            libc::madvise(start, len, libc::MADV_POPULATE_READ);
            libc::syscall(libc::SYS_mlock2, start, len, libc::MLOCK_ONFAULT);
        }
    }
}

/// The readable mappings of the file that is mapped at `address`.
fn mappings(maps: &str, address: usize) -> Vec<Range<usize>> {
    let lines: Vec<_> = maps.lines().filter_map(mapping).collect();
    let file = lines.iter().find(|(range, _, _)| range.contains(&address)).map(|(_, _, file)| *file);
    let same = lines.iter().filter(|(_, mode, other)| Some(*other) == file && mode.starts_with('r'));
    same.map(|(range, _, _)| range.clone()).collect()
}

/// `start-end mode offset device inode path`: addresses, mode, inode.
fn mapping(line: &str) -> Option<(Range<usize>, &str, &str)> {
    let mut fields = line.split_ascii_whitespace();
    let (start, end) = fields.next()?.split_once('-')?;
    let hex = |text| usize::from_str_radix(text, 16).ok();
    let (mode, inode) = (fields.next()?, fields.nth(2)?);
    (inode != "0").then_some((hex(start)?..hex(end)?, mode, inode))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn locking_all_needs_the_capability_or_no_limit() {
        let status = |caps: &str| format!("Name:\tx\nCapEff:\t{caps}\n");
        assert!(is_permitted(&status("0000000000004000"), Some(65_536)));
        assert!(is_permitted(&status("0000000000000000"), None));
        assert!(!is_permitted(&status("0000000000003fff"), Some(65_536)));
        assert!(!is_permitted("", Some(0)));
    }

    #[test]
    fn all_mappings_of_one_file_are_found() {
        let maps = "1000-2000 r--p 00000000 00:01 77 /memfd:a (deleted)\n2000-3000 r-xp 00001000 00:01 77 /memfd:a (deleted)\n\
                    3000-4000 ---p 00002000 00:01 77 /memfd:a (deleted)\n5000-6000 r-xp 00000000 00:01 78 /lib/b\n\
                    7000-8000 rw-p 00000000 00:00 0\n";
        assert_eq!(mappings(maps, 0x2010), [0x1000..0x2000, 0x2000..0x3000]);
        assert!(mappings(maps, 0x7010).is_empty());
    }
}
