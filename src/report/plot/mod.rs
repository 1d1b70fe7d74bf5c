//! Figures for the HTML reports: inline SVG that needs no network, prints well and gives the same bytes everywhere.
//!
//! A [`Figure`] is data with names and units; [`Figure::render`] turns it into markup. Long traces are thinned to
//! what a screen can show (the extremes of every pixel column survive), and coordinates are whole numbers.
//!
//! ```
//! use hil::report::plot::{Color, Figure};
//! let figure = Figure::new("Pressure", "time [s]", "pressure [bar]")
//!     .line("measured", Color::Measured, vec![0.0, 1.0], vec![2.0, 4.0])
//!     .horizontal("limit", Color::Limit, 5.0);
//! let page = hil::report::page("A page", &figure.render());
//! assert!(page.starts_with("<!DOCTYPE html>"));
//! ```

mod axis;
mod draw;
mod figure;
mod thin;

pub use axis::Scale;
pub use figure::{Band, Color, Figure, Marker, Series, Stroke};

impl Figure {
    /// The figure as markup for a page.
    pub fn render(&self) -> maud::Markup {
        draw::figure(self)
    }
}
