//! What the station says, in the languages of its page.

use std::path::{Path, PathBuf};

/// Every sentence that the German page knows is one that the program says, and every refusal of the station is known.
#[test]
fn the_german_page_knows_what_the_station_says() {
    fn sources(folder: &Path, all: &mut Vec<(PathBuf, String)>) {
        for entry in std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()) {
            if entry.is_dir() {
                sources(&entry, all);
            } else if entry.extension().is_some_and(|e| e == "rs") {
                let text = std::fs::read_to_string(&entry).unwrap();
                all.push((entry, text));
            }
        }
    }
    let mut all = Vec::new();
    sources(Path::new("src"), &mut all);
    let page = std::fs::read_to_string("src/station/page/text.de.js").unwrap();
    let sentences: Vec<[String; 2]> = page
        .lines()
        .map(str::trim)
        .filter(|line| line.starts_with("[\""))
        .map(|line| serde_json::from_str(line.trim_end_matches(',')).unwrap_or_else(|e| panic!("{line}: {e}")))
        .collect();
    assert!(sentences.len() > 40);
    let places = |text: &str| (0..9).filter(|k| text.contains(&format!("{{{k}}}"))).collect::<Vec<_>>();
    for [english, german] in &sentences {
        assert_eq!(places(english), places(german), "{english}");
        let pieces = (0..9).fold(english.clone(), |text, k| text.replace(&format!("{{{k}}}"), "\n"));
        for piece in pieces.lines().map(|p| p.trim_matches([' ', ':', ',', '`', '(', ')', '.'])).filter(|p| p.len() > 2) {
            assert!(all.iter().any(|(_, text)| text.contains(piece)), "`{piece}` of `{english}` is said nowhere");
        }
    }
    let mut refusals = 0;
    for (path, text) in all.iter().filter(|(path, _)| path.starts_with("src/station") || path.starts_with("src/cli/station")) {
        for (at, marker) in ["because(\"", "refuse(StatusCode::"].iter().flat_map(|m| text.match_indices(m)) {
            let rest = &text[at + marker.len()..];
            let call = if marker.starts_with("because") {
                rest
            } else {
                rest.split_once(", \"").map_or("", |(name, rest)| if name.len() < 40 { rest } else { "" })
            };
            let Some(literal) = call.split('"').next().filter(|l| !l.is_empty()) else { continue };
            assert!(sentences.iter().any(|s| s[0] == literal), "{}: `{literal}` has no German", path.display());
            refusals += 1;
        }
    }
    assert!(refusals > 20, "{refusals}");
}
