//! The files of the page, inside the program.

/// Path below the root, kind, text.
pub(super) struct File {
    pub path: &'static str,
    pub kind: &'static str,
    pub text: &'static str,
}

const HTML: &str = "text/html; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";
const JS: &str = "text/javascript; charset=utf-8";

/// A file of the page.
macro_rules! file {
    ($path:literal, $kind:expr, $file:literal) => {
        File { path: $path, kind: $kind, text: include_str!(concat!("page/", $file)) }
    };
}

/// Every file of the page; nothing else is served without a token.
pub(super) const FILES: &[File] = &[
    file!("/", HTML, "index.html"),
    file!("/page/style.css", CSS, "style.css"),
    file!("/page/main.js", JS, "main.js"),
    file!("/page/dom.js", JS, "dom.js"),
    file!("/page/link.js", JS, "link.js"),
    file!("/page/texts.js", JS, "texts.js"),
    file!("/page/text.en.js", JS, "text.en.js"),
    file!("/page/text.de.js", JS, "text.de.js"),
    file!("/page/curves.js", JS, "curves.js"),
    file!("/page/signs.js", JS, "signs.js"),
    file!("/page/operate.js", JS, "operate.js"),
    file!("/page/engineer.js", JS, "engineer.js"),
    file!("/page/history.js", JS, "history.js"),
    file!("/page/diagnosis.js", JS, "diagnosis.js"),
    file!("/page/uPlot.js", JS, "vendor/uPlot.iife.min.js"),
    file!("/page/uPlot.css", CSS, "vendor/uPlot.min.css"),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_is_light_and_fetches_nothing_from_elsewhere() {
        let weight: usize = FILES.iter().map(|f| f.text.len()).sum();
        assert!(weight < 200_000, "{weight} bytes");
        for file in FILES.iter().filter(|f| !f.path.contains("uPlot")) {
            assert!(!file.text.contains("http://") && !file.text.contains("https://"), "{} names another place", file.path);
            // The policy forbids both; a page that tries is one that does not work.
            assert!(!file.text.contains("style=\"") && !file.text.contains(" onclick="), "{} has something inline", file.path);
        }
        let html = FILES[0].text;
        for at in html.match_indices("<script") {
            assert!(html[at.0..].split('>').next().unwrap().contains("src="), "an inline script");
        }
    }

    #[test]
    fn both_languages_have_the_same_texts() {
        let keys = |path: &str| -> Vec<String> {
            let text = FILES.iter().find(|f| f.path == path).unwrap().text;
            // Sentences of the program are pairs, not keys.
            let lines = text.lines().filter(|l| !l.trim_start().starts_with('['));
            lines.filter_map(|l| Some(l.strip_prefix("  ")?.split_once(':')?.0.trim_matches('"').to_string())).collect()
        };
        let (english, german) = (keys("/page/text.en.js"), keys("/page/text.de.js"));
        assert!(english.len() > 50);
        assert_eq!(english, german);
    }
}
