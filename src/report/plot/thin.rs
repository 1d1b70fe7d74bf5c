//! Thins a long trace to what a screen can show, without losing its extremes.

use std::collections::HashSet;

/// Width of the plot area in whole coordinates.
pub(super) const WIDTH: i32 = 20_000;
/// Height of the plot area in whole coordinates: a stretch of a thousandth of the height can be looked at alone.
pub(super) const HEIGHT: i32 = 100_000;
/// Pixel columns that are told apart; more than a screen has, so that a reader can zoom in.
const COLUMNS: i32 = 2_400;

/// A point in whole coordinates; `None` is a gap in the line.
pub(super) type Point = Option<(i32, i32)>;

/// Points of a loop above which it is not drawn twice over itself.
const CROWDED: usize = 10_000;

/// Keeps the first, lowest, highest and last point of every pixel column of a trace whose x never falls.
/// Any other trace (a loop) loses the points that lie within a third of a pixel of the one before, and, where many
/// are left, the strokes over places that are drawn already: a day of samples makes no larger page than an hour.
pub(super) fn thin(points: &[Point]) -> Vec<Point> {
    let solid: Vec<(i32, i32)> = points.iter().flatten().copied().collect();
    if solid.len() <= COLUMNS as usize {
        return points.to_vec();
    }
    if solid.windows(2).all(|w| w[0].0 <= w[1].0) {
        return by_column(points);
    }
    let kept = by_distance(points);
    if kept.len() <= CROWDED { kept } else { not_twice(&kept) }
}

fn by_column(points: &[Point]) -> Vec<Point> {
    let mut kept = Vec::new();
    let mut column: Vec<(i32, i32)> = Vec::new();
    let flush = |column: &mut Vec<(i32, i32)>, kept: &mut Vec<Point>| {
        let extreme =
            |best: fn(i32, i32) -> bool| (0..column.len()).reduce(|a, b| if best(column[b].1, column[a].1) { b } else { a }).unwrap_or(0);
        if let Some(last) = column.len().checked_sub(1) {
            let mut indices = [0, extreme(|new, old| new < old), extreme(|new, old| new > old), last];
            indices.sort_unstable();
            let mut previous = usize::MAX;
            for index in indices {
                if index != previous {
                    kept.push(Some(column[index]));
                }
                previous = index;
            }
        }
        column.clear();
    };
    for point in points {
        match point {
            None => {
                flush(&mut column, &mut kept);
                if kept.last().is_some_and(Option::is_some) {
                    kept.push(None);
                }
            }
            Some(point) => {
                let place = |x: i32| i64::from(x) * i64::from(COLUMNS) / i64::from(WIDTH);
                if column.last().is_some_and(|last| place(last.0) != place(point.0)) {
                    flush(&mut column, &mut kept);
                }
                column.push(*point);
            }
        }
    }
    flush(&mut column, &mut kept);
    kept
}

fn by_distance(points: &[Point]) -> Vec<Point> {
    const NEAR: i32 = WIDTH / COLUMNS;
    // The coordinates are finer upwards than the screen is.
    const NEAR_Y: i32 = HEIGHT / (COLUMNS / 2);
    let mut kept: Vec<Point> = Vec::new();
    let mut skipped: Option<(i32, i32)> = None;
    for point in points {
        match (point, kept.last().copied().flatten()) {
            (Some(new), Some(last)) if (new.0 - last.0).abs() < NEAR && (new.1 - last.1).abs() < NEAR_Y => skipped = Some(*new),
            (Some(_), _) => {
                kept.push(*point);
                skipped = None;
            }
            (None, Some(_)) => {
                kept.extend(skipped.take().map(Some));
                kept.push(None);
            }
            (None, None) => {}
        }
    }
    kept.extend(skipped.map(Some));
    kept
}

/// Leaves out the strokes that end on a spot where a stroke ended before, unless they are the first between two
/// spots that lie apart.
fn not_twice(points: &[Point]) -> Vec<Point> {
    // Half a pixel of a figure that takes half the page.
    const SPOT: i32 = 2 * WIDTH / COLUMNS;
    const SPOT_Y: i32 = 2 * HEIGHT / (COLUMNS / 2);
    let spot = |p: (i32, i32)| (p.0 / SPOT, p.1 / SPOT_Y);
    let (mut spots, mut strokes) = (HashSet::new(), HashSet::new());
    let (mut kept, mut pen, mut before): (Vec<Point>, Point, Point) = (Vec::new(), None, None);
    for point in points {
        let (Some(from), Some(to)) = (before, *point) else {
            // The begin of a line, or a gap in it.
            before = *point;
            spots.extend(point.map(spot));
            continue;
        };
        before = *point;
        let (a, b) = (spot(from), spot(to));
        let near = (a.0 - b.0).abs().max((a.1 - b.1).abs()) <= 1;
        let new_spot = spots.insert(b);
        let new_stroke = !near && strokes.insert((a.min(b), a.max(b)));
        if !(new_spot || new_stroke) {
            continue;
        }
        if pen != Some(from) {
            if !kept.is_empty() {
                kept.push(None);
            }
            kept.push(Some(from));
        }
        kept.push(Some(to));
        pen = Some(to);
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_single_spike_survives() {
        let points: Vec<Point> = (0..80_000).map(|n| Some((n / 4, if n == 41_234 { 90_000 } else { 1_000 + n % 3 }))).collect();
        let thinned = thin(&points);
        assert!(thinned.len() <= 4 * COLUMNS as usize, "{}", thinned.len());
        assert!(thinned.contains(&points[41_234]));
        assert_eq!((thinned.first(), thinned.last()), (points.first(), points.last()));
    }

    #[test]
    fn a_gap_stays_a_gap() {
        let points: Vec<Point> = (0..10_000).map(|n| if (4_000..5_000).contains(&n) { None } else { Some((2 * n, n % 70)) }).collect();
        assert_eq!(thin(&points).iter().filter(|p| p.is_none()).count(), 1);
    }

    #[test]
    fn a_loop_that_is_run_through_again_and_again_is_drawn_once() {
        let turn = |n: i32| f64::from(n % 3600).to_radians() / 10.0;
        let ring = |n: i32| Some((10_000 + (9_000.0 * turn(n).cos()) as i32, 50_000 + (40_000.0 * turn(n).sin()) as i32));
        let (once, often) = (thin(&(0..3_600).map(ring).collect::<Vec<_>>()), thin(&(0..360_000).map(ring).collect::<Vec<_>>()));
        assert!(often.len() * 4 <= once.len() * 5, "{} {}", often.len(), once.len());
        // A jump between two places is drawn, and once.
        let jumps: Vec<Point> = (0..40_000).map(|n| Some(if n % 2 == 0 { (100, 100) } else { (9_000, 5_000) })).collect();
        assert_eq!(thin(&jumps), vec![jumps[0], jumps[1]]);
    }

    #[test]
    fn a_loop_keeps_its_shape() {
        let circle = |n: i32| {
            (10_000 + (9_000.0 * f64::from(n).to_radians().cos()) as i32, 50_000 + (40_000.0 * f64::from(n).to_radians().sin()) as i32)
        };
        let points: Vec<Point> = (0..36_000).map(|n| Some(circle(n / 100))).collect();
        let thinned = thin(&points);
        // One point per degree, and the very last one again.
        assert_eq!(thinned.len(), 361);
    }
}
