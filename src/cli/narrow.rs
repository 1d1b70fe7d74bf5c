//! Reports have 80 columns. Where a terminal has fewer than a line needs, sentences are broken anew; of tables the blanks between columns
//! go first, then lines are broken.

use crate::report::fold;

/// No terminal is taken to be narrower.
const LEAST: usize = 60;
/// The columns of a report.
const REPORT: usize = 80;
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
        let mut table = Vec::new();
        for part in block.chunk_by(|a, b| goes_on(a, b)) {
            match part {
                [line] => table.push(*line),
                [first, second, ..] => {
                    out += &rows(&table, width);
                    table.clear();
                    let text: Vec<&str> = part.iter().map(|line| line.trim()).collect();
                    out += &hung(&text.join(" "), indent(first), indent(second), width);
                }
                [] => {}
            }
        }
        out += &rows(&table, width);
    }
    out
}

fn indent(line: &str) -> usize {
    line.chars().take_while(|c| *c == ' ').count()
}

/// Whether `next` goes on with the sentence of `line`: its first word had no room there. What has columns, or begins with the name of a
/// channel or a key, is a row of its own.
fn goes_on(line: &str, next: &str) -> bool {
    let first = |text: &str| text.split_whitespace().next().unwrap_or_default().to_owned();
    let is_row =
        |text: &str| text.trim_start().contains("  ") || !text.trim().contains(' ') && text.len() > REPORT / 2 || first(text).contains('_');
    let (word, used) = (first(next), line.chars().count());
    let deeper = indent(line)..=indent(line) + 10;
    let had_no_room = used <= REPORT && used + 1 + word.chars().count() > REPORT;
    had_no_room && !is_row(line) && !is_row(next) && !word.ends_with(':') && deeper.contains(&indent(next))
}

/// A text broken between words, the lines after the first with an indent of their own.
fn hung(text: &str, first: usize, further: usize, width: usize) -> String {
    let (first, further) = (first.min(width / 2), further.min(width / 2));
    let parts = fold(text, width - first.max(further));
    parts.iter().enumerate().map(|(n, part)| format!("{:1$}{part}\n", "", if n == 0 { first } else { further })).collect()
}

/// Lines that stand for themselves.
fn rows(lines: &[&str], width: usize) -> String {
    let one = |line: String| {
        if line.chars().count() <= width {
            return line + "\n";
        }
        columns(&line, width).unwrap_or_else(|| hung(&line, indent(&line), indent(&line) + GAP, width))
    };
    closer(lines, width).into_iter().map(one).collect()
}

/// A line of columns that is too long: with less of its widest gap, or what follows the first column below it, to the right edge, where
/// verdicts stand.
fn columns(line: &str, width: usize) -> Option<String> {
    let start = indent(line);
    let letters: Vec<char> = line.chars().collect();
    let (mut gaps, mut at) = (Vec::new(), start);
    while at < letters.len() {
        let blanks = letters[at..].iter().take_while(|c| **c == ' ').count();
        if blanks >= GAP {
            gaps.push((blanks, at));
        }
        at += blanks.max(1);
    }
    let (widest, place) = *gaps.iter().max_by_key(|gap| gap.0)?;
    let excess = letters.len() - width;
    let text = |part: &[char]| part.iter().collect::<String>();
    if widest >= excess + GAP {
        return Some(text(&letters[..place]) + &text(&letters[place + excess..]) + "\n");
    }
    let (blanks, first) = gaps[0];
    let (head, tail) = (text(&letters[..first]), text(&letters[first + blanks..]));
    let fits = head.chars().count() <= width && tail.chars().count() + start + GAP <= width;
    fits.then(|| format!("{head}\n{tail:>width$}\n"))
}

/// The lines of a block with fewer of the blanks that stand above each other in all that have columns; rules are cut.
fn closer(block: &[&str], width: usize) -> Vec<String> {
    let is_rule = |line: &[char]| line.len() > 3 && !line[0].is_alphanumeric() && line.iter().all(|c| *c == line[0]);
    // What has no columns says nothing of where they stand.
    let apart = |line: &[char]| {
        let inside = line.iter().skip_while(|c| **c == ' ').collect::<Vec<_>>();
        is_rule(line) || !inside.windows(GAP).any(|pair| pair.iter().all(|c| **c == ' '))
    };
    let mut lines: Vec<Vec<char>> = block.iter().map(|line| line.chars().collect()).collect();
    loop {
        let longest = lines.iter().filter(|l| !apart(l)).map(Vec::len).max().unwrap_or(0);
        if longest <= width {
            break;
        }
        let blank = |at: usize| lines.iter().filter(|l| !apart(l)).all(|l| l.get(at).is_none_or(|c| *c == ' '));
        let indent = lines.iter().filter(|l| !apart(l)).map(|l| l.iter().take_while(|c| **c == ' ').count()).min();
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
        for line in lines.iter_mut().filter(|l| !apart(l) && l.len() > widest.1) {
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
    fn a_verdict_stays_at_the_right_edge() {
        let text = "tipin on a valve                                                            FAIL\n\
            SIMULATION - the pressures come from a model, not from a valve, and that is told here\n\
            ================================================================================\n\
            a line below a rule\n\
            \n\
            \x20 max_error.delayed.v1(delay=19.823 ms)   1.708 bar  <= 1.500 bar            FAIL\n\
            \x20 offset(window=1 s)                      0.131 bar  -0.300 .. 0.300 bar     PASS\n";
        let narrow = fitted(text, 60);
        let verdicts: Vec<usize> = narrow.lines().filter(|l| l.ends_with("FAIL") || l.ends_with("PASS")).map(str::len).collect();
        assert_eq!(verdicts, [60; 3], "{narrow}");
        assert!(narrow.lines().any(|l| l == "=".repeat(60)), "{narrow}");
        assert!(narrow.lines().any(|l| l == "  max_error.delayed.v1(delay=19.823 ms)"), "{narrow}");
    }

    #[test]
    fn a_paragraph_is_broken_anew() {
        let text = "Missing in the model: sensor lag (tau 45.1 ms; this record cannot tell it from\n\
            first-order lag). The model as given is off by 0.830 bar RMSE; recalibrated\n\
            0.100 bar on held-out data.\n\
            note: the pressure stands at a floor of 0.000 bar below 0.187 A: the curves are\n\
            \x20     seen from there on; down to 0.080 A\n\
            note: 5954 of 6000 samples (99 %) are steady enough to lie on a static curve here\n\
            warning: short\n\
            \x20 time_since_reversal_s 0.010 to 0.27: 72 % on 12 % of the samples, mean -0.04 bar\n\
            \x20 dwell_s 0.000 to 0.210: 100 % on 25 % of the samples, mean -0.042 bar\n\
            \x20 mostly between 0.23 Hz and 2.27 Hz\n";
        let narrow = fitted(text, 60);
        let lines: Vec<&str> = narrow.lines().collect();
        assert!(lines[1].starts_with("cannot tell it from first-order lag). The model"), "{narrow}");
        assert!(
            lines[5].starts_with("      below 0.187 A: the curves are seen from there on") && lines.contains(&"warning: short"),
            "{narrow}"
        );
        assert!(lines.iter().all(|l| l.chars().count() <= 60), "{narrow}");
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
