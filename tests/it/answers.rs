//! What a person may type or own by mistake, over all commands, each with the answer that it gets. None panics, none writes anything; the
//! answers are kept, so that a change of one is seen and read.

use std::path::Path;

use assert_cmd::Command;

/// Command lines; an underscore stands for a space within an argument, where it is no part of a name.
const MISTAKES: &[&str] = &[
    "",
    "rnu tipin --sim",
    "run",
    "run tipin",
    "run tipin --sim --driver emulator",
    "run tippin --sim",
    "run plans/tipin.toml --sim",
    "run valve.toml --sim",
    "run sweep.csv --sim",
    "run folder --sim",
    "run empty.toml --sim",
    "run binary.toml --sim",
    "run tipin --sim --valve papper",
    "run tipin --sim --valve sweep.csv",
    "run tipin --sim --set high",
    "run tipin --sim --set hihg=20_bar",
    "run tipin --sim --set high=20_s",
    "run tipin --sim --set high=20",
    "run tipin --sim --seed minus",
    "run tipin --sim --limits valve.toml",
    "run tipin --sim --out valve.toml",
    "run tipin --driver emulatr --port /dev/null",
    "run tipin --driver emulator",
    "run tipin --driver emulator --port /dev/null",
    "run tipin --driver emulator-tcp --tcp 127.0.0.1:9",
    "run tipin --driver emulator-tcp --tcp nowhere",
    "run tipin --sim --answers sweep.csv",
    "run tipin --sim --limits population",
    "check",
    "check nothing.toml",
    "check Cargo.toml",
    "check noschema.toml",
    "check wrongschema.toml",
    "check sweep.csv",
    "check folder",
    "check tippin",
    "identify nothing.csv",
    "identify valve.toml",
    "identify folder",
    "identify empty.csv",
    "identify foreign.csv",
    "identify constant.csv",
    "identify sweep.csv -o sweep.csv",
    "identify sweep.csv --map pressure=p",
    "identify sweep.csv --map pressure_bar=p_[kg]",
    "identify sweep.csv --mapping valve.toml",
    "identify sweep.csv --run a",
    "identify sweep.csv --from 99",
    "identify sweep.csv --from 5 --to 3",
    "identify sweep.csv --encoding morse",
    "identify sweep.csv --header-row 0",
    "identify sweep.csv --hysteresis wide",
    "identify sweep.csv sweep.csv",
    "inspect",
    "inspect nothing.csv",
    "inspect valve.toml",
    "inspect folder",
    "inspect sweep.csv -o sweep.csv",
    "inspect sweep.csv --encoding ascii",
    "simulate sweep.csv",
    "simulate sweep.csv --model nothing",
    "simulate sweep.csv --model noschema.toml",
    "simulate sweep.csv --model paper -o out.xlsx",
    "simulate sweep.csv --model paper -o nowhere/out.csv",
    "simulate sweep.csv --model paper -o sweep.csv",
    "simulate sweep.csv --model paper --input curved",
    "diagnose sweep.csv",
    "diagnose sweep.csv --model paper --without spring",
    "diagnose sweep.csv --model paper --report sweep.csv",
    "diagnose sweep.csv --model paper -o report.html --report report.html",
    "diagnose sweep.csv --model sweep.csv",
    "diagnose sweep.csv --model nothing.fmu",
    "diagnose sweep.csv --simulated nothing",
    "diagnose sweep.csv --simulated constant.csv",
    "diagnose sweep.csv --model paper --reference nothing.csv",
    "diagnose sweep.csv --model paper --fail-on match",
    "diagnose --jobs sweep.csv --out jobs",
    "diagnose --jobs nothing.csv --out jobs",
    "diagnose --jobs sweep.csv",
    "diagnose sweep.csv --model paper --shard 1/2",
    "diagnose --jobs sweep.csv --out jobs --shard 3/2",
    "diagnose",
    "diagnose sweep.csv sweep.csv --model paper",
    "diagnose sweep.csv --model paper --simulated pressure_bar",
    "collect",
    "collect nowhere -o fleet.parquet",
    "collect folder -o fleet.parquet",
    "collect folder -o fleet.txt",
    "collect folder -o sweep.csv",
    "margins",
    "margins --gain 0.04 --lag 0.01 --delay 0.04 --kp -1 --ki 5",
    "margins --model paper --kp 1_bar --ki 5",
    "margins --model paper --kp 1 --ki 5 --delay-range 5",
    "margins --model paper --kp 1 --ki 5 --rate 0",
    "margins --model paper --gain 0.04 --kp 1 --ki 5",
    "margins --gain 0.04 --kp 1 --ki 5",
    "tune",
    "tune --model paper --max-sensitivity 0.5",
    "tune --model paper --rule ziegler",
    "tune --model nothing",
    "batch tipin --sim",
    "batch tipin --count 3",
    "batch tipin --count 0 --sim",
    "batch tipin --sim --duts sweep.csv",
    "batch tipin --sim --duts nothing.csv",
    "batch tipin --count 3 --sim --out folder --resume --retest --population valve.toml",
    "batch tipin --count 3 --sim --population nowhere",
    "master tipin --station valve.toml --serial GOOD",
    "master tipin --sim",
    "master tipin --sim --station emulated --serial GOOD",
    "msa sweep.csv",
    "msa tipin --sim --metric nonsense",
    "msa tipin --sim",
    "msa tipin --sim --metric tip-in/rmse --trials many",
    "history nowhere",
    "history --outcome BAD",
    "history --since yesterday",
    "station",
    "station nothing",
    "station valve.toml",
    "station emulated --listen nowhere",
    "station emulated --token-file nothing",
    "diff valve.toml valve.toml",
    "diff folder folder",
    "diff folder",
    "report folder",
    "report sweep.csv",
    "report nothing",
    "report folder --format pdf",
    "compare sweep.csv",
    "compare sweep.csv nothing",
    "compare sweep.csv folder",
    "compare nothing paper",
    "accept folder",
    "accept nothing",
    "accept sweep.csv",
    "challenge --count 0",
    "challenge --fleet 0 --out fleet",
    "challenge --fleet 3",
    "export",
    "export nothing -o valve.fmu",
    "export paper -o valve.toml",
    "export paper -o valve.zip",
    "export folder -o lot.dfq",
    "export paper -o lot.dfq",
    "export paper -o valve.fmu --fmi 4",
    "export paper -o valve.fmu --step 10_bar",
    "export folder -o valve.json",
    "emulate --valve paper --driver emulator",
    "emulate --valve paper --driver emulator --pty folder",
    "emulate --valve paper --driver emulator-tcp --tcp nowhere",
    "emulate --valve paper --driver emulator-tcp --tcp 127.0.0.1:0 --fault valve.toml",
    "emulate --valve paper --driver emulator --pty a --tcp 127.0.0.1:0",
    "emulate --valve papper --driver emulator --pty",
    "probe --driver emulator",
    "probe --driver emulator --port /dev/null",
    "probe --driver emulator --port nothing --tcp 127.0.0.1:9",
    "probe --driver nothing --tcp 127.0.0.1:9",
    "explain setling_time",
    "schema spoon",
    "schema",
    "init folder/file",
    "init folder --example rocket",
    "init folder --example",
    "man folder/file",
    "completions csh",
    "completions",
    "paper sweep.csv",
];

/// Names that keep their underscores.
const NAMES: [&str; 4] = ["time_s", "pressure_bar", "current_a", "setling_time"];

/// Files that lie in the folder, so that none of the sixty is refused for want of them.
fn lay(folder: &Path) {
    let put = |name: &str, bytes: &[u8]| std::fs::write(folder.join(name), bytes).unwrap();
    let rows: String = (0..3000)
        .map(|n| {
            let t = f64::from(n) * 0.01;
            let current = 0.5 - 0.4 * (0.5 * t).cos();
            format!("{t:.2},{current:.4},{:.3}\n", 40.0 * current - 2.0)
        })
        .collect();
    put("sweep.csv", format!("time_s,current_a,pressure_bar\n{rows}").as_bytes());
    put(
        "constant.csv",
        "time_s,current_a,pressure_bar\n"
            .to_string()
            .as_bytes()
            .iter()
            .chain((0..500).map(|n| format!("{},0.5,12\n", f64::from(n) * 0.01)).collect::<String>().as_bytes())
            .copied()
            .collect::<Vec<u8>>()
            .as_slice(),
    );
    put("foreign.csv", b"t [ms];I [mA];P [psi]\n0;100;10\n10;110;11\n20;120;12\n");
    put("empty.csv", b"");
    put("empty.toml", b"");
    put("binary.toml", &[0xff, 0xfe, 0x00, 0x01]);
    put("noschema.toml", b"name = \"x\"\n");
    put("wrongschema.toml", b"schema = \"hil.plann/1\"\n");
    put("Cargo.toml", b"[package]\nname = \"x\"\n");
    put("valve.toml", &std::fs::read("valves/paper.toml").unwrap());
    std::fs::create_dir(folder.join("folder")).unwrap();
    put("folder/file", b"in the way");
}

/// Every path below a folder with its bytes.
fn all(folder: &Path) -> Vec<(std::path::PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    let mut open = vec![folder.to_path_buf()];
    while let Some(folder) = open.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() { open.push(path) } else { found.push((path.clone(), std::fs::read(&path).unwrap())) }
        }
    }
    found.sort();
    found
}

#[test]
fn every_mistake_has_its_answer_and_nothing_is_lost() {
    const { assert!(MISTAKES.len() >= 60) };
    let folder = tempfile::tempdir().unwrap();
    lay(folder.path());
    let before = all(folder.path());
    let (mut answers, mut wrong) = (String::new(), Vec::new());
    for line in MISTAKES {
        let arguments = line.split_whitespace().map(|a| {
            let spaced = if a.contains('.') && !a.contains('[') { a.to_string() } else { a.replace('_', " ") };
            NAMES.iter().fold(spaced, |a, name| a.replace(&name.replace('_', " "), name))
        });
        let output = Command::new(env!("CARGO_BIN_EXE_hil")).current_dir(folder.path()).args(arguments).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        let rust = ["panicked", "src/", "unwrap", "Err(", "Some(", "f64", "usize", "os error", "..="].iter().find(|w| said.contains(**w));
        if output.status.success() || output.status.code() == Some(70) || said.is_empty() || rust.is_some() || !output.stdout.is_empty() {
            wrong.push(format!("hil {line}: {:?}, {rust:?}:\n{said}", output.status.code()));
        }
        answers += &format!("$ hil {line}\n{}exit {}\n\n", said, output.status.code().unwrap_or(-1));
    }
    assert!(wrong.is_empty(), "{} of {}:\n{}", wrong.len(), MISTAKES.len(), wrong.join("\n"));
    assert!(all(folder.path()) == before, "something was written, changed or lost");
    // Every command is asked something wrong.
    let help = Command::new(env!("CARGO_BIN_EXE_hil")).arg("--help").output().unwrap();
    let help = String::from_utf8(help.stdout).unwrap();
    let commands = help.lines().skip_while(|l| *l != "Commands:").skip(1).take_while(|l| !l.is_empty());
    let names = commands.filter_map(|l| l.strip_prefix("  ")?.split(' ').next().filter(|c| !c.is_empty() && *c != "help"));
    let forgotten: Vec<&str> = names.filter(|name| !MISTAKES.iter().any(|line| line.split(' ').next() == Some(name))).collect();
    assert!(forgotten.is_empty(), "{forgotten:?}");
    insta::assert_snapshot!(answers);
}
