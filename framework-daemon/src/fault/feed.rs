//! The fault manager's newest lines, for whoever lists or follows them. Bounded: who reads too slowly is told how many lines
//! went by.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use serde_json::{Map, Value};

use crate::model::limits::FEED_LINES;

/// A line of the journal.
pub type Line = Arc<Map<String, Value>>;

/// Called when a line came that somebody waits for; must not wait.
pub type Wake = Box<dyn Fn() + Send + Sync>;

/// The newest lines. Written by the fault manager, read by anybody.
#[derive(Default)]
pub struct Feed {
    // Held for a few instructions by ordinary threads; no executor knows it.
    ring: Mutex<Ring>,
    awaited: AtomicBool,
    wake: OnceLock<Wake>,
}

#[derive(Default)]
struct Ring {
    lines: VecDeque<Line>,
    /// Number of the oldest line that is kept; they are counted from 0.
    first: u64,
}

impl Ring {
    fn end(&self) -> u64 {
        self.first + self.lines.len() as u64
    }
}

/// How far a reader has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cursor(u64);

/// What a reader gets.
#[derive(Clone, Debug, PartialEq)]
pub enum Next {
    /// The next line.
    Line(Line),
    /// That many lines went by unread.
    Missed(u64),
}

impl Feed {
    /// Sets who is told of lines that somebody waits for; once.
    pub fn on_line(&self, wake: Wake) {
        let _ = self.wake.set(wake);
    }

    /// Adds a line; the oldest makes room.
    pub fn push(&self, line: Map<String, Value>) {
        let line = Arc::new(line);
        let oldest = self.with(|ring| {
            ring.lines.push_back(line);
            if ring.lines.len() <= FEED_LINES {
                return None;
            }
            ring.first += 1;
            ring.lines.pop_front()
        });
        drop(oldest);
        if self.awaited.swap(false, Ordering::SeqCst)
            && let Some(wake) = self.wake.get()
        {
            wake();
        }
    }

    /// A reader who begins with the newest `last` lines that are wanted; fewer where fewer are kept.
    #[must_use]
    pub fn cursor(&self, last: usize, wanted: impl Fn(&Line) -> bool) -> Cursor {
        let (lines, first) = self.with(|ring| (ring.lines.clone(), ring.first));
        let places = (first..).zip(&lines).filter(|(_, line)| wanted(line)).map(|(place, _)| place);
        let places: Vec<u64> = places.collect();
        let end = first + lines.len() as u64;
        let skipped = places.len().saturating_sub(last);
        Cursor(if last == 0 { end } else { places.get(skipped).copied().unwrap_or(end) })
    }

    /// True when a line is kept that is wanted.
    #[must_use]
    pub fn any(&self, wanted: impl Fn(&Line) -> bool) -> bool {
        self.with(|ring| ring.lines.clone()).iter().any(wanted)
    }

    /// What comes next; `None`: nothing yet.
    #[must_use]
    pub fn next(&self, cursor: &mut Cursor) -> Option<Next> {
        self.with(|ring| {
            let missed = ring.first.saturating_sub(cursor.0);
            if missed > 0 {
                cursor.0 = ring.first;
                return Some(Next::Missed(missed));
            }
            let line = ring.lines.get(usize::try_from(cursor.0 - ring.first).ok()?)?;
            cursor.0 += 1;
            Some(Next::Line(Arc::clone(line)))
        })
    }

    /// Asks to be woken by the next line; true: there is one already that this reader has not seen.
    #[must_use]
    pub fn await_line(&self, cursor: Cursor) -> bool {
        self.awaited.store(true, Ordering::SeqCst);
        self.with(|ring| ring.end()) > cursor.0
    }

    fn with<R>(&self, work: impl FnOnce(&mut Ring) -> R) -> R {
        work(&mut self.ring.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl std::fmt::Debug for Feed {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (kept, first) = self.with(|ring| (ring.lines.len(), ring.first));
        formatter.debug_struct("Feed").field("kept", &kept).field("first", &first).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicU32;

    use proptest::prelude::*;

    use super::*;

    fn line(number: u64) -> Map<String, Value> {
        Map::from_iter([("seq".into(), number.into())])
    }

    fn number(line: &Line) -> u64 {
        line["seq"].as_u64().unwrap()
    }

    #[test]
    fn a_reader_begins_with_the_newest_lines_that_it_wants() {
        let feed = Feed::default();
        (0..10).for_each(|each| feed.push(line(each)));
        let begin = |last, wanted: fn(&Line) -> bool| {
            let mut cursor = feed.cursor(last, wanted);
            feed.next(&mut cursor)
        };
        assert_eq!(begin(0, |_| true), None);
        assert_eq!(begin(3, |_| true), Some(Next::Line(Arc::new(line(7)))));
        assert_eq!(begin(2, |line| number(line).is_multiple_of(3)), Some(Next::Line(Arc::new(line(6)))));
        assert_eq!(begin(100, |_| true), Some(Next::Line(Arc::new(line(0)))));
        assert_eq!(begin(100, |_| false), None);
    }

    #[test]
    fn a_reader_is_woken_once_by_the_line_it_waits_for() {
        let (feed, woken) = (Feed::default(), Arc::new(AtomicU32::new(0)));
        let count = Arc::clone(&woken);
        feed.on_line(Box::new(move || _ = count.fetch_add(1, Ordering::SeqCst)));
        feed.push(line(0));
        assert_eq!(woken.load(Ordering::SeqCst), 0, "nobody waited");
        let cursor = feed.cursor(0, |_| true);
        assert!(!feed.await_line(cursor));
        feed.push(line(1));
        feed.push(line(2));
        assert_eq!(woken.load(Ordering::SeqCst), 1);
        assert!(feed.await_line(cursor), "a line that came before it waited is not slept over");
    }

    proptest! {
        /// Whenever a reader looks: every line once and in order, or counted as missed.
        #[test]
        fn nothing_is_lost_unsaid(steps in prop::collection::vec((0..700u64, 0..500usize), 1..12)) {
            let (feed, mut written, mut seen) = (Feed::default(), 0, 0);
            let mut cursor = feed.cursor(0, |_| true);
            for (writes, reads) in steps {
                for _ in 0..writes {
                    feed.push(line(written));
                    written += 1;
                }
                for _ in 0..reads {
                    match feed.next(&mut cursor) {
                        Some(Next::Line(line)) => {
                            prop_assert_eq!(number(&line), seen);
                            seen += 1;
                        }
                        Some(Next::Missed(count)) => {
                            prop_assert!(written - seen > FEED_LINES as u64);
                            seen += count;
                        }
                        None => prop_assert_eq!(seen, written),
                    }
                }
            }
        }
    }
}
