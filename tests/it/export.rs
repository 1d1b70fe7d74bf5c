//! `hil export` from outside: models as JSON and as FMU, a lot as AQDEF beside its journal, what is refused.

use std::io::Read;
use std::path::PathBuf;

use assert_cmd::Command;
use predicates::str::contains;
use serde_json::Value;

struct Bench(tempfile::TempDir);

impl Bench {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }
    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
    fn hil(&self, arguments: &[&str]) -> assert_cmd::assert::Assert {
        Command::new(env!("CARGO_BIN_EXE_hil")).current_dir(self.0.path()).args(arguments).assert()
    }
    fn text(&self, name: &str) -> String {
        std::fs::read_to_string(self.at(name)).unwrap()
    }
}

#[test]
fn a_shipped_model_is_exported_by_its_bare_name() {
    let bench = Bench::new();
    bench.hil(&["export", "paper", "-o", "paper.json"]).success().stderr(contains("hil schema valve"));
    let model: Value = serde_json::from_str(&bench.text("paper.json")).unwrap();
    assert_eq!((&model["name"], &model["delay"]), (&Value::from("paper"), &Value::from("0.02 s")));
    let ascending: Vec<f64> = model["curve"]["ascending"].as_array().unwrap().iter().filter_map(Value::as_f64).collect();
    assert_eq!(ascending, [-42.65, 92.5, -8.4, -2.03]);
    // A file of another kind is not replaced unasked; the program's own is.
    bench.hil(&["export", "paper", "-o", "paper.json"]).success();
    std::fs::write(bench.at("mine.json"), "{}").unwrap();
    bench.hil(&["export", "paper", "-o", "mine.json"]).code(2);
    assert_eq!(bench.text("mine.json"), "{}");
}

#[cfg(all(unix, feature = "fmi"))]
#[test]
fn an_fmu_holds_its_description_its_library_and_the_model() {
    let bench = Bench::new();
    std::fs::write(bench.at("library.so"), b"the bytes of a library").unwrap();
    for (version, folder) in [("2", "linux64"), ("3", "x86_64-linux")] {
        let name = format!("paper-{version}.fmu");
        let asked = ["export", "paper", "-o", &name, "--fmi", version, "--library", "library.so", "--step", "5 ms"];
        bench.hil(&asked).success().stderr(contains("linux64 only"));
        let mut zip = zip::ZipArchive::new(std::fs::File::open(bench.at(&name)).unwrap()).unwrap();
        let mut held = |name: &str| {
            let mut bytes = Vec::new();
            zip.by_name(name).unwrap().read_to_end(&mut bytes).unwrap();
            bytes
        };
        assert_eq!(held(&format!("binaries/{folder}/hil_valve.so")), b"the bytes of a library");
        let valve = hil::valve::Valve::from_toml(&String::from_utf8(held("resources/valve.toml")).unwrap(), "inside").unwrap();
        assert_eq!(valve.name, "paper");
        let description = String::from_utf8(held("modelDescription.xml")).unwrap();
        assert!(description.contains(&format!("fmiVersion=\"{version}.0\"")) && description.contains("stepSize=\"0.005\""));
        // What the program writes, its own reader of foreign FMUs understands.
        let fmu = hil::exchange::foreign::ForeignFmu::read(&bench.at(&name)).unwrap();
        let ports = fmu.description.ports(None, None).unwrap();
        assert_eq!((ports.current.name.as_str(), ports.pressure.name.as_str()), ("current", "pressure"));
        assert_eq!(fmu.description.step_s, Some(0.005));
    }
    bench.hil(&["export", "paper", "-o", "x.fmu", "--library", "library.so", "--step", "0 s"]).code(3).stderr(contains("10 us to 1 s"));
    bench.hil(&["export", "paper", "-o", "x.fmu", "--library", "none.so"]).code(2).stderr(contains("none.so"));
    assert!(!bench.at("x.fmu").exists());
}

#[test]
fn an_unknown_ending_and_an_unknown_model_are_refused() {
    let bench = Bench::new();
    bench.hil(&["export", "paper", "-o", "paper.xyz"]).code(2).stderr(contains(".fmu, .json or .dfq"));
    bench.hil(&["export", "papper", "-o", "paper.json"]).code(3);
    bench.hil(&["export", "paper", "-o", "lot.dfq"]).failure();
    assert_eq!(std::fs::read_dir(bench.0.path()).unwrap().count(), 0);
}

#[cfg(all(unix, feature = "fmi"))]
#[test]
fn effects_about_a_foreign_model_are_exported_side_by_side() {
    let bench = Bench::new();
    std::fs::write(bench.at("library.so"), b"the bytes of a library").unwrap();
    let text = r#"schema = "hil.attached/1"
name = "plant+reversal_dead_band+sensor_lag"
current_range = ["0.2 A", "0.8 A"]
[base]
fmu = "plant.fmu"
[recalibration]
gain = 1.0
zero = "0 bar"
delay = "0 s"
[[effect]]
reversal_dead_band = { width = "15 mA" }
[[effect]]
sensor_lag = { tau = "30 ms" }
"#;
    std::fs::write(bench.at("found.toml"), text).unwrap();
    let export = |name: &str, more: &[&str]| bench.hil(&[&["export", "found.toml", "-o", name, "--library", "library.so"], more].concat());
    export("both.fmu", &[]).code(2).stderr(contains("--side"));
    let description = |name: &str| {
        let mut zip = zip::ZipArchive::new(std::fs::File::open(bench.at(name)).unwrap()).unwrap();
        let mut text = String::new();
        zip.by_name("modelDescription.xml").unwrap().read_to_string(&mut text).unwrap();
        text
    };
    export("ahead.fmu", &["--side", "ahead"]).success();
    let ahead = description("ahead.fmu");
    assert!(ahead.contains("current_out") && ahead.contains("reversal_dead_band.width") && !ahead.contains("sensor_lag.tau"), "{ahead}");
    export("behind.fmu", &["--side", "behind"]).success();
    let behind = description("behind.fmu");
    assert!(
        behind.contains("pressure_in") && behind.contains("sensor_lag.tau") && !behind.contains("reversal_dead_band.width"),
        "{behind}"
    );
    std::fs::write(bench.at("found.toml"), text.replace("[[effect]]\nreversal_dead_band = { width = \"15 mA\" }\n", "")).unwrap();
    export("one.fmu", &[]).success();
    assert!(description("one.fmu").contains("pressure_in"));
    export("none.fmu", &["--side", "ahead"]).code(3).stderr(contains("no effect ahead"));
}

/// The values of the file against those of the journal, valve by valve.
#[cfg(unix)]
#[test]
fn a_lot_as_aqdef_holds_the_values_of_its_journal() {
    let bench = Bench::new();
    bench.hil(&["init", ".", "--example", "bench"]).success();
    bench.hil(&["batch", "tipin", "--count", "3", "--sim", "--seed", "4", "--out", "lot"]).success();
    bench.hil(&["export", "lot", "-o", "lot.dfq"]).success().stderr(contains("3 valves"));
    let file = bench.text("lot.dfq");
    let keyed = |key: &str| -> Vec<String> {
        file.lines().filter_map(|l| l.strip_prefix(key)).map(|l| l.split_once(' ').map_or(l, |p| p.1).trim().to_string()).collect()
    };
    let mut journal = Vec::new();
    for entry in std::fs::read_dir(bench.at("lot/journal")).unwrap() {
        let text = std::fs::read_to_string(entry.unwrap().path()).unwrap();
        for line in text.lines().filter(|l| l.contains("\"finished\"")) {
            let entry: Value = serde_json::from_str(&line[line.find('{').unwrap()..=line.rfind('}').unwrap()]).unwrap();
            journal.push(entry["record"].clone());
        }
    }
    assert_eq!(journal.len(), 3);
    let mut want: Vec<(String, f64)> = Vec::new();
    for record in &journal {
        for phase in record["phases"].as_array().unwrap() {
            for m in phase["measurements"].as_array().unwrap() {
                let value = m["value"].as_f64();
                want.extend(value.map(|v| (format!("{} {}", phase["name"].as_str().unwrap(), m["metric"].as_str().unwrap()), v)));
            }
        }
    }
    let (names, values) = (keyed("K2002/"), keyed("K0001/"));
    let attributes = keyed("K0002/");
    assert_eq!(names.len() * 3, values.len());
    assert_eq!(attributes.iter().filter(|a| *a == "0").count(), want.len(), "absent values carry another attribute");
    for (name, value) in &want {
        assert!(values.iter().any(|v| v.parse::<f64>().is_ok_and(|v| v == *value)), "{name} = {value} is not in the file");
    }
    let serials: std::collections::BTreeSet<String> = keyed("K0014/").into_iter().collect();
    assert_eq!(serials.len(), 3, "{serials:?}");
}
