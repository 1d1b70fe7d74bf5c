//! A figure as data: curves with names and units, strips, markers.

use super::axis::Scale;

/// What a line stands for; the style sheet gives every role one colour, told apart also by colour-blind readers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Color {
    /// A measured quantity.
    Measured,
    /// What the measured quantity should be.
    Reference,
    /// A difference between the two.
    Error,
    /// The current from the feed-forward, or a first model.
    FeedForward,
    /// The current from the feedback, or a second model.
    Feedback,
    /// The ascending reference curve.
    Ascending,
    /// The descending reference curve.
    Descending,
    /// A limit.
    Limit,
    /// Something good: an operating point, a held-out match.
    Good,
    /// Secondary lines and shading.
    Neutral,
    /// Not drawn: a band that only carries its label.
    Clear,
}

impl Color {
    /// A colour for the `n`-th of several equal series.
    pub fn nth(n: usize) -> Self {
        const ORDER: [Color; 6] = [Color::Measured, Color::Feedback, Color::Ascending, Color::Good, Color::Error, Color::Neutral];
        ORDER[n % ORDER.len()]
    }

    pub(super) fn class(self) -> &'static str {
        match self {
            Color::Measured => "c-measured",
            Color::Reference => "c-reference",
            Color::Error => "c-error",
            Color::FeedForward => "c-feedforward",
            Color::Feedback => "c-feedback",
            Color::Ascending => "c-ascending",
            Color::Descending => "c-descending",
            Color::Limit => "c-limit",
            Color::Good => "c-good",
            Color::Neutral => "c-neutral",
            Color::Clear => "c-clear",
        }
    }
}

/// How a series is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stroke {
    /// A line; NaN breaks it.
    Line,
    /// A thin line for dense traces.
    Thin,
    /// A dashed line.
    Dashed,
    /// Dots.
    Points,
    /// A staircase: each value holds until the next.
    Steps,
    /// Vertical bars from zero, one per x, as wide as the smallest distance between two.
    Bars,
    /// A filled outline; x and y run around the area.
    Area,
}

/// One curve of a figure.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Name in the legend; empty: not in the legend.
    pub name: String,
    /// Horizontal coordinates, in the unit of the axis.
    pub x: Vec<f64>,
    /// Vertical coordinates; NaN is a gap.
    pub y: Vec<f64>,
    /// The role.
    pub color: Color,
    /// The way of drawing.
    pub stroke: Stroke,
}

/// A shaded strip with a label.
#[derive(Debug, Clone, PartialEq)]
pub struct Band {
    /// Whether `from` and `to` are on the horizontal axis.
    pub vertical: bool,
    /// Begin, in the unit of the axis.
    pub from: f64,
    /// End.
    pub to: f64,
    /// Printed inside, cut where it does not fit; may be empty.
    pub label: String,
    /// The role.
    pub color: Color,
}

/// A labelled dot (both coordinates), vertical line (only x) or horizontal line (only y).
#[derive(Debug, Clone, PartialEq)]
pub struct Marker {
    /// Horizontal position.
    pub x: Option<f64>,
    /// Vertical position.
    pub y: Option<f64>,
    /// Printed beside it.
    pub label: String,
    /// The role.
    pub color: Color,
}

/// A plot with its axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// Printed above.
    pub title: String,
    /// Quantity and unit of the horizontal axis, `time [s]`. Figures of a page with the same label zoom together.
    pub x_label: String,
    /// Quantity and unit of the vertical axis.
    pub y_label: String,
    /// The curves, drawn in this order.
    pub series: Vec<Series>,
    /// Shaded strips, drawn first.
    pub bands: Vec<Band>,
    /// Dots and lines with labels, drawn last.
    pub markers: Vec<Marker>,
    /// Range of the horizontal axis; from the data where `None`.
    pub x_range: Option<(f64, f64)>,
    /// Range of the vertical axis; from the data where `None`.
    pub y_range: Option<(f64, f64)>,
    /// Division of the horizontal axis.
    pub x_scale: Scale,
    /// Division of the vertical axis.
    pub y_scale: Scale,
    /// Height of the plot area [px].
    pub height_px: u32,
    /// A sentence below the figure: what to see in it.
    pub caption: String,
}

impl Figure {
    /// A figure without curves.
    pub fn new(title: impl Into<String>, x_label: impl Into<String>, y_label: impl Into<String>) -> Self {
        Self {
            title: title.into(),
            x_label: x_label.into(),
            y_label: y_label.into(),
            series: Vec::new(),
            bands: Vec::new(),
            markers: Vec::new(),
            x_range: None,
            y_range: None,
            x_scale: Scale::Linear,
            y_scale: Scale::Linear,
            height_px: 260,
            caption: String::new(),
        }
    }

    /// Adds a curve.
    pub fn series(mut self, name: impl Into<String>, color: Color, stroke: Stroke, x: Vec<f64>, y: Vec<f64>) -> Self {
        self.series.push(Series { name: name.into(), x, y, color, stroke });
        self
    }

    /// Adds a line.
    pub fn line(self, name: impl Into<String>, color: Color, x: Vec<f64>, y: Vec<f64>) -> Self {
        self.series(name, color, Stroke::Line, x, y)
    }

    /// Adds a dashed line.
    pub fn dashed(self, name: impl Into<String>, color: Color, x: Vec<f64>, y: Vec<f64>) -> Self {
        self.series(name, color, Stroke::Dashed, x, y)
    }

    /// Adds dots.
    pub fn points(self, name: impl Into<String>, color: Color, x: Vec<f64>, y: Vec<f64>) -> Self {
        self.series(name, color, Stroke::Points, x, y)
    }

    /// Adds bars.
    pub fn bars(self, name: impl Into<String>, color: Color, x: Vec<f64>, y: Vec<f64>) -> Self {
        self.series(name, color, Stroke::Bars, x, y)
    }

    /// Adds a histogram: the upper edge of each class and its count. The first class is as wide as the second.
    pub fn histogram(self, name: impl Into<String>, color: Color, classes: &[(f64, f64)]) -> Self {
        let first = match classes {
            [(a, _), (b, _), ..] if self.x_scale == Scale::Log => a * a / b,
            [(a, _), (b, _), ..] => 2.0 * a - b,
            [(a, _)] => a / 2.0,
            [] => 0.0,
        };
        let lower = std::iter::once(first).chain(classes.iter().map(|c| c.0));
        let (mut x, mut y) = (Vec::new(), Vec::new());
        for (from, (to, count)) in lower.zip(classes) {
            x.extend([from, from, *to, *to]);
            y.extend([0.0, *count, *count, 0.0]);
        }
        self.series(name, color, Stroke::Area, x, y)
    }

    /// Shades a strip of the horizontal axis (a phase, a window).
    pub fn band_x(mut self, label: impl Into<String>, color: Color, from: f64, to: f64) -> Self {
        self.bands.push(Band { vertical: true, from, to, label: label.into(), color });
        self
    }

    /// Shades a strip of the vertical axis (a tolerance).
    pub fn band_y(mut self, label: impl Into<String>, color: Color, from: f64, to: f64) -> Self {
        self.bands.push(Band { vertical: false, from, to, label: label.into(), color });
        self
    }

    /// Marks a point.
    pub fn marker(mut self, label: impl Into<String>, color: Color, x: f64, y: f64) -> Self {
        self.markers.push(Marker { x: Some(x), y: Some(y), label: label.into(), color });
        self
    }

    /// Draws a vertical line.
    pub fn vertical(mut self, label: impl Into<String>, color: Color, x: f64) -> Self {
        self.markers.push(Marker { x: Some(x), y: None, label: label.into(), color });
        self
    }

    /// Draws a horizontal line.
    pub fn horizontal(mut self, label: impl Into<String>, color: Color, y: f64) -> Self {
        self.markers.push(Marker { x: None, y: Some(y), label: label.into(), color });
        self
    }

    /// Sets the sentence below.
    pub fn caption(mut self, text: impl Into<String>) -> Self {
        self.caption = text.into();
        self
    }

    /// Sets the height of the plot area [px].
    pub fn height(mut self, px: u32) -> Self {
        self.height_px = px;
        self
    }

    /// Fixes the ranges of the axes; `None` takes the range from the data.
    pub fn ranges(mut self, x: Option<(f64, f64)>, y: Option<(f64, f64)>) -> Self {
        self.x_range = x;
        self.y_range = y;
        self
    }

    /// Sets the division of the axes.
    pub fn scales(mut self, x: Scale, y: Scale) -> Self {
        self.x_scale = x;
        self.y_scale = y;
        self
    }
}
