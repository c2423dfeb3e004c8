//! What a command writes: checked before it starts, so that no file is lost that it reads, and no hour to a wrong name.

use anyhow::{Result, bail};
use cardioid::image_io;
use cardioid::scene_file::{SceneDescription, files_of_scene};
use std::path::{Path, PathBuf};

/// Who chose the name of a file that is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Named {
    /// The user: what is there is replaced.
    ByUser,
    /// This program: what is there is replaced where it bears the mark of this program.
    ByUs,
}

struct Output {
    path: PathBuf,
    /// What it is, for messages: "the PNG beside it".
    what: &'static str,
}

/// The files that a command writes and those that it was given to read.
pub(crate) struct Outputs {
    outputs: Vec<Output>,
    inputs: Vec<PathBuf>,
    /// Whether names of our own may be taken from files of others.
    overwrite: bool,
}

impl Outputs {
    /// Of a command that was given these files to read.
    pub(crate) fn new<'a>(inputs: impl IntoIterator<Item = &'a Path>) -> Self {
        let inputs = inputs.into_iter().map(Path::to_path_buf).collect();
        Self { outputs: Vec::new(), inputs, overwrite: false }
    }

    /// Whether a file at a name that this program chose is replaced whoever wrote it.
    pub(crate) fn overwriting(self, overwrite: bool) -> Self {
        Self { overwrite, ..self }
    }

    /// One more file that is read, which those added before may replace.
    pub(crate) fn also_reads(&mut self, path: Option<&Path>) {
        self.inputs.extend(path.map(Path::to_path_buf));
    }

    /// A file that will be written. It can be written, it is none of those that are read, nor another that is written.
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

    /// A text that will be written; to standard output where the name is `-`.
    pub(crate) fn add_text(&mut self, path: &Path, what: &'static str, named: Named) -> Result<()> {
        if image_io::is_standard_output(path) { Ok(()) } else { self.add(path, what, named) }
    }

    /// None of the files that are written is one that the scene is read from.
    pub(crate) fn check_scene(&self, scene: &SceneDescription) -> Result<()> {
        let files = files_of_scene(scene);
        self.outputs
            .iter()
            .try_for_each(|output| files.iter().try_for_each(|file| refuse_input(output, file)))
    }
}

/// Refuses to write where `input` is.
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
