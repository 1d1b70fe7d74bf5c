//! `hil-fuzz seeds TARGET FOLDER` writes inputs to begin with, `hil-fuzz list` names the targets, `hil-fuzz run TARGET` reads what
//! AFL++ gives it.

#[path = "../../it/fuzz/targets.rs"]
mod targets;

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let find = |name: &str| targets::TARGETS.iter().find(|t| t.name == name).expect("a target of `hil-fuzz list`");
    match words[..] {
        ["list"] => targets::TARGETS.iter().for_each(|t| println!("{}", t.name)),
        ["seeds", name, folder] => {
            std::fs::create_dir_all(folder).expect("a folder");
            for (k, seed) in (find(name).seeds)().iter().enumerate() {
                std::fs::write(format!("{folder}/{k}"), seed).expect("a file in it");
            }
        }
        ["run", name] => {
            let read = find(name).read;
            afl::fuzz!(|data: &[u8]| {
                let _ = read(data);
            });
        }
        _ => panic!("list | seeds TARGET FOLDER | run TARGET"),
    }
}
