//! Draws a figure: an SVG that stretches with the page, and tick labels in HTML that do not.

use std::fmt::Write as _;

use maud::{Markup, html};

use super::axis::Axis;
use super::thin::{HEIGHT, Point, WIDTH, thin};
use super::{Figure, Marker, Series, Stroke};

/// Digits of a value beside the vertical axis for which every figure has room.
const SHORT: usize = 4;

/// How many digits a text is as wide as: signs and points are half as wide.
fn digits(text: &str) -> usize {
    let narrow = text.chars().filter(|c| !c.is_alphanumeric()).count();
    text.chars().count() - narrow / 2
}

pub(super) fn figure(figure: &Figure) -> Markup {
    let (x, y) = axes(figure);
    let view = format!("0 0 {WIDTH} {HEIGHT}");
    let y_ticks = y.ticks((figure.height_px / 34).max(4) as usize);
    let longest = y_ticks.iter().map(|t| digits(&t.text)).max().unwrap_or_default();
    html! {
        figure.plot data-x-label=(figure.x_label) data-x-from=(x.from) data-x-to=(x.to) data-x-log=(x.scale == super::Scale::Log)
            data-y-label=(figure.y_label) data-y-from=(y.from) data-y-to=(y.to) data-y-log=(y.scale == super::Scale::Log) {
            figcaption {
                span.title { (figure.title) }
                span.legend {
                    @for series in figure.series.iter().filter(|s| !s.name.is_empty()) {
                        button.key.(series.color.class()).(stroke_class(series.stroke)) type="button" aria-pressed="true" data-name=(series.name) { (series.name) }
                    }
                }
            }
            .frame style=[(longest > SHORT).then(|| format!("--ticks:{longest}ch"))] {
                .y-label { span { (figure.y_label) } }
                .y-ticks {
                    @for tick in y_ticks {
                        span style={ "top:" (percent(1.0 - tick.place)) } { (tick.text) }
                    }
                }
                .area style={ "height:" (figure.height_px) "px" } {
                    svg viewBox=(view) preserveAspectRatio="none" role="img" aria-label=(figure.title) {
                        (bands(figure, &x, &y))
                        path.grid d=(grid(&x, &y, figure.height_px)) {}
                        (zero_line(&y))
                        @for series in &figure.series {
                            path.(stroke_class(series.stroke)).(series.color.class()) data-series data-name=(series.name) d=(path(series, &x, &y)) {}
                        }
                        @for marker in &figure.markers { (marker_path(marker, &x, &y)) }
                    }
                    (labels(figure, &x, &y))
                }
                .x-ticks {
                    @for tick in x.ticks(8) {
                        span style={ "left:" (percent(tick.place)) } { (tick.text) }
                    }
                }
                .x-label { (figure.x_label) }
            }
            @if !figure.caption.is_empty() { p.caption { (figure.caption) } }
        }
    }
}

fn axes(figure: &Figure) -> (Axis, Axis) {
    let xs = figure.series.iter().flat_map(|s| {
        let half = if s.stroke == Stroke::Bars { bar_width(&s.x) / 2.0 } else { 0.0 };
        s.x.iter().flat_map(move |x| [x - half, x + half])
    });
    let xs = xs.chain(figure.markers.iter().filter_map(|m| m.x));
    let ys = figure.series.iter().flat_map(|s| s.y.iter().copied().chain((s.stroke == Stroke::Bars).then_some(0.0)));
    let ys = ys.chain(figure.markers.iter().filter_map(|m| m.y));
    let mut y = Axis::over(ys, figure.y_range, figure.y_scale, 0.05);
    if figure.y_range.is_none() && figure.bands.iter().any(|b| b.vertical && !b.label.is_empty()) {
        // Room for the labels of the bands above the curves.
        let room = 18.0 / f64::from(figure.height_px.max(100));
        match y.scale {
            super::Scale::Linear => y.to += room * (y.to - y.from),
            super::Scale::Log => y.to *= (y.to / y.from).powf(room),
        }
    }
    (Axis::over(xs, figure.x_range, figure.x_scale, 0.0), y)
}

fn percent(place: f64) -> String {
    format!("{:.2}%", place * 100.0)
}

fn stroke_class(stroke: Stroke) -> &'static str {
    match stroke {
        Stroke::Line | Stroke::Steps => "s-line",
        Stroke::Thin => "s-thin",
        Stroke::Dashed => "s-dashed",
        Stroke::Points => "s-points",
        Stroke::Bars | Stroke::Area => "s-area",
    }
}

/// Far outside is cut well beyond the edge, so that a line leaves the picture in its true direction and stays a small number.
fn whole(place: f64, size: i32) -> Option<i32> {
    place.is_finite().then(|| (place.clamp(-2.0, 3.0) * f64::from(size)).round() as i32)
}

fn point(x: f64, y: f64, x_axis: &Axis, y_axis: &Axis) -> Point {
    Some((whole(x_axis.place(x), WIDTH)?, whole(1.0 - y_axis.place(y), HEIGHT)?))
}

fn path(series: &Series, x_axis: &Axis, y_axis: &Axis) -> String {
    let points: Vec<Point> = series.x.iter().zip(&series.y).map(|(x, y)| point(*x, *y, x_axis, y_axis)).collect();
    match series.stroke {
        Stroke::Line | Stroke::Thin | Stroke::Dashed => line(&thin(&points), false),
        Stroke::Steps => {
            let stairs = points.iter().zip(points.iter().skip(1)).flat_map(|(a, b)| [*a, a.zip(*b).map(|(a, b)| (b.0, a.1))]);
            line(&thin(&stairs.chain(points.last().copied()).collect::<Vec<_>>()), false)
        }
        Stroke::Area => line(&thin(&points), true),
        Stroke::Points => thin(&points).iter().flatten().fold(String::new(), |mut d, (x, y)| {
            let _ = write!(d, "M{x} {y}h0");
            d
        }),
        Stroke::Bars => {
            let half = bar_width(&series.x) * 0.46;
            let bar = |x: f64, y: f64| {
                let (left, top) = point(x - half, y, x_axis, y_axis)?;
                let (right, foot) = point(x + half, y_axis.from.max(0.0), x_axis, y_axis)?;
                Some(format!("M{left} {foot}V{top}H{right}V{foot}z"))
            };
            series.x.iter().zip(&series.y).filter_map(|(x, y)| bar(*x, *y)).collect()
        }
    }
}

fn bar_width(x: &[f64]) -> f64 {
    let smallest = x.windows(2).map(|w| (w[1] - w[0]).abs()).filter(|d| *d > 0.0).fold(f64::INFINITY, f64::min);
    if smallest.is_finite() { smallest } else { 1.0 }
}

/// A path in relative whole steps: short, and free of rounding that adds up.
fn line(points: &[Point], closed: bool) -> String {
    let mut d = String::with_capacity(points.len() * 8);
    let mut last: Point = None;
    for point in points {
        if let Some((x, y)) = point {
            let _ = match last {
                None => write!(d, "M{x} {y}"),
                Some((x0, y0)) => write!(d, "l{} {}", x - x0, y - y0),
            };
        }
        last = *point;
    }
    if closed && !d.is_empty() {
        d.push('z');
    }
    d
}

fn grid(x: &Axis, y: &Axis, height_px: u32) -> String {
    let mut d = String::new();
    for place in x.ticks(8).into_iter().filter_map(|t| whole(t.place, WIDTH)) {
        let _ = write!(d, "M{place} 0V{HEIGHT}");
    }
    for place in y.ticks((height_px / 34).max(4) as usize).into_iter().filter_map(|t| whole(1.0 - t.place, HEIGHT)) {
        let _ = write!(d, "M0 {place}H{WIDTH}");
    }
    d
}

fn zero_line(y: &Axis) -> Markup {
    let crosses = y.scale == super::Scale::Linear && y.from < 0.0 && y.to > 0.0;
    html! { @if crosses && let Some(zero) = whole(1.0 - y.place(0.0), HEIGHT) { path.zero d={ "M0 " (zero) "H" (WIDTH) } {} } }
}

fn bands(figure: &Figure, x: &Axis, y: &Axis) -> Markup {
    html! {
        @for band in &figure.bands {
            @if band.vertical && let Some((from, to)) = whole(x.place(band.from), WIDTH).zip(whole(x.place(band.to), WIDTH)) {
                path.band.(band.color.class()) d={ "M" (from) " 0H" (to) "V" (HEIGHT) "H" (from) "z" } {}
            }
            @if !band.vertical && let Some((from, to)) = whole(1.0 - y.place(band.from), HEIGHT).zip(whole(1.0 - y.place(band.to), HEIGHT)) {
                path.band.(band.color.class()) d={ "M0 " (from) "V" (to) "H" (WIDTH) "V" (from) "z" } {}
            }
        }
    }
}

fn marker_path(marker: &Marker, x: &Axis, y: &Axis) -> Markup {
    let at_x = marker.x.and_then(|v| whole(x.place(v), WIDTH));
    let at_y = marker.y.and_then(|v| whole(1.0 - y.place(v), HEIGHT));
    html! {
        @match (at_x, at_y) {
            (Some(x), Some(y)) => path.dot.(marker.color.class()) d={ "M" (x) " " (y) "h0" } {},
            (Some(x), None) => path.rule.(marker.color.class()) d={ "M" (x) " 0V" (HEIGHT) } {},
            (None, Some(y)) => path.rule.(marker.color.class()) d={ "M0 " (y) "H" (WIDTH) } {},
            (None, None) => {},
        }
    }
}

/// Where the labels of the markers stand, so that none hides another: of rules across, those too near to the last one on the right
/// go to the left (`near`); of rules up, those beside the last one stand lower (`low`).
fn places(figure: &Figure, x: &Axis, y: &Axis) -> Vec<&'static str> {
    // Height of a line of text [px]; a label's share of the width of a narrow figure.
    const LINE_PX: f64 = 16.0;
    const WIDE: f64 = 0.4;
    let mut classes = vec![""; figure.markers.len()];
    let sorted = |of: &dyn Fn(&Marker) -> Option<f64>| {
        let mut places: Vec<(f64, usize)> =
            figure.markers.iter().enumerate().filter(|(_, m)| !m.label.is_empty()).filter_map(|(k, m)| Some((of(m)?, k))).collect();
        places.sort_by(|a, b| a.0.total_cmp(&b.0));
        places
    };
    let (mut right, mut left) = (f64::NEG_INFINITY, f64::NEG_INFINITY);
    for (top, k) in sorted(&|m| m.y.filter(|_| m.x.is_none()).map(|v| f64::from(figure.height_px) * (1.0 - y.place(v)))) {
        if top - right >= LINE_PX || top - left < LINE_PX {
            right = top;
        } else {
            (left, classes[k]) = (top, "near");
        }
    }
    let mut last = (f64::NEG_INFINITY, "");
    for (at, k) in sorted(&|m| m.x.filter(|_| m.y.is_none()).map(|v| x.place(v))) {
        classes[k] = if at - last.0 < WIDE && last.1.is_empty() { "low" } else { "" };
        last = (at, classes[k]);
    }
    classes
}

fn labels(figure: &Figure, x: &Axis, y: &Axis) -> Markup {
    let places = places(figure, x, y);
    // The label of a single band may be wider than the band.
    let is_single = figure.bands.iter().filter(|b| b.vertical && !b.label.is_empty()).count() == 1;
    html! {
        @for band in figure.bands.iter().filter(|b| !b.label.is_empty()) {
            @if band.vertical {
                @let (from, to) = (x.place(band.from).clamp(0.0, 1.0), x.place(band.to).clamp(0.0, 1.0));
                @let left = if is_single { format!("min({}, 100% - {:.1}em)", percent(from), 0.7 * band.label.len() as f64 + 1.0) } else { percent(from) };
                span.band-label.single[is_single] data-from=(band.from) data-to=(band.to) title=(band.label)
                    style={ "left:" (left) ";width:" (percent((to - from).max(0.0))) } { (band.label) }
            } @else {
                span.band-label style={ "right:0;top:" (percent(1.0 - y.place(band.to).clamp(0.0, 1.0))) } { (band.label) }
            }
        }
        @for (marker, place) in figure.markers.iter().zip(places).filter(|(m, _)| !m.label.is_empty()) {
            @let left = marker.x.map_or(if place == "near" { 0.0 } else { 1.0 }, |v| x.place(v));
            @let top = marker.y.map_or(0.0, |v| 1.0 - y.place(v));
            @if (0.0..=1.0).contains(&left) && (0.0..=1.0).contains(&top) {
                span.marker-label.(marker.color.class()).flip[left > 0.72].low[top < 0.08].lower[place == "low"].near[place == "near"].above[marker.x.is_none() && top >= 0.08] data-x=[marker.x] data-y=[marker.y] style={ "left:" (percent(left)) ";top:" (percent(top)) } { (marker.label) }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Color;
    use super::*;

    #[test]
    fn text_from_outside_is_escaped() {
        let markup = Figure::new("<script>alert(1)</script>", "x \"quoted\"", "y")
            .line("<b>", Color::Measured, vec![0.0, 1.0], vec![0.0, 1.0])
            .render();
        let text = markup.into_string();
        assert!(!text.contains("<script>") && !text.contains("<b>"), "{text}");
        assert!(text.contains("&lt;script&gt;"));
    }

    #[test]
    fn a_line_breaks_at_a_gap() {
        let series = Series {
            name: String::new(),
            x: vec![0.0, 1.0, 2.0, 3.0],
            y: vec![0.0, f64::NAN, 1.0, 1.0],
            color: Color::Measured,
            stroke: Stroke::Line,
        };
        let axis = |to: f64| Axis { from: 0.0, to, scale: super::super::Scale::Linear };
        assert_eq!(path(&series, &axis(4.0), &axis(2.0)), "M0 100000M10000 50000l5000 0");
    }

    #[test]
    fn labels_of_rules_that_lie_close_together_stand_on_two_sides_or_two_lines() {
        let across =
            [0.0, 0.5, 0.52, 0.54, 1.0].iter().fold(Figure::new("f", "x", "y").height(200), |f, v| f.horizontal("rule", Color::Error, *v));
        let (x, y) = axes(&across);
        assert_eq!(places(&across, &x, &y), ["", "", "near", "", ""]);
        let up = [0.0, 0.3, 0.35, 1.0].iter().fold(Figure::new("f", "x", "y"), |f, v| f.vertical("rule", Color::Error, *v));
        let (x, y) = axes(&up);
        assert_eq!(places(&up, &x, &y), ["", "low", "", ""]);
    }

    #[test]
    fn long_values_beside_the_axis_get_room_and_the_label_of_a_rule_stands_above_it() {
        let to = |top: f64| {
            Figure::new("f", "x", "y").line("l", Color::Error, vec![0.0, 1.0], vec![-top, top]).horizontal("rule", Color::Error, 0.0)
        };
        let (long, short) = (to(40_000.0).render().into_string(), to(40.0).render().into_string());
        assert!(
            long.contains("--ticks:6ch") && to(20_000.0).render().into_string().contains("--ticks:6ch") && !short.contains("--ticks"),
            "{long}"
        );
        assert!(short.contains("flip above"), "{short}");
    }

    #[test]
    fn an_empty_figure_is_drawn() {
        let text = Figure::new("nothing", "x", "y").line("none", Color::Measured, vec![], vec![]).render().into_string();
        assert!(text.contains("d=\"\"") && !text.contains("NaN"), "{text}");
    }

    #[test]
    fn bars_stand_on_zero() {
        let series = Series { name: String::new(), x: vec![1.0, 2.0], y: vec![1.0, 2.0], color: Color::Neutral, stroke: Stroke::Bars };
        let axis = |to: f64| Axis { from: 0.0, to, scale: super::super::Scale::Linear };
        assert_eq!(path(&series, &axis(4.0), &axis(2.0)), "M2700 100000V50000H7300V100000zM7700 100000V0H12300V100000z");
    }
}
