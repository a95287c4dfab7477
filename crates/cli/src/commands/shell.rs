//! `completions` and `man`: shell completions and the manual page.

use clap::CommandFactory;

use crate::{args::Cli, error::CliResult, output};

/// Prints the completion script of a shell.
pub(crate) fn completions(shell: clap_complete::Shell) -> CliResult {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), "radarllm", &mut script);
    output::print_line(String::from_utf8_lossy(&script).trim_end());
    Ok(())
}

/// Prints the manual page: the command, then every verb.
pub(crate) fn manual() -> CliResult {
    let mut page = Vec::new();
    let mut command = Cli::command();
    command.build();
    clap_mangen::Man::new(command.clone()).render(&mut page)?;
    render_verbs(&command, &mut page)?;
    output::print_line(String::from_utf8_lossy(&page).trim_end());
    Ok(())
}

/// Renders description and options of every verb, recursively.
fn render_verbs(command: &clap::Command, page: &mut Vec<u8>) -> CliResult {
    let is_shown = |verb: &&clap::Command| verb.get_name() != "help" && !verb.is_hide_set();
    for verb in command.get_subcommands().filter(is_shown) {
        let name = verb.get_bin_name().unwrap_or_default().to_uppercase();
        page.extend(format!(".SH \"{name}\"\n").bytes());
        let section = clap_mangen::Man::new(verb.clone());
        section.render_description_section(page)?;
        section.render_options_section(page)?;
        render_verbs(verb, page)?;
    }
    Ok(())
}
