//! The rows of a file taken apart into runs, and the way back from a sample to its row.

use super::source::{Places, Rows};
use super::{Channel, Run};

/// Rows of one run, still unchecked.
pub(super) struct Part {
    pub name: Option<String>,
    /// Ranges of rows, in order.
    pub rows: Vec<(usize, usize)>,
    pub run: Run,
}

/// From a sample of a run back to its row in the file.
pub(super) struct Index<'a> {
    /// Ranges of rows, in order.
    pub rows: Vec<(usize, usize)>,
    pub places: &'a Places,
}

impl<'a> Index<'a> {
    pub fn row(&self, mut sample: usize) -> usize {
        for &(from, to) in &self.rows {
            if sample < to - from {
                return from + sample;
            }
            sample -= to - from;
        }
        self.rows.last().map_or(0, |r| r.1.saturating_sub(1))
    }
    pub fn place(&self, sample: usize) -> String {
        self.places.of(self.row(sample))
    }
    /// The index after the samples that `keep` marks with false were dropped; `None` keeps all.
    pub fn kept(self, keep: Option<Vec<bool>>) -> Self {
        let Some(keep) = keep else { return self };
        let mut rows: Vec<(usize, usize)> = Vec::new();
        let of_samples = self.rows.iter().flat_map(|&(from, to)| from..to);
        for (row, _) in of_samples.zip(keep).filter(|k| k.1) {
            match rows.last_mut() {
                Some(last) if last.1 == row => last.1 += 1,
                _ => rows.push((row, row + 1)),
            }
        }
        Self { rows, ..self }
    }
    pub fn split_off(&mut self, sample: usize) -> Index<'a> {
        let (mut left, mut right, mut seen) = (Vec::new(), Vec::new(), 0);
        for &(from, to) in &self.rows {
            let cut = (from + sample.saturating_sub(seen)).min(to);
            seen += to - from;
            left.extend((cut > from).then_some((from, cut)));
            right.extend((to > cut).then_some((cut, to)));
        }
        self.rows = left;
        Index { rows: right, places: self.places }
    }
}

/// Takes the rows apart into the runs that the `run` column names; a name that comes back goes on with its run.
pub(super) fn parts(rows: &mut Rows) -> Vec<Part> {
    let total = rows.time_s.len();
    if rows.segments.len() <= 1 {
        let name = rows.segments.pop().and_then(|s| s.0);
        let mut run = Run { time_s: std::mem::take(&mut rows.time_s), ..Run::default() };
        for channel in Channel::ALL {
            run.set(channel, rows.channels[channel.index()].take());
        }
        return vec![Part { name, rows: vec![(0, total)], run }];
    }
    let mut order: std::collections::HashMap<&Option<String>, usize> = std::collections::HashMap::new();
    let mut parts: Vec<Part> = Vec::new();
    for (at, (name, from)) in rows.segments.iter().enumerate() {
        let to = rows.segments.get(at + 1).map_or(total, |s| s.1);
        let part = *order.entry(name).or_insert_with(|| {
            parts.push(Part { name: name.clone(), rows: Vec::new(), run: Run::default() });
            parts.len() - 1
        });
        parts[part].rows.push((*from, to));
    }
    // Column by column, so that at most one column is there twice.
    let gather = |all: &[f64], ranges: &[(usize, usize)]| {
        let mut values = Vec::with_capacity(ranges.iter().map(|r| r.1 - r.0).sum());
        ranges.iter().for_each(|&(from, to)| values.extend_from_slice(&all[from..to]));
        values
    };
    let time_s = std::mem::take(&mut rows.time_s);
    parts.iter_mut().for_each(|p| p.run.time_s = gather(&time_s, &p.rows));
    drop(time_s);
    for channel in Channel::ALL {
        let Some(all) = rows.channels[channel.index()].take() else { continue };
        parts.iter_mut().for_each(|p| p.run.set(channel, Some(gather(&all, &p.rows))));
    }
    parts
}
