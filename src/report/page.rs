//! The frame of every HTML page: one file with its style and its few lines of script, nothing fetched.

use maud::{DOCTYPE, Markup, PreEscaped, html};

const STYLE: &str = include_str!("assets/report.css");
const SCRIPT: &str = include_str!("assets/report.js");

/// How the figures of a page are used.
pub const HINT: &str = "Point or tap to read values; drag across to zoom in time, up to zoom the values, double-click for all. The keys of a legend \
    hide and show. Figures with the same axis move together.";

/// A text of the program on a page: what stands between backticks is code.
pub fn prose(text: &str) -> Markup {
    html! {
        @for (n, part) in text.split('`').enumerate() {
            @if n % 2 == 1 { code { (part) } } @else { (part) }
        }
    }
}

/// A complete, self-contained page around `body`.
pub fn page(title: &str, body: &Markup) -> String {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                // The mark by which an output may be replaced by another page: `output::Mark::PAGE`.
                meta name="generator" content="hil";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                main { (body) }
                script { (PreEscaped(SCRIPT)) }
            }
        }
    }
    .into_string()
}

#[cfg(test)]
mod tests {
    use super::STYLE;

    /// The colour of a variable in one of the blocks of the style sheet, as linear red, green and blue.
    fn color(block: &str, name: &str) -> [f64; 3] {
        let at = block.find(&format!("--{name}: #")).unwrap_or_else(|| panic!("{name}")) + name.len() + 5;
        let hex = &block[at..at + 6];
        [0, 2, 4].map(|k| {
            let v = f64::from(u8::from_str_radix(&hex[k..k + 2], 16).unwrap()) / 255.0;
            if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
        })
    }

    fn times(m: [[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
        m.map(|row| row.iter().zip(v).map(|(a, b)| a * b).sum::<f64>().clamp(0.0, 1.1))
    }

    /// CIE L*a*b* under D65.
    fn lab(rgb: [f64; 3]) -> [f64; 3] {
        let xyz = times([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]], rgb);
        let white = [0.9505, 1.0, 1.089];
        let f = [0, 1, 2].map(|k| {
            let t: f64 = xyz[k] / white[k];
            if t > 0.008856 { t.cbrt() } else { 7.787 * t + 16.0 / 116.0 }
        });
        [116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])]
    }

    /// Protanopia and deuteranopia after Machado, Oliveira and Fernandes (2009), table 1, severity 1.
    const BLIND: [[[f64; 3]; 3]; 2] = [
        [[0.152_286, 1.052_583, -0.204_868], [0.114_503, 0.786_281, 0.099_216], [-0.003_882, -0.048_116, 1.051_998]],
        [[0.367_322, 0.860_646, -0.227_968], [0.280_085, 0.672_501, 0.047_413], [-0.011_820, 0.042_940, 0.968_881]],
    ];

    #[test]
    fn lines_of_one_figure_are_told_apart_by_colour_blind_readers_and_in_grey() {
        let dark = STYLE.find("prefers-color-scheme: dark").unwrap();
        let pairs = [
            ("measured", "reference"),
            ("error", "good"),
            ("reference", "error"),
            ("reference", "good"),
            ("measured", "feedback"),
            ("ascending", "descending"),
            ("measured", "ascending"),
            ("feedforward", "reference"),
        ];
        for (theme, block) in [("light", STYLE), ("dark", &STYLE[dark..])] {
            for (a, b) in pairs {
                let (x, y) = (color(block, a), color(block, b));
                let distance = |x: [f64; 3], y: [f64; 3]| lab(x).iter().zip(lab(y)).map(|(p, q)| (p - q).powi(2)).sum::<f64>().sqrt();
                // 2.3 is just noticed side by side; thin lines apart want several times that.
                for blind in BLIND {
                    let seen = distance(times(blind, x), times(blind, y));
                    assert!(seen > 15.0, "{theme}: {a} and {b} differ by {seen:.0} for a colour-blind reader");
                }
                let grey = (lab(x)[0] - lab(y)[0]).abs();
                assert!(grey > 7.0, "{theme}: {a} and {b} differ by {grey:.0} in grey");
            }
        }
    }

    #[test]
    fn what_stands_between_backticks_is_code_and_nothing_else_is_markup() {
        let page = super::prose("`hil <x>` tells & shows").into_string();
        assert_eq!(page, "<code>hil &lt;x&gt;</code> tells &amp; shows");
    }
}
