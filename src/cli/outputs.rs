//! Output files of a command. They are checked before it starts, so that no input is overwritten and a wrong name does not cost
//! an hour.

use anyhow::{Result, bail};
use cardioid::image_io;
use cardioid::scene_file::{SceneDescription, files_of_scene};
use std::path::{Path, PathBuf};

/// Who chose the name of an output file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Named {
    /// The user: an existing file is replaced.
    ByUser,
    /// This program: an existing file is replaced only where it carries the mark of this program.
    ByUs,
}

struct Output {
    path: PathBuf,
    /// Description for messages: "the PNG beside it".
    what: &'static str,
}

/// The files that a command writes, and the files that it reads.
pub(crate) struct Outputs {
    outputs: Vec<Output>,
    inputs: Vec<PathBuf>,
    /// Whether files of other programs may be replaced under names that this program chose.
    overwrite: bool,
}

impl Outputs {
    /// The outputs of a command that reads `inputs`.
    pub(crate) fn new<'a>(inputs: impl IntoIterator<Item = &'a Path>) -> Self {
        let inputs = inputs.into_iter().map(Path::to_path_buf).collect();
        Self { outputs: Vec::new(), inputs, overwrite: false }
    }

    /// Sets whether a file under a name that this program chose is replaced, whichever program wrote it.
    pub(crate) fn overwriting(self, overwrite: bool) -> Self {
        Self { overwrite, ..self }
    }

    /// Adds another input, which the outputs added so far may replace.
    pub(crate) fn also_reads(&mut self, path: Option<&Path>) {
        self.inputs.extend(path.map(Path::to_path_buf));
    }

    /// Adds an output file. It must be writable, and it must not be an input or another output.
    pub(crate) fn add(&mut self, path: &Path, what: &'static str, named: Named) -> Result<()> {
        image_io::check_writable(path)?;
        let shown = path.display();
        if let Some(other) = self.outputs.iter().find(|other| image_io::is_same_file(path, &other.path)) {
            bail!(
                "{what} {shown} would overwrite {} {}, which is written as well; give one of them another name",
                other.what,
                other.path.display()
            );
        }
        let added = Output { path: path.to_path_buf(), what };
        self.inputs.iter().try_for_each(|input| refuse_input(&added, input))?;
        if named == Named::ByUs && !self.overwrite && path.exists() && !image_io::is_written_by_cardioid(path)
        {
            bail!(
                "{shown} is there already and was not written by cardioid: {what} would overwrite it; choose another name with \
                 -o, or, where the scene does not read it, replace it with --overwrite"
            );
        }
        self.outputs.push(added);
        Ok(())
    }

    /// Adds a text output, which goes to standard output where the name is `-`.
    pub(crate) fn add_text(&mut self, path: &Path, what: &'static str, named: Named) -> Result<()> {
        if image_io::is_standard_output(path) { Ok(()) } else { self.add(path, what, named) }
    }

    /// Checks that no output is a file that the scene is read from.
    pub(crate) fn check_scene(&self, scene: &SceneDescription) -> Result<()> {
        let files = files_of_scene(scene);
        self.outputs
            .iter()
            .try_for_each(|output| files.iter().try_for_each(|file| refuse_input(output, file)))
    }
}

/// Refuses an output that would overwrite `input`.
fn refuse_input(Output { path, what }: &Output, input: &Path) -> Result<()> {
    if image_io::is_same_file(path, input) {
        bail!(
            "{what} {} would overwrite {}, which is read; choose another name for it",
            path.display(),
            input.display()
        );
    }
    Ok(())
}
