//! A picture in memory.

/// A picture of one or more layers of the same size, with metadata.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// The larger picture that this one is a window of; `None` where it is whole.
    pub window: Option<Window>,
    /// The layers, in order of writing. A file that was read has them in the order of their names.
    pub layers: Vec<Layer>,
    /// Names and values of the metadata.
    pub metadata: Vec<(String, MetadataValue)>,
    /// Messages about oddities of a file that was read.
    pub findings: Vec<String>,
}

/// Position of a picture within a larger one, such as that of a rendered crop window. Viewers show the picture at this position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// Column of the larger picture at which this one starts.
    pub x: i64,
    /// Row of the larger picture at which this one starts.
    pub y: i64,
    /// Pixels in a row of the larger picture.
    pub full_width: u32,
    /// Rows of the larger picture.
    pub full_height: u32,
}

impl Image {
    /// A picture without layers or metadata.
    #[must_use]
    pub const fn new(width: u32, height: u32) -> Self {
        Self { width, height, window: None, layers: Vec::new(), metadata: Vec::new(), findings: Vec::new() }
    }

    /// The layer with this name; the main layer has the empty name.
    #[must_use]
    pub fn layer(&self, name: &str) -> Option<&Layer> {
        self.layers.iter().find(|layer| layer.name == name)
    }

    /// The metadata value with this name.
    #[must_use]
    pub fn metadata(&self, name: &str) -> Option<&MetadataValue> {
        self.metadata.iter().find(|(key, _)| key == name).map(|(_, value)| value)
    }

    /// Number of pixels.
    #[must_use]
    pub const fn pixel_count(&self) -> usize {
        self.width as usize * self.height as usize
    }
}

/// A layer: channels of a picture that belong together.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// Its name, empty for the main layer. In a file its channels are named `name.channel`.
    pub name: String,
    /// Names of the channels: `R`, `G`, `B` for a colour, `X`, `Y`, `Z` for a vector, `Z` for a depth. They contain no dot.
    pub channels: Vec<String>,
    /// Values row by row from the top, from left to right, with interleaved channels: channel `c` at column `x` of row
    /// `y` is `data[(y * width + x) * channels.len() + c]`.
    pub data: Vec<f32>,
}

impl Layer {
    /// A layer with these channels.
    #[must_use]
    pub fn new(name: impl Into<String>, channels: &[&str], data: Vec<f32>) -> Self {
        Self {
            name: name.into(),
            channels: channels.iter().map(|&channel| channel.to_owned()).collect(),
            data,
        }
    }

    /// The channels of a pixel, counted row by row from the top; `None` where there is no such pixel.
    #[must_use]
    pub fn pixel(&self, index: usize) -> Option<&[f32]> {
        let count = self.channels.len();
        self.data.get(index.checked_mul(count)?..)?.get(..count)
    }

    /// Index of the channel with this name in a pixel.
    #[must_use]
    pub fn channel_index(&self, channel: &str) -> Option<usize> {
        self.channels.iter().position(|name| name == channel)
    }
}

/// A metadata value of a file.
#[derive(Clone, Debug, PartialEq)]
pub enum MetadataValue {
    /// Text, in any language. Values of other types are read as text too.
    Text(String),
    /// A 32-bit integer, the largest integer type of EXR. Counts that may exceed it are better stored as `Double`.
    Int(i32),
    /// A floating-point number; integers below 2^53 are exact.
    Double(f64),
}

impl From<&str> for MetadataValue {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl From<String> for MetadataValue {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

impl From<i32> for MetadataValue {
    fn from(number: i32) -> Self {
        Self::Int(number)
    }
}

impl From<f32> for MetadataValue {
    fn from(number: f32) -> Self {
        Self::Double(f64::from(number))
    }
}

impl From<f64> for MetadataValue {
    fn from(number: f64) -> Self {
        Self::Double(number)
    }
}
