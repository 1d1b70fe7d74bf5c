//! `hil man`: the man pages of all commands, and with them the completions.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::{Args, Command};

use super::{CliError, CliResult, exit};
use crate::recording::replace_file;

/// Where to.
#[derive(Debug, Args)]
pub struct ManArgs {
    /// Folder for the pages, `hil.1`, `hil-run.1` ..; without it, pages and completions go where the shell and `man` of this user look for them
    dir: Option<PathBuf>,
}

/// Writes the pages.
pub fn run(args: &ManArgs, mut program: Command) -> CliResult {
    let pages = pages(program.clone())?;
    match &args.dir {
        Some(dir) => {
            if dir.symlink_metadata().is_ok() && !dir.is_dir() {
                return Err(CliError::usage(format!("{}: is a file, and a folder is wanted", dir.display())));
            }
            for (name, page) in &pages {
                write(&dir.join(name), page)?;
            }
            super::say(&format!("wrote {} pages to {}", pages.len(), dir.display()));
        }
        None => {
            let share = share()?;
            for (name, page) in &pages {
                write(&share.join("man/man1").join(name), page)?;
            }
            use clap_complete::Shell::{Bash, Fish, Zsh};
            for (shell, place) in
                [(Bash, "bash-completion/completions/hil"), (Zsh, "zsh/site-functions/_hil"), (Fish, "fish/vendor_completions.d/hil.fish")]
            {
                let mut script = Vec::new();
                clap_complete::generate(shell, &mut program, "hil", &mut script);
                write(&share.join(place), &script)?;
            }
            super::say(&format!("wrote {} pages and the completions of bash, zsh and fish below {}", pages.len(), share.display()));
        }
    }
    Ok(exit::DONE)
}

/// The user's own data folder, as the XDG base directory specification has it.
fn share() -> Result<PathBuf, CliError> {
    let of = |key: &str| std::env::var_os(key).filter(|v| !v.is_empty()).map(PathBuf::from);
    of("XDG_DATA_HOME")
        .or_else(|| Some(of("HOME")?.join(".local/share")))
        .ok_or_else(|| CliError::usage("neither XDG_DATA_HOME nor HOME is set; name a folder"))
}

/// A page for the program and one for each command.
fn pages(mut program: Command) -> Result<Vec<(String, Vec<u8>)>, CliError> {
    program.build();
    let mut pages = vec![("hil.1".to_string(), page("hil", program.clone())?)];
    for command in program.get_subcommands().filter(|c| c.get_name() != "help") {
        let name = format!("hil-{}", command.get_name());
        pages.push((format!("{name}.1"), page(&name, command.clone())?));
    }
    Ok(pages)
}

fn page(title: &str, command: Command) -> Result<Vec<u8>, CliError> {
    let mut text = Vec::new();
    let rendered = clap_mangen::Man::new(command).title(title.to_uppercase()).render(&mut text);
    rendered.map_err(|e| CliError { code: exit::INTERNAL, message: e.to_string() })?;
    Ok(text)
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), CliError> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(|e| CliError::not_stored(format!("{}: {e}", folder.display())))?;
    }
    replace_file(path, |file| file.write_all(bytes)).map_err(CliError::not_stored)
}
