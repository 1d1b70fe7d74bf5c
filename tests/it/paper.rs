//! The pages that commands write are what the commands print, and say what they must.

use assert_cmd::Command;

fn printed(arguments: &[&str]) -> String {
    let output = Command::cargo_bin("hil").unwrap().args(arguments).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// The numbers of a row of a table, cell by cell; the first number of each cell.
fn cells(page: &str, begins: &str) -> Vec<f64> {
    let row = page.lines().find(|l| l.starts_with(begins)).unwrap_or_else(|| panic!("no row `{begins}`"));
    row.split('|').skip(2).filter_map(|cell| cell.trim().split(' ').next()?.parse().ok()).collect()
}

#[test]
fn the_page_of_the_paper_is_up_to_date_and_its_figures_are_met() {
    let page = printed(&["paper"]);
    assert_eq!(std::fs::read_to_string("docs/paper.md").unwrap(), page, "run `hil paper > docs/paper.md` and look at what moved");
    let mut six = 0;
    for line in page.lines().filter(|l| l.starts_with("| clutch-")) {
        let [paper, ours] = cells(&page, line)[..] else { panic!("{line}") };
        assert!((paper - ours).abs() <= 0.05, "{line}");
        six += 1;
    }
    assert_eq!(six, 6);
    // The figures that the search did not see stand there, whatever they are.
    for figure in ["| Fig. 5, triangles, shrinking", "| Fig. 5, triangles, around", "| Fig. 7, ramps with holds: hyperbolic"] {
        assert_eq!(cells(&page, figure).len(), 4, "{figure}");
    }
}

/// The valves are the set of at most four parameters that is nearest to the figures that the search did not see.
#[test]
fn the_search_gives_the_valves_of_table_1() {
    let page = std::fs::read_to_string("docs/paper-search.md").unwrap();
    let rows = page.lines().filter(|l| l.contains(" mbar |")).map(|l| l.split('|').map(str::trim).collect::<Vec<_>>());
    let number = |cell: &str| cell.split(' ').next().unwrap().parse::<f64>().unwrap();
    let nearest = rows.filter(|r| number(r[2]) <= 4.0).min_by(|a, b| number(a[9]).total_cmp(&number(b[9]))).unwrap();
    assert!(number(nearest[3]) <= 50.0, "{nearest:?}");
    let mut values = nearest[4].split(',').map(|v| v.trim().parse::<f64>().unwrap());
    let files = ["clutch-1", "clutch-2"].map(|c| std::fs::read_to_string(format!("valves/{c}.toml")).unwrap());
    for cause in nearest[1].split(',').map(str::trim) {
        let mut holds = |which: std::ops::Range<usize>, wanted: &dyn Fn(f64) -> String| {
            let value = values.next().unwrap();
            assert!(files[which].iter().all(|text| text.contains(&wanted(value))), "{cause}: {}", wanted(value));
        };
        match cause {
            "dead time" => holds(0..2, &|v| format!("extra = \"{:.1} ms\"", 1e3 * v)),
            "lag" => holds(0..2, &|v| format!("tau = \"{:.1} ms\"", 1e3 * v)),
            "noise" => holds(0..2, &|v| format!("noise = \"{:.1} mbar\"", 1e3 * v)),
            "gains" => (0..2).for_each(|k| holds(k..k + 1, &|v| format!("gain = \"{v:.4}\""))),
            "zeros" => (0..2).for_each(|k| holds(k..k + 1, &|v| format!("offset = \"{:.1} mbar\"", 1e3 * v))),
            other => panic!("no valve has `{other}`"),
        }
    }
}

#[test]
fn the_page_of_the_metrics_is_up_to_date() {
    let page = std::fs::read_to_string("docs/metrics.md").unwrap();
    let (table, verdicts) = page.split_once("\n## Are the verdicts right?").unwrap();
    assert_eq!(table, printed(&["explain", "--page"]), "run `hil explain --page --seeds 1000 > docs/metrics.md`");
    assert_verdicts(verdicts, 1000);
}

/// A perfect valve is never rejected; of those beyond a limit 99 % are.
fn assert_verdicts(page: &str, seeds: u64) {
    let plans = std::fs::read_dir("plans").unwrap().count();
    // Three cells: plan, runs, false rejects. A limit of the other table may be the same number.
    let rejects: Vec<&str> = page.lines().filter(|l| l.split('|').count() == 5 && l.contains(&format!("| {seeds} | "))).collect();
    assert_eq!(rejects.len(), plans, "{page}");
    for line in rejects {
        assert!(line.ends_with(&format!("| {seeds} | 0 |")), "{line}");
    }
    let (mut rejected, mut tried) = (0.0, 0.0);
    for line in page.lines().filter(|l| l.ends_with(" |")) {
        // A limit that none of the changes reaches has no share.
        let Some((some, all)) = line.split('|').nth_back(1).and_then(|cell| cell.split_once(" of ")) else { continue };
        let number = |v: &str| v.trim().parse::<f64>().unwrap();
        (rejected, tried) = (rejected + number(some), tried + number(all));
    }
    assert!(tried > 0.0 && rejected >= 0.99 * tried, "{rejected} of {tried}");
}

#[test]
fn verdicts_hold_with_seeds_drawn_anew() {
    assert_verdicts(&printed(&["explain", "--page", "--seeds", "3"]), 3);
}

/// Ten valves stand on the page; two, drawn anew here, scatter more.
#[test]
fn the_controller_is_worth_having() {
    let page = std::fs::read_to_string("docs/control.md").unwrap();
    for (page, whole, feedback) in [(page, 0.7, 1.0), (printed(&["tune", "--page", "--valves", "2"]), 0.95, 1.05)] {
        let of = |row: &str, most: f64| {
            let ratios = cells(&page, row);
            assert!(ratios.len() == 3 && ratios.iter().all(|ratio| *ratio <= most), "{row} {ratios:?}");
        };
        of("| whole controller : curve inverse with the best rule", whole);
        of("| tuned gains : best rule (model inverse", feedback);
    }
}
