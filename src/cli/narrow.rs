//! Reports have 80 columns. Where a terminal has fewer than a line needs, the blanks between columns go first, then lines are broken.

use crate::report::fold;

/// No terminal is taken to be narrower.
const LEAST: usize = 60;
/// So many blanks stay between two columns.
const GAP: usize = 2;

/// A text for people as it fits the terminal that stdout is; as it is where there is none, or for programs (JSON, XML, HTML, Markdown).
pub fn for_terminal(text: &str) -> Option<String> {
    let (terminal_size::Width(width), _) = terminal_size::terminal_size_of(std::io::stdout())?;
    let width = usize::from(width).max(LEAST);
    let for_people = !text.starts_with(['{', '[', '<', '#', '|']) && !text.contains('\u{1b}');
    (for_people && is_wider(text, width)).then(|| fitted(text, width))
}

/// What is said beside the result, as it fits the terminal that stderr is: sentences are broken between words, excerpts of files stay.
pub fn for_notes(text: &str) -> Option<String> {
    let (terminal_size::Width(width), _) = terminal_size::terminal_size_of(std::io::stderr())?;
    let width = usize::from(width).max(LEAST);
    (!text.contains('\u{1b}') && is_wider(text, width)).then(|| broken(text, width))
}

fn is_wider(text: &str, width: usize) -> bool {
    text.lines().any(|line| line.chars().count() > width)
}

fn broken(text: &str, width: usize) -> String {
    let excerpt = |line: &str| line.contains(" | ") || ["|", "-->"].iter().any(|sign| line.trim_start().starts_with(sign));
    let mut out: Vec<String> = Vec::new();
    for line in text.lines() {
        if excerpt(line) || line.chars().count() <= width {
            out.push(line.into());
            continue;
        }
        let indent = line.chars().take_while(|c| *c == ' ').count().min(width / 2);
        out.extend(fold(line.trim_start(), width - indent).iter().map(|part| format!("{:indent$}{part}", "")));
    }
    out.join("\n")
}

/// The text with no line longer than `width`, but for single words that are.
fn fitted(text: &str, width: usize) -> String {
    let mut out = String::new();
    let lines: Vec<&str> = text.lines().collect();
    for block in lines.chunk_by(|a, b| a.is_empty() == b.is_empty()) {
        for line in closer(block, width) {
            let indent = line.chars().take_while(|c| *c == ' ').count().min(width / 2);
            let blank = " ".repeat(indent);
            if line.chars().count() <= width {
                out += &line;
                out.push('\n');
                continue;
            }
            for (n, part) in fold(&line, width - indent - GAP).iter().enumerate() {
                let further = if n > 0 { " ".repeat(GAP) } else { String::new() };
                out += &format!("{blank}{further}{part}\n");
            }
        }
    }
    out
}

/// The lines of a block with fewer of the blanks that stand above each other in all of them; rules are cut.
fn closer(block: &[&str], width: usize) -> Vec<String> {
    let is_rule = |line: &[char]| line.len() > 3 && !line[0].is_alphanumeric() && line.iter().all(|c| *c == line[0]);
    let mut lines: Vec<Vec<char>> = block.iter().map(|line| line.chars().collect()).collect();
    loop {
        let longest = lines.iter().filter(|l| !is_rule(l)).map(Vec::len).max().unwrap_or(0);
        if longest <= width {
            break;
        }
        let blank = |at: usize| lines.iter().filter(|l| !is_rule(l)).all(|l| l.get(at).is_none_or(|c| *c == ' '));
        let indent = lines.iter().filter(|l| !is_rule(l) && !l.is_empty()).map(|l| l.iter().take_while(|c| **c == ' ').count()).min();
        // The widest gap between two columns.
        let (mut widest, mut run) = ((0, 0), 0);
        for at in indent.unwrap_or(0)..longest {
            run = if blank(at) { run + 1 } else { 0 };
            if run > widest.0 {
                widest = (run, at);
            }
        }
        if widest.0 <= GAP {
            break;
        }
        for line in lines.iter_mut().filter(|l| !is_rule(l) && l.len() > widest.1) {
            line.remove(widest.1);
        }
    }
    lines.iter_mut().filter(|l| is_rule(l)).for_each(|l| l.truncate(width));
    lines.into_iter().map(|l| l.into_iter().collect::<String>().trim_end().to_owned()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_move_together_and_long_lines_break() {
        let text = "measurement                              value  limit               verdict\n\
            ----------------------------------------------------------------------------\n\
            \x20 rmse.delayed.v1                     0.147 bar  <= 0.500 bar        PASS\n\
            \x20 offset                              0.003 bar  -0.200 .. 0.200 bar PASS\n\
            \n\
            because    a sentence that is longer than a narrow terminal and has to be broken somewhere\n";
        let narrow = fitted(text, 60);
        let rows: Vec<&str> = narrow.lines().collect();
        assert_eq!((rows[1].len(), rows[3].find("PASS"), rows.len()), (60, rows[2].find("PASS"), 7), "{narrow}");
        assert!(fitted(text, 60).lines().all(|l| l.chars().count() <= 60));
        assert_eq!(fitted(text, 100), text);
    }

    #[test]
    fn a_long_message_breaks_between_words_and_the_excerpt_below_it_stays() {
        let text = "error: no plan `nosuch`: no such file, and none that ships with the program; there are: characteristic, curve-error\n\
            3 | phase = \"a line of the file that is longer than the terminal and is underlined below it\"\n  |         ^^^";
        let narrow = broken(text, 60);
        let lines: Vec<&str> = narrow.lines().collect();
        assert_eq!(lines[0], "error: no plan `nosuch`: no such file, and none that ships");
        assert!(lines[..2].iter().all(|l| l.chars().count() <= 60) && text.ends_with(&lines[2..].join("\n")), "{narrow}");
    }
}
