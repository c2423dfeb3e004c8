//! The subcommands, one file each; the only users of clap and anyhow.

pub(crate) mod compare;
