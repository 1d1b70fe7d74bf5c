//! The present of the station, and everybody who watches it.
//!
//! The board is sent whole when it changes, samples as they come. The channel to the watchers is bounded: one who falls behind is
//! sent the present anew and has lost pictures, never the station a sample.

use std::sync::{Mutex, MutexGuard, PoisonError};

use axum::body::Bytes;
use tokio::sync::broadcast;

use super::board::Board;
use super::frame::{self, Point};
use crate::runner::Glance;

/// Events that a watcher may fall behind: some two seconds of four busy sites.
const BEHIND: usize = 512;
/// Points of a run that a watcher who comes late is sent at most.
const CAUGHT_UP: usize = 6000;
/// Points of a run that are kept; a longer run is thinned out to half, so that its whole course stays visible.
const KEPT: usize = 120_000;

/// An event as it goes over the wire.
pub(super) type Event = Bytes;

/// The present of the station.
pub struct Hub {
    inner: Mutex<Inner>,
    watchers: broadcast::Sender<Event>,
}

struct Inner {
    board: Board,
    runs: Vec<Course>,
}

/// What was seen of the present or last run at a site.
#[derive(Default)]
struct Course {
    run: u64,
    points: Vec<Point>,
    stride: usize,
    seen: usize,
}

impl Course {
    fn add(&mut self, points: &[Point]) {
        for point in points {
            if self.seen.is_multiple_of(self.stride.max(1)) {
                self.points.push(*point);
            }
            self.seen += 1;
        }
        if self.points.len() > KEPT {
            let mut k = 0;
            self.points.retain(|_| {
                k += 1;
                k % 2 == 1
            });
            self.stride = self.stride.max(1) * 2;
        }
    }
}

impl Hub {
    /// A hub that shows `board`.
    pub fn new(board: Board) -> Self {
        let runs = board.sites.iter().map(|_| Course::default()).collect();
        Self { inner: Mutex::new(Inner { board, runs }), watchers: broadcast::Sender::new(BEHIND) }
    }

    /// Changes the board and shows it.
    pub fn change<T>(&self, change: impl FnOnce(&mut Board) -> T) -> T {
        let mut inner = self.lock();
        let given = change(&mut inner.board);
        // Sent under the lock: whoever joins in between sees each change once.
        let _ = self.watchers.send(event("board", &json(&inner.board)));
        given
    }

    /// Reads the board.
    pub fn read<T>(&self, read: impl FnOnce(&Board) -> T) -> T {
        read(&self.lock().board)
    }

    /// Shows samples of a run.
    pub fn samples(&self, site: usize, run: u64, glances: &[Glance]) {
        if glances.is_empty() {
            return;
        }
        let points: Vec<Point> = glances.iter().map(Point::from).collect();
        let mut inner = self.lock();
        let Some(course) = inner.runs.get_mut(site) else { return };
        if course.run != run {
            *course = Course { run, ..Course::default() };
        }
        course.add(&points);
        if self.watchers.receiver_count() > 0 {
            let _ = self.watchers.send(event("samples", &frame::json(site, run, &points)));
        }
    }

    /// Shows something that stands for itself.
    pub fn tell(&self, name: &str, value: &serde_json::Value) {
        let _ = self.watchers.send(event(name, &value.to_string()));
    }

    /// Begins to watch: what is the case now, and everything from now on.
    pub(super) fn join(&self) -> (Vec<Event>, broadcast::Receiver<Event>) {
        let inner = self.lock();
        let receiver = self.watchers.subscribe();
        let mut now = vec![event("board", &json(&inner.board))];
        for (site, course) in inner.runs.iter().enumerate().filter(|(_, c)| !c.points.is_empty()) {
            let step = course.points.len().div_ceil(CAUGHT_UP).max(1);
            let points: Vec<Point> = course.points.iter().step_by(step).copied().collect();
            now.push(event("course", &frame::json(site, course.run, &points)));
        }
        (now, receiver)
    }

    /// How many watch.
    pub(super) fn watchers(&self) -> usize {
        self.watchers.receiver_count()
    }

    /// A thread that panicked leaves the board as it was between two changes.
    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn json(board: &Board) -> String {
    serde_json::to_string(board).unwrap_or_default()
}

/// One event of the stream. JSON holds no line end, so one `data` line carries it.
pub(super) fn event(name: &str, data: &str) -> Event {
    format!("event: {name}\ndata: {data}\n\n").into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::Quality;
    use crate::station::SiteCard;

    fn glance(sample: usize) -> Glance {
        Glance {
            sample,
            samples: 100,
            phase: 0,
            time_s: sample as f64 * 0.01,
            target_bar: 1.0,
            pressure_bar: 1.0,
            current_a: 0.1,
            current_meas_a: 0.1,
            quality: Quality::Good,
            lateness_s: 0.0,
        }
    }

    fn hub() -> Hub {
        Hub::new(Board { sites: vec![SiteCard::default()], ..Board::default() })
    }

    #[test]
    fn whoever_comes_late_sees_the_whole_course_and_every_sample_after_it_once() {
        let hub = hub();
        hub.samples(0, 1, &[glance(1), glance(2)]);
        let (now, mut receiver) = hub.join();
        hub.samples(0, 1, &[glance(3)]);
        let text = |e: &Event| String::from_utf8(e.to_vec()).unwrap();
        assert!(text(&now[1]).contains("\"n\":[1,2]"));
        assert!(text(&receiver.try_recv().unwrap()).contains("\"n\":[3]"));
        hub.samples(0, 2, &[glance(1)]);
        assert!(text(&hub.join().0[1]).contains("\"r\":2,\"n\":[1]"), "a new run begins a new course");
    }

    #[test]
    fn a_watcher_who_falls_behind_holds_nobody_up() {
        let hub = hub();
        let (_, mut receiver) = hub.join();
        for k in 0..10 * BEHIND {
            hub.samples(0, 1, &[glance(k + 1)]);
        }
        assert!(matches!(receiver.try_recv(), Err(broadcast::error::TryRecvError::Lagged(_))));
        let caught_up = hub.join().0;
        assert!(String::from_utf8(caught_up[1].to_vec()).unwrap().contains(&format!("{}]", 10 * BEHIND)) || caught_up.len() == 2);
    }

    #[test]
    fn a_course_keeps_its_whole_length_in_bounded_memory() {
        let mut course = Course::default();
        let points: Vec<Point> = (0..3 * KEPT).map(|k| Point::from(&glance(k))).collect();
        points.chunks(100).for_each(|c| course.add(c));
        assert!(course.points.len() <= KEPT);
        assert!((course.points.first().unwrap().sample, course.points.last().unwrap().sample + 10 > 3 * KEPT) == (0, true));
    }
}
