//! `docs/paper.md` is what `hil paper` prints, and the clutch variants give the paper's feed-forward figures.

use assert_cmd::Command;

fn printed() -> String {
    let output = Command::cargo_bin("hil").unwrap().arg("paper").output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn the_page_is_up_to_date_and_the_clutches_are_calibrated() {
    let printed = printed();
    let page = std::fs::read_to_string("docs/paper.md").unwrap();
    assert_eq!(page, printed, "run `hil paper > docs/paper.md` and look at what moved");
    for line in printed.lines().filter(|l| l.contains("calibrated")) {
        let numbers: Vec<f64> = line.split('|').filter_map(|cell| cell.trim().split(' ').next()?.parse().ok()).collect();
        let [paper, ours] = numbers[..] else { panic!("{line}") };
        assert!((paper - ours).abs() <= 0.001, "{line}");
    }
    assert_eq!(printed.lines().filter(|l| l.contains("calibrated")).count(), 2);
}
