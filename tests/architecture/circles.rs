//! Which file uses which, so that no files form a circle.
//!
//! A name that a module only passes on counts where it is defined: who takes a sibling's type from the parent uses the
//! sibling. A parent that re-exports its children does not use them; one that calls them does.

use std::collections::{BTreeMap, BTreeSet};

type Path = Vec<String>;

/// One file of the source.
pub struct File {
    /// Its module, from the crate's root.
    module: Path,
    /// What its `use` lines name, with whether they only pass it on, the name they give it, and where it stands.
    imports: Vec<Import>,
    /// The other paths in its code.
    paths: Vec<Path>,
}

struct Import {
    passed_on: bool,
    name: String,
    target: Path,
}

/// The module of a file below `src/`.
fn module(file: &str) -> Path {
    let path = file.trim_start_matches("src/").trim_end_matches(".rs").trim_end_matches("/mod");
    if path == "lib" { Vec::new() } else { path.split('/').map(str::to_string).collect() }
}

fn is_name(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// The `use` lines of `code` with whether they are public, and the code without them.
fn take_uses(code: &str) -> (Vec<(bool, String)>, String) {
    let (mut uses, mut rest) = (Vec::new(), String::new());
    let mut left = code;
    while let Some(at) = left.find("use ") {
        let (before, after) = left.split_at(at);
        let starts_line = before.rsplit('\n').next().unwrap_or_default().trim();
        let Some(end) = after.find(';').filter(|_| starts_line.is_empty() || starts_line.starts_with("pub")) else {
            rest.push_str(before);
            rest.push_str("use ");
            left = &after[4..];
            continue;
        };
        rest.push_str(before);
        uses.push((starts_line.starts_with("pub"), after[4..end].split_whitespace().collect::<Vec<_>>().join(" ")));
        left = &after[end..];
    }
    rest.push_str(left);
    (uses, rest)
}

/// The paths of a `use` tree, groups taken apart.
fn taken_apart(tree: &str) -> Vec<String> {
    let Some(open) = tree.find('{') else { return vec![tree.trim().to_string()] };
    let (prefix, mut depth, mut part, mut out) = (&tree[..open], 0, String::new(), Vec::new());
    let mut finish = |part: &mut String| {
        let part = std::mem::take(part);
        if !part.trim().is_empty() {
            out.extend(taken_apart(&format!("{prefix}{}", part.trim())));
        }
    };
    for c in tree[open + 1..].chars() {
        match c {
            '}' if depth == 0 => break,
            ',' if depth == 0 => finish(&mut part),
            _ => {
                depth += i32::from(c == '{') - i32::from(c == '}');
                part.push(c);
            }
        }
    }
    finish(&mut part);
    out
}

/// Every `a::b::c` in `code`.
fn paths(code: &str) -> Vec<Path> {
    let mut out = Vec::new();
    let mut last_end = 0;
    for (at, _) in code.match_indices("::") {
        if at < last_end {
            continue;
        }
        let begin = code[..at].rfind(|c| !is_name(c)).map_or(0, |k| k + code[k..].chars().next().map_or(1, char::len_utf8));
        let path: String = code[begin..].chars().take_while(|c| is_name(*c) || *c == ':').collect();
        last_end = begin + path.len();
        if begin < at && !code[..begin].ends_with(['$', '.', ':']) {
            out.push(path.split("::").filter(|p| !p.is_empty()).map(|p| p.trim_matches(':').to_string()).collect());
        }
    }
    out
}

/// Where a path stands, seen from a module; nothing where it begins with neither `crate`, `self`, `super` nor a child.
fn absolute(from: &Path, path: &[String], modules: &BTreeSet<Path>) -> Option<Path> {
    let mut base = from.clone();
    let mut rest = path;
    match path.first()?.as_str() {
        "crate" => (base, rest) = (Vec::new(), &path[1..]),
        "self" => rest = &path[1..],
        "super" => {
            while rest.first().is_some_and(|p| p == "super") {
                base.pop()?;
                rest = &rest[1..];
            }
        }
        first => {
            base.push(first.to_string());
            if !modules.contains(&base) {
                return None;
            }
            rest = &path[1..];
        }
    }
    base.extend(rest.iter().cloned());
    Some(base)
}

/// The files with what they name; `code` holds their names below `src/` and their text without comments and tests.
pub fn read(code: &[(String, String)]) -> Vec<File> {
    let modules: BTreeSet<Path> = code.iter().map(|(file, _)| module(file)).collect();
    let read_one = |(file, text): &(String, String)| {
        let module = module(file);
        let (uses, rest) = take_uses(text);
        let mut imports = Vec::new();
        for (passed_on, tree) in uses {
            for one in taken_apart(&tree) {
                let (path, alias) = one.split_once(" as ").map_or((one.as_str(), None), |(p, a)| (p, Some(a)));
                let parts: Path = path.split("::").map(|p| p.trim().to_string()).collect();
                let parts: Path = if parts.last().is_some_and(|p| p == "self") { parts[..parts.len() - 1].to_vec() } else { parts };
                if let Some(target) = absolute(&module, &parts, &modules) {
                    let name = alias.map(str::to_string).or(parts.last().cloned()).unwrap_or_default();
                    imports.push(Import { passed_on, name, target });
                }
            }
        }
        let known = |first: &String| imports.iter().find(|i| i.name == *first).map(|i| i.target.clone());
        let paths = paths(&rest)
            .iter()
            .filter_map(|p| absolute(&module, p, &modules).or_else(|| known(p.first()?).map(|t| [t, p[1..].to_vec()].concat())))
            .collect();
        File { module, imports, paths }
    };
    code.iter().map(read_one).collect()
}

/// The file in which what stands at `path` is defined.
fn defined(path: &Path, files: &BTreeMap<&Path, &File>, depth: usize) -> Option<Path> {
    let length = (0..=path.len()).rev().find(|k| files.contains_key(&path[..*k].to_vec()))?;
    let (module, rest) = (path[..length].to_vec(), &path[length..]);
    let passed = rest.first().and_then(|name| files[&module].imports.iter().find(|i| i.name == *name && i.target != *path));
    match passed {
        Some(import) if depth < 8 => defined(&[import.target.clone(), rest[1..].to_vec()].concat(), files, depth + 1),
        _ => Some(module),
    }
}

/// The circles: sets of files each of which uses, through others, all others of its set.
pub fn circles(files: &[File]) -> Vec<Vec<String>> {
    let by_module: BTreeMap<&Path, &File> = files.iter().map(|f| (&f.module, f)).collect();
    let mut uses: BTreeMap<&Path, BTreeSet<&Path>> = BTreeMap::new();
    for file in files {
        let own_children = |target: &Path| target.starts_with(&file.module);
        let imports = file.imports.iter().filter_map(|i| defined(&i.target, &by_module, 0).filter(|t| !(i.passed_on && own_children(t))));
        let paths = file.paths.iter().filter_map(|p| defined(p, &by_module, 0));
        let found = imports.chain(paths).filter(|t| *t != file.module && !t.is_empty());
        let found: BTreeSet<&Path> = found.filter_map(|t| by_module.get_key_value(&t).map(|(k, _)| *k)).collect();
        uses.insert(&file.module, found);
    }
    // What nothing of the rest uses, or what uses nothing of the rest, stands in no circle; circles and the ways between them remain.
    loop {
        let left: BTreeSet<&Path> = uses.keys().copied().collect();
        let used: BTreeSet<&Path> = uses.values().flatten().copied().collect();
        let before = uses.len();
        uses.retain(|file, of| of.iter().any(|o| left.contains(o)) && used.contains(file));
        uses.values_mut().for_each(|of| of.retain(|o| left.contains(o)));
        if uses.len() == before {
            break;
        }
    }
    let reached = |from: &Path| {
        let (mut seen, mut open) = (BTreeSet::new(), vec![from.clone()]);
        while let Some(next) = open.pop() {
            for to in uses.get(&next).into_iter().flatten() {
                if seen.insert((*to).clone()) {
                    open.push((*to).clone());
                }
            }
        }
        seen
    };
    let reach: BTreeMap<Path, BTreeSet<Path>> = uses.keys().map(|f| ((*f).clone(), reached(f))).collect();
    let mut out = BTreeSet::new();
    for (file, all) in &reach {
        let circle: Vec<String> =
            all.iter().filter(|o| reach.get(*o).is_some_and(|back| back.contains(file))).map(|m| m.join("/")).collect();
        if circle.contains(&file.join("/")) {
            out.insert(circle);
        }
    }
    out.into_iter().collect()
}

#[test]
fn circles_are_found() {
    let of = |sources: &[(&str, &str)]| {
        let code: Vec<(String, String)> = sources.iter().map(|(f, t)| ((*f).to_string(), (*t).to_string())).collect();
        circles(&read(&code))
    };
    let parent = ("src/a/mod.rs", "mod b;\nmod c;\npub use b::{B, again as twice};\npub use c::C;");
    // The parent passes on what its children have, and they use one another one way.
    assert!(of(&[parent, ("src/a/b.rs", "use super::C;\npub struct B(C);"), ("src/a/c.rs", "pub struct C;")]).is_empty());
    // Through the parent's re-export, and through a path in the code.
    let round = of(&[parent, ("src/a/b.rs", "use super::C;\npub struct B(C);"), ("src/a/c.rs", "fn f() { super::twice::<u8>() }")]);
    assert_eq!(round, [["a/b", "a/c"]]);
    // A parent that calls a child that uses what the parent defines.
    let round = of(&[("src/a/mod.rs", "mod b;\npub struct A;\nfn f() { b::run() }"), ("src/a/b.rs", "use crate::a::{self, A};")]);
    assert_eq!(round, [["a", "a/b"]]);
    // Three files in a ring, with an import that is used by its name; what hangs on the ring is no part of it.
    let ring = [
        ("src/a/mod.rs", "mod b; mod c; mod d; mod e;"),
        ("src/a/b.rs", "use super::c;\nfn f() { c::g() }"),
        ("src/a/c.rs", "use super::{d::D, e};"),
        ("src/a/d.rs", "fn h() { crate::a::b::f() }"),
        ("src/a/e.rs", "pub struct E;"),
    ];
    assert_eq!(of(&ring), [["a/b", "a/c", "a/d"]]);
}
