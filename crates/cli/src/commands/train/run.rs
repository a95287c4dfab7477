//! `train`: one stage, or all of them.

use std::{fs, path::Path};

use radarllm_train::recipe::{Preset, Recipe, RecipeStage};

use radarllm_files::bounded::{self as files, MAX_CONFIG_BYTES};

use super::{Stage, TrainArgs};
use crate::{
    error::{CliError, CliResult, processor_error},
    interrupt,
    memory::peak_memory_mb,
    output,
    threads::on_threads,
};

/// Runs the command.
pub(crate) fn run(args: &TrainArgs) -> CliResult {
    let Some(path) = &args.config else {
        let preset = args.preset.map(preset).unwrap_or_default();
        output::print_line(&Recipe::of(preset).to_toml()?);
        return Ok(());
    };
    let text = files::read_text(path, MAX_CONFIG_BYTES)?;
    let base = path.parent().unwrap_or(Path::new(""));
    let mut recipe = Recipe::from_toml_with(&text, base, args.preset.map(preset)).map_err(|e| {
        CliError::new(format!("{}: {e}", path.display()))
            .hint("`radarllm train all --print-config` prints every key")
    })?;
    if let Some(name) = &args.device {
        recipe.device = name
            .parse()
            .map_err(|e| CliError::new(format!("--device: {e}")))?;
    }
    if args.print_config {
        output::print_line(&recipe.to_toml()?);
        return Ok(());
    }
    // Devices are checked before any file is removed or written.
    let devices = recipe.device.devices();
    devices.map_err(|e| processor_error("device ", &e))?;
    recipe.stop = interrupt::stop_on_ctrl_c()?;
    let stages = match args.stage {
        Stage::Motion => vec![RecipeStage::Motion],
        Stage::Tokenizer => vec![RecipeStage::Tokenizer],
        Stage::Pretrain => vec![RecipeStage::Pretrain],
        Stage::Instruct => vec![RecipeStage::Instruct],
        Stage::Points => vec![RecipeStage::Points],
        Stage::Evidence => vec![RecipeStage::Evidence],
        Stage::Pose => vec![RecipeStage::Pose],
        Stage::All => recipe.stages(),
    };
    if stages.len() > 1 {
        recipe.check_data(&stages)?;
    }
    for stage in stages {
        let folder = recipe.out.join(stage.name());
        if folder.exists() && !args.resume {
            if !args.force {
                return Err(
                    CliError::new(format!("{} exists already", folder.display()))
                        .hint("--resume continues it, --force starts over"),
                );
            }
            fs::remove_dir_all(&folder).map_err(|e| CliError::io(&folder, e))?;
        }
        if !on_threads(args.threads, || recipe.run(stage, args.resume))?? {
            output::print_line(&format!(
                "stage {} stopped early; --resume continues it",
                stage.name()
            ));
            interrupt::exit();
        }
    }
    if let Some(mb) = peak_memory_mb() {
        note!("peak memory {mb:.0} MB");
    }
    output::print_line(&recipe.out.display().to_string());
    Ok(())
}

/// The preset of the library.
fn preset(name: super::Preset) -> Preset {
    match name {
        super::Preset::Small => Preset::Small,
        super::Preset::Paper => Preset::Paper,
    }
}
