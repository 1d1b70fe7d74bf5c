//! Sixty things that a person may type or own by mistake, over all commands, each with the answer that it gets: the exit
//! code, and words that say what is wrong. None panics, none writes anything.

use std::path::Path;

use assert_cmd::Command;

/// Arguments, exit code, what the answer says.
const ANSWERS: &[(&str, i32, &str)] = &[
    ("", 2, "Usage"),
    ("rnu tipin --sim", 2, "unrecognized subcommand"),
    ("run", 2, "<PLAN>"),
    ("run tipin", 2, "--sim"),
    ("run tipin --sim --driver emulator", 2, "cannot be used with"),
    ("run tippin --sim", 3, "did you mean `tipin`"),
    ("run plans/tipin.toml --sim", 3, "`tipin` alone means"),
    ("run valve.toml --sim", 3, "a plan has"),
    ("run sweep.csv --sim", 3, "sweep.csv"),
    ("run folder --sim", 3, "is a directory"),
    ("run empty.toml --sim", 3, "is empty"),
    ("run binary.toml --sim", 3, "is not UTF-8"),
    ("run tipin --sim --valve papper", 3, "did you mean `paper`"),
    ("run tipin --sim --valve sweep.csv", 3, "sweep.csv"),
    ("run tipin --sim --set high", 2, "KEY=VALUE"),
    ("run tipin --sim --set hihg=20_bar", 3, "did you mean `high`"),
    ("run tipin --sim --set high=20_s", 3, "pressure"),
    ("run tipin --sim --set high=20", 3, "unit"),
    ("run tipin --sim --seed minus", 2, "invalid value"),
    ("run tipin --sim --limits valve.toml", 3, "a limits file has"),
    ("run tipin --sim --out valve.toml", 7, "valve.toml"),
    ("run tipin --driver emulatr --port /dev/null", 3, "did you mean `emulator`"),
    ("run tipin --driver emulator", 2, "where is it"),
    ("check", 2, "name the files"),
    ("check nothing.toml", 3, "nothing.toml"),
    ("check Cargo.toml", 3, "Cargo.toml"),
    ("check noschema.toml", 3, "schema"),
    ("check wrongschema.toml", 3, "did you mean"),
    ("identify nothing.csv", 3, "nothing.csv"),
    ("identify valve.toml", 3, "allowed: .csv"),
    ("identify folder", 3, "is a directory"),
    ("identify empty.csv", 3, "the file is empty"),
    ("identify foreign.csv", 3, "no `pressure_bar` (likely: `P [psi]`)"),
    ("identify constant.csv", 3, "constant"),
    ("identify sweep.csv -o sweep.csv", 2, "sweep.csv"),
    ("identify sweep.csv --map pressure=p", 2, "allowed: run, time_s"),
    ("identify sweep.csv --map pressure_bar=p_[kg]", 2, "is not one of a pressure"),
    ("identify sweep.csv --mapping valve.toml", 3, "a mapping file has"),
    ("identify sweep.csv --run a", 3, "one nameless run"),
    ("identify sweep.csv --from 99", 3, "the recording goes from"),
    ("identify sweep.csv --from 5 --to 3", 2, "does not lie before"),
    ("identify sweep.csv --encoding morse", 2, "latin-1"),
    ("identify sweep.csv --header-row 0", 2, "invalid value"),
    ("inspect nothing.csv", 3, "nothing.csv"),
    ("inspect valve.toml", 3, "allowed: .csv"),
    ("simulate sweep.csv", 2, "--model"),
    ("simulate sweep.csv --model nothing", 3, "there are: clutch-1"),
    ("simulate sweep.csv --model paper -o out.xlsx", 2, "allowed: .csv"),
    ("simulate sweep.csv --model paper -o nowhere/out.csv", 7, "nowhere"),
    ("diagnose sweep.csv --model paper --without spring", 2, "the model has: hysteresis, delay"),
    ("diagnose sweep.csv --model paper --report sweep.csv", 2, "sweep.csv"),
    ("margins --gain 0.04 --lag 0.01 --delay 0.04 --kp -1 --ki 5", 2, "K_P"),
    ("margins --model paper --kp 1_bar --ki 5", 2, "is not a proportional gain"),
    ("margins --model paper --kp 1 --ki 5 --delay-range 5", 2, "LOW..HIGH"),
    ("tune --model paper --max-sensitivity 0.5", 2, "more than 1"),
    ("batch tipin --sim", 2, "--duts"),
    ("batch tipin --count 3", 2, "--sim"),
    ("batch tipin --count 0 --sim", 3, "0"),
    ("batch tipin --sim --duts sweep.csv", 3, "sweep.csv"),
    ("batch tipin --count 3 --sim --out folder --resume --retest --population valve.toml", 3, "a population file has"),
    ("diff valve.toml valve.toml", 3, "is not a record"),
    ("diff folder folder", 3, "no record.json"),
    ("report folder", 3, "folder"),
    ("report sweep.csv", 3, "is not a record"),
    ("compare sweep.csv", 2, "2"),
    ("compare sweep.csv nothing", 3, "there are: clutch-1"),
    ("compare sweep.csv folder", 3, "is a folder without"),
    ("accept folder", 3, "folder"),
    ("explain setling_time", 2, "settling_time"),
    ("schema spoon", 2, "possible values"),
    ("emulate --valve paper --driver emulator", 2, "--pty"),
    ("probe --driver emulator", 2, "--port"),
    ("init folder/file", 7, "file"),
    ("completions csh", 2, "possible values"),
    ("history nowhere", 3, "nowhere"),
    ("msa sweep.csv", 3, "sweep.csv"),
    ("challenge --count 0", 2, "invalid value"),
];

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
fn sixty_mistakes_are_answered_and_nothing_is_lost() {
    const { assert!(ANSWERS.len() >= 60) };
    let folder = tempfile::tempdir().unwrap();
    lay(folder.path());
    let before = all(folder.path());
    let mut wrong = Vec::new();
    for (line, code, says) in ANSWERS {
        // An underscore stands for a space within an argument.
        let arguments =
            line.split_whitespace().map(|a| if a.contains("noschema") || a.contains('.') { a.to_string() } else { a.replace('_', " ") });
        let arguments = arguments.map(|a| {
            ["time s", "pressure bar", "current a", "setling time"].iter().fold(a, |a, with| a.replace(with, &with.replace(' ', "_")))
        });
        let output = Command::new(env!("CARGO_BIN_EXE_hil")).current_dir(folder.path()).args(arguments).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        let rust = ["panicked", "src/", "unwrap", "Err(", "Some(", "f64", "usize"].iter().find(|w| said.contains(**w));
        if output.status.code() != Some(*code) || !said.contains(says) || rust.is_some() || !output.stdout.is_empty() {
            wrong.push(format!("hil {line}: {:?} instead of {code}, `{says}` wanted, {rust:?}:\n{said}", output.status.code()));
        }
    }
    assert!(wrong.is_empty(), "{} of {}:\n{}", wrong.len(), ANSWERS.len(), wrong.join("\n"));
    assert!(all(folder.path()) == before, "something was written, changed or lost");
}
